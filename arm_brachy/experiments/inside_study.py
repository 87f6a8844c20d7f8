"""Every estimator on every plant, with every set of markers and seed of the noise.

    python -m arm_brachy.experiments.inside_study [ESTIMATOR ...] [--seeds 3] [--plant NAME]

prints a short table of some estimators while one is being worked on.
"""

import argparse
import functools
import sys
import time
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from arm_brachy.core.paths import run_dir
from arm_brachy.experiments import (
    inside_estimators,
    inside_measurements,
    inside_plants,
    kept_scores,
)
from arm_brachy.experiments.inside_measurements import session
from arm_brachy.experiments.parallel import process_pool

SEED = 41
SEEDS = 20
# Number of markers -> which of the scene's 19. The thesis shows its second set in a photograph
# only (Fig. 4.4 b); ours is every second one, spread over all of the surface.
MARKER_SETS = {19: slice(None), 10: slice(None, None, 2)}
INSIDE_95 = float(chi2.ppf(0.95, 3))   # squared Mahalanobis distance of the 95 % ellipsoid
# folders beside that of the result, shared by all of these experiments: plants, and Scores
CACHE, KEPT = 'inside-plants', 'inside-scores'


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

    folder : of the result; solutions of the plants are kept in `inside-plants` beside it, scores
        in `inside-scores`, which hold as long as nothing changes that they depend on
    names : of inside_estimators.ESTIMATORS, all by default;  groups : of pads that push together
    """
    names = [e.name for e in inside_estimators.ESTIMATORS] if names is None else list(names)
    solved = {plant: tuple(push for push in pushes if push.pads in groups) for plant, pushes in
              inside_plants.plants(Path(folder).parent / CACHE, plants).items()}
    kept = {(name, count, plant): Path(folder).parent / KEPT / _file(
        name, count, plant, solved[plant], seeds) for name in names for count in sets
        for plant in plants}
    done = {case: found for case, path in kept.items()
            if (found := kept_scores.read(path, Scores)) is not None}
    jobs = [(name, count, part) for name in names for count in sets for part in (
        [(plant,) for plant in plants] if inside_estimators.entry(name).memory else [plants])
        if any((name, count, plant) not in done for plant in part)]
    print(f'{len(done)} of {len(kept)} scores are kept from before', file=sys.stderr)
    with process_pool(max(len(jobs), 1)) as pool:
        futures = {pool.submit(scores_of, name, count, {p: solved[p] for p in part}, seeds):
                   (name, count) for name, count, part in jobs}
        for i, future in enumerate(as_completed(futures)):
            name, count = futures[future]
            for plant, found in future.result().items():
                done[name, count, plant] = found
                kept_scores.write(kept[name, count, plant], found)
                print(f'{i + 1} of {len(jobs)}: {name}, {count} markers, plant {plant}: '
                      f'{1e3 * np.nanmean(found.error):.3f} mm', file=sys.stderr)
    return {(name, count, plant): done[name, count, plant]
            for name in names for count in sets for plant in plants}


def _file(name, count, plant, pushes, seeds):
    """Name of the file in which a job's Scores are kept."""
    entry = inside_estimators.entry(name)
    modules, own = (entry.build.__module__, inside_measurements.__name__), Path(__file__)
    pushed = [(push.pads, push.q.tobytes(), push.markers.tobytes(), push.targets.tobytes())
              for push in pushes]
    said = kept_scores.key(modules, own.read_text(encoding='utf-8'),
                           entry.params, count, seeds, pushed)
    return f'{name}-{count}-{plant}-{said}.npz'


def score(name, count, plant, pushes, seeds):
    """Scores of one estimator on the pushes of one plant; arguments as `scores_of`."""
    return scores_of(name, count, {plant: pushes}, seeds)[plant]


def scores_of(name, count, solved, seeds):
    """Scores of one estimator on the pushes of plants that are pushed alike: plant -> Scores.

    name : of the estimator;  count : of markers;  solved : plant -> tuple of Push
    The estimator is built on the model's scene and stepped through Sessions; true targets are
    only compared with.
    """
    estimator, markers = _built(name, count)
    entry = inside_estimators.entry(name)
    drawn = seeds if entry.noisy else 1
    parts, cpu = {plant: [] for plant in solved}, {plant: [] for plant in solved}
    for pushes in zip(*solved.values(), strict=True):
        seen = [(plant, session(inside_plants.plant_scene(), push, markers, SEED,
                                f'{plant}/{"+".join(push.pads)}/{k}'))
                for plant, push in zip(solved, pushes, strict=True) for k in range(drawn)]
        times = [cpu[plant] for plant, _ in seen]
        said = (_all_along if entry.memory else _at_the_ends)(
            estimator, [one for _, one in seen], times)
        for (plant, _), each in zip(seen, said, strict=True):
            true = dict(zip(solved, pushes, strict=True))[plant].targets[1:]
            parts[plant].append([compare(*pair) for pair in zip(each, true, strict=True)])
    return {plant: _scores(pushes, parts[plant], drawn, seeds, cpu[plant])
            for plant, pushes in solved.items()}


def _scores(pushes, parts, drawn, seeds, cpu):
    table = np.array(parts)     # (pushes x drawn, depths, 2, k)
    table = table.reshape(len(pushes), drawn, -1, *table.shape[-2:])
    table = np.moveaxis(table, 1, 2).reshape(-1, drawn, *table.shape[-2:])
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


def _all_along(estimator, seen, times):
    """Estimates at the end of every depth of each Session; steps' times are appended to times."""
    said = []
    for one, cpu in zip(seen, times, strict=True):
        estimator.reset()
        every = [_timed(estimator, surface, cpu) for surface in one.surfaces]
        said.append([every[i] for i in one.ends])
    return said


def _at_the_ends(estimator, seen, times):
    """The same of an estimator without memory: a depth at a time, one Session after the other."""
    estimator.reset()
    said = [[] for _ in seen]
    for d in range(len(seen[0].ends)):
        for k, (one, cpu) in enumerate(zip(seen, times, strict=True)):
            surface = replace(one.surfaces[one.ends[d]], t=float(1 + d * len(seen) + k))
            said[k].append(_timed(estimator, surface, cpu))
    return said


def _timed(estimator, surface, cpu):
    begin = time.process_time()
    said = estimator.step(surface)
    cpu.append(time.process_time() - begin)
    return said


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
