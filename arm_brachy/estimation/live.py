"""A tissue estimator on live data: marker frames and encoders in, one estimate a period out."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity
from arm_brachy.estimation.calibration import Calibration, RegistrationParams
from arm_brachy.estimation.estimate import Estimate, Surface
from arm_brachy.estimation.marker_intake import IntakeParams, MarkerIntake

_KEPT = 256     # encoder samples, to interpolate at the time of a frame


@dataclass(frozen=True)
class EstimationParams:
    """What every estimator does alike: when it works, which markers it takes."""

    registration: RegistrationParams = field(default_factory=RegistrationParams)
    intake: IntakeParams = field(default_factory=IntakeParams)
    period: float = quantity(100.0, 'ms', 'from one estimate to the next', low=1.0, high=1e5,
                             source='control period of the manipulator')
    fewest: float = quantity(3.0, '', 'markers on tissue below which there is no estimate',
                             low=1.0, high=1000.0, source='three points fix a rigid motion; with '
                             'fewer an estimate would be the model with a claim of measurement')
    stale_after: float = quantity(0.5, 's', 'silence of tracker or encoders that is reported',
                                  low=0.01, high=600.0, source='control.stale_after')


@dataclass(frozen=True)
class LiveStep:
    """What one period came to.

    estimate : Estimate, None where there is none;  outcome, message : how it went, for a person
    age : [s] from acquisition to now;  seen : markers on tissue that were used
    """

    t: float
    estimate: Estimate | None
    outcome: Outcome = Outcome.OK
    message: str = ''
    age: float = np.nan
    seen: int = 0


class LiveEstimator:
    """Registers, identifies, estimates; explicit time, no clock of its own.

    targets : names;  mesh : TetMesh that `Estimate.x` belongs to
    registration : in force, None while there is none
    An estimate is of the time of acquisition of the newest frame. It is withheld, with an outcome
    that says why, while the tracker is silent, not registered or blind, and while the markers are
    not those of the scene; whoever hears the estimates finds them out of date and holds.
    Test: estimation/test_live.py
    """

    def __init__(self, estimator, motion, params, tracker, mesh=None):
        """Wire an estimator.

        estimator : estimate.Estimator, built for the tissue markers of `motion` in their order
        motion : marker_motion.MarkerMotion;  params : EstimationParams
        tracker : (noise, offset) [m] sd per axis of one marker sample, of its constant error
        mesh : TetMesh of the estimates' nodes
        """
        self.params, self._estimator, self._motion = params, estimator, motion
        self.targets, self.mesh = estimator.targets, mesh
        self._pads = motion.jacobian.shape[2]
        self._calibration = Calibration(params.registration, motion, *tracker)
        self._intake = MarkerIntake(params.intake, motion)
        self._row = {name: i for i, name in enumerate(motion.names)}
        self._encoder, self._frame, self._due = deque(maxlen=_KEPT), None, None
        self._last, self._started = -np.inf, None
        self._loads = -np.inf, ()

    @property
    def registration(self):
        """The Registration in force, or None."""
        return self._calibration.registration

    def feel(self, t, q):
        """Take the encoders at t [s]: q (p,) [m]."""
        self._encoder.append((t, np.array(q, dtype=float)))

    def bear(self, t, loads):
        """Take what the instruments load the tissue with at t [s]: known_load.KnownLoads."""
        self._loads = t, tuple(loads)

    def see(self, t, ids, points):
        """Take one frame of t [s]: points (n, 3) [m] in the tracker's frame, NaN where hidden."""
        self._frame = (t, tuple(ids), np.asarray(points, dtype=float))

    def step(self, t):
        """Return a LiveStep if a period has passed by t [s], else None."""
        if self._due is not None and t < self._due - 1e-6:
            return None
        # one that takes longer than its period works on without a backlog
        self._due = t + self.params.period if self._due is None else max(
            self._due + self.params.period, t)
        self._started = t if self._started is None else self._started
        frame, self._frame = self._frame, None
        if frame is None or (self._pads and not self._encoder):
            return self._silent(t, frame)
        if frame[0] <= self._last:
            return LiveStep(t, None, Outcome.REJECTED, 'optical: a frame is not newer than the '
                            'last')
        self._last = frame[0]
        if self._pads and frame[0] - self._encoder[-1][0] > self.params.stale_after:
            return LiveStep(t, None, Outcome.STALE_INPUT, 'actuators/state: the last encoder '
                            f'reading is {frame[0] - self._encoder[-1][0]:.2f} s older than the '
                            f'frame, allowed {self.params.stale_after:g} s; the estimate is '
                            'withheld')
        return self._estimated(t, *frame)

    def _silent(self, t, frame):
        since = max(self._last, self._started)
        if t - since <= self.params.stale_after:
            return None
        missing = ('optical/markers: no frame' if frame is None
                   else 'actuators/state: no encoder reading')
        return LiveStep(t, None, Outcome.STALE_INPUT, f'{missing} for {t - since:.2f} s, allowed '
                        f'{self.params.stale_after:g} s; the estimate is withheld')

    def _estimated(self, t, when, ids, points):
        foreign = self._foreign(ids)
        if foreign:
            return LiveStep(t, None, Outcome.WRONG_SCENE, foreign)
        q = self._travel(when)
        outcome, message = self._calibration.take(when, self._by_label(ids, points),
                                                  self._motion.at(q))
        if not outcome.ok or self.registration is None:
            return LiveStep(t, None, outcome, message)
        taken = self._intake.take(when, q, ids, self.registration.apply(points))
        markers = taken.points[self._motion.on_tissue]
        seen = int(np.isfinite(markers).all(axis=1).sum())
        outcome, message = self._trouble(taken, seen)
        if outcome in (Outcome.WRONG_SCENE, Outcome.TOO_FEW_MARKERS):
            return LiveStep(t, None, outcome, message, seen=seen)
        told, loads = self._loads
        found = _sound(self._estimator.step(Surface(
            when, q, markers, self._frame_of(markers),
            loads if abs(when - told) <= self.params.stale_after else ())))
        if not found.outcome.ok:
            return LiveStep(t, None, found.outcome, found.message, seen=seen)
        if outcome.ok:
            outcome, message = found.notice, found.message
        return LiveStep(t, found, outcome, message, t - when, seen)

    def _foreign(self, ids):
        """Why these labels cannot be of this scene, '' if they can."""
        known = sum(n in self._row for n in ids)
        if 2 * known >= len(self._row):
            return ''
        return (f'{known} of the {len(self._row)} markers of the scene are among the '
                f'{len(ids)} of the tracker; at least half must be')

    def _travel(self, t):
        """Encoders (p,) [m] at t, interpolated; the last where t is later."""
        if not self._pads:
            return np.zeros(0)
        times = [when for when, _ in self._encoder]
        return np.array([np.interp(t, times, column)
                         for column in np.transpose([q for _, q in self._encoder])])

    def _by_label(self, ids, points):
        out = np.full((len(self._row), 3), np.nan)
        for name, point in zip(ids, points, strict=True):
            if name in self._row:
                out[self._row[name]] = point
        return out

    def _trouble(self, taken, seen):
        """(outcome, message) of a frame."""
        rejected = ', '.join(taken.rejected)
        if 2 * len(taken.rejected) > taken.labelled:
            return Outcome.WRONG_SCENE, (f'{len(taken.rejected)} of {taken.labelled} markers are '
                                         f'not where the scene can have them: {rejected}')
        if seen < self.params.fewest:
            return Outcome.TOO_FEW_MARKERS, (f'{seen} markers on tissue, needed are '
                                             f'{self.params.fewest:g}')
        if rejected:
            return Outcome.MARKERS_REJECTED, f'too far from where they can be: {rejected}'
        if taken.swapped:
            return Outcome.MARKERS_SWAPPED, f'labels put right: {", ".join(taken.swapped)}'
        return Outcome.OK, ''

    def _frame_of(self, markers):
        """Registration covariance (6, 6) about the middle of the markers seen."""
        return self.registration.covariance_about(np.nanmean(markers, axis=0))


def _sound(estimate):
    """The Estimate, or one that failed where a covariance is not positive definite."""
    if not estimate.outcome.ok:
        return estimate
    for name, point, C in zip(estimate.targets, estimate.points, estimate.covariance,
                              strict=True):
        least = np.linalg.eigvalsh(C).min() if np.isfinite(C).all() else np.nan
        if not (least > 0.0 and np.isfinite(point).all()):
            return Estimate.failed(estimate.t, estimate.targets, Outcome.NOT_POSITIVE_DEFINITE,
                                   f'{name}: the covariance is not positive definite; the '
                                   'estimate is withheld')
    return estimate
