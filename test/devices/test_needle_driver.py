"""The needle driver: where the tip is, where it is told to be, and what stops it."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import CommandRefused, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.devices.insertion import InsertionProfile
from arm_brachy.devices.needle_driver import (
    NeedleDriver,
    NeedleDriverParams,
    nominal_offset,
)

HOLE, AXIS, SIDE = np.array([-0.1, 0.02, 0.03]), np.array([0.6, 0.8, 0.0]), np.array([0, 0, 1.0])
EXACT = NeedleDriverParams(radius_spread=0.0, depth_noise=0.0, depth_error=0.0, force_noise=0.0,
                           depth_latency=0.0, column=1, row=0)
TICK = 0.05
# Three columns along SIDE, two rows across it; the needle starts in column 1, row 0: HOLE.
UP = np.cross(AXIS, SIDE)
HOLES = HOLE + 5e-3 * (np.array([-1, 0, 1])[:, None, None] * SIDE
                       + np.array([0, 1])[None, :, None] * UP)


def driver(params=EXACT, seed=0):
    needle = NeedleDriver(replace(params, column=1, row=0), HOLES, AXIS, SIDE,
                          np.random.default_rng(seed))
    needle.read(0.0)
    return needle


def run(needle, seconds, force=0.0, start=0.0):
    return [needle.read(start + TICK * k, force) for k in range(1, round(seconds / TICK) + 1)]


def test_the_motor_arrives_in_the_time_of_a_trapezoid():
    needle = driver()
    needle.command(0.08, 0.02)
    states = run(needle, 6.0)
    profile = EXACT.insertion
    last = 0.08 / 0.02 + 0.02 / profile.acceleration
    moving = [s.t for s in states if s.moving]
    assert np.isclose(moving[-1], last, atol=2 * TICK)
    assert states[-1].true_depth == 0.08 and states[-1].outcome is Outcome.OK
    assert max(s.velocity for s in states) <= 0.02 + 1e-9


def test_the_told_tip_is_the_true_one_where_depth_and_radius_are_known():
    needle = driver()
    needle.command(0.08)
    state = run(needle, 12.0)[-1]
    assert np.allclose(state.tip_p, state.shaft[-1], atol=1e-12)
    assert np.allclose(state.tip_R[:, 2], state.axes[-1], atol=1e-12)
    assert np.allclose(state.tip_R.T @ state.tip_R, np.eye(3)) and np.linalg.det(state.tip_R) > 0.0
    assert np.allclose(state.shaft[0], HOLE) and np.allclose(state.axes[0], AXIS)


def test_told_straight_the_tip_is_wrong_by_the_deflection():
    needle = driver(replace(EXACT, told='straight'))
    needle.command(0.08)
    state = run(needle, 12.0)[-1]
    R = EXACT.needle.radius
    assert np.allclose(state.tip_p, HOLE + 0.08 * AXIS)
    error = state.shaft[-1] - state.tip_p
    assert np.isclose(error @ SIDE, R * (1.0 - np.cos(0.08 / R)), rtol=1e-9)
    assert np.isclose(error @ AXIS, R * np.sin(0.08 / R) - 0.08, rtol=1e-9)


def test_the_roll_turns_the_side_that_it_bends_to():
    needle = driver(replace(EXACT, roll=np.pi / 2))
    needle.command(0.08)
    bent = run(needle, 12.0)[-1].shaft[-1] - HOLE
    assert np.isclose(bent @ SIDE, 0.0, atol=1e-12) and bent @ np.cross(AXIS, SIDE) > 7e-3


def test_half_a_turn_midway_brings_it_back_and_the_told_tip_knows():
    needle = driver()
    needle.command(0.04)
    run(needle, 5.0)
    needle.turn(np.pi)
    needle.command(0.08)
    state = run(needle, 5.0, start=5.0)[-1]
    assert state.roll == np.pi
    assert np.isclose(state.axes[-1] @ SIDE, 0.0, atol=1e-12)
    assert np.allclose(state.tip_p, state.shaft[-1], atol=1e-9)
    offset = nominal_offset(EXACT, AXIS, SIDE)
    assert np.allclose(offset(np.pi, 0.04), offset(0.0, 0.04) * [1, 1, -1])


def test_a_curvature_told_after_a_withdrawal_past_a_turn_moves_no_tip():
    """The same curvature as before: what was cut anew bends to where the bevel was then."""
    needle, t = driver(), 0.0
    for depth, roll in ((0.06, None), (0.03, np.pi), (0.06, None)):
        if roll is not None:
            needle.turn(roll)
        needle.command(depth)
        state = run(needle, 8.0, start=t)[-1]
        t += 8.0
    needle.bends(1.0 / EXACT.needle.radius)
    after = run(needle, 1.0, start=t)[-1]
    assert np.allclose(after.tip_p, state.tip_p, atol=1e-6)
    assert np.allclose(after.tip_p, after.shaft[-1], atol=1e-6)


def test_the_told_tip_follows_the_arc_that_the_driver_is_told():
    """Turned midway, told straight, then told how it bends: the tip is the true one at once."""
    needle = driver(replace(EXACT, told='straight'))
    needle.command(0.04)
    run(needle, 5.0)
    needle.turn(np.pi / 2)
    needle.command(0.06)
    state = run(needle, 5.0, start=5.0)[-1]
    assert np.linalg.norm(state.tip_p - state.shaft[-1]) > 2e-3
    needle.bends(1.0 / EXACT.needle.radius)
    state = needle.read(10.05)
    assert np.allclose(state.tip_p, state.shaft[-1], atol=1e-9)
    needle.command(0.08)
    state = run(needle, 5.0, start=10.05)[-1]
    assert np.allclose(state.tip_p, state.shaft[-1], atol=1e-9)
    needle.bends(0.0)
    assert np.allclose(needle.read(15.1).tip_p, HOLE + 0.08 * AXIS, atol=1e-9)
    off = np.array([0.0, 0.3e-3, -0.4e-3])
    needle.bends(0.0, off)
    assert np.allclose(needle.read(15.15).tip_p, HOLE + 0.08 * AXIS + off, atol=1e-9)


@pytest.mark.parametrize('curvature', [-1.0, 21.0, np.nan])
def test_a_curvature_that_no_needle_has_is_refused(curvature):
    needle = driver()
    with pytest.raises(CommandRefused, match='curvature'):
        needle.bends(curvature)


@pytest.mark.parametrize('offset', [(0.0, 0.0, 0.011), (np.nan, 0.0, 0.0)])
def test_an_offset_that_no_tissue_causes_is_refused(offset):
    needle = driver()
    with pytest.raises(CommandRefused, match='offset'):
        needle.bends(2.5, offset)


def test_in_another_hole_it_goes_another_way():
    needle = driver()
    needle.command(0.02)
    run(needle, 4.0)
    with pytest.raises(CommandRefused, match='withdraw it first'):
        needle.place(HOLES[2, 1], 0.0)
    needle.command(0.0)
    run(needle, 4.0, start=4.0)
    with pytest.raises(CommandRefused, match='no hole at'):
        needle.place(HOLES[2, 1] + 1e-3, 0.0)
    needle.place(HOLES[2, 1], 0.3)
    needle.command(0.05)
    state = run(needle, 6.0, start=8.0)[-1]
    assert np.allclose(state.shaft[0], HOLES[2, 1])
    assert np.allclose(state.shaft[-1], HOLES[2, 1] + nominal_offset(EXACT, AXIS, SIDE)(0.3, 0.05))


def test_a_hole_outside_the_grid_is_refused_in_one_line():
    with pytest.raises(InputError, match='column = 3; must be 0 to 2'):
        NeedleDriver(replace(EXACT, column=3), HOLES, AXIS, SIDE, np.random.default_rng(0))


def test_the_measured_depth_has_its_noise_its_error_and_its_delay():
    params = NeedleDriverParams(depth_noise=1e-4, depth_error=0.0, depth_rate=100.0,
                                depth_latency=0.03)
    needle = driver(params)
    needle.command(0.2, 0.01)
    states = run(needle, 15.0)[20:]
    assert np.isclose(np.mean([s.t - s.measured_t for s in states]), 0.03, atol=5e-3)
    error = [s.depth - (s.true_depth - 0.01 * (s.t - s.measured_t)) for s in states]
    assert np.isclose(np.std(error), 1e-4, rtol=0.15) and abs(np.mean(error)) < 3e-5
    constant = [driver(NeedleDriverParams(depth_noise=0.0, depth_error=2e-4), seed)
                for seed in range(60)]
    assert np.isclose(np.std([run(n, 1.0)[-1].depth for n in constant]), 2e-4, rtol=0.25)


def test_the_tip_is_told_only_outside_the_hole():
    needle = driver()
    assert needle.read(0.0).tip_p is None and needle.read(0.0).outcome is Outcome.OK
    needle.command(0.02)
    states = run(needle, 4.0)
    assert all((s.tip_p is not None) == (s.depth > EXACT.shown) for s in states)
    needle.command(0.0)
    assert run(needle, 4.0, start=4.0)[-1].tip_p is None


@pytest.mark.parametrize('by', ['motor', 'hand'])
def test_a_force_above_the_limit_stops_it_until_the_next_command(by):
    needle = driver(replace(EXACT, insertion=InsertionProfile(by)))
    needle.command(0.08)
    run(needle, 2.0)
    first = needle.read(2.05, 1.2 * EXACT.force_limit)
    later = run(needle, 2.0, start=2.05)[-1]
    assert first.outcome is later.outcome is Outcome.HELD and 'force_limit_N' in later.message
    assert later.true_depth == first.true_depth < 0.08 and not later.moving
    needle.command(0.0)     # away from the force: allowed
    assert needle.read(4.1, 1.2 * EXACT.force_limit).outcome is Outcome.OK
    assert run(needle, 12.0, start=4.1)[-1].true_depth == 0.0


@pytest.mark.parametrize('by', ['motor', 'hand'])
def test_hold_brakes_and_stop_is_at_once_and_lasts(by):
    needle = driver(replace(EXACT, insertion=InsertionProfile(by)))
    needle.command(0.08)
    before = run(needle, 1.0)[-1]
    needle.hold()
    held = run(needle, 1.0, start=1.0)[-1]
    braking = before.velocity**2 / (2 * EXACT.insertion.braking)
    assert held.outcome is Outcome.HELD and not held.moving
    assert abs(held.true_depth - before.true_depth) <= braking + 2e-3
    needle.command(0.08)
    moving = run(needle, 1.0, start=2.0)[-1]
    needle.stop()
    stopped = run(needle, 1.0, start=3.0)[-1]
    assert stopped.true_depth == moving.true_depth and stopped.outcome is Outcome.HELD
    with pytest.raises(CommandRefused, match='call release first'):
        needle.command(0.01)
    needle.release()
    needle.command(0.01)
    assert run(needle, 20.0, start=4.0)[-1].true_depth == 0.01


@pytest.mark.parametrize(('depth', 'speed', 'match'), [
    (0.25, None, 'depth = 250 mm; must be 0 to 200 mm'), (-0.01, None, 'depth = -10'),
    (np.nan, None, 'depth = nan'), (0.05, 0.0, 'speed = 0 mm/s'), (0.05, 1.0, 'at most 200')])
def test_what_it_cannot_do_is_refused_and_nothing_changes(depth, speed, match):
    needle = driver()
    needle.command(0.03)
    with pytest.raises(CommandRefused, match=match):
        needle.command(depth, speed)
    states = run(needle, 6.0)
    assert states[0].outcome is Outcome.REJECTED and states[1].outcome is Outcome.OK
    assert states[-1].true_depth == 0.03


def test_same_seed_same_bits_and_reading_more_often_moves_no_needle():
    params = NeedleDriverParams(insertion=InsertionProfile('hand'))
    first, second, finer = driver(params, 7), driver(params, 7), driver(params, 7)
    for needle in (first, second, finer):
        needle.command(0.06)
    for a, b in zip(run(first, 8.0), run(second, 8.0), strict=True):
        assert (a.depth, a.force, a.shaft.tobytes()) == (b.depth, b.force, b.shaft.tobytes())
    for k in range(1, 321):
        last = finer.read(k * TICK / 2)
    assert np.isclose(last.true_depth, b.true_depth, atol=1e-15)
    assert np.allclose(last.shaft[-1], b.shaft[-1], atol=1e-12)


def test_a_clock_of_any_age_starts_at_the_first_read():
    needle = NeedleDriver(EXACT, HOLES, AXIS, SIDE, np.random.default_rng(0))
    needle.command(0.05)
    assert needle.read(1.7e9).true_depth == 0.0
    assert 0.0 < needle.read(1.7e9 + 1.0).true_depth < 0.011


def test_the_true_radius_spreads_about_the_nominal_one():
    radii = [driver(NeedleDriverParams(), seed).path._radius for seed in range(80)]
    share = np.array(radii) / NeedleDriverParams().needle.radius
    assert np.isclose(np.log(share).std(), 0.1, rtol=0.25) and abs(np.log(share).mean()) < 0.04
