"""Figure 5.7: error of the registered mesh against N_e and C_d, N_a = 5."""

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Target
from arm_brachy.experiments.latent_study import Case, sweep

NAME = 'figure-5.7'
MEMBERS = (10, 50, 100)             # N_e of the figure
NOISES = (0.1, 0.01, 0.001)         # C_d of the figure
ASSIMILATIONS = 5                   # N_a, fixed
CASES = tuple(Case(members, C_d, ASSIMILATIONS) for C_d in NOISES for members in MEMBERS)


def targets(end):
    """What the thesis says of its figure (sec. 5.4)."""
    few, some, most = (end[Case(members, 0.001, ASSIMILATIONS)] for members in MEMBERS)
    loose, close = (end[Case(100, C_d, ASSIMILATIONS)] for C_d in (0.1, 0.01))
    return (Target('error with 10 members over that with 100', few / most, '1', '> 1.1',
                   few > 1.1 * most),
            Target('error with 50 members over that with 100', some / most, '1', '0.9 to 1.1',
                   0.9 <= some / most <= 1.1),
            Target('error at C_d = 0.1 over that at 0.001', loose / most, '1', '> 1',
                   loose > most),
            Target('error at C_d = 0.01 over that at 0.001', close / most, '1', '0.9 to 1.1',
                   0.9 <= close / most <= 1.1))


@style.styled
def draw(curves):
    """Return the figure: one panel for each C_d, mean over pairs and seeds."""
    figure = Figure(figsize=(7.6, 3.2), layout='constrained')
    axes = figure.subplots(1, len(NOISES), sharey=True)
    for ax, C_d in zip(axes, NOISES, strict=True):
        for k, members in enumerate(MEMBERS):
            curve = style.MM * curves[Case(members, C_d, ASSIMILATIONS)].mean(axis=(0, 1))
            ax.plot(np.arange(len(curve)), curve, 'o-', color=style.SERIES[k], markersize=3.5,
                    label=f'{members} members')
        ax.set_title(f'$C_d$ = {C_d:g} cm²')
        ax.set_xlabel('assimilations made')
    axes[0].set_ylabel('mean distance of nodes [mm]')
    axes[0].set_ylim(bottom=0.0)
    axes[-1].legend()
    return figure


reproduce = partial(sweep, NAME, CASES, draw, targets)
