"""Every estimator on every plant, with every set of markers and seed of the noise.

    python -m arm_brachy.experiments.inside_study [ESTIMATOR ...] [--seeds 3] [--plant NAME]

prints a short table of some estimators while one is being worked on.
"""

import argparse
import functools
import sys
import time
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from arm_brachy.core.paths import run_dir
from arm_brachy.experiments import inside_estimators, inside_plants
from arm_brachy.experiments.inside_measurements import session
from arm_brachy.experiments.parallel import process_pool

SEED = 41
SEEDS = 20
# Number of markers -> which of the scene's 19. The thesis shows its second set in a photograph
# only (Fig. 4.4 b); ours is every second one, spread over all of the surface.
MARKER_SETS = {19: slice(None), 10: slice(None, None, 2)}
INSIDE_95 = float(chi2.ppf(0.95, 3))   # squared Mahalanobis distance of the 95 % ellipsoid
CACHE = 'inside-plants'   # folder beside that of the result, shared by all of these experiments


@dataclass(frozen=True)
class Scores:
    """One estimator with one set of markers on one plant; e experiments, s seeds, k targets.

    depth : (e,) [m] of the pushes
    error : (e, s, k) [m] distance of estimate and truth at the end of every push, NaN if failed
    distance : (e, s, k) squared Mahalanobis distance of the truth, NaN without a covariance
    cpu : (n,) [s] processor time of every step
    """

    depth: np.ndarray
    error: np.ndarray
    distance: np.ndarray
    cpu: np.ndarray


def run(folder, names=None, *, plants=tuple(inside_plants.PLANTS), sets=tuple(MARKER_SETS),
        seeds=SEEDS, groups=inside_plants.GROUPS):
    """Score estimators; returns {(estimator, number of markers, plant): Scores}.

    folder : of the result; solutions of the plants are kept in `inside-plants` beside it
    names : of inside_estimators.ESTIMATORS, all by default;  groups : of pads that push together
    """
    names = [e.name for e in inside_estimators.ESTIMATORS] if names is None else list(names)
    solved = {plant: tuple(push for push in pushes if push.pads in groups) for plant, pushes in
              inside_plants.plants(Path(folder).parent / CACHE, plants).items()}
    jobs = [(name, count, plant) for name in names for count in sets for plant in plants]
    done = {}
    with process_pool(len(jobs)) as pool:
        futures = {pool.submit(score, *job, solved[job[2]], seeds): job for job in jobs}
        for future in as_completed(futures):
            job = futures[future]
            done[job] = future.result()
            print(f'{len(done)} of {len(jobs)}: {job[0]}, {job[1]} markers, plant {job[2]}: '
                  f'{1e3 * np.nanmean(done[job].error):.3f} mm', file=sys.stderr)
    return {job: done[job] for job in jobs}


