"""Figure 4.7: open loop, KF-ADMM with 19 and with 10 markers, experiment by experiment."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import inside_plants, inside_study, table_4_1

NAME = 'figure-4.7'
CASES = {('open_loop', 19): ('open loop', style.SERIES[6]),
         ('kf_admm', 19): ('KF-ADMM, 19 markers', style.OURS),
         ('kf_admm', 10): ('KF-ADMM, 10 markers', style.SERIES[1])}
THESIS_MM = {('open_loop', 19): 1.7, ('kf_admm', 19): 0.8, ('kf_admm', 10): 1.1}


def reproduce(out_dir, done=None):
    """Score open loop and KF-ADMM on every plant; figure-4.7.png shows the 16 experiments.

    out_dir : folder;  done : of `inside_study.run`, computed if not given
    Returns Result, a row for each experiment.
    """
    done = done or inside_study.run(out_dir, ('open_loop', 'kf_admm'))
    done = {key: scores for key, scores in done.items() if key[0] in ('open_loop', 'kf_admm')}
    draw(done).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    return Result(NAME, inside_study.SEED, commit_of(share_dir()), machine_description(),
                  tuple(table_4_1.experiment_rows(done)), targets(done))


def means(done):
    """Case -> mean error (e,) [m] of every experiment, over plants, seeds and targets."""
    return {case: np.nanmean([s.error for s in table_4_1.over_plants(done, *case)],
                             axis=(0, 2, 3)) for case in CASES}


def targets(done):
    """The thesis' claims: fewer markers are worse, and the filter helps most at large pushes."""
    error = {case: mean.reshape(-1, len(inside_plants.DEPTHS)).mean(axis=0)
             for case, mean in means(done).items()}
    below = 100.0 * (1.0 - error['kf_admm', 19] / error['open_loop', 19])
    few = error['kf_admm', 10].mean() / error['kf_admm', 19].mean()
    return (Target('error with 10 markers over that with 19 (thesis: 1.1 / 0.8)', few, '1', '> 1',
                   bool(few > 1.0)),
            Target(f'KF-ADMM below open loop at 20 mm (at 5 mm: {below[0]:.1f} %)', below[-1],
                   '%', '> that at 5 mm', bool(below[-1] > below[0])))


@style.styled
def draw(done):
    """Return the figure: bars for each experiment, a line for the thesis' mean."""
    figure = Figure(figsize=(9.6, 4.2), layout='constrained')
    ax = figure.subplots()
    where = np.arange(len(inside_plants.EXPERIMENTS))
    for i, (case, error) in enumerate(means(done).items()):
        name, colour = CASES[case]
        ax.bar(where + 0.27 * (i - 1), style.MM * error, 0.25, color=colour, label=name)
        ax.axhline(THESIS_MM[case], color=colour, linestyle=':', linewidth=1.2)
    ax.set_xticks(where, [f'{e.number}\n{"+".join(p.removeprefix("pad_") for p in e.pads)}\n'
                          f'{style.MM * e.depth:.0f}' for e in inside_plants.EXPERIMENTS])
    ax.set_xlabel('experiment, pads, push [mm]')
    ax.set_ylabel('mean target error [mm]')
    ax.set_title('Mean over plants, seeds and targets; dotted: mean of the thesis')
    ax.legend()
    return figure
