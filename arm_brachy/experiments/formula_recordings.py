"""Recordings made of formulas: a body whose answer is written down, nothing missing in its cell.

No tissue solver takes part: what moves is a formula of the pads' travel, and of what the tissue
remembers of it. Two kinds of tissue answer. A `Ideal` one does what the regressors of the
diagnosis can say exactly. A `Lasting` one is as smooth and honest, but no sum of them: its markers
follow a pad with a saturating law of their own, together less than the sum, aside as well as
along, and a share of that comes late by seconds; its forces relax by a power law.
Test: experiments/test_false_alarms.py
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from arm_brachy.cell import pad_directions
from arm_brachy.core.scene import Marker, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.evaluation.timeseries import EmSamples, OpticalFrames, RunData, Series
from arm_brachy.offline import with_scene

RADIUS = 0.06     # m
REACH = 0.03      # m, how far a push is felt
TICK = 0.005      # s, on which paths and memories are worked out
REST = 2.0        # s before and after
FIRST = 0.1       # s from one command to the pad's next motion
RAMP = 0.05       # s in which a pad takes up its speed
STIFFNESS, STIFFENING = 300.0, 1.5e4     # N/m, N/m^2
COUPLED = 0.1     # of the force on one pad that is felt at another
LOST = 1          # status of an EM sample without a position
COUNT = 5e-6      # m, of an encoder


def on_dome(azimuth, height, radius=RADIUS):
    """A point of the hemisphere [m]."""
    a, across = np.radians(azimuth), np.sqrt(radius ** 2 - height ** 2)
    return np.array([across * np.cos(a), across * np.sin(a), height])


def make_scene(tissue=12):
    """Three pads, one marker on each, three on the base, two EM targets; so many on the tissue."""
    pads, markers = [], []
    for i, azimuth in enumerate((0.0, 120.0, 240.0)):
        centre = on_dome(azimuth, 0.03)
        pads.append(PadPatch(f'pad_{i}', tuple(centre), tuple(-centre / RADIUS), 0.01, 0.02))
        markers.append(Marker(f'pad_{i}', tuple(1.2 * centre), f'pad_{i}'))
    for i in range(tissue):
        height = (0.015, 0.035, 0.05)[i % 3]
        place = on_dome(360.0 / tissue * i + 15.0, height)
        markers.append(Marker(f'tissue_{i}', tuple(place), 'tissue'))
    for i, place in enumerate(((0.085, 0.05, 0.0), (-0.085, 0.05, 0.0), (0.0, -0.09, 0.0))):
        markers.append(Marker(f'base_{i}', place, 'base'))
    targets = (Target('deep', (0.005, 0.0, 0.025)), Target('high', (-0.01, 0.01, 0.04)))
    return Scene('formulas', MeshFile('none.msh'), Region('half_space'), pads=tuple(pads),
                 markers=tuple(markers), targets=targets)


@dataclass(frozen=True)
class Sensor:
    """How one kind of sensor samples. rate : [Hz];  noise : SI, standard deviation per component

    share : of the variance that is slow;  memory : [s] of that part;  dropout : of its samples
    """

    rate: float
    noise: float
    share: float
    memory: float
    dropout: float


def pushes(rng, duration):
    """Pads' travel (m, 3) [m] on a grid of TICK [s], for about `duration` [s]; (t (m,), q).

    Pads go out alone or in pairs, to depths and at speeds drawn at random, half of the times
    stop again on their way back, and rest between.
    """
    corners, at = [(0.0, np.zeros(3)), (REST, np.zeros(3))], np.zeros(3)

    def go(there, hold):
        nonlocal at
        start = corners[-1][0] + FIRST
        end = start + np.abs(there - at).max() / speed
        corners.extend([(start, at), (end, there), (end + hold, there)])
        at = there

    turn = int(rng.integers(3))
    while corners[-1][0] < duration - REST or turn % 4:
        speed = float(np.exp(rng.uniform(np.log(0.004), np.log(0.02))))
        pads = np.eye(3)[turn % 3] + (np.eye(3)[(turn + 1) % 3] if rng.random() < 0.3 else 0.0)
        go(rng.uniform(0.003, 0.008) * pads, rng.uniform(0.4, 1.5))
        if rng.random() < 0.5:
            go(0.5 * at, rng.uniform(0.3, 0.8))
        go(np.zeros(3), rng.uniform(0.6, 1.5))
        turn += 1
        if corners[-1][0] > duration + 4.0 * REST:
            break
    times, places = zip(*corners, (corners[-1][0] + REST, at), strict=True)
    t = np.arange(0.0, times[-1], TICK)
    q = np.stack([np.interp(t, times, column) for column in np.array(places).T], axis=1)
    keep = np.exp(-TICK / RAMP)
    return t, lfilter([1.0 - keep], [1.0, -keep], q, axis=0)


def remembered(u, time):
    """Exponential memory of u (m, k) on the grid, time m' + m = u, from rest."""
    keep = np.exp(-TICK / time)
    return lfilter([1.0 - keep], [1.0, -keep], u, axis=0)


