"""Figure 5.9: one mesh on its way to another, assimilation by assimilation."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import latent_study

NAME = 'figure-5.9'
MEMBERS, ASSIMILATIONS, C_D = 100, 5, 0.001     # of the figure
THESIS = 7.3, 0.54                              # mm, before and after


def reproduce(out_dir, seeds=latent_study.SEEDS):
    """Assimilate the pair of states furthest apart; figure-5.9.png receives its errors.

    out_dir : folder;  seeds : of markers and members. Returns Result, a row for each pair.
    """
    bench = latent_study.bench(out_dir)
    curves = latent_study.curves(bench, seeds, members=MEMBERS, C_d=C_D,
                                 assimilations=ASSIMILATIONS)
    best = latent_study.reconstruction(bench)
    draw(curves, best).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    rows = tuple({'pair': k, 'before_mm': style.MM * float(curve[:, 0].mean()),
                  'after_mm': style.MM * float(curve[:, -1].mean()),
                  'network_at_best_mm': style.MM * float(best[k, 0]),
                  'linear_modes_at_best_mm': style.MM * float(best[k, 1])}
                 for k, curve in enumerate(curves))
    far = rows[_furthest(curves)]
    left = far['after_mm'] / far['before_mm']
    goal = THESIS[1] / THESIS[0]
    return Result(NAME, latent_study.SEED, commit_of(share_dir()), machine_description(), rows,
                  (Target('error after over error before, pair furthest apart (thesis '
                          f'{THESIS[0]:g} mm to {THESIS[1]:g} mm)', left, '1', f'<= {goal:.3f}',
                          bool(left <= goal)),))


def _furthest(curves):
    return int(curves[..., 0].mean(axis=1).argmax())


@style.styled
def draw(curves, best):
    """Return the figure: every seed of the pair furthest apart, and the network at best."""
    k = _furthest(curves)
    figure = Figure(figsize=(5.2, 3.2), layout='constrained')
    ax = figure.subplots()
    steps = np.arange(curves.shape[2])
    ax.plot(steps, style.MM * curves[k].T, color=style.MEASURED, linewidth=0.7)
    ax.plot(steps, style.MM * curves[k].mean(axis=0), 'o-', color=style.OURS, label='ours, mean')
    ax.plot([0, steps[-1]], THESIS, 'x', color=style.GOAL, markersize=8, markeredgewidth=2,
            label='thesis, its pair')
    ax.axhline(style.MM * best[k, 0], color=style.INK, linestyle='--', linewidth=1.0,
               label='network knowing all nodes')
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel('assimilations made')
    ax.set_ylabel('mean distance of nodes [mm]')
    ax.set_title('The pair of unseen states furthest apart')
    ax.legend()
    return figure
