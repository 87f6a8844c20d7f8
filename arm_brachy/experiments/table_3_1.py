"""Table 3.1: five targets, three tasks, open against closed loop, on a plant that is no model."""

import sys
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy import inprocess
from arm_brachy.control.goal import task as published_goal
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.random import stream
from arm_brachy.evaluation import comparison, figures, metrics, style
from arm_brachy.evaluation.assess import Goals, TaskMetrics, assess
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.evaluation.thesis import Manipulation, published_task
from arm_brachy.evaluation.timeseries import EmSamples, Series
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.scenario import load_cell, resolve

NAME = 'table-3.1'
SCENARIO = 'table_3_1.yaml'
GOALS = Goals()
LARGEST_RATIO = 0.25      # closed-loop ITAE over ours in open loop, in the median of the rows
DRAWN = ('target_1', 'target_2')   # whose time responses the thesis shows, Fig. 3.6-3.11
LOOPS = ('open', 'closed')
OPEN = style.SERIES[6]    # a colour that neither pads nor truth have


@dataclass(frozen=True)
class Row:
    """One line of the table.

    target, task : numbers of the thesis;  seed : of both runs, so that both see one noise
    numbers, runs : 'open' or 'closed' -> TaskMetrics, RunData
    """

    target: int
    task: int
    seed: int
    numbers: dict
    runs: dict

    def ours(self):
        """The row as evaluation.thesis.Manipulation, from truth."""
        mm = [style.MM * value(self.numbers[loop]) for value in (_itae, _error) for loop in LOOPS]
        return Manipulation(self.target, self.task, *mm)

    @property
    def ratio(self):
        """ITAE in closed loop over that in open loop."""
        return _itae(self.numbers['closed']) / _itae(self.numbers['open'])


def _itae(numbers: TaskMetrics):
    return numbers.itae_truth


def _error(numbers: TaskMetrics):
    return numbers.steady_truth.mean_abs


def reproduce(out_dir, scenario=None):
    """Run every task of the scenario in open and in closed loop, each from rest.

    out_dir : folder; receives table-3.1.png (ours beside the thesis') and, for targets 1 and 2,
        table-3.1-target-N.png (time responses)
    scenario : file; default config/scenarios/table_3_1.yaml
    Returns Result, a row for each task. Raises ConfigError for a task that the thesis has not.
    """
    path = Path(scenario or config_dir() / 'scenarios' / SCENARIO)
    cell = load_cell(path)
    rows = _run_all(cell, path)
    comparison.table_3_1([row.ours() for row in rows], style.MM * GOALS.steady_state_error).save(
        Path(out_dir) / f'{NAME}.png')
    for name in DRAWN:
        chosen = [row for row in rows if f'target_{row.target}' == name]
        if chosen:
            _time_response(chosen).save(Path(out_dir) / f'{NAME}-{name.replace("_", "-")}.png')
    return Result(NAME, cell.scenario.seed, commit_of(share_dir()), machine_description(),
                  tuple(_flat(row) for row in rows), _targets(rows))


def _run_all(cell, path):
    """Both loops of every task, spread over the cores; the order of rows is the scenario's."""
    tasks = cell.scenario.tasks
    numbered = [published_numbers(task) for task in tasks]
    seeds = [row_seed(cell.scenario.seed, task) for task in tasks]
    jobs = [(path, i, loop, seeds[i]) for i in range(len(tasks)) for loop in LOOPS]
    done = _in_parallel(jobs)
    return [Row(*numbered[i], seeds[i], *({loop: done[path, i, loop, seeds[i]][part]
                                           for loop in LOOPS} for part in (0, 1)))
            for i in range(len(tasks))]


def _in_parallel(jobs):
    """Job -> what run_task says of it. Each that is done says so on stderr."""
    done = {}
    with process_pool(len(jobs)) as pool:
        futures = {pool.submit(run_task, *job): job for job in jobs}
        for future in as_completed(futures):
            job = futures[future]
            done[job] = numbers, _ = future.result()
            print(f'{NAME}: {len(done)} of {len(jobs)}: {numbers.name}, {job[2]} loop, '
                  f'{style.MM * _error(numbers):.3f} mm left', file=sys.stderr)
    return done


def run_task(path, index, loop, seed):
    """Run one task of a scenario file alone, from rest; returns (TaskMetrics, RunData).

    index : of the task;  loop : 'open' or 'closed';  seed : instead of the scenario's
    Raises ConfigError if the goal is refused.
    """
    whole = load_cell(path)
    scenario = replace(whole.scenario, tasks=(whole.scenario.tasks[index],), seed=seed,
                       control=replace(whole.scenario.control, loop=loop))
    run = inprocess.run(resolve(scenario, whole.path), go_home=False)
    if not run.tasks:
        said = '; '.join(f'{o.node}: {o.message}' for o in run.outcomes)
        raise ConfigError(f'{path}: task {scenario.tasks[0].name} was not run: {said}')
    return assess(run, GOALS).tasks[0], run


