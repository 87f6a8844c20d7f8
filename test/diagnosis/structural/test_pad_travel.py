"""What the marker on a pad says of its actuator: each cause planted, sized and named."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.diagnosis.isolation.actuators import actuator_findings
from arm_brachy.diagnosis.isolation.pad_tracking import (
    COMPLIANCE,
    DELAY,
    GAIN,
    PLAY,
    _chosen,
    _Explained,
    pad_travels,
    push_frame,
)
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.regressors import play
from arm_brachy.diagnosis.statistics.noise_process import Colour
from arm_brachy.registry import parse_terms

PLANTED = {
    GAIN: ({'name': 'actuator_gain', 'gain': 0.06, 'actuators': [0]}, 0.06),
    COMPLIANCE: ({'name': 'actuator_compliance', 'compliance_mm_N': 0.125, 'actuators': [0]},
                 1.25e-4),
    PLAY: ({'name': 'backlash', 'width_mm': 0.25, 'actuators': [0]}, 2.5e-4),
    DELAY: ({'name': 'clock_offset', 'stream': 'optical', 'delay_ms': 20.0}, 0.02),
}


def travels(run, scene):
    prepared = prepare(evidence_of(run, scene))
    return pad_travels(prepared.evidence, prepared.noise['optical'], prepared.motion.touch,
                       alarm=1e-5)


@pytest.fixture(scope='module')
def planted(recorded, laboratory):
    """cause, or None for none -> PadTravel of every pad."""
    scene = laboratory().scene

    @cache
    def pads(cause):
        return travels(recorded(PLANTED[cause][0] if cause else None), scene)

    return pads


@pytest.mark.parametrize('cause', PLANTED)
def test_a_cause_is_found_alone_and_in_size(planted, cause):
    value = PLANTED[cause][1]
    one = next(p for p in planted(cause) if p.pad == 'pad_0')
    found, sd = one.causes[cause]
    assert found == pytest.approx(value, rel=0.05) and abs(found - value) < 4.0 * sd
    others = {c: abs(v) / s for c, (v, s) in one.causes.items() if c != cause}
    assert all(z < 4.0 for z in others.values()), others
    assert not one.steps and one.rivals.get(cause, ()) == ()


def test_the_other_pads_stay_sound(planted):
    for cause in (GAIN, COMPLIANCE, PLAY):
        for one in planted(cause):
            if one.pad != 'pad_0':
                assert all(abs(v) < 4.0 * sd for v, sd in one.causes.values())


def test_sound_pads_have_no_cause(planted):
    pads = planted(None)
    assert [one.pad for one in pads] == ['pad_0', 'pad_1', 'pad_2']
    for one in pads:
        assert all(abs(v) < 4.0 * sd for v, sd in one.all.values())
        assert np.all(np.abs(one.tilt) < 4.0 * one.tilt_sd) and not one.steps


def one_push(laboratory, entry):
    """One pad, one speed, in and out once, tissue whose force is in proportion to the push."""
    lab = laboratory(parse_terms([entry], 'test'), 3, relaxing=0.0, stiffening=0.0)
    one, = travels(lab.record([(np.array([6e-3, 0.0, 0.0]), 0.005, 2.0)]), lab.scene)
    return one


@pytest.mark.parametrize('entry', [
    {'name': 'actuator_gain', 'gain': -0.06, 'actuators': [0]},
    {'name': 'actuator_compliance', 'compliance_mm_N': 0.2, 'actuators': [0]}])
def test_one_push_cannot_tell_gain_from_compliance(laboratory, entry):
    """Where the force is in proportion to the push, -c F = -c k u is a gain of -c k."""
    one = one_push(laboratory, entry)
    (named, (_, sd)), = [(c, v) for c, v in one.causes.items() if c in (GAIN, COMPLIANCE)]
    assert {named, *one.rivals[named]} == {GAIN, COMPLIANCE} and sd > 0.0


@pytest.mark.parametrize('gain', [-0.06, 0.06])
def test_without_forces_a_pad_that_falls_short_may_yield(laboratory, gain):
    """Its marker alone cannot tell; what goes too far does not yield."""
    lab = laboratory(parse_terms([{'name': 'actuator_gain', 'gain': gain, 'actuators': [0]}],
                                 'test'), 3)
    run = replace(lab.record([(np.array([6e-3, 0.0, 0.0]), 0.01, 1.0)]), force=None,
                  force_pads=())
    prepared = prepare(evidence_of(run, lab.scene))
    found, = actuator_findings(prepared, pad_travels(
        prepared.evidence, prepared.noise['optical'], prepared.motion.touch, alarm=1e-5))
    assert found.term == 'actuator_gain'
    assert ('actuator_compliance' in found.rivals) is (gain < 0.0)


def test_noise_of_the_force_sensor_is_no_gain(laboratory, short_pushes):
    """A yield times that noise was louder than the marker: the yield came out 12 % too small."""
    lab = laboratory(parse_terms([PLANTED[COMPLIANCE][0]], 'test'), 4,
                     force=ForceSensorParams(noise=0.6))
    one = next(p for p in travels(lab.record(short_pushes()), lab.scene) if p.pad == 'pad_0')
    assert GAIN not in one.causes
    assert one.causes[COMPLIANCE][0] == pytest.approx(1.25e-4, rel=0.05)


def test_a_yield_in_proportion_to_the_push_and_a_gain_are_rivals_in_any_noise():
    """What tells them apart, 1 % of either, a law that bends may have."""
    t = np.linspace(0.0, 20.0, 2000)
    u = 5e-3 * np.sin(t) ** 2
    force = 300.0 * u * (1.0 + 0.02 * np.sin(3.0 * t))
    one = _Explained((-0.1 * u)[:, None], {'offset': np.ones_like(t)},
                     {GAIN: u, COMPLIANCE: -force}, None, Colour(), np.array([1e-6]), (), 0.0,
                     None)
    found = _chosen(t, one, np.ones_like(t, dtype=bool))
    assert set(found.estimates) == {GAIN} and found.rivals[GAIN] == (COMPLIANCE,)
    fast = replace(one, causes={GAIN: u, COMPLIANCE: -force * (1.0 + 0.5 * np.sin(5.0 * t))})
    assert _chosen(t, fast, np.ones_like(t, dtype=bool)).rivals == {GAIN: ()}


def test_gain_and_play_together(laboratory, pushes):
    lab = laboratory(parse_terms([PLANTED[GAIN][0], PLANTED[PLAY][0]], 'test'), 4)
    one, = travels(lab.record(pushes(pads=(0,))), lab.scene)
    # the play comes after the gain on the way to the pad
    assert one.causes[GAIN][0] == pytest.approx(0.06, rel=0.05)
    assert one.causes[PLAY][0] == pytest.approx(2.5e-4, rel=0.08)


def test_a_tilted_push_is_measured(laboratory):
    lab = laboratory((), 5)
    frame = push_frame(lab.directions[0])
    rest = np.array([m.position for m in lab.scene.markers])
    k = [m.name for m in lab.scene.markers].index('pad_0')

    def tilted(t, names, points):
        out = points.copy()
        out[k] += 0.05 * ((points[k] - rest[k]) @ frame[0]) * frame[1]
        return out

    bent = laboratory((), 5, disturb=tilted)
    one, = travels(bent.record([(np.array([8e-3, 0, 0]), 0.01, 0.5)]), lab.scene)
    assert one.tilt == pytest.approx([0.05, 0.0], abs=0.005)


@pytest.mark.parametrize('axis', [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
def test_the_frame_of_a_push_is_a_rotation_with_up_nearest_to_z(axis):
    frame = push_frame(np.array(axis))
    assert np.allclose(frame @ frame.T, np.eye(3)) and np.linalg.det(frame) == pytest.approx(1.0)
    if abs(axis[2]) < 0.9:
        assert frame[1, 2] == pytest.approx(np.sqrt(1.0 - axis[2] ** 2))


def test_play_of_a_triangle():
    """In by 3, out by 3, play of 1: stands for the first 1 of either way."""
    q = np.concatenate([np.linspace(0, 3, 31), np.linspace(3, 0, 31)[1:]])
    y = play(q, 1.0)
    assert y[10] == 0.0 and y[30] == pytest.approx(2.0) and y[40] == pytest.approx(2.0)
    assert y[-1] == 0.0


def test_play_from_inside_its_gap_closes_on_either_side():
    """In by 3, out by 3, play of 1 from a quarter of it: the first way in lacks three quarters."""
    q = np.concatenate([np.linspace(0, 3, 31), np.linspace(3, 0, 31)[1:]])
    y = play(q, 1.0, 0.25)
    assert y[0] == 0.0 and y[30] == pytest.approx(2.25) and y[-1] == pytest.approx(0.25)


@pytest.mark.parametrize('start', [0.5, pytest.param(1.0, marks=pytest.mark.validate)])
def test_where_play_begins_is_a_state_of_it(laboratory, short_pushes, look, start):
    """It was told as lost steps of half the width, or of all of it, besides."""
    entry = {'name': 'backlash', 'width_mm': 0.32, 'actuators': [1], 'start': start}
    lab = laboratory(parse_terms([entry], 'test'), 2)
    found, = look(lab.record(short_pushes()))[1].findings
    assert found.term == 'backlash' and found.value == pytest.approx(3.2e-4, rel=0.05)
    assert found.parameters['start'] == pytest.approx(start, abs=0.1)
    assert abs(found.parameters['start'] - start) < 4.0 * found.errors['start']


def test_play_that_begins_after_a_retraction_has_no_start(planted):
    assert all(one.start == (0.0, 0.0) for cause in (PLAY, None) for one in planted(cause))
