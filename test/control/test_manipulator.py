"""The loop against plants that are not its model: no offset, quiet on noise, honest in trouble."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.control.goal import Goal, GoalKind, task
from arm_brachy.control.loop import ManipulatorParams
from arm_brachy.control.manipulator import Manipulator
from arm_brachy.control.model import ModelState
from arm_brachy.control.mpc import MpcParams
from arm_brachy.control.observer import ObserverParams
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome

SPEED, STROKE, SAMPLE, PER_STEP = 5e-3, 30e-3, 0.025, 4
NAMES = ('right', 'left', 'top', 'bottom')
# Gains as those of the breast phantom, pads at +x, -x, +y, -y pushing inwards.
J4 = np.array([[-0.40, 0.40, 0.05, -0.05], [0.05, -0.05, -0.40, 0.40], [0.1, 0.1, 0.1, 0.1]])
QUIET = ManipulatorParams(observer=ObserverParams(noise=0.05e-3))


class LinearModel:
    """A model with a constant Jacobian; it can be told to fail."""

    targets = ('t1', 't2')

    def __init__(self, J=J4):
        self.J, self.outcome, self.asked = J, Outcome.OK, []

    def rest(self, target):
        return np.array([0.0, 0.0, 30e-3])

    def evaluate(self, q, target):
        self.asked.append(q)
        return ModelState(self.rest(target) + self.J @ q, self.J, self.outcome)


def turned(degrees, gain=1.0):
    """Rotation about z with a gain."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return gain * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


class Bench:
    """A linear plant with ideal servos and a 40 Hz tracker around a Manipulator."""

    def __init__(self, plant, params=QUIET, *, noise=0.0, seed=0, model_J=J4, offset=(0, 0, 0)):
        self.model, self.plant = LinearModel(model_J), np.asarray(plant)
        p = self.plant.shape[1]
        self.loop = Manipulator(params, self.model, np.full(p, STROKE), SPEED, NAMES[:p])
        self.rng, self.noise = np.random.default_rng(seed), noise
        self.offset = np.array([0.0, 0.0, 30e-3]) + np.array(offset)
        self.q, self.command, self.samples = np.zeros(p), np.zeros(p), []
        self.k, self.steps, self.qq, self.truth = 0, [], [], []

    @property
    def position(self):
        return self.offset + self.plant @ self.q

    def run(self, seconds, *, blind=False):
        for _ in range(round(seconds / SAMPLE)):
            self.k += 1
            reach = SPEED * SAMPLE
            self.q = self.q + np.clip(self.command - self.q, -reach, reach)
            if not blind:
                seen = self.position + self.noise * self.rng.normal(size=3)
                self.samples.append((self.k * SAMPLE, seen))
            if self.k % PER_STEP == 0:
                self.tick()
        return self.steps[-1]

    def tick(self):
        step = self.loop.step(self.k * SAMPLE, self.q, self.samples)
        self.samples, self.command = [], step.command
        self.steps.append(step)
        self.qq.append(self.q)
        self.truth.append(self.position)


def controlled_error(bench, goal):
    """True error [m] on the controlled axes, over the steps."""
    reference = goal.position(bench.model.rest('t1'))
    return (np.array(bench.truth) - reference)[:, goal.mask]


@pytest.mark.parametrize('number', [1, 2, 3])
@pytest.mark.parametrize(('degrees', 'gain'), [(0, 1.0), (0, 0.7), (0, 1.3), (20, 1.0),
                                               (-20, 0.7)])
def test_no_offset_is_left_by_a_wrong_jacobian_and_a_shifted_target(number, degrees, gain):
    bench = Bench(turned(degrees, gain) @ J4, offset=(0.5e-3, -0.3e-3, 0.2e-3))
    goal = task(number, 't1')
    bench.run(1.0)
    bench.loop.set_goal(goal)
    last = bench.run(19.0)
    assert np.abs(controlled_error(bench, goal)[-1]).max() < 0.05e-3
    assert last.reached and last.settled and last.outcome is Outcome.OK


@pytest.mark.parametrize('number', [1, 3])
def test_pads_only_ever_push_within_stroke_and_speed(number):
    bench = Bench(turned(15, 1.2) @ J4, ManipulatorParams(), noise=0.3e-3)
    bench.loop.set_goal(task(number, 't1'))
    bench.run(15.0)
    commands = np.array([s.command for s in bench.steps])
    push = np.diff(commands, axis=0)
    assert push.min() >= 0.0
    assert push.max() <= SPEED * QUIET.mpc.period * (1 + 1e-12)
    assert push.max() == pytest.approx(SPEED * QUIET.mpc.period)
    assert commands.min() >= 0.0 and commands.max() <= STROKE


