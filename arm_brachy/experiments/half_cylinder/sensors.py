"""What devices do to what they see: instants, clocks, noise with a memory, gaps, frames.

Slow noise is a first-order Markov process of some seconds' memory. In a rest of three seconds it
hardly shows, in a recording it does.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from arm_brachy.experiments.csv_files import EM, ENCODERS, FORCES, OPTICAL
from arm_brachy.experiments.half_cylinder.layout import MM

TURN, SHIFT = np.radians(0.25), 0.4 * MM    # sd per axis, of a tracker's frame against the scene's
RATE_OFF = 1e-5         # sd of a clock's rate: 1 ms in 100 s


@dataclass(frozen=True)
class Device:
    """One kind of sensor; noise is per axis, in m or N.

    rate : [1/s];  jitter : sd of the instants [s];  white, slow : sd of the noise without and
    with memory;  memory : time constant [s];  clock : most that it is late or early [s], 0 = it
    sets the time;  gap : (fewest, most) samples lost in a row, once;  gaps : share of the
    channels that lose them, all of them at once if 1
    """

    rate: float
    jitter: float
    white: float
    slow: float = 0.0
    memory: float = 1.0
    clock: float = 0.0
    gap: tuple = (0, 0)
    gaps: float = 0.0


DEVICES = {
    ENCODERS: Device(50.0, 3e-4, 4e-3 * MM),
    FORCES: Device(100.0, 0.0, 0.008, 0.0033, 4.0, 6e-3, (12, 12), 1.0),
    OPTICAL: Device(40.0, 4e-4, 0.04 * MM, 0.012 * MM, 5.0, 12e-3, (6, 29), 0.4),
    EM: Device(12.0, 1e-3, 0.12 * MM, 0.05 * MM, 6.0, 20e-3, (8, 8), 1.0)}


@dataclass(frozen=True)
class Clock:
    """Stamps t (1 + rate) + late;  late : [s]"""

    late: float
    rate: float

    def stamps(self, t):
        """What it shows at times t (t,) [s]."""
        return t * (1.0 + self.rate) + self.late


def clock(device, rng):
    """The Clock of a Device in one recording."""
    late = rng.uniform(-device.clock, device.clock)
    return Clock(late, rng.normal(0.0, RATE_OFF) if device.clock else 0.0)


def instants(device, end, rng):
    """When a Device measures until `end` [s], jitter included, (t,) [s]; the first is no sooner
    than two periods, so that no clock shows a negative time."""
    even = np.arange(2, int(end * device.rate)) / device.rate
    return np.sort(even + rng.normal(0.0, device.jitter, len(even)))


def noise(device, shape, rng):
    """Noise of a Device at even instants, (t, ...) as `shape`: white and slow together."""
    decay = np.exp(-1.0 / (device.rate * device.memory))
    kicks = rng.normal(0.0, device.slow, shape)
    kicks[1:] *= np.sqrt(1.0 - decay ** 2)
    return rng.normal(0.0, device.white, shape) + lfilter([1.0], [1.0, -decay], kicks, axis=0)


def lose(values, device, rng):
    """Write NaN into values (t, k, 3) where a Device sees nothing, away from both ends."""
    count, channels = values.shape[:2]
    low, high = device.gap
    if device.gaps == 1.0:
        starts = np.full(channels, rng.integers(count // 20, count - count // 20 - high))
    else:
        starts = rng.integers(count // 20, count - count // 20 - high, channels)
    for channel in np.flatnonzero(rng.uniform(size=channels) < device.gaps):
        values[starts[channel]:starts[channel] + rng.integers(low, high + 1), channel] = np.nan


def in_frame(points, rng):
    """Points (t, k, 3) [m] in the frame of a tracker, turned and shifted; a small turn."""
    turn, shift = rng.normal(0.0, TURN, 3), rng.normal(0.0, SHIFT, 3)
    return points + np.cross(turn, points) + shift
