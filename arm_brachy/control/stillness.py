"""When not to push: pads that cannot retract must not answer noise, for every answer stays.

The error is shrunk by a share of its own uncertainty before it is acted on. Once what is left is
negligible the loop pauses, and pushes again only for an error that has become significant; after
a while it rests and asks for more. Thresholds are in standard deviations of the estimate, so they
follow the tracker's noise and what the observer knows.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity


@dataclass(frozen=True)
class StillnessParams:
    """Thresholds of the pause and of the rest."""

    caution: float = quantity(
        0.5, '', 'standard deviations by which an error is shrunk before it is acted on',
        low=0.0, high=10.0, source='a push on noise cannot be taken back')
    settle: float = quantity(
        0.01, 'mm', 'remaining error at which pushing pauses', low=0.0, high=10.0,
        source='encoder resolution of a lead-screw actuator')
    settle_time: float = quantity(
        2.0, 's', 'length of the pause after which the loop rests', low=0.0, high=60.0,
        source='about two time constants of the observer at rest')
    resume: float = quantity(
        2.0, '', 'standard deviations of error that end the pause', low=0.0, high=20.0,
        source='the estimate is still becoming surer: 5 % false alarms are worth the accuracy')
    release: float = quantity(
        4.5, '', 'standard deviations of error that end the rest', low=0.0, high=20.0,
        source='resting a standard deviation off, one false alarm in some 2000 estimates')


class Stillness:
    """The three states of the gate: pushing, pausing, resting."""

    def __init__(self, params):
        """params : StillnessParams. Starts pushing."""
        self.params = params
        self.reset()

    def reset(self):
        """Back to pushing: a new goal."""
        self._paused_at, self.resting = None, False

    def keeps_still(self, t, error, sd):
        """Tell whether to go on pausing or resting; if not, the gate is back to pushing.

        t : [s];  error : [m] largest error on an axis that the pads could still remove
        sd : [m] of the estimate
        """
        if self._paused_at is None:
            return False
        self.resting |= t - self._paused_at >= self.params.settle_time
        allowed = self.params.release if self.resting else self.params.resume
        if error > self.params.settle + allowed * sd:
            self.reset()
        return self._paused_at is not None

    def cautious(self, error, sd):
        """Shrink every entry of error (m,) [m] towards 0 by `caution` standard deviations."""
        error = np.asarray(error, dtype=float)
        return np.copysign(np.maximum(np.abs(error) - self.params.caution * sd, 0.0), error)

    def pauses(self, t, error):
        """Start to pause if `error` [m], shrunk and attainable, is negligible; say whether so."""
        if error <= self.params.settle:
            self._paused_at = t
        return self._paused_at is not None