@dataclass(frozen=True)
class Ideal:
    """What the regressors say exactly, in a force nearly: one memory of 1.5 s between two."""

    def moved(self, q, weight, directions):
        """(m, k, 3) [m] motion of k points that feel pads' travel q (m, p) by weight (k, p)."""
        return np.einsum('kp,mp,pc->mkc', weight, q + q ** 2 / RADIUS, directions)

    def pushed_back(self, q):
        """(m, p) [N]."""
        elastic = STIFFNESS * q + STIFFENING * q ** 2
        elastic = elastic + COUPLED * (elastic.sum(axis=1, keepdims=True) - elastic)
        return elastic - 0.2 * remembered(elastic, 1.5)


@dataclass(frozen=True)
class Lasting:
    """Smooth tissue that no sum of the regressors is. Points and pads have numbers of their own.

    saturation : (k, p) [m] push by which a point follows by half;  aside : (k, p, 3) of the way
    late : (k,) share that comes late;  time : [s];  less : of two pads together
    exponent : of the force;  relaxing : share of the force that relaxes by a power law
    set_in : share of the answer that the first push of a depth has softened
    """

    saturation: np.ndarray
    aside: np.ndarray
    late: np.ndarray
    time: float
    less: float
    exponent: float
    relaxing: float
    set_in: float

    @classmethod
    def drawn(cls, rng, k, p):
        """One at random."""
        return cls(rng.uniform(0.006, 0.03, (k, p)), 0.3 * rng.standard_normal((k, p, 3)),
                   rng.uniform(0.0, 0.15, k), float(np.exp(rng.uniform(np.log(0.7), np.log(8.0)))),
                   rng.uniform(0.0, 0.3), rng.uniform(1.1, 1.7), rng.uniform(0.1, 0.4),
                   rng.uniform(0.0, 0.08))

    def moved(self, q, weight, directions):
        """(m, k, 3) [m] as of an `Ideal`; points that feel a pad little have it slower."""
        push = q[:, None, :]
        alone = weight * push / (1.0 + push / self.saturation)
        most = np.maximum.accumulate(push, axis=0)
        alone = alone * (1.0 + self.set_in * most / 0.008)
        total = alone.sum(axis=2, keepdims=True)
        shared = alone * (1.0 - self.less * (total - alone) / (np.abs(total) + 1e-4))
        lasting = remembered(shared.reshape(len(q), -1), self.time).reshape(shared.shape)
        shared = shared + self.late[:, None] * (lasting - shared)
        return np.einsum('mkp,kpc->mkc', shared, directions + self.aside)

    def pushed_back(self, q):
        """(m, p) [N], contact that grows with depth."""
        elastic = STIFFNESS * 0.005 * (np.maximum(q, 0.0) / 0.005) ** self.exponent
        elastic = elastic + COUPLED * (elastic.sum(axis=1, keepdims=True) - elastic)
        times = 0.05 * 2.5 ** np.arange(7)
        slow = sum(remembered(elastic, time) for time in times) / len(times)
        return elastic - self.relaxing * slow


