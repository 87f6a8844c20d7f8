"""One estimate a period, of the newest frame, at the travel that the pads had then."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.live import EstimationParams, LiveEstimator

REST = np.array([[80, 60, 0], [-80, 60, 0], [-80, -60, 0], [0, 0, 60], [30, 0, 50], [0, 30, 50],
                 [-30, 0, 50]]) * 1e-3
NAMES = ('b1', 'b2', 'b3', 'a', 'b', 'c', 'd')
FRAMES = tuple(0.01 * np.arange(1, 101))


class Recorded:
    """An estimator that keeps what it is given."""

    targets = ('t',)

    def __init__(self):
        self.given = []

    def step(self, surface):
        self.given.append(surface)
        return Estimate(surface.t, self.targets, np.zeros((1, 3)), 1e-8 * np.eye(3)[None])


def live(pads=1, **changes):
    on_base = np.arange(len(NAMES)) < 3
    motion = SimpleNamespace(
        names=NAMES, on_base=on_base, on_pad=np.zeros(len(NAMES), dtype=bool), on_tissue=~on_base,
        rest=REST, jacobian=np.zeros((len(NAMES), 3, pads)),
        at=lambda q: REST + np.outer(~on_base, [float(np.sum(q)), 0.0, 0.0]))
    estimator = Recorded()
    return LiveEstimator(estimator, motion, EstimationParams(**changes), (2e-5, 9e-5)), estimator


def run(one, until, tick=0.05, pads=1, frames=FRAMES, speed=10e-3, hidden=()):
    """Ticks until [s]; the pad moves at `speed`; frames come 10 ms after they were taken."""
    steps, taken = [], 0
    for t in tick * np.arange(1, round(until / tick) + 1):
        if pads:
            one.feel(t, [speed * t] * pads)
        while taken < len(frames) and frames[taken] + 0.01 <= t + 1e-9:
            points = one._motion.at([speed * frames[taken]] * pads)
            points[list(hidden)] = np.nan
            one.see(frames[taken], NAMES, points)
            taken += 1
        steps.append(one.step(t))
    return [s for s in steps if s is not None]


def test_one_estimate_a_period_at_the_time_of_the_newest_frame():
    one, estimator = live()
    steps = [s for s in run(one, 1.0) if s.estimate is not None]
    times = [s.estimate.t for s in steps]
    assert np.allclose(np.diff(times), 0.1) and times[-1] == pytest.approx(0.94)
    assert all(s.age == pytest.approx(0.01) for s in steps)
    assert [s.t for s in estimator.given] == times


def test_travel_is_that_of_the_time_of_the_frame_not_of_the_tick():
    one, estimator = live()
    run(one, 1.0)
    for surface in estimator.given:
        assert surface.q[0] == pytest.approx(10e-3 * surface.t, rel=1e-9)


def test_the_estimator_hears_of_the_registration_and_of_tissue_markers_only():
    one, estimator = live()
    run(one, 1.0)
    surface = estimator.given[-1]
    assert surface.markers.shape == (4, 3) and surface.seen.all()
    np.testing.assert_allclose(surface.frame_covariance, one.registration.covariance_about(
        surface.markers.mean(axis=0)))


def test_a_body_without_pads_needs_no_encoders():
    one, estimator = live(pads=0)
    run(one, 1.0, pads=0)
    assert len(estimator.given) > 5 and estimator.given[-1].q.shape == (0,)


def test_loads_that_are_told_are_the_estimators_until_they_are_old():
    one, estimator = live(stale_after=0.3)
    one.bear(0.2, ['pressed'])
    run(one, 1.0)
    told = [surface.t for surface in estimator.given if surface.loads == ('pressed',)]
    assert told and max(told) <= 0.5 + 1e-9
    assert all(surface.loads == () for surface in estimator.given if surface.t > 0.51)


def test_a_silent_encoder_is_named():
    one, _ = live()
    steps = run(one, 1.0, pads=0)
    assert steps[-1].outcome is Outcome.STALE_INPUT and 'actuators/state: no encoder' in (
        steps[-1].message)


def test_encoders_that_fall_silent_are_named_and_nothing_is_estimated_at_an_old_travel():
    one, estimator = live()
    feel, one.feel = one.feel, lambda t, q: feel(t, q) if t <= 0.4 else None
    steps = run(one, 2.0, frames=tuple(0.01 * np.arange(1, 201)))
    late = [s for s in steps if s.t > 0.4 + one.params.stale_after + 0.15]
    assert late and all(s.estimate is None and s.outcome is Outcome.STALE_INPUT for s in late)
    assert 'encoder' in late[-1].message
    assert max(s.t for s in estimator.given) <= 0.4 + one.params.stale_after


def test_nothing_is_worked_off_later_that_was_due_while_it_worked():
    one, _ = live()
    run(one, 0.5)
    one.see(0.9, NAMES, REST)
    assert one.step(10.0) is not None    # as after an estimate that took nine seconds
    one.see(10.03, NAMES, REST)
    assert one.step(10.0 + 1e-3) is not None
    one.see(10.05, NAMES, REST)
    assert one.step(10.05) is None


def test_a_frame_that_is_not_newer_is_refused_by_name():
    one, _ = live()
    run(one, 0.55)
    one.see(0.2, NAMES, REST)
    step = one.step(0.66)
    assert step.outcome is Outcome.REJECTED and 'not newer' in step.message


@pytest.mark.parametrize('bump', [1.5e-3, 4e-3])
def test_a_tracker_that_is_bumped_is_named_and_registered_again(bump):
    one, estimator = live()
    see = one.see
    one.see = lambda t, ids, points: see(t, ids, points + (bump if t > 0.5 else 0.0))
    steps = run(one, 1.0, speed=0.0)
    lost = [s for s in steps if s.outcome is Outcome.LOST_REGISTRATION]
    assert lost and 'has moved' in lost[0].message
    after = [s for s in estimator.given if s.t > 0.5]
    assert after and all(np.allclose(s.markers, REST[3:], atol=1e-4) for s in after)


def test_too_few_landmarks_to_register_is_said_once_patience_is_over():
    one, _ = live()
    steps = run(one, 1.4, frames=tuple(0.01 * np.arange(1, 150)), hidden=[0, 1])
    assert all(s.estimate is None for s in steps)
    assert steps[-1].outcome is Outcome.LOST_REGISTRATION
    assert steps[-1].message.startswith('1 landmarks (b3)')
