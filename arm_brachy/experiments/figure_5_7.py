"""Figure 5.7: error of the registered mesh against N_e and C_d, N_a = 5."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import latent_study

NAME = 'figure-5.7'
MEMBERS = (10, 50, 100)             # N_e of the figure
NOISES = (0.1, 0.01, 0.001)         # C_d of the figure
ASSIMILATIONS = 5                   # N_a, fixed


def reproduce(out_dir, seeds=latent_study.SEEDS):
    """Assimilate ten pairs with every N_e and C_d; figure-5.7.png receives the curves.

    out_dir : folder;  seeds : of markers and members. Returns Result, a row for each curve.
    """
    bench = latent_study.bench(out_dir)
    curves = {(members, C_d): latent_study.curves(bench, seeds, members=members, C_d=C_d,
                                                  assimilations=ASSIMILATIONS)
              for C_d in NOISES for members in MEMBERS}
    draw(curves).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    rows = tuple({'members': m, 'C_d_cm2': c} | latent_study.row(curve)
                 for (m, c), curve in curves.items())
    return Result(NAME, latent_study.SEED, commit_of(share_dir()), machine_description(), rows,
                  targets(curves))


def targets(curves):
    """What the thesis says of its figure (sec. 5.4)."""
    end = {case: float(curve[..., -1].mean()) for case, curve in curves.items()}
    few = end[10, 0.001] / end[100, 0.001]
    many = end[50, 0.001] / end[100, 0.001]
    return (Target('error with 10 members over that with 100', few, '1', '> 1.1', few > 1.1),
            Target('error with 50 members over that with 100', many, '1', '0.9 to 1.1',
                   0.9 <= many <= 1.1),
            Target('error at C_d = 0.1 over that at 0.001', end[100, 0.1] / end[100, 0.001], '1',
                   '> 1', end[100, 0.1] > end[100, 0.001]))


@style.styled
def draw(curves):
    """Return the figure: one panel for each C_d, mean over pairs and seeds."""
    figure = Figure(figsize=(7.6, 3.2), layout='constrained')
    axes = figure.subplots(1, len(NOISES), sharey=True)
    for ax, C_d in zip(axes, NOISES, strict=True):
        for k, members in enumerate(MEMBERS):
            curve = style.MM * curves[members, C_d].mean(axis=(0, 1))
            ax.plot(np.arange(len(curve)), curve, 'o-', color=style.SERIES[k], markersize=3.5,
                    label=f'{members} members')
        ax.set_title(f'$C_d$ = {C_d:g} cm²')
        ax.set_xlabel('assimilations made')
    axes[0].set_ylabel('mean distance of nodes [mm]')
    axes[0].set_ylim(bottom=0.0)
    axes[-1].legend()
    return figure
