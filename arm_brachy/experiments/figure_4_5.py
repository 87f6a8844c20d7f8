"""Figure 4.5: target error against iterations, ADMM and KF-ADMM with the first set of markers."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import inside_iterations, inside_study
from arm_brachy.experiments.inside_iterations import EXPERIMENTS

NAME = 'figure-4.5'
TITLES = {'admm': ('ADMM, open loop', style.SERIES[6]),
          'kf_admm_19': ('KF-ADMM, 19 markers', style.OURS),
          'kf_admm_10': ('KF-ADMM, 10 markers', style.SERIES[1])}


def reproduce(out_dir, traces=None):
    """Iterate from rest with and without the filter; figure-4.5.png shows four experiments.

    out_dir : folder;  traces : of `inside_iterations.run`, computed if not given
    Returns Result, a row for each experiment and method.
    """
    traces = traces or inside_iterations.run(out_dir, (19,))
    draw(traces).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    return Result(NAME, inside_study.SEED, commit_of(share_dir()), machine_description(),
                  inside_iterations.rows(traces), targets(traces))


def targets(traces):
    """The thesis' claims: 200 iterations instead of 500, and a smaller error in the end."""
    with_, without = (inside_iterations.slowest(traces[m]) for m in ('kf_admm_19', 'admm'))
    ends = [np.mean([traces[m].mean(e)[-1] for e in EXPERIMENTS]) for m in ('kf_admm_19', 'admm')]
    return (Target('iterations until KF-ADMM has converged, slowest experiment', with_, '1',
                   f'<= {inside_iterations.THESIS["kf_admm_19"]}',
                   with_ <= inside_iterations.THESIS['kf_admm_19']),
            Target('the same over those of ADMM (thesis: 200 / 500)', with_ / without, '1',
                   '<= 0.4', with_ <= 0.4 * without),
            Target('error in the end over that of ADMM', ends[0] / ends[1], '1', '< 1',
                   bool(ends[0] < ends[1])))


@style.styled
def draw(traces):
    """Return the figure: a panel for each experiment, the mean over plants of every method."""
    figure = Figure(figsize=(9.6, 6.0), layout='constrained')
    for ax, number in zip(figure.subplots(2, 2, sharex=True, sharey=True).ravel(), EXPERIMENTS,
                          strict=True):
        for trace in traces.values():
            name, colour = TITLES[trace.method]
            count = np.arange(1, len(trace.mean(number)) + 1)
            ax.fill_between(count, *(style.MM * np.quantile(trace.errors[number], q, axis=0)
                                     for q in (0.0, 1.0)), color=colour, alpha=0.12, linewidth=0)
            ax.plot(count, style.MM * trace.mean(number), color=colour, label=name)
            ax.axvline(trace.converged(number), color=colour, linestyle=':', linewidth=1.2)
        ax.set_title(f'Experiment {number}')
        ax.set_xscale('log')
        ax.set_ylim(bottom=0.0)
    for ax in figure.axes[2:]:
        ax.set_xlabel('iterations')
    for ax in figure.axes[::2]:
        ax.set_ylabel('mean target error [mm]')
    figure.axes[0].legend()
    figure.suptitle('Mean over plants, band their range; dotted: within 0.1 mm of the end for '
                    'good', fontsize=9)
    return figure
