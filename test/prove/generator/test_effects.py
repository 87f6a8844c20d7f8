"""Effects have the sign, the size and the place that their equations say."""
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.prove.generator import actuation
from arm_brachy.prove.generator.body import COARSE
from arm_brachy.prove.generator.case import draw
from arm_brachy.prove.generator.catalogue import Effect
from arm_brachy.prove.generator.mismount import to_ball
from arm_brachy.prove.generator.plant import build_world, play
from arm_brachy.prove.generator.protocol import Protocol
from arm_brachy.prove.generator.sensing import Stream, axis_crosstalk
from arm_brachy.prove.generator.tissue import met, reshaping
from arm_brachy.prove.generator.world import pad_markers


@pytest.fixture(scope='module')
def outputs(body, cache):
    """Function of effects: times, motor travel, tissue displacements, forces, pad travel."""
    null, known = draw(np.random.default_rng(7), 'null', body), {}
    # One pad slow and fast, and then the other: what needs a long run has a test of its own.
    slow, fast = null.protocol.pushes[:2], null.protocol.pushes[4:6]
    short = Protocol((*slow, *fast, null.protocol.pushes[2], null.protocol.pushes[6]))
    held = Protocol(null.heldout.pushes[:1], idle=0.5)

    def run(*effects):
        if repr(effects) not in known:
            known[repr(effects)] = ran(effects)
        return known[repr(effects)]

    def ran(effects):
        played = play(replace(null, effects=effects, protocol=short, heldout=held), cache)
        some = slice(None, None, 25)
        moved, force = played.world.outputs(played.t[some], played.y[some])
        return played.t[some], played.u[some], moved, force, played.y[some]
    return run


def rms(x):
    return np.sqrt((x**2).mean())


def effect(name, **values):
    return Effect(name, values, 1.0)


def test_gain_scales_the_travel_of_its_pad_only(outputs, body):
    _, u, _, _, y0 = outputs()
    _, _, _, _, y = outputs(effect('actuator_gain', gain=0.06, offset_mm=0.5,
                                   actuators=('pad_2',)))
    np.testing.assert_allclose(y[:, 0], y0[:, 0])
    np.testing.assert_allclose(y[:, 1], 1.06 * y0[:, 1] + 5e-4, atol=1e-12)


def test_compliance_takes_travel_in_proportion_to_the_force(outputs, body):
    _, _, _, _, y0 = outputs()
    _, _, _, force, y = outputs(effect('actuator_compliance', compliance_mm_N=0.2,
                                       actuators=('pad_1',)))
    pushed = -force[:, 0] @ np.array(body.pads[0].direction)
    np.testing.assert_allclose(y[:, 0], y0[:, 0] - 0.2e-3 * pushed, atol=2e-6)
    assert pushed.max() > 0.3


def test_lag_of_a_ramp_is_its_time_constant_and_dead_time():
    t = np.arange(0, 2, 1e-3)
    u = np.column_stack([0.01 * t])
    y = actuation.lag(t, u, ('a',), {'time_constant_ms': 20.0, 'delay_ms': 30.0}, None)
    np.testing.assert_allclose((u - y)[-1] / 0.01, 0.05, atol=6e-4)


def test_backlash_is_lost_once_at_every_reversal():
    u = np.concatenate([np.linspace(0, 4e-3, 50), np.linspace(4e-3, 0, 50)])[:, None]
    y = actuation.play(u, 5e-4)
    assert abs(y[49, 0] - 3.5e-3) < 1e-12 and abs(y[-1, 0]) < 1e-12
    assert (y <= u + 1e-15).all() and (u - y <= 5e-4 + 1e-15).all()


def test_modulus_scales_forces_and_moves_nothing(outputs):
    _, _, moved, force, _ = outputs()
    _, _, same, stiff, _ = outputs(effect('stiffness_scale', factor=1.4))
    np.testing.assert_allclose(stiff, 1.4 * force, atol=2e-3 * rms(force))
    assert np.abs(same - moved).max() < 2e-7


def test_axes_of_a_pads_sensor_talk_into_each_other():
    t, forces = np.arange(3.0), np.random.default_rng(0).normal(size=(3, 2, 3))
    streams = {'forces': Stream(('pad_1', 'pad_2'), t, t, forces.copy(), np.zeros((3, 2)))}
    axis_crosstalk(streams, {'onward': (0.1, 0.2, 0.3), 'backward': (0.4, 0.5, 0.6),
                             'pads': ('pad_2',)})
    found = streams['forces'].values
    np.testing.assert_array_equal(found[:, 0], forces[:, 0])
    shown = np.array([[1.0, 0.5, 0.3], [0.1, 1.0, 0.6], [0.4, 0.2, 1.0]])
    np.testing.assert_allclose(found[:, 1], forces[:, 1] @ shown.T, atol=1e-14)


