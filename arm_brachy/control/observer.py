"""What the model lacks, estimated: a Kalman filter on the output disturbance.

Measured target position = model position at the encoders + disturbance d + noise. d is a random
walk, isotropic, so that one scalar variance serves the three axes. Its steps have two causes:
time (creep, drift) and travel (a Jacobian that is wrong by a share of what it predicts). The
second makes the gain high while the target moves and low at rest, where push-only pads must not
chase noise: there it falls to the stationary solution of the scalar Riccati equation. That d goes
to its true mean at rest is what makes tracking offset-free.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity

_MINUTE = 60.0


@dataclass(frozen=True)
class ObserverParams:
    """How noisy the tracker is and how wrong the model may be."""

    noise: float = quantity(
        0.3, 'mm', 'sd of one tracker sample on one axis', low=1e-4, high=20.0,
        source="upper end of what an NDI Aurora sensor at rest shows; take the tracker's own")
    drift: float = quantity(
        0.3, 'mm', 'sd by which the disturbance wanders in one minute at rest', low=1e-4,
        high=100.0, source='soft-tissue creep after a push, of the order of 5 % of a 5 mm task')
    model_error: float = quantity(
        0.3, '', 'relative error of the Jacobian, 1 sd', low=0.0, high=2.0,
        source='own choice: the order by which linear tetrahedra at nu = 0.49 are off')
    error_length: float = quantity(
        5.0, 'mm', 'target travel over which that error keeps its sign', low=0.01, high=1000.0,
        source='length of one task')
    initial: float = quantity(
        5.0, 'mm', 'sd of the disturbance before the first sample', low=1e-3, high=1000.0,
        source='placement of a sensor in a phantom by hand')


class DisturbanceObserver:
    """Random-walk Kalman filter fed with samples at any times; samples in order of time.

    Valid while model error is a smooth function of travel: a sudden slip of a pad shows up over
    about one second, as noise would.
    """

    def __init__(self, params):
        """params : ObserverParams. Starts ignorant; see `reset`."""
        self.params = params
        self.reset()

    def reset(self):
        """Forget everything: no sample yet, disturbance 0 with the initial variance."""
        self.disturbance = np.zeros(3)
        self.variance = self.params.initial**2
        self.last_time = None
        self._last_model = None

    @property
    def sd(self):
        """Standard deviation of the estimate on each axis [m]."""
        return float(np.sqrt(self.variance))

    def surprise(self, t, measured, model):
        """Distance [m] of a sample from its prediction, and the sd of that on one axis [m].

        Arguments as of `update`; nothing is changed.
        """
        variance = self.variance + self.params.noise**2
        if self.last_time is not None:
            variance += self._process(t - self.last_time, model - self._last_model)
        return (float(np.linalg.norm(measured - model - self.disturbance)),
                float(np.sqrt(variance)))

    def update(self, t, measured, model):
        """Take one sample.

        t : [s] when it was acquired, later than the last;  measured : (3,) [m] finite
        model : (3,) [m] where the model had the target at t
        """
        if self.last_time is not None:
            self.variance += self._process(t - self.last_time, model - self._last_model)
        gain = self.variance / (self.variance + self.params.noise**2)
        self.disturbance = self.disturbance + gain * (measured - model - self.disturbance)
        self.variance *= 1.0 - gain
        self.last_time, self._last_model = t, np.array(model, dtype=float)

    def _process(self, dt, travel):
        """Variance that dt [s] and model travel (3,) [m] add; linear in both."""
        p = self.params
        moved = p.model_error**2 * p.error_length * np.linalg.norm(travel)
        return p.drift**2 * dt / _MINUTE + moved
