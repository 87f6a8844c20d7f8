"""What was found, channel by channel where it shows most, beside what only it can explain.

A root mean square over all channels hides an effect that a few of them see. Here the residual has
everything taken out but what was found (a partial residual: Larsen & McCleary 1972, Technometrics
14:781), so that points and line fall together if it is there, and the points on zero if it is not.
Test: diagnosis/test_diagnose.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.report import conclusions
from arm_brachy.diagnosis.results.formatting import STREAMS
from arm_brachy.diagnosis.results.parts import edge_unit
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior
from arm_brachy.evaluation.style import BAND, MEASURED, OURS, Plate, new_figure, styled

AXES = 'xyz'


@dataclass(frozen=True)
class Partial:
    """One axis of one channel in the recording in which it shows most, at its k load states.

    t : (k,) [s];  effect : (k,) of what was found;  measured : (k,) less everything else
    sd : (k,) of noise alone; SI
    """

    recording: str
    stream: str
    channel: str
    axis: int
    t: np.ndarray
    effect: np.ndarray
    measured: np.ndarray
    sd: np.ndarray


def partials(assembly, found):
    """The Partial of every stream of an problem.Assembly; found : judge.Explanation each."""
    if not found:
        return ()
    problem = assembly.problem
    columns = np.hstack([one.columns for one in found])
    whole = np.hstack([problem.U, columns])
    mean = posterior(whole, problem.r).mean
    effect, left = columns @ mean[problem.U.shape[1]:], problem.r - whole @ mean
    best = {}
    for (m, mine), (_, rest) in zip(conclusions.split_rows(assembly, effect),
                                    conclusions.split_rows(assembly, left), strict=True):
        for key, power in _powers(m, mine).items():
            if power > best.get(key[0], (0.0,))[0]:
                best[key[0]] = (power, m, key, mine, rest)
    return tuple(_partial(m, key, mine, rest) for _, m, key, mine, rest in best.values())


def _powers(m, effect):
    """(stream, channel, axis) -> sum of squares of an effect over the noise."""
    out = {}
    for row, value in zip(m.observables.rows, effect, strict=True):
        key = (row.kind, row.channel, row.axis)
        out[key] = out.get(key, 0.0) + value**2
    return out


def _partial(m, key, effect, left):
    rows = [i for i, row in enumerate(m.observables.rows)
            if (row.kind, row.channel, row.axis) == key]
    effect, left = m.observables.coloured(effect)[rows], m.observables.coloured(left)[rows]
    t = m.recorded.states.t[m.observables.states[rows]]
    order = np.argsort(t)
    return Partial(m.recorded.name, *key, *(part[order] for part in (
        t, effect, effect + left, m.observables.sd[rows])))


@styled
def partial_plate(shown):
    """Panels, one for each Partial."""
    figure = new_figure(9.5, 0.5 + 1.75 * len(shown))
    axes = figure.subplots(len(shown), squeeze=False)[:, 0]
    for axis, one in zip(axes, shown, strict=True):
        unit, scale = edge_unit(one.stream)
        axis.axhline(0.0, color=BAND, lw=1.3, label='without it')
        axis.errorbar(one.t, one.measured / scale, one.sd / scale, color=MEASURED, fmt='o', ms=3,
                      lw=0.8, label='measured, less everything else')
        axis.plot(one.t, one.effect / scale, color=OURS, lw=1.2, label='what was found')
        axis.set_ylabel(f'{STREAMS[one.stream][0]}\n'
                        f'{one.channel}, {AXES[one.axis]} / {unit}')
    axes[-1].set_xlabel('time / s')
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=3)
    where = '; '.join(dict.fromkeys(one.recording for one in shown))
    return Plate('partial', figure, (
        f'Where it shows most ({where}), at every load state: the axis of each stream on which it '
        'stands out most. Bars: noise alone, one standard deviation.'))
