"""Figure 5.8: error of the registered mesh against N_e and N_a, C_d = 0.001."""

from functools import partial

from matplotlib.figure import Figure

from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Target
from arm_brachy.experiments.latent_study import Case, sweep

NAME = 'figure-5.8'
MEMBERS = (10, 50, 100)             # N_e of the figure
ASSIMILATIONS = (1, 2, 3, 5, 8)     # N_a
C_D = 0.001                         # fixed
CASES = tuple(Case(members, C_D, count) for count in ASSIMILATIONS for members in MEMBERS)


def targets(end):
    """What the thesis says of its figure (sec. 5.4)."""
    one, five, eight = (end[Case(100, C_D, count)] for count in (1, 5, 8))
    return (Target('error with 1 assimilation over that with 5', one / five, '1', '> 1',
                   one > five),
            Target('error with 8 assimilations over that with 5', eight / five, '1',
                   '0.9 to 1.1', 0.9 <= eight / five <= 1.1))


@style.styled
def draw(curves):
    """Return the figure: error in the end against N_a, a curve for each N_e."""
    figure = Figure(figsize=(5.2, 3.2), layout='constrained')
    ax = figure.subplots()
    for k, members in enumerate(MEMBERS):
        ends = [style.MM * curves[Case(members, C_D, count)][..., -1].mean()
                for count in ASSIMILATIONS]
        ax.plot(ASSIMILATIONS, ends, 'o-', color=style.SERIES[k], label=f'{members} members')
    ax.set_xticks(ASSIMILATIONS)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel('assimilations $N_a$')
    ax.set_ylabel('mean distance of nodes [mm]')
    ax.set_title(f'$C_d$ = {C_D:g} cm², ten pairs of unseen states')
    ax.legend()
    return figure


reproduce = partial(sweep, NAME, CASES, draw, targets)
