"""A run -> its numbers: the metrics of every task and stream, and whether the goals were met."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.evaluation import deformation, metrics
from arm_brachy.evaluation.estimates import estimate_metrics, estimate_rows
from arm_brachy.evaluation.moves import move_metrics, move_rows
from arm_brachy.evaluation.procedure_metrics import (
    ProcedureMetrics,
    assess_procedure,
    procedure_row,
    procedure_targets,
)
from arm_brachy.evaluation.result import Result, Target

MM = 1e3


@dataclass(frozen=True)
class Goals:
    """What a run is held to.

    steady_state_error : [m] largest allowed mean |e| at the end of a closed-loop task; it is also
        the band of the settling time. 0.3 mm is less than the smallest open-loop error of the
        thesis, 0.36 mm (Table 3.1, target 1, task 2). Without a sensor in the tissue 0.5 mm: what
        an estimator's error at the goal is to stay below
    window : [s] over which the end of a task is averaged
    """

    steady_state_error: float = 0.3e-3
    window: float = 2.0

    @classmethod
    def of(cls, run):
        """What a RunData is held to."""
        return cls() if run.feedback == 'em' else cls(steady_state_error=0.5e-3)


@dataclass(frozen=True)
class TaskMetrics:
    """Numbers of one task, SI. `_truth` is NaN without truth, `_em` without measurements.

    overshoot, rise_time and settling_time are taken from truth where there is one, from the EM
    measurement otherwise; `response_from` says which ('truth' or 'EM').
    """

    name: str
    target: str
    mode: str
    duration: float
    itae_em: float
    itae_truth: float
    steady_em: metrics.SteadyState
    steady_truth: metrics.SteadyState
    overshoot: metrics.Overshoot
    rise_time: float
    settling_time: float
    pad_travel: np.ndarray
    peak_force: np.ndarray
    response_from: str

    @property
    def steady_state_error(self):
        """Mean |e| at the end [m], from truth if there is one, else from EM."""
        steady = self.steady_truth if self.response_from == 'truth' else self.steady_em
        return steady.mean_abs


@dataclass(frozen=True)
class RunMetrics:
    """Numbers of a run.

    tasks : TaskMetrics;  moves : moves.MoveMetrics;  estimates : estimates.EstimateMetrics
    streams : topic -> metrics.StreamQuality
    deformation : deformation.Deformation at the snapshot deformed most, or None
    deformed_at : index of that snapshot;  real_time_factor : simulated s per s; NaN if unknown
    targets : result.Target, the goals and whether they were met
    procedure : procedure_metrics.ProcedureMetrics of a run with one
    """

    tasks: tuple
    moves: tuple
    streams: dict
    deformation: deformation.Deformation | None
    deformed_at: int
    real_time_factor: float
    goals: Goals
    targets: tuple
    estimates: tuple = ()
    procedure: ProcedureMetrics | None = None

    @property
    def lost(self):
        """Messages published and not recorded, over the streams that count."""
        return sum(q.lost for q in self.streams.values() if q.lost is not None)


def assess(run, goals=None):
    """Evaluate a run (timeseries.RunData) against `goals`, None = Goals.of(run).

    Returns RunMetrics.
    """
    goals = Goals.of(run) if goals is None else goals
    tasks = tuple(_task(run, window, goals) for window in run.tasks)
    moves = tuple(move_metrics(run, window) for window in run.moves)
    streams = {r.topic: metrics.stream_quality(r.stamps, r.published) for r in run.topics}
    index, shape = (-1, None)
    if run.tissue is not None and len(run.tissue.t):
        index, shape = deformation.largest_deformation(run.tissue)
    first, last = run.span()
    probe = None if run.procedure is None else assess_procedure(
        run.procedure, run.truth.get(run.procedure.target), run.tissue)
    return RunMetrics(tasks, moves, streams, shape, index,
                      metrics.real_time_factor(last - first, run.wall_time), goals,
                      (*_done('tasks done', len(tasks), run.tasks_planned),
                       *_done('moves made', sum(move.made for move in moves), run.moves_planned),
                       *(() if probe is None else procedure_targets(probe)),
                       *_targets(tasks, streams, goals)), estimate_metrics(run), probe)


def task_rows(tasks):
    """One flat dict per task, units in the keys; `itae_*_mm_s2` is millimetre times s squared."""
    return tuple(_row(task) for task in tasks)


def stream_rows(streams):
    """One flat dict per topic, units in the keys."""
    return tuple({'topic': topic, 'count': q.count, 'lost': q.lost, 'rate_Hz': q.rate,
                  'jitter_ms': q.jitter * 1e3, 'longest_gap_ms': q.longest_gap * 1e3}
                 for topic, q in streams.items())


def to_result(run, numbers):
    """The run's tasks or moves, and goals, in the common JSON form."""
    return Result(run.name, run.seed, run.commit, run.machine,
                  (*task_rows(numbers.tasks), *move_rows(numbers.moves),
                   *(() if numbers.procedure is None else (procedure_row(numbers.procedure),))),
                  numbers.targets)