def row_seed(seed, task):
    """Seed of one row: follows from the scenario's and the name of the task."""
    return int(stream(seed, task.name).integers(2**31))


def published_numbers(task):
    """(target, task) numbers of the thesis. Raises ConfigError if it has no such task."""
    target = int(task.target.rsplit('_', 1)[-1])
    axes = tuple(a in task.axes for a in 'xyz')
    for number in (1, 2, 3):
        goal = published_goal(number, task.target)
        if goal.axes == axes and np.allclose(np.array(goal.value)[goal.mask],
                                             np.array(task.displacement)[goal.mask]):
            return target, number
    raise ConfigError(f'task {task.name}: {task.displacement} m along {", ".join(task.axes)} is '
                      'none of the three tasks of Table 3.1')


def _flat(row):
    """One flat dict, units in the keys; truth unless a key says EM."""
    o, c, theirs = row.numbers['open'], row.numbers['closed'], published_task(row.target, row.task)
    mm = style.MM
    return {
        'target': row.target, 'task': row.task,
        'open_itae_mm_s2': mm * _itae(o), 'closed_itae_mm_s2': mm * _itae(c),
        'thesis_open_itae_mm_s2': theirs.open_loop_itae_mm_s2,
        'thesis_closed_itae_mm_s2': theirs.closed_loop_itae_mm_s2,
        'open_error_mm': mm * _error(o), 'closed_error_mm': mm * _error(c),
        'thesis_open_error_mm': theirs.open_loop_steady_state_error_mm,
        'open_itae_em_mm_s2': mm * o.itae_em, 'closed_itae_em_mm_s2': mm * c.itae_em,
        'open_error_em_mm': mm * o.steady_em.offset, 'closed_error_em_mm': mm * c.steady_em.offset,
        'closed_overshoot_mm': mm * c.overshoot.distance,
        'closed_settling_time_s': c.settling_time,
        'duration_s': c.duration, 'seed': row.seed}


def _targets(rows):
    worst = max(rows, key=lambda row: _error(row.numbers['closed']))
    error, limit = style.MM * _error(worst.numbers['closed']), style.MM * GOALS.steady_state_error
    ratio = float(np.median([row.ratio for row in rows]))
    return (Target(f'largest closed-loop steady-state error (target {worst.target}, task '
                   f'{worst.task})', error, 'mm', f'< {limit:g}', error < limit),
            Target('median of closed-loop over open-loop ITAE', ratio, '1',
                   f'<= {LARGEST_RATIO:g}', ratio <= LARGEST_RATIO))


def _time_response(rows):
    """Closed-loop responses of one target, a column for each task, the open loop drawn over."""
    run = joined([row.runs['closed'] for row in rows])
    plate = figures.time_response(run, run.tasks, GOALS.steady_state_error)
    panels = np.reshape(plate.figure.axes, (5, len(rows)))
    for column, row in zip(panels.T, rows, strict=True):
        _draw_open_loop(column, row.runs['open'])
    return plate


def _draw_open_loop(panels, run):
    """Truth of an open-loop run over the panels x, y, z, error of the closed-loop one."""
    task = run.tasks[0]
    true = run.truth[task.target].between(task.t_start, task.t_end)
    t, look = true.t - task.t_start, {'color': OPEN, 'linestyle': '-.', 'linewidth': 1.3}
    for k in range(3):
        panels[k].plot(t, style.MM * (true.values[:, k] - task.start[k]), **look)
    size = style.MM * metrics.magnitude(metrics.deviation(true.values, task.goal, task.axes))
    panels[3].plot(t, size, **look)
    panels[3].annotate('open loop', (t[-1], size[-1]), xytext=(0, 4), ha='right',
                       textcoords='offset points', fontsize=8.5, color=OPEN)


def joined(runs):
    """Runs one after another on one axis of time, as if recorded together: RunData.

    runs : RunData of one target with the same sensors. What a time response does not show is left
    out.
    """
    ends = np.cumsum([0.0] + [run.encoder.t[-1] for run in runs])[:-1]
    target = runs[0].tasks[0].target
    tasks = tuple(replace(task, t_start=task.t_start + dt, t_end=task.t_end + dt)
                  for run, dt in zip(runs, ends, strict=True) for task in run.tasks)
    em = [run.em[target] for run in runs]
    return replace(
        runs[0], tasks=tasks, truth={target: _chain([run.truth[target] for run in runs], ends)},
        em={target: EmSamples(_times(em, ends), *(
            np.concatenate([getattr(s, name) for s in em])
            for name in ('position', 'quality', 'status')))},
        encoder=_chain([run.encoder for run in runs], ends), command_position=None,
        pad_displacement=None, force=None)


def _chain(series, ends):
    return Series(_times(series, ends), np.concatenate([s.values for s in series]))


def _times(series, ends):
    return np.concatenate([s.t + dt for s, dt in zip(series, ends, strict=True)])
