"""The needle's path is the arc of the unicycle model; its forces are those of Okamura's."""

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from arm_brachy.devices.needle import NeedleForce, NeedleParams, NeedlePath

PARAMS = NeedleParams()
AXIS, SIDE = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def path():
    return NeedlePath(PARAMS, np.zeros(3), AXIS, SIDE)


def test_the_tip_is_on_the_circle_of_the_bevel():
    needle = path()
    for _ in range(40):
        needle.advance(2e-3)
    centre = PARAMS.radius * SIDE
    assert np.isclose(np.linalg.norm(needle.p - centre), PARAMS.radius, rtol=1e-12)
    assert np.isclose(needle.p @ SIDE, PARAMS.radius * (1 - np.cos(0.08 / PARAMS.radius)))
    assert np.isclose(needle.depth, 0.08)


def test_before_the_skin_it_goes_straight_whatever_the_steps():
    ends = []
    for steps in ([0.08], [0.004] * 20, [0.013, 0.067]):
        needle = NeedlePath(replace(PARAMS, skin=0.012), np.zeros(3), AXIS, SIDE)
        for step in steps:
            needle.advance(step)
        ends.append(needle.p)
        assert np.allclose(needle.shaft(81)[:12] @ SIDE, 0.0)
    inside = 0.068 / PARAMS.radius
    assert np.allclose(ends, 0.012 * AXIS + PARAMS.radius * (
        np.sin(inside) * AXIS + (1 - np.cos(inside)) * SIDE), atol=1e-12)


def test_a_turned_bevel_integrates_the_unicycle_equations():
    needle = path()
    turns = [0.0, 2.0, -0.7, 1.1]
    y = np.concatenate([needle.p, needle.t, needle.n])
    for angle in turns:
        needle.turn(angle)
        needle.advance(0.02)
        t, n = y[3:6], y[6:]
        y[6:] = np.cos(angle) * n + np.sin(angle) * np.cross(t, n)
        y = solve_ivp(lambda s, y: np.concatenate([y[3:6], y[6:] / PARAMS.radius,
                                                   -y[3:6] / PARAMS.radius]),
                      (0.0, 0.02), y, rtol=1e-10, atol=1e-13).y[:, -1]
    assert np.allclose(np.concatenate([needle.p, needle.t, needle.n]), y, atol=1e-9)


def test_half_a_turn_midway_makes_the_needle_parallel_to_its_hole_again():
    """Two opposite arcs: half the deviation of one, and the needle parallel to its hole again."""
    straight, turned = path(), path()
    straight.advance(0.08)
    turned.advance(0.04)
    turned.turn(np.pi)
    turned.advance(0.04)
    assert np.isclose(turned.t @ SIDE, 0.0, atol=1e-12)
    assert np.isclose(turned.p @ SIDE, 0.5 * straight.p @ SIDE, rtol=0.01)


def test_it_withdraws_along_the_path_that_it_cut():
    needle, track = path(), []
    for k in range(30):
        needle.turn(0.1 * k)
        needle.advance(1.5e-3)
        track.append(needle.p)
    for k in range(29, 5, -1):
        assert np.allclose(needle.p, track[k], atol=1e-12)
        needle.advance(-1.5e-3)
    needle.advance(-1.0)
    assert needle.depth == 0.0 and np.allclose(needle.p, 0.0)


def test_withdrawn_past_a_turn_it_bends_to_where_its_bevel_is_now():
    needle = path()
    needle.advance(0.03)
    needle.turn(np.pi)
    needle.advance(0.03)
    needle.advance(-0.05)
    needle.advance(0.02)
    assert np.isclose(needle.depth, 0.03)
    assert np.isclose(needle.t @ SIDE, np.sin((0.01 - 0.02) / PARAMS.radius), atol=1e-9)


def test_the_shaft_runs_from_the_hole_to_the_tip_without_gaps():
    needle = path()
    needle.advance(0.05)
    needle.turn(1.0)
    needle.advance(0.03)
    shaft = needle.shaft(81)
    assert np.allclose(shaft[0], 0.0) and np.allclose(shaft[-1], needle.p)
    assert np.allclose(np.linalg.norm(np.diff(shaft, axis=0), axis=1), 1e-3, rtol=1e-4)


def pushed(speed, depth, skin=0.01):
    force = NeedleForce(PARAMS)
    at = np.arange(0.0, depth, speed * 1e-3)
    return force, at, np.array([force.step(d, skin, speed) for d in at])


def test_the_capsule_dents_breaks_and_lets_go():
    force, at, f = pushed(0.01, 0.05)
    dent = (-PARAMS.dent_linear + np.sqrt(PARAMS.dent_linear**2
            + 4 * PARAMS.dent_square * PARAMS.puncture)) / (2 * PARAMS.dent_square)
    assert np.isclose(force.entry, 0.01 + dent, atol=2e-5)
    assert np.all(f[at <= 0.01] == 0.0)
    before = (at > 0.01) & (at < force.entry - 1e-5)
    d = at[before] - 0.01
    assert np.allclose(f[before], PARAMS.dent_linear * d + PARAMS.dent_square * d**2)
    assert f[before].max() <= PARAMS.puncture


