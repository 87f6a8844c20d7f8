"""What the laboratory's sensors make of the block, and the CSV files it hands over.

Every device has its own rate, clock, jitter and noise; the tracker's frame is a little off the
scene's. None of that is told to the diagnosis, and none of it counts as missing physics.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from arm_brachy.core.random import stream
from arm_brachy.experiments.csv_files import EM, ENCODERS, FORCES, OPTICAL, Recorded
from arm_brachy.experiments.gel_block import layout
from arm_brachy.experiments.gel_block.layout import DIRECTIONS, MARKERS, MM, PADS, TARGETS
from arm_brachy.experiments.gel_block.protocol import END, FIRST, motors, response

FINE_STEP = 2e-3        # s, in which memory is integrated: a 1500th of the time constant
BURSTS, BURST = 12, (0.2, 1.0)      # how often a marker is hidden, and for how long [s]
ZERO = 0.015            # N, sd of the zeros of the forces
TURN, SHIFT = np.radians(0.08), 0.3 * MM    # of the tracker's frame against the scene's
CLOCK = 2e-3            # s, by which the clocks other than the encoders' are late or early

FORMATS = {ENCODERS: ('q_{key}', '%.4f'), OPTICAL: ('{key}_{axis}', '%.3f'),
           FORCES: ('F{axis}_{key}', '%.4f'), EM: ('{key}_{axis}', '%.3f')}   # mm, forces N


@dataclass(frozen=True)
class Device:
    """rate [1/s]; jitter: sd of the instants [s]; noise: sd per axis [m or N]; lost: share."""

    rate: float
    jitter: float
    noise: float
    lost: float = 0.0


DEVICES = {ENCODERS: Device(50.0, 1e-4, 3e-3 * MM), OPTICAL: Device(30.0, 2e-4, 0.08 * MM, 0.01),
           FORCES: Device(100.0, 1e-4, 0.03), EM: Device(25.0, 3e-4, 0.15 * MM, 0.005)}


@dataclass(frozen=True)
class Setup:
    """What is true of one recording and not said in its files.

    modulus : over the scene's
    gain : (p,) pad travel over motor travel
    slip : marker, onset [s] and shift (3,) [m] of one that slides, or None
    late : device -> how late its stamps are, beside what every clock is off [s]
    drift : pad -> growth of its force's error (3,) [N/s]
    memory : share of the sudden force that relaxes, its time constant [s]; None = elastic
    poor : nothing is recorded but encoders and the markers on block and base
    """

    modulus: float = 1.0
    gain: tuple = (1.0, 1.0)
    slip: tuple | None = None
    late: dict = field(default_factory=dict)
    drift: dict = field(default_factory=dict)
    memory: tuple | None = None
    poor: bool = False


def lateness(setup, seed, name):
    """Device -> how late it stamps [s] in the recording `name`; the encoders set the time."""
    off = stream(seed, f'{name}/clocks').permutation((CLOCK, -CLOCK, CLOCK))
    drawn = dict(zip((FORCES, OPTICAL, EM), off.tolist(), strict=True))
    return {device: drawn.get(device, 0.0) + setup.late.get(device, 0.0) for device in DEVICES}


class Recorder:
    """Records a block, given as rays (name -> bodies.Ray), in a Setup.

    seed, name : of the recording; every device draws from a random stream of its own
    Test: experiments/gel_block/test_recorder.py
    """

    def __init__(self, rays, setup, seed, name):
        self._rays, self._setup = rays, setup
        self._seed, self._name = seed, name
        self._late = lateness(setup, seed, name)

    def record(self):
        """Device -> Recorded, of the devices that this Setup has."""
        out = {ENCODERS: self._encoders(), OPTICAL: self._optical()}
        return out if self._setup.poor else out | {FORCES: self._forces(), EM: self._em()}

    def _rng(self, what):
        return stream(self._seed, f'{self._name}/{what}')

    def _instants(self, device, rng):
        """When a device measures, jitter included, (t,) [s]."""
        of = DEVICES[device]
        count = int(END * of.rate) - 1
        even = (1.0 + np.arange(count) + rng.uniform()) / of.rate
        return np.sort(even + rng.normal(0.0, of.jitter, count))

    def _recorded(self, device, names, t, clean, rng):
        """With the device's noise, losses and clock."""
        of = DEVICES[device]
        values = clean + rng.normal(0.0, of.noise, clean.shape)
        values[rng.uniform(size=values.shape[:2]) < of.lost] = np.nan
        return Recorded(tuple(names), t + self._late[device], values)

    def _encoders(self):
        rng = self._rng(ENCODERS)
        t = self._instants(ENCODERS, rng)
        return self._recorded(ENCODERS, [pad.name for pad in PADS], t, motors(t), rng)

    def _em(self):
        rng = self._rng(EM)
        t = self._instants(EM, rng)
        moved = self._response(t, 'u')[:, len(MARKERS):]
        return self._recorded(EM, TARGETS, t, np.array([*TARGETS.values()]) + moved, rng)

    def _response(self, t, what):
        return response(self._rays, t, what, self._setup.gain)

    def _optical(self):
        rng = self._rng(OPTICAL)
        t = self._instants(OPTICAL, rng)
        seen = self._glued(t) | ({} if self._setup.poor else self._on_pads(t)) | {
            name: np.tile(at, (len(t), 1)) for name, at in layout.BASE_MARKERS.items()}
        clean = _in_frame(np.stack([*seen.values()], axis=1), rng)
        out = self._recorded(OPTICAL, seen, t, clean, rng)
        for _ in range(BURSTS):
            # not in the rest before all pushes, in which the diagnosis registers the frame
            marker, start = rng.integers(len(seen)), rng.uniform(FIRST, END - 2.0)
            out.values[(t > start) & (t < start + rng.uniform(*BURST)), marker] = np.nan
        return out

    def _glued(self, t):
        """Marker on the block -> where it is, (t, 3) [m]."""
        moved = self._response(t, 'u')
        out = {name: at + moved[:, i] for i, (name, at) in enumerate(MARKERS.items())}
        if self._setup.slip is not None:
            name, onset, shift = self._setup.slip
            out[name][t >= onset] += shift
        return out

    def _on_pads(self, t):
        """Marker on a pad -> where it is, (t, 3) [m]."""
        travel = motors(t) * np.array(self._setup.gain)
        return {name: at + np.outer(travel[:, p], DIRECTIONS[p])
                for p, (name, at) in enumerate(layout.PAD_MARKERS.items())}

    def _forces(self):
        rng = self._rng(FORCES)
        t = self._instants(FORCES, rng)
        clean = self._setup.modulus * self._remembered(t) + rng.normal(0.0, ZERO, (len(PADS), 3))
        for p, pad in enumerate(PADS):
            clean[:, p] += np.outer(t, self._setup.drift.get(pad.name, (0.0, 0.0, 0.0)))
        return self._recorded(FORCES, [pad.name for pad in PADS], t, clean, rng)

    def _remembered(self, t):
        """Forces on the pads (t, p, 3) [N] at the scene's modulus.

        Quasi-linear: f(t) = (1 - g) e(t) + g times the integral of exp(-(t - s) / tau) de(s),
        with e the elastic force, g and tau the Setup's memory.
        """
        if self._setup.memory is None:
            return self._response(t, 'force')
        share, tau = self._setup.memory
        even = np.arange(0.0, END + FINE_STEP, FINE_STEP)
        elastic = self._response(even, 'force')
        decay = np.exp(-FINE_STEP / tau)
        relaxing = lfilter([np.sqrt(decay)], [1.0, -decay],
                           np.diff(elastic, axis=0, prepend=elastic[:1]), axis=0)
        force = (1.0 - share) * elastic + share * relaxing
        after = np.floor(t / FINE_STEP).astype(int)
        part = (t / FINE_STEP - after)[:, None, None]
        return (1.0 - part) * force[after] + part * force[after + 1]


def _in_frame(points, rng):
    """Points (t, k, 3) [m] in the tracker's frame, small angles."""
    turn, shift = (size * v / np.linalg.norm(v)
                   for size, v in zip((TURN, SHIFT), rng.normal(size=(2, 3)), strict=True))
    return points + np.cross(turn, points) + shift
