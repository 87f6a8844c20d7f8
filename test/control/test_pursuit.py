"""Control period, running means, relative goals: what stands between goals and manipulator."""

import numpy as np
import pytest

from arm_brachy.control.goal import Goal, GoalKind
from arm_brachy.control.loop import ManipulatorParams
from arm_brachy.control.manipulator import Manipulator
from arm_brachy.control.model import ModelState
from arm_brachy.control.pursuit import Pursuit
from arm_brachy.control.safety import Permission
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome

NAMES = ('right', 'left')
STROKES = np.array([30e-3, 30e-3])
J = np.array([[-0.4, 0.4], [0.0, 0.0], [0.0, 0.0]])  # two opposed pads: only x can be had
REST = np.array([0.0, 0.0, 30e-3])
X = (True, False, False)


class LinearModel:
    """A target that moves in proportion to pad travel; it can be told to fail."""

    targets = ('t1', 't2')

    def __init__(self):
        self.outcome = Outcome.OK

    def rest(self, target):
        return REST

    def evaluate(self, q, target):
        return ModelState(REST + J @ q, J, self.outcome)


@pytest.fixture
def model():
    return LinearModel()


@pytest.fixture
def make(model):
    def build(tools=('t1', 't2'), **options):
        loop = Manipulator(ManipulatorParams(**options), model, STROKES, 20e-3, NAMES)
        return Pursuit(loop, model, tools, STROKES, NAMES)
    return build


def moved(x, target='t1'):
    return Goal(target, (x, 0.0, 0.0), axes=X)


def test_it_says_nothing_before_an_encoder_has_been_read(make):
    pursuit = make()
    assert pursuit.step(1.0) is None
    pursuit.feel(np.zeros(2))
    assert pursuit.step(1.02) is not None


@pytest.mark.parametrize('tick', [0.02, 0.025, 0.05])
def test_the_control_period_does_not_drift_with_the_tick(make, tick):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    steps = [pursuit.step(k * tick) for k in range(1, round(10.0 / tick) + 1)]
    assert sum(s is not None for s in steps) == 100


def test_a_displacement_counts_from_the_mean_of_the_last_second(make):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    for k in range(120):  # 3 s at 40 Hz: 2 s somewhere else, then 1 s around 7 mm
        x = 1e-3 if k < 79 else 7e-3 + 0.1e-3 * (-1)**k
        pursuit.hear('t1', 0.025 * k, np.array([x, 0.0, 30e-3]))
    answer = pursuit.pursue(moved(-2e-3))
    recent = [7e-3 + 0.1e-3 * (-1)**k for k in range(79, 120)]
    assert answer.start[0] == pytest.approx(np.mean(recent), abs=1e-12)
    assert answer.reference[0] == pytest.approx(answer.start[0] - 2e-3, abs=1e-12)
    assert answer.feasible and pursuit.active


def test_a_free_axis_keeps_its_place(make):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, np.array([1e-3, 2e-3, 3e-3]))
    answer = pursuit.pursue(Goal('t1', (-1e-3, 9.0, 9.0), axes=X))
    assert answer.reference[1:] == pytest.approx([2e-3, 3e-3])


def test_samples_that_are_not_finite_do_not_enter_the_mean(make):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST)
    pursuit.hear('t1', 0.025, np.full(3, np.nan))
    assert np.array_equal(pursuit.pursue(moved(1e-3)).start, REST)


def test_in_open_loop_nothing_measured_enters(make):
    pursuit = make(loop='open')
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST + 5e-3)
    answer = pursuit.pursue(moved(-2e-3))
    assert np.array_equal(answer.start, REST)
    assert answer.reference[0] == -2e-3


def test_a_position_is_taken_as_it_is(make):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST + 1e-3)
    goal = Goal('t1', (4e-3, 0.0, 0.0), GoalKind.POSITION, X)
    assert pursuit.pursue(goal).reference[0] == 4e-3


def test_a_goal_out_of_reach_is_answered_with_the_closest_point(make):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST)
    answer = pursuit.pursue(moved(-20e-3))  # 30 mm of stroke at 0.4 give 12 mm
    assert not answer.feasible
    assert answer.closest[0] == pytest.approx(-12e-3, abs=1e-6)
    assert 'right' in answer.message