def test_after_puncture_force_grows_with_the_length_inside_and_with_speed():
    for speed in (0.005, 0.05):
        _, at, f = pushed(speed, 0.06)
        late = at > 0.04
        slope = np.polyfit(at[late], f[late], 1)
        assert np.isclose(slope[0], PARAMS.coulomb + PARAMS.viscous * speed)
        assert np.isclose(np.polyval(slope, 0.01), PARAMS.cutting)


def went(force, places, speed, skin=0.01):
    return np.array([force.step(d, skin, speed) for d in places])


def test_withdrawing_has_friction_but_no_cutting():
    force, _, _ = pushed(0.01, 0.05)
    back = went(force, np.linspace(0.05, 0.048, 200), -0.01)
    assert np.isclose(back[-1], -0.038 * (PARAMS.coulomb + PARAMS.viscous * 0.01))
    assert force.tip == 0.0


def test_at_rest_the_needle_goes_on_holding_the_tissue():
    """All of the last force but its viscous part stays, and nothing of it fades."""
    force, at, f = pushed(0.01, 0.05)
    viscous = (at[-1] - 0.01) * PARAMS.viscous * 0.01
    rest = went(force, np.full(50, at[-1]), 0.0)
    assert np.allclose(rest, f[-1] - viscous)


def test_force_is_continuous_through_a_stop():
    """Braking from 5 mm/s to rest in 25 ms: no step of force larger than the way explains."""
    force, t = pushed(0.005, 0.05)[0], np.arange(0.0, 0.03, 1e-4)
    speed = np.maximum(0.005 - 0.2 * t, 0.0)
    depth = 0.05 + np.concatenate([[0.0], np.cumsum(speed[:-1] * 1e-4)])
    f = np.array([force.step(d, 0.01, v) for d, v in zip(depth, speed, strict=True)])
    slope = 0.041 * PARAMS.static / 0.5e-3 + PARAMS.static      # N/m: of stretch, and of length
    steps = slope * np.diff(depth) + 0.041 * PARAMS.viscous * np.abs(np.diff(speed))
    assert np.all(np.abs(np.diff(f)) <= steps + 1e-9)
    assert f[-1] > 0.9 * f[0]


def test_creeping_and_turning_back_stay_within_the_static_friction():
    force, at, _ = pushed(0.01, 0.05)
    creep = PARAMS.band / 2
    on = went(force, np.arange(0.05, 0.052, 1e-6), creep)
    back = went(force, np.arange(0.052, 0.049, -1e-6), -creep)
    again = went(force, np.arange(0.049, 0.052, 1e-6), creep)
    f = np.concatenate([on, back, again])
    assert np.all(np.abs(np.diff(f)) < 2e-3)     # 1 um of stretch and of cutting
    assert np.isclose(on[-1], PARAMS.cutting + 0.042 * PARAMS.static, rtol=1e-3)
    assert np.isclose(back[-1], -0.039 * PARAMS.static, rtol=1e-3)
    assert np.isclose(again[-1], on[-1], rtol=1e-3)


def test_from_rest_to_sliding_the_force_drops_by_no_more_than_static_less_sliding():
    for creep, sense in ((0.9, 1.0), (-0.9, -1.0)):
        force, _, _ = pushed(0.01, 0.05)
        end = 0.05 + sense * 2e-3
        stuck = went(force, np.arange(0.05, end, sense * 1e-6), creep * PARAMS.band)[-1]
        slid = force.step(end, 0.01, 1.1 * sense * PARAMS.band)
        drop = (end - 0.01) * (PARAMS.static - PARAMS.coulomb)
        assert 0.0 < sense * (stuck - slid) <= drop
    for way in (-0.6e-3, -0.3e-3):               # a stretch that is not full: no jump at all
        force, _, _ = pushed(0.01, 0.05)
        stuck = went(force, np.linspace(0.05, 0.05 + way, 300), 0.0)[-1]
        slid = force.step(0.05 + way, 0.01, 1.01 * PARAMS.band)
        assert np.isclose(slid - stuck, (0.04 + way) * PARAMS.viscous * 1.01 * PARAMS.band)


def test_at_rest_the_needle_is_held_up_to_the_static_friction():
    force, _, _ = pushed(0.01, 0.05)
    pulled = went(force, 0.05 - np.linspace(0.0, 2e-3, 50), 0.0)
    assert np.all(np.diff(pulled[:10]) < 0.0)
    assert np.isclose(min(pulled), -0.04 * PARAMS.static, rtol=0.06)


def test_out_of_the_tissue_the_capsule_is_whole_again():
    force, _, _ = pushed(0.01, 0.05)
    assert force.step(0.0, 0.01, -0.01) == 0.0 and not force.punctured
