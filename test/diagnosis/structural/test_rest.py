"""Rest against the scene, the base, rhythms, silence: what trackers and bench do by themselves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import RecordingError
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.isolation.sensor_offsets import exchanged_findings
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare, rigid_motion
from arm_brachy.diagnosis.signals.registration import register
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.registry import parse_terms


@pytest.fixture(scope='module')
def happened(laboratory, short_pushes, look):
    """(terms, disturb, change of the RunData, moves) -> Finding each."""

    def record(*entries, disturb=None, change=lambda run: run, moves=None, seed=51):
        lab = laboratory(parse_terms(list(entries), 'test'), seed, disturb=disturb)
        return look(change(lab.record(moves or short_pushes())))[1].findings

    return record


def test_a_shift_of_the_em_tracker(happened):
    found, = happened({'name': 'em_offset', 'offset_mm': [1.2, 0.0, -0.6]})
    assert found.term == 'em_offset' and 'reference_shape' in found.rivals
    assert found.value == pytest.approx([1.2e-3, 0.0, -0.6e-3], abs=1e-4)


def test_a_stretch_of_the_em_tracker(happened):
    found, = happened({'name': 'em_distortion', 'gradient_mm_per_mm': 0.1})
    assert found.term == 'em_distortion' and found.value == pytest.approx(0.1, rel=0.1)


def test_an_em_field_that_turns_may_be_an_offset_of_it_by_half(happened):
    """Tools that are not off alike: the model is asked. Of a shift alone it is not."""
    found, = happened({'name': 'em_distortion', 'gradient_mm_per_mm': 0.0,
                       'rotation_mm_per_mm': [0.1, -0.1, 0.05], 'centre_mm': [40.0, 0.0, 0.0]})
    assert found.term == 'em_offset' and 'em_distortion' in found.rivals
    found, = happened({'name': 'em_offset', 'offset_mm': [4.0, -3.0, 2.0]})
    assert found.term == 'em_offset' and 'em_distortion' not in found.rivals


def test_a_scale_of_the_optical_tracker_shows_on_pads_and_base(happened):
    found, = happened({'name': 'optical_scale', 'scale': 0.012})
    assert found.term == 'optical_scale' and found.value == pytest.approx(0.012, rel=0.15)


def test_the_same_gain_of_all_actuators_leaves_the_base_as_it_is(happened):
    found, = happened({'name': 'actuator_gain', 'gain': 0.06})
    assert found.term == 'actuator_gain' and 'optical_scale' not in found.rivals
    assert found.parameters == {'gain': pytest.approx(0.06, rel=0.05), 'actuators': ()}


def test_a_pad_beside_its_place(happened):
    def aside(t, names, points):
        return points + np.array([n == 'pad_2' for n in names])[:, None] * [0.0, 0.0, 3e-3]

    found, = happened(disturb=aside)
    assert found.term == 'pad_misplacement' and found.channel == 'pad_2'
    assert found.parameters['up'] > 2e-3


def exchanged(one, two):
    def change(run):
        ids = list(run.optical.ids)
        i, j = ids.index(one), ids.index(two)
        ids[i], ids[j] = ids[j], ids[i]
        return replace(run, optical=replace(run.optical, ids=tuple(ids)))
    return change


def test_a_marker_that_swings_with_a_tilted_push_sits_in_its_place(laboratory, happened):
    """More than 2 mm aside at rest, 11 mm behind the pad: what the tilt of its push says."""
    scene = laboratory((), 1).scene
    pad, d = scene.pads[2], np.array(scene.pads[2].direction)
    turned = Rotation.from_rotvec(0.25 * np.cross(d, [0.0, 0.0, 1.0])
                                  / np.linalg.norm(np.cross(d, [0.0, 0.0, 1.0]))).apply(d)

    def swing(t, names, points):
        k = list(names).index('pad_2')
        points = points.copy()
        points[k] = pad.centre + ((points[k] - pad.centre) @ d) * turned
        return points

    rest = next(m.position for m in scene.markers if m.name == 'pad_2')
    away = swing(0.0, ['pad_2'], np.array([rest]))[0] - rest
    assert np.linalg.norm(away) > 2e-3
    found, = happened(disturb=swing)
    assert found.term == 'pad_misplacement' and found.parameter == 'tilt_up'
    assert found.value == pytest.approx(0.25, rel=0.1)


def test_exchanged_names_of_neighbours(laboratory):
    """Two markers 8 mm apart: too near for the shape of all markers to be refused."""
    lab = laboratory((), 53)
    run = lab.record([(np.array([6e-3, 0, 0]), 0.02, 0.5)])
    beside = np.array([0.0, 0.0, 8e-3])
    i, j = (run.optical.ids.index(name) for name in ('tissue_4', 'tissue_5'))
    points = run.optical.points.copy()
    points[:, j] = points[:, i] + beside
    place = next(m for m in lab.scene.markers if m.name == 'tissue_4').position
    scene = replace(lab.scene, markers=tuple(
        replace(m, position=tuple(place + beside)) if m.name == 'tissue_5' else m
        for m in lab.scene.markers))
    near = replace(run, optical=replace(run.optical, points=points))
    assert exchanged_findings(prepare(evidence_of(near, scene))) == ()
    found, = exchanged_findings(prepare(evidence_of(exchanged('tissue_4', 'tissue_5')(near),
                                                    scene)))
    assert {'tissue_4', 'tissue_5'} <= set(found.statement.replace(' and ', ' ').split())


def test_exchanged_names_far_apart_are_refused(happened):
    with pytest.raises(RecordingError, match='tissue_(0|6) and tissue_(0|6) exchanged'):
        happened(change=exchanged('tissue_0', 'tissue_6'))


def swinging(amplitude, frequency, moves_with):
    """Function for `disturb`: a wave along z [m] of the points whose names say yes."""
    def breathe(t, names, points):
        z = amplitude * np.sin(2.0 * np.pi * frequency * t + 0.5)
        return points + np.array(list(map(moves_with, names)))[:, None] * [0.0, 0.0, z]
    return breathe


@pytest.mark.parametrize('body', [pytest.param('base', marks=pytest.mark.validate), 'tissue'])
def test_breathing(happened, pushes, body):
    """0.4 mm, 0.23 Hz, of all that is on the base, or of the tissue alone."""
    breathe = swinging(4e-4, 0.23, lambda name: body == 'base' or not name.startswith(
        ('base', 'pad')))
    told = happened(disturb=breathe, moves=pushes(speeds=(0.02,)))
    found, = [f for f in told if f.term == 'breathing']
    assert found.channel == body and found.value == pytest.approx(4e-4, rel=0.15)
    p = found.parameters
    assert p['frequency'] == pytest.approx(0.23, abs=0.005)
    wave = p['amplitude'] * np.sin(p['phase']) * p['direction'][2]
    assert wave == pytest.approx(4e-4 * np.sin(0.5), abs=1e-4)


def test_a_floor_that_is_still_has_no_rhythm(looked_at):
    assert looked_at()[1].rhythm == 0.0


@pytest.mark.parametrize(('amplitude', 'told'), [(4e-5, False), (1e-4, True)])
def test_a_floor_that_trembles_is_no_fault_but_is_known(laboratory, pushes, look, amplitude, told):
    """A rhythm too faint to be told of is still there for the model: 0.1 mm that nobody had told
    of was taken for a drift of the tissue.
    """
    lab = laboratory((), 51, disturb=swinging(amplitude, 0.32, lambda name: name[:4] == 'base'))
    structure = look(lab.record(pushes(speeds=(0.02,))))[1]
    assert ('breathing' in [f.term for f in structure.findings]) is told
    assert structure.rhythm == pytest.approx(0.32, abs=0.005)


def test_a_base_that_gives_way_under_load(happened, laboratory):
    direction = laboratory().directions[0]

    def give(t, names, points):
        travel = (points[list(names).index('pad_0')]
                  - laboratory().scene.markers[0].position) @ direction
        based = np.array([n.startswith('base') for n in names])
        return points + based[:, None] * 0.05 * travel * direction

    found, = happened(disturb=give)
    assert found.channel == 'base' and 'pad_0 pushes' in found.statement
    assert found.value == pytest.approx(0.05 * 8e-3 * direction, abs=5e-5)


def test_a_tracker_that_drifts_is_no_marker_that_slips(happened):
    def drift(t, names, points):
        return points + 1e-5 * t * np.array([1.0, 0.0, 0.0])

    found, = happened(disturb=drift)
    assert found.term is None and 'drift' in found.statement


def test_long_gaps_and_frozen_values(happened):
    def spoil(run):
        points, visible = run.optical.points.copy(), run.optical.visible.copy()
        k, late = run.optical.ids.index('tissue_7'), run.optical.t > 6.0
        visible[late & (run.optical.t < 12.5), k] = False
        force = run.force.values.copy()
        held = (run.force.t > 10.0) & (run.force.t < 10.4)
        force[held, 1] = force[np.argmax(held), 1]
        return replace(run, optical=replace(run.optical, points=points, visible=visible),
                       force=replace(run.force, values=force))

    found = {f.channel: f for f in happened(change=spoil)}
    assert set(found) == {'tissue_7', 'pad_1'}
    assert found['tissue_7'].value == pytest.approx(6.5, abs=0.3)
    assert found['pad_1'].t_start == pytest.approx(10.0, abs=0.05)
    assert 'does not change for 0.3' in found['pad_1'].statement


@pytest.mark.parametrize('count', [pytest.param(0.1, marks=pytest.mark.validate), 0.5])
def test_a_force_that_is_digitised_coarsely_has_not_frozen(happened, count):
    def rounded(run):
        return replace(run, force=replace(run.force,
                                          values=count * np.round(run.force.values / count)))

    assert not any('does not change' in found.statement for found in happened(change=rounded))


def test_without_noise_nothing_has_frozen(laboratory, short_pushes, look):
    lab = laboratory((), 53, optical=OpticalParams(noise=0.0),
                     em=EmTrackerParams(position_noise=0.0), force=ForceSensorParams(noise=0.0))
    findings = look(lab.record(short_pushes()))[1].findings
    assert not any('does not change' in found.statement for found in findings)


def test_a_tracker_that_goes_off(happened):
    def off(run):
        visible = run.optical.visible.copy()
        visible[run.optical.t > 8.0] = False
        return replace(run, optical=replace(run.optical, visible=visible))

    found, = happened(change=off)
    assert found.stream == 'optical' and found.t_start == pytest.approx(8.0, abs=0.02)
    assert 'Nothing of optical was recorded' in found.statement


def test_registration_leaves_a_knocked_marker_out(laboratory):
    """A rotated tracker, and a base marker 8 mm off: the others still give the rotation."""
    lab = laboratory((), 52)
    run = lab.record([(np.array([6e-3, 0, 0]), 0.02, 0.5)])
    a = np.radians(3.0)
    R = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    points = (run.optical.points - [0.1, 0.2, 0.3]) @ R
    points[:, run.optical.ids.index('base_1')] += [0.0, 0.008, 0.0]
    evidence = evidence_of(replace(run, optical=replace(run.optical, points=points)), lab.scene)
    found = register(evidence, 3e-4)
    assert 'base_1' not in found.on and len(found.on) == 5
    assert np.allclose(found.R, R, atol=5e-3)
    world = prepare(evidence).evidence.get('optical')
    assert np.allclose(world.values[50, :3], run.optical.points[50, :3], atol=6e-4)


def elsewhere(run, names, begin=0.0, optical_alone=False):
    """What of a RunData a tracker that stands anywhere saw of some markers from `begin` [s] on."""
    turn = Rotation.from_euler('zyx', [70.0, -35.0, 20.0], degrees=True).as_matrix()
    k = [i for i, name in enumerate(run.optical.ids) if name.startswith(names)]
    late = run.optical.t > begin
    seen = replace(run.optical, t=run.optical.t[late], ids=tuple(run.optical.ids[i] for i in k),
                   points=run.optical.points[late][:, k] @ turn.T + [0.5, -0.2, 0.9],
                   visible=run.optical.visible[late][:, k])
    if optical_alone:
        return replace(run, optical=seen)
    return replace(run, optical=seen, em={}, encoder=run.encoder.between(begin, 99.0),
                   force=run.force.between(begin, 99.0))


@pytest.mark.parametrize(('begin', 'optical_alone'), [
    pytest.param(3.0, False, marks=pytest.mark.validate), (3.0, True)])
def test_a_tracker_that_saw_no_rest_is_registered_along_the_way(recorded, look, begin,
                                                                optical_alone):
    """Without base markers, and with pads that push as soon as there are any frames."""
    run = elsewhere(recorded(), ('pad', 'tissue'), begin, optical_alone)
    prepared, structure = look(run)
    assert set(prepared.registration.on) == {'pad_0', 'pad_1', 'pad_2'}
    assert structure.findings == () and len(structure.pads) == 3


@pytest.mark.parametrize('names', [('pad_0',), ('pad_0', 'pad_1'), ('tissue_0',)])
def test_markers_in_a_frame_that_nothing_tells_are_left_out_with_a_note(recorded, look, names):
    prepared, structure = look(elsewhere(recorded(), names))
    assert prepared.evidence.get(OPTICAL) is None and structure.findings == ()
    assert 'fewer than three on base and pads' in prepared.evidence.notes[-1]


def test_nothing_but_markers_in_a_frame_that_nothing_tells_is_refused(recorded, look):
    run = elsewhere(recorded(), ('pad_0',))
    with pytest.raises(RecordingError, match='register the tracker'):
        look(replace(run, force=None, force_pads=(), em={}))


def test_one_marker_in_the_frame_of_the_scene_is_kept(recorded, look):
    run, k = recorded(), recorded().optical.ids.index('pad_0')
    run = replace(run, optical=replace(run.optical, ids=('pad_0',),
                                       points=run.optical.points[:, [k]],
                                       visible=run.optical.visible[:, [k]]))
    prepared, structure = look(run)
    assert prepared.evidence.get(OPTICAL).names == ('pad_0',) and structure.findings == ()


def test_rigid_motion_of_points_is_recovered():
    rng = np.random.default_rng(2)
    rest = rng.standard_normal((5, 3)) * 0.05
    turn, shift = np.array([1e-3, -2e-3, 5e-4]), np.array([1e-3, 2e-3, -3e-3])
    moved = shift + np.cross(turn, rest - rest.mean(axis=0))
    motion, left, lever = rigid_motion(rest, moved[None], np.ones((1, 5), dtype=bool))
    assert motion[0] == pytest.approx([*shift, *(lever * turn)], abs=1e-12)
    assert np.abs(left).max() < 1e-12