@pytest.mark.parametrize(('tools', 'heard', 'target', 'said'), [
    (('t1',), True, 't2', 't2: it carries no sensor; those that do: t1'),
    (('t1',), False, 't1', 't1: its sensor has not been seen yet'),
    (('t1', 't3'), True, 't3', "target 't3'; must be one of t1, t2"),
])
def test_goals_it_cannot_pursue_are_refused(make, tools, heard, target, said):
    pursuit = make(tools)
    pursuit.feel(np.zeros(2))
    if heard:
        for tool in tools:
            pursuit.hear(tool, 0.0, REST)
    with pytest.raises(CommandRefused, match=said):
        pursuit.pursue(moved(1e-3, target))
    assert not pursuit.active


def test_a_goal_before_the_first_encoder_reading_is_refused(make):
    with pytest.raises(CommandRefused, match='start the actuator driver'):
        make().pursue(moved(1e-3))


def test_a_goal_is_refused_while_the_model_fails(make, model):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST)
    model.outcome = Outcome.NOT_CONVERGED
    with pytest.raises(CommandRefused, match='solver stopped short'):
        pursuit.pursue(moved(1e-3))
    assert not pursuit.active


@pytest.mark.parametrize(('age', 'taken'), [(0.45, True), (0.55, False)])
def test_a_goal_is_refused_once_the_last_sample_is_stale(make, age, taken):
    pursuit = make(stale_after=0.5)
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 1.0, REST)
    pursuit.step(1.0 + age)
    if taken:
        assert pursuit.pursue(moved(1e-3)).feasible
    else:
        with pytest.raises(CommandRefused, match=r'last seen 0\.55 s ago, allowed 0\.5 s'):
            pursuit.pursue(moved(1e-3))


@pytest.mark.parametrize('permission', [Permission.HOLD, Permission.STOP])
def test_without_permission_the_goal_is_dropped_and_the_next_refused(make, permission):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST)
    pursuit.pursue(moved(-3e-3))
    pursuit.permit(permission, 'pad_1: too much')
    assert not pursuit.active
    with pytest.raises(CommandRefused, match='pad_1: too much.*actuator_driver/release'):
        pursuit.pursue(moved(-3e-3))
    pursuit.permit(Permission.RUN)
    assert not pursuit.active
    assert pursuit.pursue(moved(-3e-3)).feasible


def drive(pursuit, t0, seconds, q, tick=0.05):
    """Ideal servos and a tracker that sees what the model predicts; returns the last step."""
    step = None
    for k in range(1, round(seconds / tick) + 1):
        t = t0 + k * tick
        pursuit.hear('t1', t, REST + J @ q)
        pursuit.feel(q)
        new = pursuit.step(t)
        if new is not None and pursuit.active:
            step, q = new, np.array(new.command)
    return step, q


def test_it_reaches_holds_and_drops_the_goal(make):
    pursuit = make()
    drive(pursuit, 0.0, 1.0, np.zeros(2))
    pursuit.pursue(moved(-3e-3))
    step, q = drive(pursuit, 1.0, 5.0, np.zeros(2))
    assert step.reached and (REST + J @ q)[0] == pytest.approx(-3e-3, abs=0.1e-3)
    pursuit.hold()
    step, _ = drive(pursuit, 6.0, 0.5, q)
    assert step.outcome is Outcome.HELD and np.array_equal(step.command, q)
    pursuit.abort()
    assert not pursuit.active
    assert drive(pursuit, 6.5, 0.5, q)[0] is None


def test_a_sample_is_used_once(make):
    pursuit = make()
    pursuit.feel(np.zeros(2))
    pursuit.hear('t1', 0.0, REST)
    assert pursuit.step(0.1).outcome is Outcome.OK
    last = pursuit.step(0.2)
    assert 'refused' not in last.message and last.outcome is Outcome.OK


def test_what_was_felt_is_its_own(make):
    pursuit, q = make(), np.zeros(2)
    pursuit.feel(q)
    q += 10e-3
    step = pursuit.step(0.1)
    assert np.array_equal(step.estimate - step.disturbance, REST)
