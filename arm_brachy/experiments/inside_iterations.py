"""Target error against iterations, with and without the filter: figures 4.5 and 4.6.

As in the thesis: experiments 4, 8, 12 and 16, pads 20 mm in at once, the body at rest before.
"""

import sys
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy.estimation.estimate import Surface
from arm_brachy.estimation.kf_admm import KfAdmm, KfAdmmParams
from arm_brachy.experiments import inside_plants, inside_study
from arm_brachy.experiments.inside_measurements import session
from arm_brachy.experiments.parallel import process_pool

ITERATIONS = 500
EXPERIMENTS = (4, 8, 12, 16)
# Within so much of what it ends at, for good: "the rate of decrease significantly decreases"
# (thesis sec. 4.4.1) gives no number.
NEAR = 0.1e-3   # m
THESIS = {'admm': 500, 'kf_admm_19': 200}


@dataclass(frozen=True)
class Trace:
    """Mean error of the five targets [m] after every iteration.

    errors : experiment -> (plants, iterations)
    """

    method: str
    errors: dict

    def mean(self, experiment):
        """(iterations,) over the plants."""
        return self.errors[experiment].mean(axis=0)

    def converged(self, experiment):
        """Iterations after which the mean stays within NEAR of its last value."""
        mean = self.mean(experiment)
        away = np.flatnonzero(np.abs(mean - mean[-1]) > NEAR)
        return int(away[-1]) + 2 if len(away) else 1


def run(folder, counts, iterations=ITERATIONS, plants=tuple(inside_plants.PLANTS)):
    """Traces of plain ADMM and of KF-ADMM with each number of markers; method -> Trace.

    folder : of the result;  counts : of inside_study.MARKER_SETS
    """
    solved = inside_plants.plants(Path(folder).parent / inside_study.CACHE, plants)
    jobs = [(0, None)] + [(count, plant) for count in counts for plant in plants]
    done = {}
    with process_pool(len(jobs)) as pool:
        futures = {pool.submit(trace, count, solved, plant, iterations): (count, plant)
                   for count, plant in jobs}
        for future in as_completed(futures):
            done[futures[future]] = future.result()
            print(f'{len(done)} of {len(jobs)} traces', file=sys.stderr)
    plain = {e: done[0, None][e].reshape(len(plants), -1) for e in EXPERIMENTS}
    traces = {'admm': Trace('admm', plain)}
    for count in counts:
        errors = {e: np.vstack([done[count, plant][e] for plant in plants]) for e in EXPERIMENTS}
        traces[f'kf_admm_{count}'] = Trace(f'kf_admm_{count}', errors)
    return traces


def trace(count, solved, plant, iterations):
    """Errors of one method in every experiment: experiment -> (iterations,) or (plants, ...).

    count : of markers, 0 = plain ADMM, which sees no plant: compared with all of them
    solved : plant -> tuple of Push;  plant : name, or None with count 0
    """
    model = inside_plants.model_scene()
    names = inside_plants.tissue_markers(model)[inside_study.MARKER_SETS[count or 19]]
    params = replace(KfAdmmParams(), iterations=1, **(
        {} if count else {'measurement_variance': np.inf}))
    estimator = KfAdmm(model, (), inside_plants.target_names(model), names, params)
    errors = {}
    for g, number in enumerate(EXPERIMENTS):
        push = next(iter(solved.values()))[g] if plant is None else solved[plant][g]
        points = _points(estimator, push, names, plant, iterations)
        truths = [solved[p][g].targets[-1] for p in (solved if plant is None else [plant])]
        errors[number] = np.array([np.linalg.norm(points - truth, axis=2).mean(axis=1)
                                   for truth in truths])
    return errors


def _points(estimator, push, names, plant, iterations):
    """(iterations, k, 3) estimates; a new frame of the tracker at every tick."""
    seen = session(inside_plants.plant_scene(), push, names, inside_study.SEED,
                   f'{plant}/{"+".join(push.pads)}/0')
    frames = seen.surfaces[seen.ends[-2] + 1:]   # at the deepest push
    every = KfAdmmParams().iterations
    estimator.reset()
    points = []
    for i in range(iterations):
        frame = frames[(i // every) % len(frames)]
        points.append(estimator.step(Surface(float(i), push.q[-1], frame.markers,
                                             frame.frame_covariance)).points)
    return np.array(points)


def rows(traces):
    """A row for each experiment and method."""
    return tuple({'experiment': e, 'method': t.method,
                  'error_after_10_iterations_mm': 1e3 * float(t.mean(e)[9]),
                  'error_at_end_mm': 1e3 * float(t.mean(e)[-1]),
                  'converged_after_iterations': t.converged(e),
                  'thesis_converged_after_iterations': THESIS.get(t.method)}
                 for e in EXPERIMENTS for t in traces.values())


def slowest(one):
    """Iterations that the slowest experiment of a Trace takes to converge."""
    return max(one.converged(e) for e in EXPERIMENTS)
