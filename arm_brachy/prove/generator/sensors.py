"""Sensors: coloured noise, quantisation, bursts of dropouts, and a clock of its own for each."""
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

RATES = {'encoders': 100.0, 'forces': 50.0, 'optical': 60.0, 'em': 40.0}


@dataclass(frozen=True)
class Sensors:
    """Calibrated imperfections of one set-up, present in every recording it makes; SI.

    noise: standard deviation per stream; quantum: step of encoders [m] and forces [N];
    clock: how late each stream is stamped [s]; jitter [s]; bursts [1/s] of lost samples.
    """

    noise: dict
    quantum: dict
    clock: dict
    jitter: float = 1e-4
    bursts: float = 1 / 40
    colour: float = field(default=0.25)


def draw_sensors(rng):
    """Random `Sensors`."""
    return Sensors(
        noise={'encoders': 0.0, 'forces': 0.010, 'optical': float(rng.uniform(3e-5, 8e-5)),
               'em': float(rng.uniform(1e-4, 3e-4))},
        quantum={'encoders': float(rng.uniform(1e-6, 5e-6)), 'forces': 0.002},
        clock={name: float(rng.uniform(-2e-3, 2e-3)) if name != 'encoders' else 0.0
               for name in RATES})


def sample_times(rng, sensors, stream, end):
    """True times of acquisition (t,) [s] and the stamps (t,) they get."""
    period = 1 / RATES[stream]
    start = rng.uniform(0.002, period)
    true = np.arange(start, end - 0.01, period)
    late = sensors.clock[stream] + rng.normal(0, sensors.jitter, len(true))
    return true, true + np.clip(late, -0.01, 0.01)


def coloured(rng, shape, sigma, rate, colour, memory=0.3):
    """Noise of standard deviation `sigma`, a share `colour` of its variance AR(1), axis 0 time.

    memory : time constant of the AR(1) part [s].
    """
    rho = np.exp(-1 / (memory * rate))
    drive = rng.normal(size=shape) * np.sqrt(1 - rho**2)
    drive[0] /= np.sqrt(1 - rho**2)
    slow = lfilter([1.0], [1.0, -rho], drive, axis=0)
    return sigma * (np.sqrt(1 - colour) * rng.normal(size=shape) + np.sqrt(colour) * slow)


def quantise(values, step):
    """Values rounded to whole steps."""
    return np.round(values / step) * step


def lost(rng, times, bursts):
    """Which samples of one sensor are lost (t,): bursts of 0.05 to 0.5 s, and single ones."""
    gone = rng.random(len(times)) < 0.002
    for start in np.flatnonzero(rng.random(len(times)) < bursts * np.median(np.diff(times))):
        gone |= (times >= times[start]) & (times < times[start] + rng.uniform(0.05, 0.5))
    return gone