def score(name, count, plant, pushes, seeds):
    """Scores of one estimator on the pushes of one plant.

    name : of the estimator;  count : of markers;  plant : name;  pushes : tuple of Push
    The estimator is built on the model's scene and stepped through Sessions; true targets are
    only compared with.
    """
    estimator, markers = _built(name, count)
    real, targets = inside_plants.plant_scene(), estimator.targets
    drawn = seeds if inside_estimators.entry(name).noisy else 1
    parts, cpu = [], []
    for push in pushes:
        for k in range(drawn):
            seen = session(real, push, markers, SEED, f'{plant}/{"+".join(push.pads)}/{k}')
            estimates = _estimates(estimator, seen, cpu, inside_estimators.entry(name).memory)
            parts.append([compare(one, true) for one, true in
                          zip(estimates, push.targets[1:], strict=True)])
    table = np.array(parts).reshape(len(pushes), drawn, -1, 2, len(targets))
    table = np.moveaxis(table, 1, 2).reshape(-1, drawn, 2, len(targets))
    table = np.repeat(table, seeds // drawn, axis=1)
    depth = np.concatenate([push.q[1:].max(axis=1) for push in pushes])
    return Scores(depth, table[:, :, 0], table[:, :, 1], np.array(cpu))


@functools.lru_cache(maxsize=1)
def _built(name, count):
    """An estimator and the names of its markers, built once for all plants in a row."""
    entry, model = inside_estimators.entry(name), inside_plants.model_scene()
    markers = inside_plants.tissue_markers(model)[MARKER_SETS[count]]
    return entry.build(model, (), inside_plants.target_names(model), markers,
                       entry.params), markers


def _estimates(estimator, seen, cpu, memory):
    """Estimates at the end of every depth; the time of every step is appended to cpu.

    memory : False where the frames between need not be given; what it solved for one session
        then serves the next
    """
    if memory:
        estimator.reset()
    said = {}
    for i in range(len(seen.surfaces)) if memory else seen.ends:
        begin = time.process_time()
        said[i] = estimator.step(seen.surfaces[i])
        cpu.append(time.process_time() - begin)
    return [said[i] for i in seen.ends]


def compare(estimate, truth):
    """Distance [m] and squared Mahalanobis distance of an Estimate from truth (k, 3): (2, k)."""
    off = estimate.points - truth
    far = np.full(len(off), np.nan)
    known = np.isfinite(estimate.covariance).all(axis=(1, 2))
    far[known] = [o @ np.linalg.solve(P, o)
                  for o, P in zip(off[known], estimate.covariance[known], strict=True)]
    return np.array([np.linalg.norm(off, axis=1), far])


@dataclass(frozen=True)
class Summary:
    """What a table says of an estimator. Lengths in metres, shares in 1.

    mean, low, high : mean error and its 95 % range (quantiles 2.5 and 97.5 %)
    deepest : mean error of the deepest pushes
    coverage : share of truths inside the 95 % ellipsoid, NaN without covariance; with the 95 %
        binomial interval (Wilson 1927, J Am Stat Assoc 22:209) of as many trials as there are
        plants times experiments times targets: seeds of one push share their model error and are
        no trials of their own
    failed : share of estimates that were none
    cpu, cpu_high : [s] of one step, median and quantile 95 %
    """

    mean: float
    low: float
    high: float
    deepest: float
    coverage: float
    coverage_low: float
    coverage_high: float
    failed: float
    cpu: float
    cpu_high: float


def summary(scores):
    """Summary of a list of Scores of the same estimator."""
    error = np.stack([s.error for s in scores])
    distance = np.stack([s.distance for s in scores])
    cpu = np.concatenate([s.cpu for s in scores])
    good = error[np.isfinite(error)]
    if not good.size:
        good = np.array([np.nan])
    deep = error[:, scores[0].depth == scores[0].depth.max()]
    low, high = np.quantile(good, [0.025, 0.975])
    deep = deep[np.isfinite(deep)]
    return Summary(good.mean(), low, high, deep.mean() if deep.size else np.nan,
                   *coverage(distance), float(np.mean(~np.isfinite(error))),
                   *np.quantile(cpu, [0.5, 0.95]))


def coverage(distance):
    """Share of squared distances (..., s, k) within the ellipsoid, and its interval's ends."""
    known = np.isfinite(distance)
    if not known.any():
        return np.nan, np.nan, np.nan
    share = float(np.mean(distance[known] <= INSIDE_95))
    trials = int(known.any(axis=-2).sum())
    return share, *wilson(share, trials)


def wilson(share, trials, z=1.959964):
    """Ends of the score interval of a binomial share; z : normal quantile, 95 % by default."""
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = (z / (1 + z * z / trials)
            * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2)))
    return middle - half, middle + half


def main():
    """Print mean errors of some estimators, plant by plant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('estimators', nargs='*', default=None)
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--plant', action='append', choices=inside_plants.PLANTS)
    given = parser.parse_args()
    chosen = tuple(given.plant or inside_plants.PLANTS)
    done = run(run_dir() / 'inside', given.estimators or None, plants=chosen, seeds=given.seeds)
    for name, count in dict.fromkeys((n, c) for n, c, _ in done):
        each = [done[name, count, plant] for plant in chosen]
        s = summary(each)
        print(f'{name:16s} {count:3d} markers: mean {1e3 * s.mean:.3f} mm, 20 mm pushes '
              f'{1e3 * s.deepest:.3f} mm, covered {100 * s.coverage:.0f} %, failed '
              f'{100 * s.failed:.0f} %, cpu {1e3 * s.cpu:.1f} ms; ' + ', '.join(
                  f'{plant} {1e3 * np.nanmean(one.error):.3f}'
                  for plant, one in zip(chosen, each, strict=True)))


if __name__ == '__main__':
    main()
