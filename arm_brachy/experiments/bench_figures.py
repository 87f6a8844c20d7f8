"""Figures of `arm-brachy bench`: solvers side by side, growth over the size of the mesh."""

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator

from arm_brachy.evaluation import style
from arm_brachy.evaluation.style import Plate

COLOURS = {'linear': style.SERIES[1], 'quadratic': style.OURS}
QUANTITIES = {'cpu_s': 'CPU time [s]', 'wall_s': 'wall time [s]',
              'peak_memory_MiB': 'peak memory [MiB]'}


@style.styled
def solver_times(rows):
    """Plate of CPU seconds on a logarithmic axis, a panel for each mesh and element.

    rows : of bench_solvers; those without a time are named with the reason
    """
    panels = list(dict.fromkeys((r['mesh'], r['element']) for r in rows))
    rows_of_panels = (len(panels) + 1) // 2
    figure = style.new_figure(11.0, 0.5 + 2.0 * rows_of_panels)
    axes = figure.subplots(rows_of_panels, min(2, len(panels)), squeeze=False)
    for ax, key in zip(axes.ravel(), panels, strict=False):
        _times(ax, [r for r in rows if (r['mesh'], r['element']) == key])
        ax.set_title(f'{key[0]} dome, {key[1]} tetrahedra')
    for ax in axes.ravel()[len(panels):]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel('CPU time of the push [s]')
    return Plate('bench-solvers', figure, 'CPU time of one push from rest, solver by solver.')


def _times(ax, rows):
    """A line per solver, at its cheapest number of threads; ours, the first, is the unit."""
    best = {}
    for row in rows:
        name, cpu = row['solver'].replace(' (', '\n('), row['cpu_s']
        best[name] = min(filter(None, (best.get(name), cpu)), default=None)
    known = [cpu for cpu in best.values() if cpu is not None]
    low, high = 0.5 * min(known), 7.0 * max(known)   # room for the words
    for y, cpu in enumerate(best.values()):
        if cpu is None:
            ax.text(1.05 * low, y, 'not run', va='center', fontsize=8.5)
            continue
        colour = style.SERIES[6] if y else style.OURS
        ax.plot([low, cpu], [y, y], color=colour, linewidth=1.0, alpha=0.5)
        ax.plot(cpu, y, 'o', color=colour, markersize=6.0)
        times = f'  ({cpu / known[0]:.1f} x ours)' if y else ''
        ax.annotate(f'{cpu:.2g} s{times}', (cpu, y), xytext=(7, 0), va='center', fontsize=8.5,
                    textcoords='offset points')
    ax.set(xscale='log', xlim=(low, high), ylim=(len(best) - 0.5, -0.5),
           yticks=range(len(best)), yticklabels=list(best))
    ax.grid(axis='y', visible=False)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f'{v:g}'))
    ax.xaxis.set_minor_formatter('')


@style.styled
def growth_lines(rows):
    """Plate of CPU time, wall time and memory over the number of tetrahedra.

    rows : of bench_growth
    """
    figure = style.new_figure(11.0, 3.9)
    for ax, (column, label) in zip(figure.subplots(1, 3), QUANTITIES.items(), strict=True):
        for element, threads in dict.fromkeys((r['element'], r['threads']) for r in rows):
            line = [r for r in rows if (r['element'], r['threads']) == (element, threads)]
            ax.plot([r['tets'] for r in line], [r[column] for r in line], marker='o', ms=3.5,
                    color=COLOURS[element], linestyle='-' if threads == 1 else '--',
                    label=f'{element}, {threads} thread{"s" if threads > 1 else ""}')
        if column == 'cpu_s':
            _slopes(ax, rows)
        ax.set(xscale='log', yscale='log', xlabel='tetrahedra', title=label)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter(FuncFormatter(_thousands))
            axis.set_minor_formatter('')
        if column == 'peak_memory_MiB':   # hardly a decade
            ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.legend(loc='upper left')
    return Plate('bench-growth', figure, 'Cost of one push over the size of the mesh.')


def _slopes(ax, rows):
    """Guides below the lines: m, the assembly's, and m^2, that of nested dissection in space.

    Source of the latter: Lipton, Rose & Tarjan 1979, SIAM J Numer Anal 16:346.
    """
    last = max(rows, key=lambda row: row['tets'])
    m = last['tets'] * np.array([0.1, 1.0])
    for power, name in ((1, 'm'), (2, 'm²')):
        y = 0.003 * last['cpu_s'] * (m / m[0]) ** power
        ax.plot(m, y, color='#6b6b6b', linewidth=0.9, linestyle=':')
        ax.annotate(name, (m[-1], y[-1]), fontsize=8.5, color='#6b6b6b', xytext=(3, -3),
                    textcoords='offset points')


def _thousands(value, _):
    return f'{value / 1e3:g} k' if value >= 1e3 else f'{value:g}'
