"""What every estimator of the tissue's inside takes and gives."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from arm_brachy.core.outcome import Outcome


@dataclass(frozen=True)
class Surface:
    """What is measured at one instant: pad encoders and optical markers, in the model's frame W.

    t : [s] time of acquisition;  q : (p,) [m] pad travel along each push direction
    markers : (m, 3) [m] positions of the tissue's markers, in the order that the estimator was
        built with; NaN where not seen, gated out or not identified
    frame_covariance : (6, 6) covariance of the rigid registration that brought the markers into
        W: rotation vector about the centroid of the markers [rad], then translation [m]; the
        error is common to all markers of a frame
    loads : known_load.KnownLoads that act on the tissue besides the pads, as measured; `map`
        counts on them, the other estimators do not
    """

    t: float
    q: np.ndarray
    markers: np.ndarray
    frame_covariance: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    loads: tuple = ()

    @property
    def seen(self):
        """(m,) True where a marker has a position."""
        return np.isfinite(self.markers).all(axis=1)


@dataclass(frozen=True)
class Estimate:
    """Where the targets are believed to be. World frame, SI. NaN throughout if not OK.

    targets : k names;  points : (k, 3) [m];  covariance : (k, 3, 3) [m^2] of each target
    x : (n, 3) [m] nodes of the estimator's mesh, None where it has none
    outcome, message : how it went, for a person;  notice : what to know of an estimate that is OK
    """

    t: float
    targets: tuple
    points: np.ndarray
    covariance: np.ndarray
    x: np.ndarray | None = None
    outcome: Outcome = Outcome.OK
    message: str = ''
    notice: Outcome = Outcome.OK

    @classmethod
    def failed(cls, t, targets, outcome, message=''):
        """The estimate that says why there is none."""
        k = len(targets)
        return cls(t, tuple(targets), np.full((k, 3), np.nan), np.full((k, 3, 3), np.nan),
                   None, outcome, message or outcome.advice)


class Estimator(Protocol):
    """One way to see inside: Surface in, Estimate out. No clock, no ROS, no truth.

    Built on the model side of a scene alone. `step` depends on what was given since `reset` and
    on nothing else: same input, same bits.
    """

    targets: tuple

    def reset(self):
        """Forget everything that was measured."""

    def step(self, surface):
        """Take one Surface, later than the last; return the Estimate at its time."""