def record(rng, scene, tissue, path, sensors, counted=None):
    """RunData of pads that go along a path, `with_scene`; every field that is truth is empty.

    scene : of `make_scene`;  path : (t (m,) [s], q (m, p) [m]) of `pushes`
    sensors : 'optical', 'em', 'force', 'encoder' -> Sensor
    counted : (m, p) [m] what the encoders count, None = where the pads are
    """
    (t, q), directions = path, pad_directions(scene)
    points = _points(scene, tissue, q, directions)
    force = -tissue.pushed_back(q)[:, :, None] * directions
    names, tools = [m.name for m in scene.markers], [x.name for x in scene.targets]
    pads = tuple(p.name for p in scene.pads)
    at, seen, optical = _sensed(rng, t, points[:, :len(names)], sensors['optical'])
    frames = OpticalFrames(at, tuple(names), optical, seen)
    em = {}
    for k, tool in enumerate(tools, start=len(names)):
        at, seen, place = _sensed(rng, t, points[:, k:k + 1], sensors['em'])
        em[tool] = EmSamples(at, place[:, 0], np.zeros(len(at)),
                             np.where(seen[:, 0], 0, LOST))
    at, _, push = _sensed(rng, t, force, replace(sensors['force'], dropout=0.0))
    when, _, travel = _sensed(rng, t, (q if counted is None else counted)[:, :, None],
                              sensors['encoder'])
    run = RunData('formulas', '', 0, '', '', em=em, optical=frames, force=Series(at, push),
                  encoder=Series(when, COUNT * np.round(travel[:, :, 0] / COUNT)),
                  encoder_pads=pads, force_pads=pads)
    return with_scene(run, scene)


def _points(scene, tissue, q, directions):
    """(m, k, 3) [m] markers, then targets."""
    every = (*scene.markers, *scene.targets)
    rest = np.array([one.position for one in every])
    bodies = [getattr(one, 'body', 'tissue') for one in every]
    away = rest[:, None] - np.array([p.centre for p in scene.pads])
    weight = np.exp(-0.5 * np.sum((away / REACH) ** 2, axis=2))
    out = rest + tissue.moved(q, weight, directions)
    for i, pad in enumerate(scene.pads):
        for k in (k for k, body in enumerate(bodies) if body == pad.name):
            out[:, k] = rest[k] + q[:, i:i + 1] * directions[i]
    still = [k for k, body in enumerate(bodies) if body == 'base']
    out[:, still] = rest[still]
    return out


def _sensed(rng, t, values, sensor):
    """(stamps (n,) [s], seen (n, k), values (n, k, c) with noise) of what is at t (m,)."""
    period = 1.0 / sensor.rate
    at = np.arange(rng.uniform(0.0, period), t[-1], period)
    flat = values.reshape(len(t), -1)
    true = np.stack([np.interp(at, t, column) for column in flat.T], axis=1)
    seen = rng.random((len(at), values.shape[1])) >= sensor.dropout
    noise = sensor.noise * coloured(rng, true.shape, period, sensor.share, sensor.memory)
    return at, seen, (true + noise).reshape(len(at), *values.shape[1:])


def coloured(rng, shape, period, share, memory):
    """(n, k) noise of unit variance: white, and a share of it first-order Markov.

    memory : [s] of that share (Gelb 1974, Applied Optimal Estimation), stationary from the start
    """
    keep = np.exp(-period / memory)
    drive = rng.standard_normal(shape) * np.sqrt(1.0 - keep ** 2)
    drive[0] /= np.sqrt(1.0 - keep ** 2)
    slow = lfilter([1.0], [1.0, -keep], drive, axis=0)
    return np.sqrt(1.0 - share) * rng.standard_normal(shape) + np.sqrt(share) * slow
