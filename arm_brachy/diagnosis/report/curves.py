"""Measured and predicted curves of the channels with the largest misfit, before and after.

"Before" is the recalibrated model without a new term, "after" the model with the term that was
named. What calibration leaves open (registration, zeros, clocks) is fitted to the curves that are
shown; what the mesh may be wrong by is not, so that it stays visible.
Test: diagnosis/test_curves.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.estimation.cross_validation import which, with_found
from arm_brachy.diagnosis.estimation.fit import parts_of, times_of
from arm_brachy.diagnosis.results.formatting import STREAMS, listed
from arm_brachy.diagnosis.results.parts import edge_unit
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior, stacked
from arm_brachy.evaluation.style import GOAL, INK, OURS, Plate, new_figure, styled

AXES = 'xyz'
DENSE = 60      # points from which a curve is drawn as a line


@dataclass(frozen=True)
class Curve:
    """One axis of one channel in one recording.

    t : (n,) [s];  measured, before, after : (n,) SI; after None = nothing was named
    noise : standard deviation of a measured value [SI];  label : of the term that `after` has
    """

    recording: str
    stream: str
    channel: str
    axis: int
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    noise: float
    after: np.ndarray | None = None
    label: str = ''

    def __post_init__(self):
        for name in ('measured', 'before', 'after'):
            values = getattr(self, name)
            if values is not None and np.shape(values) != np.shape(self.t):
                raise InputError(f'curve of {self.channel} in {self.recording}: {name} has shape '
                                 f'{np.shape(values)}; must be that of t, {np.shape(self.t)}')

    def misfit(self, predicted):
        """Root mean square of measured less predicted [SI]."""
        return float(np.sqrt(np.nanmean((self.measured - predicted) ** 2)))


def worst_curves(assembly, fitted, label, ratio):
    """The Curve of each stream of an problem.Assembly whose misfit without a term is largest.

    fitted : fit.Fitted of what was found, None = nothing;  label : its name in words
    ratio : as of `fit.parts_of`
    The misfit is over the noise, of all recordings that may lack something; at the load states of
    the full fit.
    """
    parts = parts_of(assembly, fitted, ratio)
    U, mesh = stacked(parts), which(parts, [part.mesh for part in parts])
    off = np.concatenate([part.of_mesh for part in parts])
    before = _left(U, np.concatenate([part.r for part in parts]), off, mesh)
    after = None
    if any(part.named is not None for part in parts):
        named, columns = with_found(parts)
        after = _left(np.hstack([U, columns]), named, off, np.pad(mesh, (0, columns.shape[1])))
    ends = np.cumsum([0, *(len(part.r) for part in parts)])
    best = {}
    for i, part in enumerate(parts):
        mine = slice(ends[i], ends[i + 1])
        for key, rows in _channels(part).items():
            size = float(np.sum(before[mine][rows] ** 2))
            if size > best.get(key[0], (0.0,))[0]:
                best[key[0]] = size, i, key, rows
    times = times_of(assembly, fitted)
    return tuple(_curve(assembly.suspects[i].recorded.name, parts[i], times[i], key, rows, [
        None if one is None else one[ends[i]:ends[i + 1]] for one in (before, after)], label)
        for _, i, key, rows in best.values())


def _left(U, r, of_mesh, mesh):
    """(N,) of r beside U at its best; what the mesh is wrong by is fitted and left in."""
    best = posterior(U, r - of_mesh).mean
    return r - U @ np.where(mesh, 0.0, best)


def _channels(part):
    """(stream, channel, axis) -> numbers of its rows in a cross_validation.Part."""
    out = {}
    for i, row in enumerate(part.observables.rows):
        out.setdefault((row.kind, row.channel, row.axis), []).append(i)
    return out


def _curve(recording, part, t, key, rows, left, label):
    """left : (N,) of the whole part before and after, over the noise; None = nothing was named"""
    seen = part.observables
    states = np.array([seen.rows[i].state for i in rows])
    order = np.argsort(t[states])
    rows = np.array(rows)[order]
    measured = seen.values[rows]
    measured = measured - (measured[0] if key[0] != 'force' else 0.0)
    before, after = (None if one is None else measured - seen.coloured(one)[rows] for one in left)
    return Curve(recording, *key, t[states][order], measured, before,
                 float(np.sqrt(np.mean(seen.sd[rows] ** 2))), after, label if after is not None
                 else '')


@styled
def curve_plate(curves):
    """Panels, one for each Curve."""
    figure = new_figure(9.5, 0.6 + 2.0 * len(curves))
    axes = figure.subplots(len(curves), squeeze=False)[:, 0]
    for axis, one in zip(axes, curves, strict=True):
        unit, scale = edge_unit(one.stream)
        lines = len(one.t) > DENSE
        axis.plot(one.t, one.measured / scale, color=INK, label='measured',
                  **({'lw': 1.6} if lines else {'ls': '', 'marker': 'o', 'ms': 3.2}))
        axis.plot(one.t, one.before / scale, color=GOAL, lw=1.1, ls='--',
                  label='predicted, recalibrated, no new term')
        if one.after is not None:
            axis.plot(one.t, one.after / scale, color=OURS, lw=1.3,
                      label=f'predicted, with {one.label}')
        axis.set_title(f'{one.channel}, {AXES[one.axis]}: {_numbers(one, scale, unit)}',
                       loc='left', fontsize=8.5, fontweight='normal')
        axis.set_ylabel(f'{STREAMS[one.stream][0]}\n{_what(one)} / {unit}')
        axis.margins(x=0.01)
    axes[-1].set_xlabel('time / s')
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=3)
    where = listed(dict.fromkeys(one.recording for one in curves))
    return Plate('curves', figure, (
        f'Measured and predicted, in {where}: the channels and axes whose misfit without a new '
        'term is largest beside the noise. Registration, zeros and clocks are fitted to each '
        'prediction. The misfit is the root mean square of measured minus predicted.'))


def _what(curve):
    return 'force' if curve.stream == 'force' else 'displacement'


def _numbers(one, scale, unit):
    values = [one.misfit(one.before), *([] if one.after is None else [one.misfit(one.after)])]
    shown = ' → '.join(f'{value / scale:.3g}' for value in values)
    return f'misfit {shown} {unit}, noise {one.noise / scale:.2g} {unit}'
