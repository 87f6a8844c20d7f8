"""The needle's path is the arc of the unicycle model; its forces are those of Okamura's."""

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


def test_withdrawing_has_friction_but_no_cutting():
    force, _, _ = pushed(0.01, 0.05)
    back = force.step(0.05, 0.01, -0.01)
    assert np.isclose(back, -0.04 * (PARAMS.coulomb + PARAMS.viscous * 0.01))


def test_at_rest_the_needle_is_held_up_to_the_static_friction():
    force, _, _ = pushed(0.01, 0.05)
    assert force.step(0.05, 0.01, 0.0) == 0.0
    pulled = [force.step(0.05 - d, 0.01, 0.0) for d in np.linspace(0.0, 2e-3, 50)]
    assert np.all(np.diff(pulled[:10]) < 0.0)
    assert np.isclose(min(pulled), -0.04 * PARAMS.static, rtol=0.06)


def test_out_of_the_tissue_the_capsule_is_whole_again():
    force, _, _ = pushed(0.01, 0.05)
    assert force.step(0.0, 0.01, -0.01) == 0.0 and not force.punctured
