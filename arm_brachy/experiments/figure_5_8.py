"""Figure 5.8: error of the registered mesh against N_e and N_a, C_d = 0.001."""

from pathlib import Path

from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import latent_study

NAME = 'figure-5.8'
MEMBERS = (10, 50, 100)             # N_e of the figure
ASSIMILATIONS = (1, 2, 3, 5, 8)     # N_a
C_D = 0.001                         # fixed


def reproduce(out_dir, seeds=latent_study.SEEDS):
    """Assimilate ten pairs with every N_e and N_a; figure-5.8.png receives the curves.

    out_dir : folder;  seeds : of markers and members. Returns Result, a row for each case.
    """
    bench = latent_study.bench(out_dir)
    curves = {(members, count): latent_study.curves(bench, seeds, members=members, C_d=C_D,
                                                    assimilations=count)
              for count in ASSIMILATIONS for members in MEMBERS}
    draw(curves).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    rows = tuple({'members': m, 'assimilations': n} | latent_study.row(curve)
                 for (m, n), curve in curves.items())
    return Result(NAME, latent_study.SEED, commit_of(share_dir()), machine_description(), rows,
                  targets(curves))


def targets(curves):
    """What the thesis says of its figure (sec. 5.4)."""
    end = {case: float(curve[..., -1].mean()) for case, curve in curves.items()}
    fewer, more = end[100, 1] / end[100, 5], end[100, 8] / end[100, 5]
    return (Target('error with 1 assimilation over that with 5', fewer, '1', '> 1', fewer > 1.0),
            Target('error with 8 assimilations over that with 5', more, '1', '0.9 to 1.1',
                   0.9 <= more <= 1.1))


@style.styled
def draw(curves):
    """Return the figure: error in the end against N_a, a curve for each N_e."""
    figure = Figure(figsize=(5.2, 3.2), layout='constrained')
    ax = figure.subplots()
    for k, members in enumerate(MEMBERS):
        ends = [style.MM * curves[members, count][..., -1].mean() for count in ASSIMILATIONS]
        ax.plot(ASSIMILATIONS, ends, 'o-', color=style.SERIES[k], label=f'{members} members')
    ax.set_xticks(ASSIMILATIONS)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel('assimilations $N_a$')
    ax.set_ylabel('mean distance of nodes [mm]')
    ax.set_title(f'$C_d$ = {C_D:g} cm², ten pairs of unseen states')
    ax.legend()
    return figure
