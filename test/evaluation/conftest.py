"""A made-up run and a made-up replay whose every number is known beforehand."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import Delaunay

from arm_brachy.core.random import stream
from arm_brachy.evaluation.timeseries import (
    EmSamples,
    NodeOutcome,
    PadMark,
    Regime,
    ResidualData,
    RunData,
    Series,
    TaskWindow,
    Tissue,
    TopicRecord,
)

TAU = 0.8           # s, time constant of the made-up loop
STEP = 5e-3         # m
TASK_TIME = 14.0    # s
NOISE = 0.05e-3     # m, per axis
RADIUS = 65e-3      # m, of the dome
DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
MOVES = (('task 1', (-1, 0, 0), (1, 0, 0)), ('task 2', (0, -1, 0), (0, 1, 0)),
         ('task 3', (1, 1, 0), (1, 1, 0)))


@pytest.fixture(scope='session')
def run():
    """Three closed-loop tasks with first-order responses, every optional part present."""
    return make_run()


@pytest.fixture(scope='session')
def replay():
    """Six markers on a dome that the model predicts too stiff, with known noise."""
    return make_replay()


def make_run():
    rng = stream(7, 'synthetic run')
    t = np.arange(0.0, 3 * TASK_TIME, 0.01)
    home = np.array([5e-3, -4e-3, 35e-3])
    position, tasks = _responses(t, home)
    em_t = np.arange(0.0, t[-1], 0.025)
    measured = _at(em_t, t, position) + NOISE * rng.standard_normal((len(em_t), 3))
    status = np.where(np.arange(len(em_t)) % 97 == 5, 1, 0)
    push = np.maximum(0.0, -(position - home) @ -DIRECTIONS.T) * 2.2
    force = 310.0 * push[:, :, None] * -DIRECTIONS
    tissue, pads = _dome(t, push)
    return RunData(
        'breast phantom, target 1, tasks 1 to 3', SCENARIO, 7, '3f2a91c', '2 cores, test machine',
        command='arm-brachy run config/scenarios/table_3_1_target_1.yaml --seed 7',
        recorded_at='2025-03-04 10:15 UTC', tasks=tasks, truth={'target 1': Series(t, position)},
        em={'target 1': EmSamples(em_t, measured, np.full(len(em_t), 0.1), status)},
        encoder=Series(t, np.round(push / 1e-5) * 1e-5), command_position=Series(t, push),
        pad_displacement=Series(t, push), force=Series(t, force), tissue=tissue, pads=pads,
        markers={f'marker {i}': p for i, p in enumerate(_ring(8, 0.8))}, topics=_topics(em_t),
        outcomes=(NodeOutcome('tissue_simulator', 'OK', 4200),
                  NodeOutcome('mpc_manipulator', 'OK', 419),
                  NodeOutcome('mpc_manipulator', 'STALE_INPUT', 1,
                              'em/target_1 silent for 60 ms')),
        wall_time=21.0)


def make_replay():
    rng = stream(7, 'synthetic replay')
    t = np.arange(0.0, 5.0, 0.01)
    rest = _ring(6, 0.7)
    size = 8e-3 * (1 - np.exp(-np.maximum(t - 1.0, 0) / 0.3) * np.cos(
        18 * np.maximum(t - 1.0, 0)))
    way = np.array([0.0, 0.3, -1.0])
    motion = size[:, None, None] * way * (rest[:, :1] / RADIUS + 1.2)
    predicted = rest + 0.85 * motion
    measured = rest + motion + NOISE * rng.standard_normal(motion.shape)
    measured[120:150, 2] = np.nan
    nodes, tets = _dome_mesh()
    moved = nodes + 0.85 * 8e-3 * way * (nodes[:, 2:] / RADIUS)
    return ResidualData(
        'soft dome, recording A', t, tuple(f'm{i}' for i in range(1, 7)), measured, predicted,
        rest, statement='Recording A replayed against the published scene; nothing was fitted.',
        source='synthetic', seed=7, commit='3f2a91c', machine='2 cores, test machine',
        command='arm-brachy replay A.mcap', registration=np.full(6, 0.3e-3),
        regimes=(Regime('rest', 0.0, 1.0), Regime('release', 1.0, 2.5), Regime('hold', 2.5, 5.0)),
        tissue=Tissue(np.array([0.0, 1.2]), np.stack([nodes, moved]), nodes, tets))


def without_truth(run):
    """The run as a real cell would have recorded it."""
    return dataclasses.replace(run, truth={}, tissue=None, pad_displacement=None, force=None)


def _responses(t, home):
    position, tasks, start = np.tile(home, (len(t), 1)), [], home
    for k, (name, way, axes) in enumerate(MOVES):
        goal = start + STEP * np.array(way)
        inside = t >= k * TASK_TIME
        position[inside] = goal + (start - goal) * np.exp(
            -(t[inside, None] - k * TASK_TIME) / TAU)
        tasks.append(TaskWindow(name, 'target 1', k * TASK_TIME, (k + 1) * TASK_TIME - 0.01,
                                start, goal, np.array(axes, dtype=bool)))
        start = goal
    return position, tuple(tasks)


def _at(times, t, values):
    return np.stack([np.interp(times, t, values[:, k]) for k in range(3)], axis=1)


def _ring(count, height):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    flat = np.sqrt(1 - height ** 2)
    return RADIUS * np.stack([flat * np.cos(angle), flat * np.sin(angle),
                              np.full(count, height)], axis=1)


def _dome_mesh():
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 11)] * 2, np.linspace(0, 1, 6),
                                indexing='ij'), axis=-1).reshape(-1, 3)
    inside = grid[np.linalg.norm(grid, axis=1) < 0.85]
    golden = np.pi * (3 - np.sqrt(5)) * np.arange(320)
    z = np.linspace(0, 1, 320)
    shell = np.stack([np.sqrt(1 - z ** 2) * np.cos(golden), np.sqrt(1 - z ** 2) * np.sin(golden),
                      z], axis=1)
    nodes = np.concatenate([inside, shell]) * RADIUS
    tets = Delaunay(nodes).simplices
    edges = np.swapaxes(nodes[tets[:, 1:]] - nodes[tets[:, :1]], 1, 2)
    volume = np.linalg.det(edges)
    tets = np.where((volume < 0)[:, None], tets[:, [0, 2, 1, 3]], tets)
    return nodes, tets[np.abs(volume) > 1e-12]


def _dome(t, push):
    nodes, tets = _dome_mesh()
    times = np.arange(0.0, t[-1], 3.5)
    pads = tuple(PadMark(f'pad {i + 1}', np.array([0, 0, 25e-3]) - 60e-3 * d, d)
                 for i, d in enumerate(DIRECTIONS))
    states = []
    for now in times:
        u = np.zeros_like(nodes)
        for p, pad in enumerate(pads):
            near = np.exp(-np.sum((nodes - pad.centre) ** 2, axis=1) / (28e-3) ** 2)
            u += np.interp(now, t, push[:, p]) * near[:, None] * pad.direction
        states.append(nodes + u * np.minimum(nodes[:, 2:] / 25e-3, 1.0))
    return Tissue(times, np.array(states), nodes, tets), pads


def _topics(em_t):
    end = 3 * TASK_TIME
    steady = (('em/target_1/pose', 'geometry_msgs/PoseStamped', 40.0),
              ('optical/frame', 'arm_brachy_msgs/OpticalFrame', 100.0),
              ('actuators/state', 'sensor_msgs/JointState', 100.0),
              ('actuators/command', 'arm_brachy_msgs/ActuatorCommand', 10.0),
              ('truth/tissue', 'arm_brachy_msgs/TissueState', 10.0))
    records = [TopicRecord(name, kind, np.arange(0.0, end, 1 / rate),
                           int(np.ceil(round(end * rate, 6)))) for name, kind, rate in steady]
    stalled = records[1].stamps
    keep = (stalled < 20.0) | (stalled > 21.2)
    records[1] = dataclasses.replace(records[1], stamps=stalled[keep], published=len(stalled))
    goal_times = np.array([0.0, TASK_TIME, 2 * TASK_TIME])
    return (*records, TopicRecord('manipulation/goal', 'arm_brachy_msgs/Goal', goal_times))


SCENARIO = """name: table_3_1_target_1
seed: 7
scene: breast_phantom
plant:
  material: {E_kPa: 6.0, nu: 0.49}
  terms: [{stiffness_scale: 1.2}]
controller: {horizon: 5, retraction: false}
"""