def test_stiffness_drift_grows_from_its_onset(outputs):
    t, _, moved, force, _ = outputs()
    _, _, same, drifted, _ = outputs(effect('stiffness_drift', rate_per_min=0.3, onset_s=9.0))
    expected = force * (1 + 0.3 / 60 * np.maximum(t - 9, 0))[:, None, None]
    np.testing.assert_allclose(drifted, expected, rtol=1e-9)
    np.testing.assert_array_equal(same, moved)


@pytest.mark.parametrize(('name', 'values', 'stiffer'), [
    ('compressibility', {'factor': 0.4}, False),
    ('skin_layer', {'ratio': 2.5, 'thickness_mm': 2.0}, True),
    ('anisotropy', {'ratio': 1.0, 'azimuth_deg': 20.0, 'elevation_deg': 10.0}, True),
    ('base_compliance', {'normal_kPa_mm': 1.0, 'tangential_kPa_mm': 0.5}, False),
    ('base_debond', {'radius_mm': 25.0, 'centre_mm': (10.0, 0.0, 0.0)}, False),
], ids=lambda v: v if isinstance(v, str) else '')
def test_forces_rise_or_fall_and_markers_move(outputs, name, values, stiffer):
    _, _, moved, force, _ = outputs()
    _, _, other, changed, _ = outputs(effect(name, **values))
    assert (rms(changed) > 1.01 * rms(force)) if stiffer else (rms(changed) < 0.997 * rms(force))
    assert np.abs(other - moved).max() > 2e-5


def test_gravity_sags_towards_where_it_points(outputs):
    _, _, moved, _, _ = outputs()
    _, _, sagged, _, _ = outputs(effect('gravity', added_m_s2=(0.0, 0.0, -2.5)))
    assert np.mean((sagged - moved)[..., 2]) < -2e-5


def test_a_finger_acts_while_it_presses_and_where(outputs, body):
    t, _, moved, _, _ = outputs()
    place = body.points[0]
    _, _, touched, _, _ = outputs(effect(
        'external_force', force_N=(0.0, 0.0, -0.5), centre_mm=tuple(1e3 * place), radius_mm=10.0,
        onset_s=10.0, duration_s=4.0))
    change = np.linalg.norm(touched - moved, axis=2)
    during = (t > 10.01) & (t < 13.99)
    assert change[~((t > 9.98) & (t < 14.02))].max() < 1e-12
    assert change[during, 0].mean() > 1e-4
    assert change[during, 0].mean() > 0.8 * change[during].mean(0).max()


def test_breathing_moves_the_base_by_its_amplitude(body, cache):
    null = draw(np.random.default_rng(7), 'null', body)
    values = {'amplitude_mm': 0.4, 'frequency_Hz': 0.25, 'phase_deg': 0.0,
              'direction': (0.0, 0.0, 1.0)}
    run = play(replace(null, effects=(effect('breathing', **values),)), cache)
    markers = run.world.markers(run.t[::25], run.y[::25])
    base = markers[:, -3:, 2]
    np.testing.assert_allclose(base[:, 0], 4e-4 * np.sin(np.pi / 2 * run.t[::25]), atol=1e-6)
    tissue = markers[:, 0, 2] - markers[0, 0, 2]
    assert np.corrcoef(tissue, base[:, 0])[0, 1] > 0.3


@pytest.mark.parametrize(('name', 'values'), [
    ('base_compliance', {'normal_kPa_mm': 300.0, 'tangential_kPa_mm': 150.0}),
    pytest.param('base_debond', {'radius_mm': 8.0, 'centre_mm': (25.0, 0.0, 0.0)},
                 marks=pytest.mark.validate)],
    ids=lambda v: v if isinstance(v, str) else '')
def test_a_base_that_breathes_carries_what_springs_hold_on_it(outputs, name, values):
    """All but firm springs, and glue that is loose in a small disc, are as good as clamps."""
    breath = effect('breathing', amplitude_mm=0.4, frequency_Hz=0.25, phase_deg=0.0,
                    direction=(0.0, 0.0, 1.0))
    loose = effect(name, **values)
    _, _, still, calm, _ = outputs()
    _, _, moved, force, _ = outputs(breath)
    _, _, loose_still, loose_calm, _ = outputs(loose)
    _, _, loose_moved, loose_force, _ = outputs(loose, breath)
    for alone, both in ((moved - still, loose_moved - loose_still),
                        (force - calm, loose_force - loose_calm)):
        assert rms(both - alone) < 0.1 * rms(alone)


