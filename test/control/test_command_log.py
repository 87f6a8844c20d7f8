"""Pending travel: credited while it can still come, written off afterwards."""

import numpy as np

from arm_brachy.control.command_log import CommandLog


def log_of(*entries, delay=0.3):
    log = CommandLog(delay)
    for t, command in entries:
        log.append(t, np.array([command]))
    return log


def test_a_fresh_command_is_pending_in_full():
    log = log_of((0.0, 0.0), (0.1, 1e-3))
    assert np.allclose(log.pending(0.15, np.array([0.2e-3])), 0.8e-3)


def test_travel_seen_at_the_encoder_is_no_longer_pending():
    log = log_of((0.0, 0.0), (0.1, 1e-3))
    assert np.allclose(log.pending(0.2, np.array([1e-3])), 0.0)


def test_a_servo_that_stays_behind_for_good_is_not_waited_for():
    log = log_of((0.0, 0.0), (0.1, 1e-3), (0.5, 1e-3))
    assert np.allclose(log.pending(0.6, np.array([0.9e-3])), 0.0)


def test_only_the_recent_push_is_credited_to_a_servo_with_an_offset():
    log = log_of((0.0, 1e-3), (0.4, 1e-3), (0.8, 1.1e-3))
    assert np.allclose(log.pending(0.9, np.array([0.7e-3])), 0.1e-3)


def test_a_pad_beyond_its_command_owes_nothing():
    log = log_of((0.0, 0.0), (0.1, 1e-3))
    assert np.allclose(log.pending(0.2, np.array([1.2e-3])), 0.0)


def test_a_retraction_is_pending_too():
    log = log_of((0.0, 2e-3), (0.1, 1e-3))
    assert np.allclose(log.pending(0.15, np.array([1.6e-3])), -0.6e-3)
