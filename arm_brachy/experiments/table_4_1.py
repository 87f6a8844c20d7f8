"""Table 4.1: 16 experiments, two sets of markers, every estimator, on plants that are no model."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import inside_estimators, inside_plants, inside_study

NAME = 'table-4.1'
KF_BELOW_OPEN_LOOP = 52.0   # %, conclusion 3 of the thesis' chapter 4
COVERAGE = (93.0, 97.0)     # %, of 95 % ellipsoids


def reproduce(out_dir, names=None, program=None, done=None):
    """Score every estimator; table-4.1.png receives the mean errors.

    out_dir : folder;  names : of estimators, all by default
    program : keyword arguments of `inside_study.run`;  done : what it returned, if run already
    Returns Result: a row for each estimator and set of markers over all plants, then plant by
    plant, then experiment by experiment.
    """
    done = done or inside_study.run(out_dir, names, **(program or {}))
    draw(done).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    return Result(NAME, inside_study.SEED, commit_of(share_dir()), machine_description(),
                  (*summary_rows(done), *plant_rows(done), *experiment_rows(done)),
                  targets(done))


def cases(done):
    """(estimator, number of markers) pairs, in order; one for an estimator without markers."""
    return [(name, count) for name, count in dict.fromkeys((n, c) for n, c, _ in done)
            if inside_estimators.entry(name).noisy or count == _first(done, name)]


def _first(done, name):
    return next(count for n, count, _ in done if n == name)


def over_plants(done, name, count):
    """Scores of one estimator and set of markers, plant after plant."""
    return [scores for (n, c, _), scores in done.items() if (n, c) == (name, count)]


def summary_rows(done):
    """One row for each estimator and set of markers."""
    means = {case: inside_study.summary(over_plants(done, *case)) for case in cases(done)}
    loop = next((s.mean for (name, _), s in means.items() if name == 'open_loop'), np.nan)
    return [_summary_row(name, count, s, loop) for (name, count), s in means.items()]


def _summary_row(name, count, s, loop):
    mm, entry = style.MM, inside_estimators.entry(name)
    return {'estimator': name, 'markers': count if entry.noisy else 0,
            'mean_error_mm': mm * s.mean,
            'thesis_mean_error_mm': entry.thesis.get(count, np.nan),
            'quantile_2.5_mm': mm * s.low, 'quantile_97.5_mm': mm * s.high,
            'mean_at_20_mm_pushes_mm': mm * s.deepest,
            'below_open_loop_percent': 100.0 * (1.0 - s.mean / loop),
            'in_95_ellipsoid_percent': 100.0 * s.coverage,
            'interval_low_percent': 100.0 * s.coverage_low,
            'interval_high_percent': 100.0 * s.coverage_high,
            'failed_percent': 100.0 * s.failed, 'cpu_ms': 1e3 * s.cpu,
            'cpu_quantile_95_ms': 1e3 * s.cpu_high}


def plant_rows(done):
    """Mean error plant by plant."""
    plants = list(dict.fromkeys(plant for _, _, plant in done))
    return [{'estimator': name, 'markers': count if inside_estimators.entry(name).noisy else 0}
            | {f'plant_{plant}_mm': style.MM * float(np.nanmean(done[name, count, plant].error))
               for plant in plants} for name, count in cases(done)]


def experiment_rows(done):
    """Mean error experiment by experiment, over plants, seeds and targets."""
    errors = {case: np.nanmean([s.error for s in over_plants(done, *case)], axis=(0, 2, 3))
              for case in cases(done)}
    return [{'experiment': e.number, 'pads': '+'.join(p.removeprefix('pad_') for p in e.pads),
             'push_mm': style.MM * e.depth}
            | {label(*case) + '_mm': style.MM * float(error[i]) for case, error in errors.items()}
            for i, e in enumerate(inside_plants.EXPERIMENTS)]


def label(name, count):
    """'kf_admm_19'; without markers the name alone."""
    return f'{name}_{count}' if inside_estimators.entry(name).noisy else name


def targets(done):
    """What the thesis says of KF-ADMM, and what ellipsoids promise, where these were run."""
    means = {case: inside_study.summary(over_plants(done, *case)) for case in cases(done)}
    loop = next((s.mean for (name, _), s in means.items() if name == 'open_loop'), None)
    goals = []
    if loop and ('kf_admm', 19) in means:
        below = 100.0 * (1.0 - means['kf_admm', 19].mean / loop)
        goals.append(Target('KF-ADMM with 19 markers below open loop', below, '%',
                            f'>= {KF_BELOW_OPEN_LOOP:g}', below >= KF_BELOW_OPEN_LOOP))
    goals += [_covered(name, count, s) for (name, count), s in means.items()
              if np.isfinite(s.coverage)]
    return tuple(goals)


def _covered(name, count, s):
    low, high = COVERAGE
    share = 100.0 * s.coverage
    return Target(f'truths in the 95 % ellipsoids of {name}, {count} markers (95 % interval '
                  f'{100 * s.coverage_low:.1f} to {100 * s.coverage_high:.1f})', share, '%',
                  f'{low:g} to {high:g}', bool(low <= share <= high))


@style.styled
def draw(done):
    """Return the figure: mean error and 95 % range of every case, each plant's mean as a dot."""
    shown = cases(done)
    figure = Figure(figsize=(7.2, 1.6 + 0.36 * len(shown)), layout='constrained')
    ax = figure.subplots()
    plants = list(dict.fromkeys(plant for _, _, plant in done))
    for y, (name, count) in enumerate(shown):
        s, mm = inside_study.summary(over_plants(done, name, count)), style.MM
        ax.plot([mm * s.low, mm * s.high], [y, y], color=style.MEASURED, linewidth=5,
                solid_capstyle='butt', label='95 % of errors' if y == 0 else None)
        ax.plot(mm * s.mean, y, 'D', color=style.OURS, markersize=6,
                label='mean' if y == 0 else None)
        for i, plant in enumerate(plants):
            ax.plot(mm * np.nanmean(done[name, count, plant].error), y, 'o', markersize=3.5,
                    color=style.colour(i + 1), label=f'plant {plant}' if y == 0 else None)
        theirs = inside_estimators.entry(name).thesis.get(count)
        if theirs is not None:
            ax.plot(theirs, y, 'x', color=style.INK, markersize=7, markeredgewidth=2,
                    label='thesis, mean' if y == 0 else None)
    ax.set_yticks(range(len(shown)), [_title(*case) for case in shown])
    ax.invert_yaxis()
    ax.set_xlim(left=0.0)
    ax.set_xlabel('target error [mm]')
    ax.set_title('Targets inside the tissue: 16 pushes on each plant')
    figure.legend(loc='outside lower center', ncols=4)
    return figure


def _title(name, count):
    plain = name.replace('_', ' ')
    return f'{plain}, {count} markers' if inside_estimators.entry(name).noisy else plain
