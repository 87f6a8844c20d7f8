"""Our numbers beside the published ones, as a figure."""

import numpy as np
from matplotlib.ticker import LogLocator

from arm_brachy.evaluation.style import BAND, INK, OURS, THEIRS, Plate, new_figure, styled
from arm_brachy.evaluation.thesis import CITATION, TABLE_3_1


@styled
def table_3_1(ours, limit_mm, theirs=TABLE_3_1):
    """ITAE and steady-state error of every task, ours beside the thesis' (Table 3.1).

    ours : thesis.Manipulation per row, any subset of targets and tasks;  limit_mm : goal of the
    closed loop's steady-state error. For who asks: is the loop better than what was published?
    """
    published = {(row.target, row.task): row for row in theirs}
    pairs = [(row, published[row.target, row.task]) for row in ours]
    figure = new_figure(9.5, 1.4 + 0.31 * len(pairs))
    left, right = figure.subplots(1, 2, sharey=True, gridspec_kw={'width_ratios': (1.5, 1)})
    for name, colour, pick in (('thesis', THEIRS, 1), ('ours', OURS, 0)):
        shift = 0.17 if name == 'ours' else -0.17
        rows = [pair[pick] for pair in pairs]
        _dumbbells(left, rows, 'itae_mm_s2', name, colour, shift)
        _dumbbells(right, rows, 'steady_state_error_mm', name, colour, shift)
    left.set(xscale='log', xlabel='ITAE / mm s²', ylim=(len(pairs) - 0.5, -0.5))
    left.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    left.xaxis.set_major_formatter('{x:g}')
    left.xaxis.set_minor_formatter('')
    left.set_yticks(range(len(pairs)), [f'target {r.target}, task {r.task}' for r in ours])
    right.axvline(limit_mm, color=BAND, lw=1.2, label=f'goal, closed loop: {limit_mm:g} mm')
    right.set(xlabel='steady-state error / mm', xlim=(0, None))
    entries = dict(zip(*reversed(right.get_legend_handles_labels()), strict=True))
    figure.legend(entries.values(), entries.keys(), loc='outside upper center', ncols=5)
    return Plate('table_3_1', figure, (
        'Open loop (hollow) and closed loop (filled), ours beside the thesis. Left: ITAE '
        '(3.30), logarithmic; right: steady-state error. Further left is better. The thesis '
        'prints no steady-state error for its closed loop. ITAE grows with the square of the '
        f'duration of a task, which the thesis does not state. Thesis: {CITATION}.'))


def _dumbbells(axis, rows, quantity, name, colour, shift):
    """Open loop hollow, closed loop filled, joined by a line; NaN is left out."""
    y = np.arange(len(rows)) + shift
    opened = np.array([getattr(row, f'open_loop_{quantity}') for row in rows])
    closed = np.array([getattr(row, f'closed_loop_{quantity}') for row in rows])
    axis.hlines(y, closed, opened, color=colour, alpha=0.45, lw=1.4)
    axis.plot(opened, y, 'o', markerfacecolor='white', markeredgecolor=colour, markersize=5.5,
              linestyle='', label=f'{name}, open loop')
    if np.isfinite(closed).any() or quantity == 'steady_state_error_mm':
        axis.plot(closed, y, 'o', color=colour, markersize=5.5, linestyle='',
                  label=f'{name}, closed loop')
    axis.tick_params(axis='y', length=0, colors=INK)