def estimates_to_result(run, numbers):
    """What the run's estimators said beside the truth, in the common JSON form."""
    return Result(f'{run.name}: estimates', run.seed, run.commit, run.machine,
                  estimate_rows(numbers.estimates), ())


def _task(run, window, goals):
    measured = _samples(run.em, window, lambda samples: samples.tracked())
    true = _samples(run.truth, window, lambda series: series)
    if measured is None and true is None:
        raise InputError(f'task {window.name!r}: neither EM samples nor truth of target '
                         f'{window.target!r} between {window.t_start} and {window.t_end} s')
    source = 'EM' if true is None else 'truth'
    response = measured if true is None else true
    way = (window.start, window.goal, window.axes)
    error = metrics.deviation(response.values, window.goal, window.axes)
    return TaskMetrics(
        window.name, window.target, window.mode, window.t_end - window.t_start,
        *_itae_pair(measured, true, window), *_steady_pair(measured, true, window, goals),
        metrics.overshoot(response.values, *way),
        metrics.rise_time(response.t, response.values, *way),
        metrics.settling_time(response.t, error, goals.steady_state_error),
        _of_window(run.encoder, window, metrics.pad_travel),
        _of_window(run.force, window, metrics.peak_force), source)


def _samples(streams, window, take):
    """The target's samples inside the window, or None if there are none."""
    if window.target not in streams:
        return None
    inside = take(streams[window.target]).between(window.t_start, window.t_end)
    return inside if len(inside) else None


def _itae_pair(measured, true, window):
    """ITAE from EM and from truth, time counted from the start of the window."""
    return [np.nan if s is None else metrics.itae(
        s.t, metrics.deviation(s.values, window.goal, window.axes), t_start=window.t_start)
        for s in (measured, true)]


def _steady_pair(measured, true, window, goals):
    none = metrics.SteadyState(np.nan, np.nan, np.nan)
    return [none if s is None else metrics.steady_state(
        s.t, metrics.deviation(s.values, window.goal, window.axes), goals.window)
        for s in (measured, true)]


def _of_window(series, window, number):
    if series is None:
        return np.zeros(0)
    return number(series.between(window.t_start, window.t_end).values)


def _row(task):
    return {
        'task': task.name, 'target': task.target, 'mode': task.mode,
        'duration_s': task.duration,
        'itae_em_mm_s2': task.itae_em * MM, 'itae_truth_mm_s2': task.itae_truth * MM,
        'steady_state_error_truth_mm': task.steady_truth.mean_abs * MM,
        'steady_state_error_em_mm': task.steady_em.mean_abs * MM,
        'steady_state_offset_em_mm': task.steady_em.offset * MM,
        'overshoot_mm': task.overshoot.distance * MM,
        'overshoot_percent': task.overshoot.fraction * 100.0,
        'rise_time_s': task.rise_time, 'settling_time_s': task.settling_time,
        'pad_travel_mm': float(task.pad_travel.sum()) * MM if len(task.pad_travel) else np.nan,
        'peak_force_N': float(task.peak_force.max()) if len(task.peak_force) else np.nan,
    }


def _done(name, count, planned):
    """The goal that all that was planned took place; none if nothing was."""
    return () if planned is None else (
        Target(name, count, '1', f'= {planned}', count == planned),)


def _targets(tasks, streams, goals):
    limit = goals.steady_state_error * MM
    reached = [Target(f'{task.name}: steady-state error ({task.response_from})',
                      task.steady_state_error * MM, 'mm', f'< {limit:g}',
                      bool(task.steady_state_error < goals.steady_state_error))
               for task in tasks if task.mode == 'closed_loop']
    counted = [q.lost for q in streams.values() if q.lost is not None]
    if streams:
        reached.append(Target('messages lost', sum(counted) if counted else np.nan, '1', '= 0',
                              sum(counted) == 0 if counted else None))
    return tuple(reached)
