"""Target error against the push, in the two scenarios of sec. 5.5: figures 5.11 and 5.12.

The thesis has one phantom, one buried sensor and 15 optical markers. Ours are the simulated plants
and targets of Table 4.1 with the scene's 19 markers; no estimator sees a target.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import inside_study

MARKERS = 19
# estimator -> name and colour in the figure; the first three are the thesis', in its order
SHOWN = {'open_loop': ('FEM, open loop', style.SERIES[6]),
         'kf_admm': ('KF-ADMM', style.SERIES[1]),
         'graph_vae': ('GNN-VAE with ES-MDA', style.OURS),
         'pod': ('POD, closed form', style.MEASURED)}
# %, sec. 5.5: the thesis gives them over both of its scenarios together
BELOW_OPEN_LOOP, BELOW_KF = 72.0, 45.0


def reproduce(name, pads, title, out_dir, done=None):
    """Push every plant with `pads`; NAME.png shows the error of each estimator at each depth.

    out_dir : folder;  done : of inside_study.run, computed if not given
    Returns Result, a row for each depth.
    """
    done = done or inside_study.run(out_dir, SHOWN, sets=(MARKERS,), groups=(pads,))
    depths, errors = errors_of(done)
    draw(depths, errors, title).savefig(Path(out_dir) / f'{name}.png', dpi=150)
    rows = tuple({'push_mm': style.MM * float(depth)}
                 | {f'{key}_mm': style.MM * float(np.nanmean(error[:, i]))
                    for key, error in errors.items()} for i, depth in enumerate(depths))
    return Result(name, inside_study.SEED, commit_of(share_dir()), machine_description(), rows,
                  targets(errors))


def errors_of(done):
    """Depths (e,) [m], and {estimator: (plants, e) [m] mean error over seeds and targets}."""
    found = {}
    for (name, _, _), scores in done.items():
        found.setdefault(name, []).append(np.nanmean(scores.error, axis=(1, 2)))
    return scores.depth, {name: np.array(each) for name, each in found.items()}


def targets(errors):
    """The thesis' claims of its two scenarios, and the linear baseline."""
    mean = {name: float(np.nanmean(error)) for name, error in errors.items()}
    goals = []
    for other, text, least in (('open_loop', 'open loop', BELOW_OPEN_LOOP),
                               ('kf_admm', 'KF-ADMM', BELOW_KF), ('pod', 'POD', 0.0)):
        below = 100.0 * (1.0 - mean['graph_vae'] / mean[other])
        goals.append(Target(f'GNN-VAE with ES-MDA below {text}', below, '%', f'>= {least:g}',
                            bool(below >= least)))
    return tuple(goals)


@style.styled
def draw(depths, errors, title):
    """Return the figure: mean over plants, targets and seeds, band the range of plants."""
    figure = Figure(figsize=(5.6, 3.6), layout='constrained')
    ax = figure.subplots()
    for name, error in errors.items():
        text, colour = SHOWN[name]
        ax.fill_between(style.MM * depths, *(style.MM * np.nanquantile(error, q, axis=0)
                                             for q in (0.0, 1.0)), color=colour, alpha=0.12,
                        linewidth=0)
        ax.plot(style.MM * depths, style.MM * np.nanmean(error, axis=0), 'o-', color=colour,
                label=text)
    ax.set_xticks(style.MM * depths)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel('push [mm]')
    ax.set_ylabel('mean target error [mm]')
    ax.set_title(title)
    ax.legend()
    return figure
