"""The 15 tasks of Table 3.1 without a sensor in the tissue: the loop closed on each estimator.

Scene, plant, tasks and seeds are those of `table-3.1`, whose closed loop hears the EM sensor in
the target. Here the controller hears an estimator that sees markers and encoders; what counts is
where the true target comes to rest. Estimators are set up as in target_1_markers.yaml.
Test: experiments/test_estimate_feedback.py
"""

import resource
import sys
import time
from concurrent.futures import as_completed
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from arm_brachy import graph, inprocess
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.evaluation import metrics, style
from arm_brachy.evaluation.assess import Goals, assess
from arm_brachy.evaluation.estimates import held, true_at
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.experiments.table_3_1 import SCENARIO, published_numbers, row_seed
from arm_brachy.scenario import Scenario, load_cell, resolve

NAME = 'estimate-feedback'
CHOSEN = 'target_1_markers.yaml'    # the scenario whose feedback is held to the goal
# Not graph_vae: a step of it takes half a second and the controller asks every 0.1 s. Lockstep,
# which waits for it, would not show that.
FEEDBACKS = tuple(name for name in graph.ESTIMATORS if name != 'graph_vae')
LARGEST_ERROR = 0.5e-3    # m, of the true target at the end of every task
MM = style.MM
SECTIONS = ('estimation', *(f.name for f in fields(Scenario) if f.name in graph.ESTIMATORS))


@dataclass(frozen=True)
class Run:
    """One task under one feedback. SI.

    target, task : numbers of the thesis;  error : mean distance of the true target from its goal
        at the end, on the controlled axes;  itae : [m s^2], from truth
    estimate_error, sd : of the estimate itself over the task, mean distance from the truth and
        root mean variance per axis;  coverage : share of 95 % ellipsoids that hold the truth
    withheld : share of the estimator's outcomes that are not OK, by name, '' = none
    cpu : [s] of the run;  memory : [B] largest of the process
    """

    feedback: str
    target: int
    task: int
    seed: int
    error: float
    itae: float
    settling: float
    estimate_error: float = np.nan
    sd: float = np.nan
    coverage: float = np.nan
    withheld: str = ''
    cpu: float = np.nan
    memory: float = np.nan


def reproduce(out_dir, scenario=None, feedbacks=FEEDBACKS):
    """Run every task of the scenario under each feedback, each from rest.

    out_dir : folder, nothing is drawn;  scenario : file, default table_3_1.yaml
    Returns Result, a row for each task and feedback.
    """
    path = Path(scenario or config_dir() / 'scenarios' / SCENARIO)
    cell = load_cell(path)
    jobs = [(path, i, feedback) for feedback in feedbacks
            for i in range(len(cell.scenario.tasks))]
    runs = _in_parallel(jobs)
    return Result(NAME, cell.scenario.seed, commit_of(share_dir()), machine_description(),
                  tuple(_flat(run) for run in runs), _targets(runs, feedbacks, _chosen().feedback))


def _chosen():
    """The Scenario whose feedback is the default and whose estimators are set up."""
    return load_cell(config_dir() / 'scenarios' / CHOSEN).scenario


def _in_parallel(jobs):
    done = {}
    with process_pool(len(jobs)) as pool:
        futures = {pool.submit(run_task, *job): job for job in jobs}
        for future in as_completed(futures):
            job = futures[future]
            done[job] = run = future.result()
            print(f'{NAME}: {len(done)} of {len(jobs)}: {run.feedback}, target {run.target}, task '
                  f'{run.task}: {MM * run.error:.3f} mm left', file=sys.stderr)
    return [done[job] for job in jobs]


def run_task(path, index, feedback):
    """Run one task of a scenario file under one feedback; returns Run.

    Raises ConfigError if the goal is refused.
    """
    whole = load_cell(path)
    task = whole.scenario.tasks[index]
    seed = row_seed(whole.scenario.seed, task)
    scenario = replace(whole.scenario, tasks=(task,), seed=seed, feedback=feedback, estimators=(),
                       **{name: getattr(_chosen(), name) for name in SECTIONS})
    begun = time.process_time()
    run = inprocess.run(resolve(scenario, whole.path), go_home=False)
    if not run.tasks:
        said = '; '.join(f'{o.node}: {o.message}' for o in run.outcomes)
        raise ConfigError(f'{path}: task {task.name} was not run on {feedback}: {said}')
    numbers = assess(run, Goals.of(run)).tasks[0]
    own = {} if feedback == 'em' else _own_numbers(run, feedback)
    return Run(feedback, *published_numbers(task), seed, numbers.steady_truth.mean_abs,
               numbers.itae_truth, numbers.settling_time, **own,
               cpu=time.process_time() - begun,
               memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0)


def _own_numbers(run, name):
    """What the estimator said during the task, beside the truth."""
    task = run.tasks[0]
    said = run.estimates[name][task.target].between(task.t_start, task.t_end)
    error = said.points - true_at(run.truth[task.target], said.t)
    outcomes = [f'{o.outcome} {o.count}' for o in run.outcomes
                if o.node == f'{name}_estimator' and o.outcome != 'OK']
    return {'estimate_error': metrics.magnitude(error).mean(),
            'sd': np.sqrt(np.trace(said.covariance, axis1=1, axis2=2).mean() / 3.0),
            'coverage': held(error, said.covariance).mean(), 'withheld': ', '.join(outcomes)}


def _flat(run):
    return {
        'feedback': run.feedback, 'target': run.target, 'task': run.task,
        'error_mm': MM * run.error, 'itae_mm_s2': MM * run.itae, 'settling_time_s': run.settling,
        'estimate_error_mm': MM * run.estimate_error, 'claimed_sd_mm': MM * run.sd,
        'coverage_percent': 100.0 * run.coverage, 'outcomes': run.withheld, 'cpu_s': run.cpu,
        'memory_MB': run.memory / 1e6, 'seed': run.seed}


def _targets(runs, feedbacks, chosen):
    out = []
    for feedback in feedbacks:
        errors = np.array([run.error for run in runs if run.feedback == feedback])
        if not len(errors):
            continue
        goal = feedback == chosen
        out.append(Target(f'{feedback}: mean steady-state error', MM * errors.mean(), 'mm', '',
                          None))
        worst = MM * errors.max()
        out.append(Target(f'{feedback}: largest steady-state error', worst, 'mm',
                          f'< {MM * LARGEST_ERROR:g}' if goal else '',
                          bool(worst < MM * LARGEST_ERROR) if goal else None))
    return tuple(out)
