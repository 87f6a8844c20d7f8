"""A laboratory made of formulas: real device models around a body whose answer is written down.

No tissue solver takes part. A marker follows every pad with a weight that falls off with distance,
a little more than in proportion; a pad is pushed back by k q + k2 q^2, part of which relaxes.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from arm_brachy.cell import pad_directions
from arm_brachy.core.scene import Marker, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.core.term import Stage
from arm_brachy.devices.actuator import SimulatedBank
from arm_brachy.devices.actuator_driver import ActuatorParams
from arm_brachy.devices.em_tracker import EmTracker, EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams, OpticalTracker
from arm_brachy.diagnosis.isolation.isolate import structure_of
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.evaluation.timeseries import EmSamples, OpticalFrames, RunData, Series
from arm_brachy.offline import with_scene
from arm_brachy.registry import parse_terms, split

RADIUS = 0.06     # m
REACH = 0.03      # m, how far a push is felt
TICK = 0.02       # s
REST = 2.0        # s before and after
STIFFNESS, STIFFENING = 300.0, 1.5e4     # N/m, N/m^2
RELAXING, MEMORY = 0.2, 1.5              # share, s


def on_dome(azimuth, height, radius=RADIUS):
    """A point of the hemisphere [m]."""
    a, across = np.radians(azimuth), np.sqrt(radius ** 2 - height ** 2)
    return np.array([across * np.cos(a), across * np.sin(a), height])


def make_scene():
    """Three pads, one marker on each, twelve on the tissue, three on the base, two EM targets."""
    pads, markers = [], []
    for i, azimuth in enumerate((0.0, 120.0, 240.0)):
        centre = on_dome(azimuth, 0.03)
        pads.append(PadPatch(f'pad_{i}', tuple(centre), tuple(-centre / RADIUS), 0.01, 0.02))
        markers.append(Marker(f'pad_{i}', tuple(1.2 * centre), f'pad_{i}'))
    for i in range(12):
        height = (0.015, 0.035, 0.05)[i % 3]
        markers.append(Marker(f'tissue_{i}', tuple(on_dome(30.0 * i + 15.0, height)), 'tissue'))
    for i, place in enumerate(((0.085, 0.05, 0.0), (-0.085, 0.05, 0.0), (0.0, -0.09, 0.0))):
        markers.append(Marker(f'base_{i}', place, 'base'))
    targets = (Target('deep', (0.005, 0.0, 0.025)), Target('high', (-0.01, 0.01, 0.04)))
    return Scene('formulas', MeshFile('none.msh'), Region('half_space'), pads=tuple(pads),
                 markers=tuple(markers), targets=targets)


def protocol(pads=(0, 1, 2), amplitudes=(4e-3, 8e-3), speeds=(0.005, 0.02), hold=0.6):
    """Pushes [(q (3,), speed, hold), ...]: single pads out and back, then pairs."""
    moves = []
    for speed in speeds:
        for amplitude in amplitudes:
            for pad in pads:
                moves += _there_and_back(amplitude * np.eye(3)[pad], speed, hold)
    if len(pads) > 1:
        for pad in pads:
            both = 5e-3 * (np.eye(3)[pad] + np.eye(3)[(pad + 1) % 3])
            moves += _there_and_back(both, speeds[-1], hold)
    return moves


def short_protocol():
    """Every pad once, two pairs, fast: 20 s."""
    one = np.eye(3)
    return [leg for q in (8e-3 * one[0], 6e-3 * one[1], 4e-3 * one[2], 4e-3 * (one[0] + one[1]),
                          6e-3 * (one[1] + one[2])) for leg in _there_and_back(q, 0.02, 0.5)]


def _there_and_back(q, speed, hold):
    return [(q, speed, hold), (0.5 * q, speed, 0.5 * hold), (q, speed, 0.5 * hold),
            (np.zeros(3), speed, hold)]


class Laboratory:
    """Runs a protocol and records it; terms of the registry act in the devices."""

    def __init__(self, terms=(), seed=1, *, relaxing=RELAXING, stiffening=STIFFENING,
                 optical=None, em=None, force=None, disturb=None, markers=()):
        """disturb : (t, names, points (k, 3)) -> points, what happens to the scene itself

        markers : Marker each, besides those of the scene
        """
        scene = make_scene()
        self.scene = replace(scene, markers=(*scene.markers, *markers))
        self._relaxing, self._stiffening = relaxing, stiffening
        rng = np.random.default_rng(seed)
        by = split(terms)
        self.directions = pad_directions(self.scene)
        names = tuple(p.name for p in self.scene.pads)
        moving = by[Stage.SETPOINT] + by[Stage.TRANSMISSION] + by[Stage.ENCODER]
        self._bank = SimulatedBank(names, [p.stroke for p in self.scene.pads],
                                   ActuatorParams(effort_noise=0.0), moving,
                                   rng.spawn(1)[0], homed=True)
        self._markers = tuple(m.name for m in self.scene.markers)
        self._tools = tuple(t.name for t in self.scene.targets)
        self._optical = OpticalTracker(optical or OpticalParams(noise=1e-4), self._markers,
                                       by[Stage.OPTICAL], rng.spawn(1)[0])
        self._em = EmTracker(em or EmTrackerParams(), self._tools, by[Stage.EM], rng.spawn(1)[0])
        self._force = ForceSensor(force or ForceSensorParams(), names, by[Stage.FORCE],
                                  rng.spawn(1)[0])
        self._rest = np.array([m.position for m in (*self.scene.markers, *self.scene.targets)])
        self._body = [m.body for m in self.scene.markers] + ['tissue'] * len(self._tools)
        centres = np.array([p.centre for p in self.scene.pads])
        far = np.linalg.norm(self._rest[:, None] - centres, axis=2)
        self._weight = np.exp(-0.5 * (far / REACH) ** 2)
        self._disturb = disturb or (lambda t, names, points: points)
        self._memory = np.zeros(3)

    def points(self, t, pad):
        """(k, 3) [m] markers, then targets, with the pads at pad (3,) [m]."""
        felt = self._weight * (pad + pad ** 2 / RADIUS)
        out = self._rest + felt @ self.directions
        for i, name in enumerate(p.name for p in self.scene.pads):
            rides = [b == name for b in self._body]
            out[rides] = self._rest[rides] + pad[i] * self.directions[i]
        base = [b == 'base' for b in self._body]
        out[base] = self._rest[base]
        return self._disturb(t, (*self._markers, *self._tools), out)

    def push_back(self, pad, dt):
        """(3,) [N]; advances the memory of the material by dt [s]."""
        elastic = STIFFNESS * pad + self._stiffening * pad ** 2
        elastic = elastic + 0.1 * (elastic.sum() - elastic)
        self._memory += (elastic - self._memory) * -np.expm1(-dt / MEMORY)
        return elastic - self._relaxing * self._memory

    def record(self, moves=None, rest=REST):
        """RunData of a protocol, `with_scene`; every field that is truth is empty."""
        moves = protocol() if moves is None else moves
        log = {name: [] for name in ('t', 'q', 'optical', 'em', 'force')}
        self._bank.connect()
        state, force = self._bank.read(0.0), np.zeros(3)
        before = (0.0, self.points(0.0, state.pad), -force[:, None] * self.directions,
                  self.directions * state.pad[:, None])
        k, until, queue = 0, rest, list(moves)
        while queue or k * TICK < until - 1e-9:
            if k * TICK >= until - 1e-9:
                q, speed, hold = queue.pop(0)
                way = np.abs(q - state.q).max() / speed + 0.2
                self._bank.move(q, np.full(3, speed))
                until = k * TICK + way + (hold if queue else rest)
            k += 1
            t = k * TICK
            state = self._bank.read(t, force)
            force = self.push_back(state.pad, TICK)
            now = (t, self.points(t, state.pad), -force[:, None] * self.directions,
                   self.directions * state.pad[:, None])
            log['t'].append(t)
            log['q'].append(state.q)
            self._sense(log, before, now)
            before = now
        return self._run(log)

    def _sense(self, log, before, now):
        (t0, p0, f0, d0), (t1, p1, f1, d1) = before, now
        n = len(self._markers)
        log['optical'] += self._optical.advance(t0, p0[:n], t1, p1[:n], d0, d1)
        turns = np.tile(np.eye(3), (len(self._tools), 1, 1))
        log['em'] += self._em.advance(t0, p0[n:], turns, t1, p1[n:], turns, d0, d1)
        zero = np.zeros((3, 3))
        log['force'] += self._force.advance(t0, f0, zero, t1, f1, zero, d0, d1)

    def _run(self, log):
        pads = tuple(p.name for p in self.scene.pads)
        frames, wrenches = log['optical'], log['force']
        em = {}
        for tool in self._tools:
            samples = [s for s in log['em'] if s.tool == tool]
            em[tool] = EmSamples(np.array([s.t for s in samples]),
                                 np.array([s.position for s in samples]),
                                 np.array([s.quality for s in samples]),
                                 np.array([int(s.status) for s in samples]))
        times = sorted({w.t for w in wrenches})
        force = np.array([w.force for w in wrenches]).reshape(len(times), 3, 3)
        run = RunData(
            'formulas', '', 0, '', '', em=em, encoder=Series(np.array(log['t']),
                                                             np.array(log['q'])),
            encoder_pads=pads, force=Series(np.array(times), force), force_pads=pads,
            optical=OpticalFrames(np.array([f.t for f in frames]), self._markers,
                                  np.array([f.points for f in frames]),
                                  np.array([f.visible for f in frames])))
        return with_scene(run, self.scene)


@pytest.fixture(scope='session')
def laboratory():
    """The class Laboratory."""
    return Laboratory


@pytest.fixture(scope='session')
def pushes():
    """The function `protocol`."""
    return protocol


@pytest.fixture(scope='session')
def short_pushes():
    """The function `short_protocol`."""
    return short_protocol


@pytest.fixture(scope='session')
def recorded():
    """(entry of a scenario's terms or None, seed) -> RunData of `short_pushes`, kept."""

    @cache
    def run(entry=None, seed=1):
        terms = parse_terms([dict(entry)] if entry else [], 'test')
        return Laboratory(terms, seed).record(short_protocol())

    return lambda entry=None, seed=1: run(_frozen(entry), seed)


@pytest.fixture(scope='session')
def looked_at(recorded):
    """(entry, seed) -> (Prepared, Structure) of the same recordings, kept."""

    @cache
    def look(entry, seed):
        prepared = prepare(evidence_of(recorded(dict(entry) if entry else None, seed),
                                       make_scene()))
        return prepared, structure_of(prepared)

    return lambda entry=None, seed=1: look(_frozen(entry), seed)


@pytest.fixture(scope='session')
def look():
    """RunData -> (Prepared, Structure)."""

    def prepared_and_structure(run):
        prepared = prepare(evidence_of(run, make_scene()))
        return prepared, structure_of(prepared)

    return prepared_and_structure


def _frozen(entry):
    return None if entry is None else tuple(
        (k, tuple(v) if isinstance(v, list) else v) for k, v in entry.items())
