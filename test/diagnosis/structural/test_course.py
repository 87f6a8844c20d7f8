"""An actuator that errs from place to place: found, taken out, no other cause blamed for it."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.random import stream as draws
from arm_brachy.diagnosis.isolation.isolate import structure_of
from arm_brachy.diagnosis.isolation.pad_tracking import pad_travels
from arm_brachy.diagnosis.isolation.positioning_error import UNSURE, course_of
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.stream import ENCODER
from arm_brachy.diagnosis.statistics.noise_process import Colour

PITCH, HEIGHT = 0.9e-3, 0.08e-3     # m: a turn of the screw, and what it errs by


def ripple(u):
    """What the encoder shows too much at true travels u [m]."""
    return HEIGHT * (np.sin(2.0 * np.pi * u / PITCH + 1.0) - np.sin(1.0))


@pytest.fixture(scope='module')
def uneven(laboratory):
    """(Evidence whose first encoder ripples, its true travel (n,) [m]), every pad slow."""
    lab = laboratory()
    moves = [(depth * np.eye(3)[pad], 3e-3, 0.5) for pad in range(3) for depth in (6e-3, 0.0) * 2]
    evidence = evidence_of(lab.record(moves), lab.scene)
    encoder = evidence.get(ENCODER)
    values, true = encoder.values.copy(), encoder.values[:, 0, 0]
    values[:, 0, 0] = true + ripple(true)
    streams = {**evidence.streams, ENCODER: replace(encoder, values=values)}
    return replace(evidence, streams=streams), true


def travels(evidence):
    prepared = prepare(evidence)
    return pad_travels(prepared.evidence, prepared.noise['optical'], prepared.motion.touch,
                       alarm=1e-5)


def test_a_screw_that_is_not_even_is_found_in_shape_and_nothing_else_blamed(uneven):
    evidence, true = uneven
    first, *others = travels(evidence)
    shown = evidence.get(ENCODER).values[:, 0, 0]
    away = true > 2e-4
    left = shown + first.course.error(shown) - true
    # 0.06 mm of noise in 27 samples for each of 30 coefficients, fewer near the ends
    assert np.std(left[away]) < 0.5 * np.std(ripple(true[away]))
    assert first.course.chance < 1e-20
    assert all(abs(v) < 4.0 * sd for v, sd in first.causes.values()) and not first.steps
    assert all(one.course is None for one in others)


def test_it_is_known_as_well_as_it_says(uneven):
    """What is left of the course, by its modes, of which each has a standard deviation of one."""
    evidence, true = uneven
    course = travels(evidence)[0].course
    shown = evidence.get(ENCODER).values[:, 0, 0]
    left = (true - shown - course.error(shown))[::20]
    modes = (course.unsure(shown) / UNSURE)[::20]
    inside = (true > 2e-4)[::20]
    size = np.linalg.norm(modes[inside], axis=1)
    assert 0.3 < np.sqrt(np.mean((left[inside] / size)**2)) < 2.0
    assert np.median(size) < 0.5 * HEIGHT
    assert np.array_equal(course.unsure(np.zeros(1)), np.zeros((1, modes.shape[1])))


def test_where_a_pad_never_comes_home_nothing_is_extrapolated():
    """The course begins where the pad was nearest to home; a cubic beyond that was 40 mm off."""
    t = 0.02 * np.arange(4000)
    u = 5e-3 - 3e-3 * np.cos(0.3 * t)       # from 2 to 8 mm
    y = ripple(u)[:, None] + 1e-5 * draws(1, 'course').standard_normal((len(t), 1))
    course = course_of(t, y, u, {'1': np.ones(len(t))}, {}, np.ones(len(t), dtype=bool), Colour(),
                       np.array([1e-5]), away=1e-4)
    off = course.error(u) - ripple(u)
    assert np.ptp(off) < 2e-5 and abs(course.error(np.array([2e-3]))[0]) < 1e-9
    assert np.linalg.norm(course.unsure(u), axis=1).max() < 5e-5


@pytest.mark.parametrize('entry', [
    None, {'name': 'actuator_compliance', 'compliance_mm_N': 0.125, 'actuators': [0]},
    *(pytest.param(entry, marks=pytest.mark.validate) for entry in (
        {'name': 'actuator_gain', 'gain': 0.06, 'actuators': [0]},
        {'name': 'backlash', 'width_mm': 0.25, 'actuators': [0]},
        {'name': 'clock_offset', 'stream': 'optical', 'delay_ms': 20.0}))])
def test_what_has_a_name_is_no_unevenness(recorded, laboratory, entry):
    assert all(one.course is None
               for one in travels(evidence_of(recorded(entry), laboratory().scene)))


def test_it_is_told_without_a_cause_and_where(uneven):
    findings = structure_of(prepare(uneven[0])).findings
    told, = (f for f in findings if f.term is None)
    assert (told.stream, told.channel) == (ENCODER, 'pad_0')
    assert told.value == pytest.approx(HEIGHT / np.sqrt(2.0), rel=0.3)
    assert not [f for f in findings if f.channel == 'pad_0' and f.term is not None]


def test_the_model_is_driven_by_the_encoder_put_right(uneven):
    evidence, true = uneven
    encoder = evidence.get(ENCODER)
    states = look(evidence).states
    there = np.interp(states.path_t, encoder.t, true)
    shown = np.interp(states.path_t, encoder.t, encoder.values[:, 0, 0])
    assert np.std(states.path_q[:, 0] - there) < 0.6 * np.std(shown - there)


def test_a_force_of_the_wrong_sign_is_refused_before_it_passes_for_a_compliance(
        recorded, laboratory):
    evidence = evidence_of(recorded({'name': 'actuator_compliance', 'compliance_mm_N': 0.125,
                                     'actuators': [0]}), laboratory().scene)
    force = evidence.get('force')
    sign = np.array([-1.0, 1.0, 1.0])[:, None]
    turned = replace(evidence, streams={**evidence.streams,
                                        'force': replace(force, values=sign * force.values)})
    with pytest.raises(RecordingError, match='on pad_0 pull where the pads are pushed in'):
        travels(turned)
