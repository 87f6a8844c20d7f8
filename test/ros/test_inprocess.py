"""The same scenario in one process and as a graph of processes: the same numbers, to the bit."""

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.offline import load_run, with_scene
from arm_brachy.scenario import load_cell

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def differences(ours, theirs):
    """Names of the series of two RunData that differ in any bit of time or value."""
    return [name for name, a, b in _pairs(ours, theirs)
            if a.shape != b.shape or a.tobytes() != b.tobytes()]


def _pairs(a, b):
    """Yield (name, array, array) for what both hold."""
    for name in ('encoder', 'command_position', 'pad_displacement', 'force'):
        yield f'{name}.t', getattr(a, name).t, getattr(b, name).t
        yield name, getattr(a, name).values, getattr(b, name).values
    for name, series in b.truth.items():
        yield f'truth.{name}', a.truth[name].values, series.values
    for name, samples in b.em.items():
        yield f'em.{name}.t', a.em[name].t, samples.t
        yield f'em.{name}', a.em[name].position, samples.position
        yield f'em.{name}.status', a.em[name].status, samples.status
    yield 'optical', a.optical.points, b.optical.points
    for i, (mine, other) in enumerate(zip(a.tasks, b.tasks, strict=True)):
        for field in ('t_start', 't_end', 'start', 'goal', 'axes'):
            yield f'task.{i}.{field}', *(np.asarray(getattr(w, field)) for w in (mine, other))


def test_a_run_in_one_process_equals_the_recording_of_the_graph(quiet_run, short_scenario):
    cell = load_cell(short_scenario)
    recorded = with_scene(load_run(quiet_run[0] / 'bag'), cell.scene)
    ours = inprocess.run(cell, sensors=inprocess.SENSORS)
    assert len(recorded.tasks) == 1 and len(recorded.encoder) > 100
    assert differences(ours, recorded) == []
    assert [(o.node, o.outcome, o.count) for o in ours.outcomes] == \
        [(o.node, o.outcome, o.count) for o in recorded.outcomes]