def test_the_marker_on_a_misplaced_pad_goes_with_it(body, cache):
    null = draw(np.random.default_rng(7), 'null', body)
    aside = effect('pad_misplacement', up_mm=0.0, side_mm=2.0, tilt_up_deg=3.0, tilt_side_deg=0.0,
                   pads=('pad_1',))
    world = build_world(replace(null, effects=(aside,)), cache)
    travel = np.zeros((2, len(body.pads)))
    travel[1] = 1e-3
    home, gone = world.markers(np.zeros(2), travel)[:, len(body.surface_markers):][:, :2]
    sound = np.array([pad.direction for pad in body.pads[:2]])
    angle = np.rad2deg(np.arccos(np.sum((gone - home) * sound, axis=1) / 1e-3))
    np.testing.assert_allclose(angle, [3.0, 0.0], atol=1e-4)
    off = home - pad_markers(body.pads)[:2]
    assert 1.5e-3 < np.linalg.norm(off[0]) < 4e-3 and not off[1].any()


def shape(height=0.0, width=0.0, bump_mm=0.0, at=(0.0, 0.0, 0.1)):
    """Values of a reference shape, its bump 20 mm wide."""
    return {'height': height, 'width': width, 'bump_height_mm': bump_mm,
            'bump_centre_mm': tuple(1e3 * np.array(at)), 'bump_radius_mm': 20.0}


def test_pads_meet_the_true_shape_along_their_push(body):
    """Stretched back, a pad lies on the body's surface again; no pad is carried up or aside."""
    values, larger = shape(0.004, -0.002, at=body.points[0]), (0.998, 0.998, 1.004)
    for pad, was in zip(met(body, body.pads, values), body.pads, strict=True):
        went = np.subtract(pad.centre, was.centre)
        np.testing.assert_allclose(np.cross(went, pad.direction), 0.0, atol=1e-15)
        true, sound = (np.linalg.norm(to_ball(body.dome, np.array([p.centre]) / larger))
                       for p in (pad, was))
        assert abs(true - 1.0) < 0.05 * abs(sound - 1.0) + 1e-6


def test_a_bump_goes_along_the_normal(body):
    at = body.points[:1]
    went = reshaping(body.grid(COARSE), shape(bump_mm=2.0, at=at[0]))(at)[0] - at[0]
    normal = body.dome.normal(body.surface_markers[:1])[0]
    assert np.linalg.norm(went) == pytest.approx(2e-3, rel=0.05)
    assert went @ normal > np.cos(np.deg2rad(5.0)) * np.linalg.norm(went)


def test_a_swollen_body_stands_off_at_rest(outputs):
    t, _, moved, _, _ = outputs()
    _, _, swollen, _, _ = outputs(effect('swelling_drift', rate_per_min=0.04, onset_s=5.0))
    grown = (swollen - moved)[:, :, 2].max(1)
    assert np.abs((swollen - moved)[t < 5]).max() < 1e-9
    assert grown[-1] > 2e-4


def test_relaxing_forces_exceed_the_lasting_ones_and_come_back(outputs):
    t, _, moved, force, y = outputs()
    _, _, other, relaxing, _ = outputs(effect('viscoelasticity', g1=0.3, tau1_s=2.0, g2=0.0,
                                              tau2_s=30.0))
    size, lasting = (np.linalg.norm(f, axis=2).max(1) for f in (relaxing, force))
    fast = (y.max(1) > 0.6 * y.max()) & np.r_[False, np.diff(y.max(1)) > 2e-5]
    ratio = size[fast] / lasting[fast]
    # At once the modulus is 1 / (1 - g1) = 1.43 of the lasting one.
    assert 1.1 < np.median(ratio) < 1.43
    # With the positions hardly changed: 0.05 of what the pads travel.
    assert np.abs(other - moved).max() < 0.05 * y.max()


def test_softening_lowers_the_second_push_more_than_the_first(outputs):
    t, _, _, force, y = outputs()
    _, _, _, soft, _ = outputs(effect('stress_softening', damage=0.4, energy_Pa=30.0))
    ratio = np.linalg.norm(soft, axis=2).sum(1) / np.linalg.norm(force, axis=2).sum(1)
    first = np.flatnonzero(y.max(1) > 0.3 * y.max())[0]
    pad = int(y[first].argmax())
    half = np.flatnonzero(np.abs(y[:, pad] - 0.4 * y.max()) < 0.04 * y.max())
    assert 0.6 < ratio[half[-1]] < ratio[half[0]] < 1.0
