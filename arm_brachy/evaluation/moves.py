"""Prescribed moves of a recording: when each began and ended, how far, how hard."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.evaluation import metrics
from arm_brachy.evaluation.timeseries import MoveWindow, Regime

MM = 1e3
ACTIVE, DONE, REFUSED = 2, 3, 4   # arm_brachy_msgs/TaskState


@dataclass(frozen=True)
class MoveMetrics:
    """Numbers of one move, SI.

    duration : [s];  deepest : largest encoder position of any pad [m]
    pad_travel : (p,) [m];  peak_force : (p,) [N];  made : the pads arrived
    NaN or empty where nothing was recorded.
    """

    name: str
    duration: float
    deepest: float
    pad_travel: np.ndarray
    peak_force: np.ndarray
    made: bool


def move_windows(events):
    """MoveWindow of every move that is over, from what was said of it.

    events : in order of time, each with t [s], status (arm_brachy_msgs/TaskState), name of the
        move, message
    """
    windows, phases = [], []
    for event in events:
        if event.status in (DONE, REFUSED):
            ends = [*(p.t for p in phases[1:]), event.t]
            regimes = tuple(Regime(p.message, p.t, end)
                            for p, end in zip(phases, ends, strict=True) if end > p.t)
            begin = phases[0].t if phases else event.t
            windows.append(MoveWindow(event.name, begin, event.t, regimes, event.status == DONE,
                                      event.message))
            phases = []
        elif event.status == ACTIVE or phases:
            phases.append(event)
    return tuple(windows)


def move_metrics(run, window):
    """MoveMetrics of one MoveWindow of a RunData."""
    span = window.t_start, window.t_end
    encoder = None if run.encoder is None else run.encoder.between(*span).values
    force = None if run.force is None else run.force.between(*span).values
    seen = encoder is not None and encoder.size > 0
    return MoveMetrics(
        window.name, window.t_end - window.t_start,
        float(encoder.max()) if seen else np.nan,
        metrics.pad_travel(encoder) if seen else np.zeros(0),
        np.zeros(0) if force is None else metrics.peak_force(force), window.made)


def move_rows(moves):
    """One flat dict per MoveMetrics, units in the keys."""
    return tuple({
        'move': move.name, 'duration_s': move.duration, 'deepest_mm': move.deepest * MM,
        'pad_travel_mm': float(move.pad_travel.sum()) * MM if len(move.pad_travel) else np.nan,
        'peak_force_N': float(move.peak_force.max()) if len(move.peak_force) else np.nan,
        'made': move.made} for move in moves)
