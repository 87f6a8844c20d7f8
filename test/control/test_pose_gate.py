"""A forged pose drives no pad; noise, a wrong model and an offset from the start are believed."""

import numpy as np
import pytest

from arm_brachy.control.goal import Goal
from arm_brachy.control.loop import ManipulatorParams
from arm_brachy.control.manipulator import Manipulator
from arm_brachy.control.model import ModelState
from arm_brachy.control.observer import ObserverParams
from arm_brachy.core.outcome import Outcome

NAMES, STROKE, SPEED, SAMPLE = ('right', 'left', 'top', 'bottom'), 30e-3, 5e-3, 0.025
J4 = np.array([[-0.40, 0.40, 0.05, -0.05], [0.05, -0.05, -0.40, 0.40], [0.1, 0.1, 0.1, 0.1]])
REST = np.array([0.0, 0.0, 30e-3])
FORGED = np.array([6e-3, 0.0, 0.0])


class Model:
    """Linear, and believed to be the truth."""

    targets = ('t1',)

    def rest(self, target):
        return REST

    def evaluate(self, q, target):
        return ModelState(REST + J4 @ q, J4, Outcome.OK)


def run(seconds, *, gain=1.0, offset=(0.0, 0.0, 0.0), forge=None, goal_at=2.0, seed=0):
    """Pursue 2 mm of a plant with `gain` on the Jacobian; returns the steps and true pad travel.

    forge : callable (t, true position) -> position of a second sample, or None
    """
    loop = Manipulator(ManipulatorParams(observer=ObserverParams(noise=0.3e-3)), Model(),
                       np.full(4, STROKE), SPEED, NAMES)
    rng, q, command = np.random.default_rng(seed), np.zeros(4), np.zeros(4)
    samples, steps = [], []
    for k in range(1, round(seconds / SAMPLE)):
        t = k * SAMPLE
        q = q + np.clip(command - q, -SPEED * SAMPLE, SPEED * SAMPLE)
        true = REST + np.array(offset) + gain * J4 @ q
        samples.append((t, true + 0.3e-3 * rng.normal(size=3)))
        if forge is not None and (forged := forge(t, true)) is not None:
            samples.append((t + 1e-3, forged))
        if abs(t - goal_at) < SAMPLE / 2:
            loop.set_goal(Goal('t1', (-2e-3 + offset[0], 0.0, 0.0), axes=(True, False, False)))
        if k % 4 == 0:
            steps.append(loop.step(t, q, samples))
            samples, command = [], steps[-1].command
    return loop, steps, q


def test_a_pose_forged_beside_the_true_one_moves_no_pad_and_is_named():
    _, _, honest = run(2.0)
    loop, steps, q = run(12.0, forge=lambda t, true: true + FORGED if t > 1.0 else None)
    assert np.allclose(q, honest, atol=1e-4)
    assert steps[-1].outcome is Outcome.REJECTED
    assert 'contradict' in steps[-1].message and 'second publisher' in steps[-1].message
    assert loop.gate.gated > 300


def test_two_sources_hold_the_pads_where_they_are():
    """A second tracker during the task: no pad goes on by more than a millimetre."""
    _, _, before = run(5.0)
    _, steps, q = run(12.0, forge=lambda t, true: true + FORGED if t > 5.0 else None)
    assert np.abs(q - before).max() < 1e-3
    assert not steps[-1].outcome.ok


@pytest.mark.parametrize(('gain', 'offset'), [
    (1.0, (0, 0, 0)), (0.5, (0, 0, 0)), (1.8, (0, 0, 0)), (1.0, (6e-3, -4e-3, 0))])
@pytest.mark.parametrize('seed', range(3))
def test_noise_a_wrong_gain_and_an_offset_from_the_start_are_believed(gain, offset, seed):
    loop, steps, _ = run(15.0, gain=gain, offset=offset, seed=seed)
    assert loop.gate.gated == 0
    assert abs(steps[-1].error[0]) < 0.3e-3


def test_one_source_that_jumps_and_stays_is_believed_after_two_seconds():
    loop, _, q = run(6.0)
    seen = REST + J4 @ q + FORGED
    outcomes = {}
    for k in range(1, 40):
        t = 6.0 + 0.1 * k
        step = loop.step(t, q, [(t - 0.05, seen), (t - 0.025, seen)])
        outcomes[round(t, 1)] = step.outcome
    assert all(outcomes[t] is not Outcome.OK for t in (6.1, 7.0, 8.0))
    assert step.outcome is Outcome.OK and np.allclose(step.estimate, seen, atol=0.1e-3)


def test_after_an_abort_the_target_is_taken_where_it_is_seen():
    loop, _, q = run(6.0)
    late = [(6.0 + SAMPLE * k, REST + J4 @ q + FORGED) for k in range(1, 5)]
    assert loop.step(6.1, q, late).outcome is Outcome.REJECTED
    loop.abort()
    step = loop.step(6.2, q, [(6.2, REST + J4 @ q + FORGED)])
    assert step.outcome is Outcome.OK
    assert np.allclose(step.estimate, REST + J4 @ q + FORGED, atol=0.1e-3)
