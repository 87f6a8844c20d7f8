"""Errors on what was held out: every kind of push predicted by what the other kinds say."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from arm_brachy.diagnosis.likelihood.observation import Observables
from arm_brachy.diagnosis.results.parts import StreamFit
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior, stacked


@dataclass(frozen=True)
class Part:
    """One recording for `stream_fits`, N rows.

    observables : Observables;  kinds : (N,) labels
    given : (N,) measured less the scene as it came, SI;  r : (N,) whitened, less the model
    U : (N, k) whitened nuisances;  own : (k,) those that other recordings do not share
    mesh : (k,) those of what a mesh may be wrong by;  set_up : (k,) those of what is set anew
        before each recording (`match.SET_UP`)
    of_mesh : (N,) whitened, what finer elements would add to the model; r and named are without
    named : (N,) r of the model with what was found, its numbers taken out to first order, and
    columns : (N, p) what these numbers do, at one prior standard deviation; None = nothing found
        that acts in this recording
    back : (N, g) what pads off their zeros, in this recording, do besides with what was found
    """

    observables: Observables
    kinds: np.ndarray
    given: np.ndarray
    r: np.ndarray
    U: np.ndarray
    own: np.ndarray
    mesh: np.ndarray
    set_up: np.ndarray
    of_mesh: np.ndarray
    named: np.ndarray | None = None
    columns: np.ndarray | None = None
    back: np.ndarray | None = None

    def beside_mesh(self):
        """The Part with what its mesh is known to be wrong by taken off all that is left."""
        named = None if self.named is None else self.named - self.of_mesh
        return replace(self, r=self.r - self.of_mesh, named=named,
                       of_mesh=np.zeros_like(self.of_mesh))


def which(parts, flags):
    """(k,) which columns of `stacked` have a flag;  flags : (k,) for each of the parts"""
    return np.concatenate([*(one[part.own] for one, part in zip(flags, parts, strict=True)),
                           flags[0][~parts[0].own]])


def stream_fits(parts, tested=()):
    """statements.StreamFit of every stream that Part recordings hold.

    tested : (name, Part) of recordings that were not fitted, on which all errors are then
        taken; () = every kind of push of the fitted ones in turn
    Nothing of what is predicted is known beforehand, nuisances included: what a pad that is
    pushed there alone has of its own is left in. So is what the mesh is wrong by, which no model
    that runs on it is without: it is allowed for when numbers are fitted, and predicts nothing.
    But how a recording that was not fitted was set up is no prediction: where the tracker stood,
    zeros and where pads touched are matched to all of it, within what a laboratory leaves open.
    """
    every = (*parts, *(part for _, part in tested))
    U, mesh = stacked(every), which(every, [part.mesh for part in every])
    set_up = which(every, [part.set_up & (i >= len(parts)) for i, part in enumerate(every)])
    kinds = np.concatenate([part.kinds for part in parts])
    folds = [kinds == kind for kind in np.unique(kinds)]
    if tested:
        folds = [np.repeat(np.arange(len(every)) >= len(parts), [len(p.r) for p in every])]
    asked, off = np.any(folds, axis=0), np.concatenate([part.of_mesh for part in every])
    errors = {'as_given': np.concatenate([part.given for part in every]),
              'recalibrated': _left(every, U, (mesh, set_up), np.concatenate(
                  [p.r for p in every]), off, folds),
              'noise_floor': np.concatenate([part.observables.sd for part in every])}
    if any(part.named is not None for part in every):
        named, columns = with_found(every)
        flags = (np.pad(one, (0, columns.shape[1])) for one in (mesh, set_up))
        errors['named'] = _left(every, np.hstack([U, columns]), flags, named, off, folds)
    streams = np.array([row.kind for part in every for row in part.observables.rows])
    held_out = ', '.join(name for name, _ in tested) or 'every kind of push in turn'
    return tuple(StreamFit(kind, **{name: _rms(values[asked & (streams == kind)])
                                    for name, values in errors.items()},
                           held_out=held_out)
                 for kind in dict.fromkeys(streams[asked].tolist()))


def with_found(parts):
    """(named (N,), columns (N, p)) of all parts: where nothing was found all is as without.

    Numbers of what was found are the same in all, zeros of pads are of single recordings.
    """
    width = max(part.columns.shape[1] for part in parts if part.named is not None)
    pairs = [(part.r, np.zeros((len(part.r), width))) if part.named is None else
             (part.named, part.columns) for part in parts]
    named, columns = (np.concatenate(some) for some in zip(*pairs, strict=True))
    back = block_diag(*(np.zeros((len(part.r), 0)) if part.back is None else part.back
                        for part in parts))
    return named, np.hstack([columns, back])


def chords(columns, z, effect):
    """Columns (N, p) at numbers z (p,) by which none of them leaves out their whole effect (N,).

    columns : (N, p) tangents at z. Of a place that other kinds of push say nothing of, far from
    where it was found, tangents make an effect where there is none left.
    """
    size = z @ z
    return columns + np.outer(effect - columns @ z, z) / size if size else columns


def _rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def _left(parts, U, flags, r, of_mesh, folds):
    """(N,) SI: what is left of r where each of `folds` (N,) is predicted from all but it.

    flags : two (k,) of columns of U: of the mesh, that are fitted and predict nothing, as of_mesh
        (N,) does; of a set-up, that are matched to the rows of the fold themselves
    """
    mesh, set_up = flags
    out = np.zeros(len(r))
    for rows in folds:
        known = np.where(mesh, 0.0, posterior(U[~rows], (r - of_mesh)[~rows]).mean)
        out[rows] = r[rows] - U[rows] @ known
        if set_up.any():
            placed = U[rows][:, set_up]
            out[rows] -= placed @ posterior(placed, out[rows]).mean
    ends = np.cumsum([0, *(len(part.r) for part in parts)])
    return np.concatenate([part.observables.coloured(out[a:b]) for part, a, b in
                           zip(parts, ends[:-1], ends[1:], strict=True)])