@pytest.mark.parametrize('noise', [0.15e-3, 0.3e-3])
@pytest.mark.parametrize('seed', [0, 1, 2])
def test_a_minute_of_noise_does_not_ratchet_the_pads(noise, seed):
    bench = Bench(turned(10, 1.2) @ J4, ManipulatorParams(), noise=noise, seed=seed)
    goal = task(3, 't1')
    bench.run(1.0)
    bench.loop.set_goal(goal)
    bench.run(14.0)
    before = bench.q.copy()
    bench.run(60.0)
    assert np.sum(bench.q - before) < 0.2e-3
    assert np.abs(controlled_error(bench, goal)[-600:]).max() < 0.2e-3


def test_open_loop_follows_the_model_and_never_the_tracker():
    params = dataclasses.replace(QUIET, loop='open')
    bench = Bench(turned(0, 0.8) @ J4, params, offset=(1e-3, 0, 0))
    goal = task(1, 't1')
    bench.loop.set_goal(goal)
    bench.run(20.0)
    assert bench.model.J[0] @ bench.q == pytest.approx(-5e-3, abs=0.02e-3)
    assert controlled_error(bench, goal)[-1, 0] == pytest.approx(1e-3 + 1e-3, abs=0.02e-3)
    blind = Bench(turned(0, 0.8) @ J4, params)
    blind.loop.set_goal(goal)
    blind.run(20.0, blind=True)
    assert np.array_equal(blind.command, bench.command)


def test_retraction_brings_back_what_pushing_overshot():
    params = dataclasses.replace(QUIET, mpc=MpcParams(retraction=True))
    bench = Bench(J4[:, :1], params, model_J=J4[:, :1])
    bench.loop.set_goal(Goal('t1', (-4e-3, 0, 0), axes=(True, False, False)))
    bench.run(8.0)
    bench.loop.set_goal(Goal('t1', (-2e-3, 0, 0), axes=(True, False, False)))
    bench.run(8.0)
    assert bench.position[0] == pytest.approx(-2e-3, abs=0.05e-3)


def test_two_opposed_pads_cannot_go_sideways_but_go_to_the_closest_point_and_say_why():
    J = np.array([[-0.4, 0.4], [0.0, 0.0], [0.1, 0.1]])
    bench = Bench(J, model_J=J)
    bench.loop.set_goal(Goal('t1', (-3e-3, 4e-3, 0)))
    last = bench.run(10.0)
    assert last.outcome is Outcome.INFEASIBLE
    assert 'right, left only push' in last.message and '4.0' in last.message
    assert np.allclose(last.closest[:2], [-3e-3, 0.0], atol=0.05e-3)
    assert np.allclose(bench.position[:2], [-3e-3, 0.0], atol=0.05e-3)
    assert last.settled and not last.reached


def test_with_the_option_off_an_unreachable_goal_moves_nothing():
    J = np.array([[-0.4, 0.4], [0.0, 0.0], [0.1, 0.1]])
    bench = Bench(J, dataclasses.replace(QUIET, go_to_closest=False), model_J=J)
    bench.loop.set_goal(Goal('t1', (-3e-3, 4e-3, 0)))
    assert bench.run(3.0).outcome is Outcome.INFEASIBLE
    assert np.all(bench.q == 0.0)


def test_a_goal_beyond_the_stroke_ends_at_the_stroke_and_names_the_pad():
    bench = Bench(J4)
    bench.loop.set_goal(Goal('t1', (-25e-3, 0, 0), axes=(True, False, False)))
    last = bench.run(15.0)
    assert last.outcome is Outcome.INFEASIBLE and 'stroke of right' in last.message
    assert bench.q[0] == pytest.approx(STROKE)


def test_preview_answers_without_moving():
    loop = Bench(J4[:, :2], model_J=J4[:, :2]).loop
    reach = loop.preview(Goal('t1', (0, 5e-3, 0)), np.zeros(2), loop.rest('t1'))
    assert not reach.feasible and reach.explanation
    assert loop.goal is None


def test_abort_stops_where_the_pads_are_and_a_new_goal_starts_there():
    bench = Bench(J4)
    bench.loop.set_goal(task(1, 't1'))
    bench.run(1.0)
    bench.loop.abort()
    at = bench.q.copy()
    last = bench.run(1.0)
    assert last.outcome is Outcome.OK and bench.loop.goal is None   # as it was asked to
    assert np.abs(bench.q - at).max() <= SPEED * QUIET.mpc.period + 1e-12
    bench.q = bench.command = np.zeros(4)     # somebody sends the pads home meanwhile
    bench.loop.set_goal(task(2, 't1'))
    bench.tick()
    assert np.all(bench.command <= SPEED * QUIET.mpc.period)


