"""Pads that may not move must stand; two nodes under one name are not one started again."""

import math

import pytest

from arm_brachy.control.cell_watch import MotionWatch, PulseWatch


def moved(watch, allowed, speed, t_end=2.0):
    """The first breach, with its time, of a pad at `speed` [m/s] from a permission's end on."""
    t = 0.0
    while t < t_end:
        if said := watch.breach(t, allowed, {'pad_1': speed * t, 'pad_2': 0.01}):
            return t, said
        t += 0.05
    return None


def test_a_pad_that_goes_on_without_permission_is_named_within_a_second():
    t, said = moved(MotionWatch(), False, 1e-3)
    assert 0.75 <= t <= 0.9      # 0.5 s of grace, then 0.3 mm at 1 mm/s
    assert said.startswith('pad_1 moved 0.3') and 'allowed 0.3 mm' in said


def test_braking_within_the_grace_and_permitted_motion_are_none():
    watch = MotionWatch()
    assert moved(watch, True, 20e-3) is None
    assert watch.breach(10.0, False, {'pad_1': 0.0}) == ''
    assert watch.breach(10.4, False, {'pad_1': 2e-3}) == ''      # still braking
    assert watch.breach(10.6, False, {'pad_1': 2e-3}) == ''
    assert watch.breach(60.0, False, {'pad_1': 2.2e-3}) == ''    # counts of the encoder
    assert watch.breach(60.1, False, {'pad_1': 2.4e-3}) != ''


def test_an_encoder_that_reads_nan_counts_as_motion():
    watch = MotionWatch()
    for t in (0.0, 1.0):
        watch.breach(t, False, {'pad_1': 0.0})
    assert 'nan' in watch.breach(1.1, False, {'pad_1': math.nan})


@pytest.mark.parametrize('offset', [0, 1, 700])
def test_two_nodes_of_a_name_are_seen_within_a_second(offset):
    watch = PulseWatch()
    for k in range(20):
        watch.heard(0.05 * k, 'recorder', k)
        watch.heard(0.05 * k + 0.01, 'recorder', k + offset)
        watch.heard(0.05 * k, 'em_tracker', k)
    assert watch.doubles(1.0) == ('recorder',)
    assert watch.doubles(10.0) == ()     # one of them has ended


def test_a_node_that_was_started_again_is_one():
    watch = PulseWatch()
    for k in [*range(100), *range(5), *range(7)]:
        watch.heard(0.0, 'recorder', k)
    assert watch.doubles(0.5) == ()
