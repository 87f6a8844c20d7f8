"""Figures of what an estimator said of a target: over time, and in the plane with its ellipses."""

import numpy as np
from matplotlib.patches import Ellipse
from scipy.stats import chi2, norm

from arm_brachy.evaluation import metrics
from arm_brachy.evaluation.estimates import LEVEL, held, true_at
from arm_brachy.evaluation.style import GOAL, INK, MM, OURS, TRUTH, Plate, new_figure, styled

AXIS_NAMES = ('x', 'y', 'z')
SHOWN = 9                # ellipses along the way, evenly in time: more would hide one another
_PLANE = float(np.sqrt(chi2.ppf(LEVEL, 2)))     # half axis of a plane ellipse, in sd
_LINE = float(norm.ppf(0.5 + LEVEL / 2.0))      # half width of the band of one coordinate, in sd


@styled
def estimate(run, name, target):
    """Estimate, 95 % region and reference of one target; for who asks whether to believe it.

    run : timeseries.RunData with a reference of the target;  name : of the estimator
    """
    said, truth = run.estimates[name][target], run.reference[target]
    figure = new_figure(9.5, 6.4)
    grid = figure.add_gridspec(4, 2, width_ratios=(1.55, 1.0))
    axes = [figure.add_subplot(grid[row, 0]) for row in range(4)]
    start = truth.values[0]
    for k in range(3):
        _coordinate(axes[k], said, truth, k, start[k], run.reference_name)
    _error(axes[3], said, truth)
    for axis in axes[:3]:
        axis.sharex(axes[3])
        axis.tick_params(labelbottom=False)
    for task in run.tasks:
        for axis in axes:
            axis.axvline(task.t_start, color='#9aa5ad', lw=0.9)
    axes[3].set_xlabel('time / s')
    figure.align_ylabels(axes)
    plane = figure.add_subplot(grid[:, 1])
    _plane(plane, said, truth, start)
    handles, labels = axes[0].get_legend_handles_labels()
    more = axes[3].get_legend_handles_labels()
    figure.legend(handles + more[0], labels + more[1], loc='outside upper center', ncols=5)
    error = said.points - true_at(truth, said.t)
    share = 100.0 * held(error, said.covariance).mean()
    return Plate(f'estimate_{name}_{target}', figure, (
        f'{name}_estimator on {target}, which it never measures. Displacement from where the '
        'target was at first: estimate (line) with the 95 % band of each coordinate, '
        f'{run.reference_name} (dark). Below: distance between the two; crosses where the 95 % '
        f'ellipsoid does not hold the {run.reference_name} ({100.0 - share:.1f} % of estimates). '
        'Right: the same in the plane of the pads, true to scale, with the 95 % ellipses at '
        f'{SHOWN} times. Vertical lines: a goal was set. A gap: the estimate was withheld.'))


def _coordinate(axis, said, truth, k, start, label):
    t, mid, sd = _with_gaps(said, k)
    half = _LINE * sd
    axis.fill_between(t, (mid - half - start) * MM, (mid + half - start) * MM, color=OURS,
                      alpha=0.2, lw=0, label='95 %')
    axis.plot(truth.t, (truth.values[:, k] - start) * MM, color=TRUTH, label=label)
    axis.plot(t, (mid - start) * MM, color=OURS, lw=1.1, label='estimate')
    axis.set_ylabel(f'{AXIS_NAMES[k]} / mm')


def _with_gaps(said, k):
    """(t, coordinate k, sd) with a NaN in every pause longer than three usual intervals."""
    t, x = said.t, said.points[:, k]
    sd = np.sqrt(said.covariance[:, k, k])
    if len(t) < 3:
        return t, x, sd
    steps = np.diff(t)
    cut = np.flatnonzero(steps > 3.0 * np.median(steps)) + 1
    return (np.insert(t, cut, t[cut - 1]), np.insert(x, cut, np.nan), np.insert(sd, cut, np.nan))


def _error(axis, said, truth):
    error = said.points - true_at(truth, said.t)
    size, inside = metrics.magnitude(error) * MM, held(error, said.covariance)
    axis.plot(said.t, size, '.', color=OURS, markersize=2.2, rasterized=True)
    axis.plot(said.t[~inside], size[~inside], 'x', color=GOAL, markersize=4.0,
              label='outside the 95 % ellipsoid')
    axis.set_ylabel('error / mm')
    axis.set_ylim(bottom=0.0)


def _plane(axis, said, truth, start):
    axis.plot(*((truth.values[:, :2] - start[:2]) * MM).T, color=TRUTH, lw=1.2)
    axis.plot(*((said.points[:, :2] - start[:2]) * MM).T, '.', color=OURS, markersize=1.8,
              rasterized=True)
    for i in np.unique(np.linspace(0, len(said.t) - 1, SHOWN).astype(int)):
        centre = (said.points[i, :2] - start[:2]) * MM
        _ellipse(axis, centre, said.covariance[i, :2, :2] * MM**2)
        axis.plot(*((true_at(truth, said.t[i:i + 1])[0, :2] - start[:2]) * MM), 'o', color=INK,
                  markersize=3.5)
    axis.set(xlabel='x / mm', ylabel='y / mm')
    axis.set_aspect('equal', adjustable='datalim')


def _ellipse(axis, centre, covariance):
    values, vectors = np.linalg.eigh(covariance)
    width, height = 2.0 * _PLANE * np.sqrt(values)
    axis.add_patch(Ellipse(centre, width, height, facecolor=OURS, alpha=0.25, edgecolor=OURS,
                           angle=np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))))