def test_the_command_does_not_wind_up_while_the_pads_do_not_follow():
    bench = Bench(J4)
    bench.run(0.5)
    bench.loop.set_goal(task(1, 't1'))
    bench.run(0.5)
    for _ in range(100):  # ten seconds in which the bank refuses every command
        bench.k += PER_STEP
        bench.samples = [(bench.k * SAMPLE, bench.position)]
        bench.tick()
    lead = SPEED * (QUIET.actuator_delay + QUIET.mpc.period)
    assert (bench.command - bench.q).max() == pytest.approx(lead)
    bench.run(10.0)
    assert bench.steps[-1].reached


def test_hold_keeps_the_command_and_resume_goes_on():
    bench = Bench(J4)
    with pytest.raises(CommandRefused, match='no goal'):
        bench.loop.resume()
    bench.loop.set_goal(task(1, 't1'))
    bench.run(1.0)
    bench.loop.hold()
    held = bench.command.copy()
    assert bench.run(2.0).outcome is Outcome.HELD
    assert np.array_equal(bench.command, held)
    bench.loop.resume()
    assert bench.run(10.0).reached


def test_no_samples_means_no_push():
    bench = Bench(J4)
    bench.loop.set_goal(task(1, 't1'))
    first = bench.run(1.0, blind=True)
    assert first.outcome is Outcome.STALE_INPUT and 'none was received' in first.message
    assert np.all(bench.q == 0.0)
    bench.run(1.0)
    bench.run(QUIET.stale_after + 0.2, blind=True)
    held = bench.command.copy()
    stale = bench.run(2.0, blind=True)
    assert stale.outcome is Outcome.STALE_INPUT and 's old' in stale.message
    assert f'must be within {QUIET.stale_after:g} s' in stale.message
    assert np.array_equal(stale.command, held)
    assert bench.run(12.0).reached


def test_a_sample_that_is_not_finite_or_comes_twice_is_refused_and_harmless():
    bench, twin = Bench(J4), Bench(J4)
    for b in (bench, twin):
        b.loop.set_goal(task(1, 't1'))
        b.run(0.975)
    bench.samples.insert(1, (0.96, np.array([np.nan, 0.0, 0.0])))
    bench.samples.append(bench.samples[0])
    step, clean = bench.run(0.025), twin.run(0.025)
    assert step.outcome is Outcome.REJECTED
    assert 'not finite' in step.message and 'not newer' in step.message
    assert np.array_equal(step.command, clean.command)


def test_an_encoder_that_is_not_finite_holds_the_command():
    bench = Bench(J4)
    bench.loop.set_goal(task(1, 't1'))
    bench.run(1.0)
    step = bench.loop.step(1.1, np.array([0.0, np.nan, 0.0, 0.0]))
    assert step.outcome is Outcome.REJECTED
    assert np.array_equal(step.command, bench.command)


def test_a_model_that_fails_holds_the_command_and_recovers():
    bench = Bench(J4)
    bench.loop.set_goal(task(1, 't1'))
    bench.run(1.0)
    held, bench.model.outcome = bench.command.copy(), Outcome.INVERTED_ELEMENT
    failed = bench.run(0.5)
    assert failed.outcome is Outcome.INVERTED_ELEMENT and 'tissue model' in failed.message
    assert np.array_equal(failed.command, held)
    bench.model.outcome = Outcome.OK
    assert bench.run(10.0).reached


def test_a_resting_loop_does_not_solve_the_model_again():
    bench = Bench(J4)
    bench.loop.set_goal(task(1, 't1'))
    bench.run(15.0)
    count = len(bench.model.asked)
    bench.run(5.0)
    assert len(bench.model.asked) == count


def test_an_unknown_target_is_refused_by_name_and_the_goal_stays():
    bench = Bench(J4)
    bench.loop.set_goal(task(1, 't1'))
    with pytest.raises(CommandRefused, match="'t9'; must be one of t1, t2"):
        bench.loop.set_goal(task(1, 't9'))
    assert bench.loop.goal == task(1, 't1')


def test_another_target_starts_without_the_first_ones_disturbance():
    bench = Bench(J4, offset=(2e-3, 0, 0))
    bench.run(3.0)
    assert bench.steps[-1].disturbance[0] == pytest.approx(2e-3, rel=0.01)
    bench.loop.set_goal(Goal('t2', (0, 0, 0), GoalKind.POSITION))
    assert np.all(bench.loop.observer.disturbance == 0.0) and bench.loop.target == 't2'
