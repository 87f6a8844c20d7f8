"""Tests over all channels at once: has the tissue somewhere, or a pad, a past?

What a law or a mesh has wrong depends on where the pads are now. What depends besides on what they
did before comes of neither: fluid that is squeezed out, a gap that opens under a pad, a drive that
warms, an arm that bends, a vessel that stays shut. A channel alone shows little of that. So all of
them are held against what they would show if, in proportion to what a history of the pushes has
left, the tissue of a region were stiffer, or a pad went elsewhere, along its push or aside.
Test: diagnosis/theorems/test_pasts.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.spatial.distance import cdist

from arm_brachy.diagnosis.selection.candidates import interior_places
from arm_brachy.diagnosis.signals.motion import TOUCH
from arm_brachy.diagnosis.signals.regressors import POWERS, memories, moving, play
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL

REGIONS = 12                # of tissue, of about equal volume
MEMORIES = (2.0, 6.0, 20.0)     # s: slower than a push, faster than a recording
LOST = 0.25                 # of the largest push, for a hysteresis of about its size
WORK = 'memory of {:g} s of the work'   # of a motor, which tissue knows nothing of
WORKS = frozenset(map(WORK.format, MEMORIES))
WITHIN = 90.0               # per cent of a region's elements that its radius holds


@dataclass(frozen=True)
class Past:
    """What a pooled test looks for: something that goes with a history of the pushes.

    history : which;  pad : name of the pad whose pushes that is of, '' = of time
    moved : name of the pad that would go elsewhere, or sensor : of that whose force sensor would
        read more, or both '' = tissue of a region would be stiffer, with
    aside : True if it would go across its push
    centre : (3,) [m] its middle at rest;  radius : [m] around that, of most of it
    """

    history: str
    pad: str = ''
    moved: str = ''
    sensor: str = ''
    aside: bool = False
    centre: tuple | None = None
    radius: float | None = None

    @property
    def said(self):
        """A sentence on what stands out if this does."""
        goes = f'the {self.history} of the pushes of {self.pad}' if self.pad else 'time'
        way = 'aside' if self.aside else 'along'
        what = (f'how far {self.moved} takes the tissue {way}' if self.moved else
                f'what the force sensor of {self.sensor} reads' if self.sensor else
                'the stiffness there')
        often = ' (a guide that rubs and a cell that creeps do)' if self.sensor else ''
        return (f'What stands out most goes with {goes}, as if {what} depended on it{often}. A '
                'law or a mesh that is wrong would go with where the pads are now.')


def pooled_tests(matched, parts):
    """Columns (N, m), whitened, and the Past of each; arguments as of `misfit_tests`.

    No regions where a model has a memory of its own: its stresses are not linear in the moduli.
    """
    pads, pasts = matched[0].baseline.model.specimen.pads, [_histories(m) for m in matched]
    every = list(dict.fromkeys(name for past in pasts for name in past))
    columns, labels = [np.zeros((sum(len(o.rows) for o, _ in parts), 0))], []
    for where, effects in (*_pads_moved(matched), *_sensors_off(matched),
                           *_regions_stiffer(matched)):
        mine = next((pads.index(where[key]) for key in ('moved', 'sensor') if key in where), None)
        names = [(history, pad) for history, pad in every if pad == mine or (
            history not in WORKS and 'sensor' not in where)]
        if not names:       # the sensor of a pad that never pushes
            continue
        columns.append(np.vstack([
            _in_proportion(effect, past, names, *part)
            for effect, past, part in zip(effects, pasts, parts, strict=True)]))
        labels += [Past(history, pads[pad] if pad >= 0 else '', **where)
                   for history, pad in names]
    return np.hstack(columns), tuple(labels)


def _histories(m):
    """(history, index of the pad or -1) -> (n,) at the states of a Matched, of order one.

    Of a pad's, what is not a smooth function of where it is now: that a law may have wrong.
    """
    states = m.recorded.states
    t, q = states.path_t, states.path_q
    out = {('time', -1): (states.t - t[0]) / max(t[-1] - t[0], 1e-9)}
    for i in moving(q, TOUCH).tolist():
        push = q[:, i] / np.abs(q[:, i]).max()
        gone = np.cumsum(np.abs(np.diff(push, prepend=push[0])))
        past = {}
        for time in MEMORIES:
            kept = memories(states.t, t, np.stack([push, gone], axis=1), time)
            past[f'memory of {time:g} s'] = kept[:, 0]
            past[WORK.format(time)] = gone[states.state] - kept[:, 1]
        past['hysteresis'] = play(push, LOST)[states.state]
        past['maximum'] = np.maximum.accumulate(push)[states.state]
        now = push[states.state][:, None] ** np.arange(POWERS[-1] + 1)
        for name, values in past.items():
            out[name, i] = values - now @ np.linalg.lstsq(now, values, rcond=None)[0]
    return out


def _in_proportion(effect, past, names, observables, kept):
    """Columns (N, len(names)) of an effect kind -> (n, c, 3) that goes with each history."""
    nothing = np.zeros(len(next(iter(effect.values()))))
    shares = np.stack([past.get(name, nothing) for name in names], axis=1)[kept]
    return observables.whiten({kind: values[kept][..., None] * shares[:, None, None, :]
                               for kind, values in effect.items()})


def _pads_moved(matched):
    """(where, effect kind -> (n, c, 3) of each Matched) of every pad, along its push and aside."""
    model = matched[0].baseline.model
    for i, name in enumerate(model.specimen.pads):
        along = model.directions[i]
        for k, way in enumerate((along, *null_space(along[None]).T)):
            pads = np.zeros_like(model.directions)
            pads[i] = way
            yield {'moved': name, 'aside': k > 0}, [_stacked(
                [m.baseline.pads_shifted(state, pads) for state in range(len(m.baseline.t))])
                for m in matched]


def _sensors_off(matched):
    """The same of every pad's force sensor, along its push."""
    model = matched[0].baseline.model
    for i, name in enumerate(model.specimen.pads):
        yield {'sensor': name}, [_reads_more(m.baseline, i) for m in matched]


def _reads_more(baseline, i):
    """Effect of 1 N more of the tissue on the sensor of pad i."""
    more = {kind: np.zeros_like(shown) for kind, shown in baseline.shown.items()}
    more[FORCE][:, i] = -baseline.model.directions[i]
    return more


def _regions_stiffer(matched):
    """The same of every region of tissue, by the logarithm of its modulus."""
    if any(m.baseline.by_modulus is None for m in matched):
        return
    mesh = matched[0].baseline.model.specimen.mesh
    middles = mesh.nodes[mesh.tets].mean(axis=1)
    centres = interior_places(mesh, REGIONS)
    region = cdist(middles, centres).argmin(axis=1)
    for j in np.unique(region):
        mine = (region == j).astype(np.float32)
        radius = np.percentile(np.linalg.norm(middles[region == j] - centres[j], axis=1), WITHIN)
        yield {'centre': tuple(map(float, centres[j])), 'radius': float(radius)}, [
            _stiffer(m.baseline, mine) for m in matched]


def _stiffer(baseline, share):
    """Effect of elements whose moduli are larger by a share (m,), to first order."""
    places = {i: baseline.split(baseline.by_modulus[i] @ share) for i in baseline.places()}
    return _stacked([places[i] for i in baseline.place.tolist()])


def _stacked(changes):
    """kind -> (n, c, 3) of n dicts kind -> (c, 3)."""
    return {kind: np.stack([change[kind] for change in changes]) for kind in (OPTICAL, EM, FORCE)}
