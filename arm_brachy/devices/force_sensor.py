"""Force and torque sensors between actuators and pads, one per pad."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.devices.sampling import DelayLine, SampleTimes, fraction, lateness, lerp

_NANO17 = 'ATI Nano17, calibration SI-50-0.5: '


@dataclass(frozen=True)
class ForceSensorParams:
    """Rate, noise, range and resolution; moments are in N m throughout.

    The default is an ATI Nano17, 17 mm across, since it fits behind a pad. The Axia of the thesis
    carries the ultrasound probe (ch. 6): wider than a pad, and ranges of hundreds of newtons where
    tissue returns a few. Of the Nano17's calibrations, SI-25-0.25 resolves twice as finely but
    ends at 25 N, where a supervisor that stops at 30 N would never see its limit.
    """

    rate: float = quantity(100.0, 'Hz', 'samples per second', low=1.0, high=8000.0,
                           source='kept at the rate of the optical tracker; an ATI Axia samples '
                                  'at 0.5 to 8 kHz (manual 9620-05-C-Ethernet Axia, table 5.5)')
    phase: float = quantity(0.0, 'ms', 'time of sample 0', low=0.0, high=1e4)
    latency: float = quantity(0.0, 'ms', 'from acquisition to delivery', low=0.0, high=1000.0,
                              source='engineering judgement: UDP streaming, below 1 ms')
    noise: float = quantity(0.025, 'N', 'standard deviation per axis', low=0.0, high=100.0,
                            source='engineering judgement: two counts, 0.05 % of full scale')
    moment_noise: float = quantity(
        2.5e-4, '', 'standard deviation per axis [N m]', low=0.0, high=10.0,
        source='engineering judgement: 0.05 % of full scale')
    noise_correlation: float = quantity(0.0, 's', 'correlation time of the noise (0 = white)',
                                        low=0.0, high=100.0, source='white unless measured')
    range: float = quantity(50.0, 'N', 'largest force per axis', low=0.01, high=1e4,
                            source=_NANO17 + 'Fx, Fy 50 N (Fz 70 N)')
    moment_range: float = quantity(0.5, '', 'largest moment per axis [N m]', low=1e-4, high=1e3,
                                   source=_NANO17 + '500 N mm')
    resolution: float = quantity(0.0125, 'N', 'one count (0 = continuous)', low=0.0, high=10.0,
                                 source=_NANO17 + '1/80 N')
    moment_resolution: float = quantity(6.25e-5, '', 'one count [N m] (0 = continuous)', low=0.0,
                                        high=1.0, source=_NANO17 + '1/16 N mm, in proportion '
                                        'to the 1/64 N mm of SI-12-0.12')


@dataclass(frozen=True)
class ForceSample:
    """One pad at one instant.

    t : s, time of acquisition by the sensor's clock;  sample_number : from 0
    force : (3,) [N], moment : (3,) [N m] about the centre of the pad; both are the external wrench
        on the pad (what the tissue does to it), world frame: a push gives a force against the push
        direction
    saturated : True if any component was at the end of its range
    """

    t: float
    sample_number: int
    pad: str
    force: np.ndarray
    moment: np.ndarray
    saturated: bool


class ForceSensor:
    """Simulated sensors of p pads; advanced tick by tick. Tared at zero load.

    params : ForceSensorParams;  pads : p names;  rng : numpy Generator
    terms : sensing terms of Stage.FORCE, applied to the true forces (not moments), before noise
    Cross-talk between sensors is not modelled; between axes it is the term `axis_crosstalk`.
    Test: devices/test_force_sensor.py
    """

    def __init__(self, params, pads, terms, rng):
        self.params = params
        self.pads = tuple(pads)
        self._terms = tuple(terms)
        self.times = SampleTimes(params.rate, params.phase)
        self._line = DelayLine(self.times, params.latency, lateness(self._terms))
        self._noise = ColouredNoise((len(self.pads), 6), params.noise_correlation,
                                    1.0 / params.rate, rng)

    def advance(self, t0, forces0, moments0, t1, forces1, moments1, pads0, pads1):
        """Follow the truth from t0 to t1 [s] and return the ForceSamples delivered in (t0, t1].

        forces0, forces1 : (p, 3) [N] true force of the tissue on each pad, world frame
        moments0, moments1 : (p, 3) [N m] about each pad's centre
        pads0, pads1 : (p, 3) [m] true pad displacements
        """
        acquired = []
        for instant in self.times.between(t0, t1):
            f = fraction(instant, t0, t1)
            samples = self._samples(instant, lerp(forces0, forces1, f),
                                    lerp(moments0, moments1, f), lerp(pads0, pads1, f))
            acquired += [(instant.number, sample) for sample in samples]
        return self._line.exchange(acquired, t0, t1)

    def _samples(self, instant, forces, moments, displacements):
        p = self.params
        noise = self._noise.draw()
        for term in self._terms:
            forces = term.distort(instant.t, self.pads, forces, displacements)
        forces, over = digitise(forces + p.noise * noise[:, :3], p.range, p.resolution)
        moments, over_m = digitise(moments + p.moment_noise * noise[:, 3:], p.moment_range,
                                   p.moment_resolution)
        saturated = (over | over_m).any(axis=1)
        t = self._line.stamped(instant).t
        return [ForceSample(t, instant.number, name, forces[i].copy(), moments[i].copy(),
                            bool(saturated[i])) for i, name in enumerate(self.pads)]


def digitise(values, limit, resolution):
    """Clip to +-limit and round to whole counts.  Returns (values, True where clipped)."""
    clipped = np.clip(values, -limit, limit)
    over = np.abs(values) >= limit
    return (resolution * np.round(clipped / resolution) if resolution > 0.0 else clipped), over
