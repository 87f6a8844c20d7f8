"""The gate between pushing, pausing and resting."""

import numpy as np

from arm_brachy.control.stillness import Stillness, StillnessParams

SD = 0.05e-3
P = StillnessParams()


def resting_gate():
    gate = Stillness(P)
    gate.pauses(0.0, 0.0)
    gate.keeps_still(P.settle_time, 0.0, SD)
    return gate


def test_it_starts_by_pushing_and_pauses_when_little_is_left():
    gate = Stillness(P)
    assert not gate.keeps_still(0.0, 0.0, SD)
    assert not gate.pauses(0.0, 2 * P.settle)
    assert gate.pauses(0.1, 0.5 * P.settle)
    assert gate.keeps_still(0.2, P.settle, SD)
    assert not gate.resting


def test_a_pause_becomes_a_rest_that_is_harder_to_end():
    between = P.settle + 0.5 * (P.resume + P.release) * SD
    paused = Stillness(P)
    paused.pauses(0.0, 0.0)
    assert not paused.keeps_still(0.5 * P.settle_time, between, SD)
    gate = resting_gate()
    assert gate.resting
    assert gate.keeps_still(P.settle_time + 1.0, between, SD)
    assert not gate.keeps_still(P.settle_time + 2.0, P.settle + 1.1 * P.release * SD, SD)
    assert not gate.resting


def test_caution_shrinks_towards_zero_and_never_turns_a_push_around():
    error = np.array([1e-3, -1e-3, 0.4 * P.caution * SD])
    left = Stillness(P).cautious(error, SD)
    assert np.allclose(left, [1e-3 - P.caution * SD, -1e-3 + P.caution * SD, 0.0])


def test_a_new_goal_ends_the_rest():
    gate = resting_gate()
    gate.reset()
    assert not gate.resting and not gate.keeps_still(9.0, 0.0, SD)
