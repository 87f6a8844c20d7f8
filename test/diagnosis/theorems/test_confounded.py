"""T8 to T11: actuators, clocks, lengths, shapes and friction that one recording cannot part."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.selection.screening import triable
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import BASE, EM, OPTICAL, TISSUE
from arm_brachy.registry import by_name
from arm_brachy.tissue.newton import StaticSolver

SAME = 1e-9         # m: ten times what Newton leaves outstanding
SHORT = {'name': 'actuator_gain', 'gain': -0.08, 'actuators': [0]}
LATE = {'name': 'clock_offset', 'stream': 'optical', 'delay_ms': 30.0}
LARGER, SCALED = {'name': 'reference_shape', 'height': 0.03, 'width': 0.03}, {
    'name': 'optical_scale', 'scale': 0.03}


@pytest.fixture(scope='module')
def yielding(cause, others):
    return [cause('actuator_gain', ('gain',), actuators=(0,)),
            cause('actuator_compliance', actuators=(0,)), *others]


def test_t8_one_pad_in_one_direction_does_not_tell_gain_from_compliance(breast, once, judge,
                                                                        yielding):
    found = judge([breast.watch(once, SHORT)], yielding)
    assert found.verdict == 'equivalent'
    assert found.names == {'actuator_gain', 'actuator_compliance'}


def test_t8_another_stiffness_before_the_pad_does(breast, pushes, judge, yielding):
    """The pad opposite, and those beside it, hold the tissue against the push."""
    path = pushes(((1, 0, 0, 0), 6e-3, 10e-3), ((1, 0, 1, 0), 6e-3, 10e-3),
                  ((1, 1, 0, 1), 6e-3, 10e-3))
    found = judge([breast.watch(path, SHORT)], yielding)
    assert found.verdict == 'named' and found.names == {'actuator_gain'}


def loading(pushes):
    """Path that only goes in, at one speed."""
    path = pushes(((1, 0, 0, 0), 8e-3, 4e-3))
    last = path.t <= 5.0 + 1e-9
    return Path(path.t[last], path.q[last])


def test_t8_at_one_speed_a_clock_is_where_the_pad_touches(breast, pushes, cause, others, judge):
    m = breast.watch(loading(pushes), LATE, kinds=(OPTICAL,))
    assert m.recorded.structure.findings == ()
    found = judge([m], [cause('clock_offset', stream='optical'), *others])
    assert found.verdict == 'nothing_missing'


def test_t8_at_two_speeds_it_is_a_clock(breast, pushes):
    path = pushes(((1, 0, 0, 0), 8e-3, 4e-3), ((1, 0, 0, 0), 8e-3, 16e-3))
    finding, = breast.watch(path, LATE, kinds=(OPTICAL,)).recorded.structure.findings
    assert finding.term == 'clock_offset' and finding.value == pytest.approx(30e-3, abs=5e-3)


def test_t9_a_larger_body_pushed_further_is_a_larger_unit_of_length(breast, once):
    """Alike but for the frame, at rest and pushed; forces are those of a larger body."""
    t = [0.0, 4.5]
    larger = breast.run(Path(once.t, 1.03 * once.q), t, LARGER)
    plain, scaled = breast.run(once, t), breast.run(once, t, SCALED)
    tissue = [i for i, body in enumerate(breast.specimen.carriers) if body == TISSUE]
    apart = (larger.optical - scaled.optical)[:, tissue]
    assert np.ptp(apart, axis=(0, 1)).max() < SAME
    np.testing.assert_allclose(larger.force, 1.03**2 * plain.force, rtol=1e-6, atol=1e-6)


@pytest.fixture(scope='module')
def lengths(cause, others):
    return [cause('optical_scale', ('scale',)), cause('reference_shape', ('height', 'width')),
            *others]


@pytest.mark.parametrize(('entry', 'name'), [
    (SCALED, 'optical_scale'),
    pytest.param(LARGER, 'reference_shape', marks=pytest.mark.validate)])
def test_t9_encoders_that_are_known_tie_the_length(breast, rich, judge, lengths, entry, name):
    found = judge([breast.watch(rich, entry, kinds=(OPTICAL,))], lengths)
    best, second = found.decision.ranked[:2]
    assert best.causes == (name,) and best.evidence - second.evidence > 4.0
    assert found.names <= {name}


UNKNOWN_STROKE = Calibration(gain=0.1)


def test_t9_without_them_neither_is_named(breast, rich, judge, lengths):
    m = breast.watch(rich, SCALED, kinds=(OPTICAL,), calibration=UNKNOWN_STROKE)
    found = judge([m], lengths)
    one, other = sorted(found.decision.ranked, key=lambda c: -c.evidence)[:2]
    assert {*one.causes, *other.causes} == {'optical_scale', 'reference_shape'}
    assert one.evidence > 100.0 and one.evidence - other.evidence < 4.0
    assert found.verdict != 'named'


def test_t9_without_them_both_come_as_a_class(breast, rich, judge, lengths):
    m = breast.watch(rich, SCALED, kinds=(OPTICAL,), calibration=UNKNOWN_STROKE)
    found = judge([m], lengths)
    assert found.verdict == 'equivalent'
    assert found.names == {'optical_scale', 'reference_shape'}


def test_t9_an_em_tracker_is_a_second_ruler(breast, rich, judge, lengths):
    m = breast.watch(rich, SCALED, kinds=(OPTICAL, EM), calibration=UNKNOWN_STROKE)
    found = judge([m], lengths)
    assert found.verdict == 'named' and found.names == {'optical_scale'}


UPRIGHT, TIPPED = (0.0, 0.0, -9.81), (9.81, 0.0, 0.0)


def at_rest(specimen, nodes, gravity):
    """Nodes (n, 3) [m] at rest under gravity of a body stress-free at `nodes`."""
    body = specimen.body
    body = replace(body, gravity=gravity, mesh=replace(body.mesh, nodes=nodes))
    found = StaticSolver(body).solve(nodes, np.zeros((4, 3)))
    assert found.outcome.ok
    return found.x


def test_t10_a_scan_under_gravity_has_a_shape_that_sags_into_it(breast):
    """One orientation: exactly the scan, as if it were stress-free. Another: not."""
    scan = breast.specimen.body.mesh.nodes
    shape = scan.copy()
    for _ in range(8):
        shape = shape + scan - at_rest(breast.specimen, shape, UPRIGHT)
    assert np.abs(shape - scan).max() > 5e-4
    assert np.abs(at_rest(breast.specimen, shape, UPRIGHT) - scan).max() < SAME
    mistaken = at_rest(breast.specimen, scan, TIPPED)
    assert np.abs(at_rest(breast.specimen, shape, TIPPED) - mistaken).max() > 5e-4


@pytest.fixture(scope='module')
def soft(scene, lab):
    return lab(replace(scene, material=replace(scene.material, E=2e3)))


@pytest.fixture(scope='module')
def sagged(soft, lab):
    """The Lab of the same body, stress-free in the shape to which gravity brings it."""
    one, out = soft.specimen, lab(soft.specimen.scene)
    shape = at_rest(one, one.body.mesh.nodes, UPRIGHT)
    out.specimen = replace(one, body=replace(one.body, mesh=replace(one.body.mesh, nodes=shape)))
    return out


@pytest.mark.parametrize(('turned', 'verdict', 'names'), [
    (False, 'equivalent', {'weight', 'shape'}), (True, 'named', {'weight'})],
    ids=['one orientation', 'two'])
def test_t10_two_orientations_part_shape_from_weight(soft, sagged, pushes, judge, turned, verdict,
                                                     names):
    """The rig is turned with the tracker: the weight changes its direction, the shape does not.

    Small pushes: how a sagged body answers to larger ones tells it from one of that shape.
    """
    path = pushes(((1, 0, 0, 0), 1.5e-3, 10e-3))
    pulls = [{'name': 'gravity', 'added_m_s2': list(g)} for g in (UPRIGHT, TIPPED)[:1 + turned]]
    recordings = [soft.watch(path, pull, kinds=(OPTICAL,), markers=(TISSUE, BASE), seed=5 + i)
                  for i, pull in enumerate(pulls)]
    weight = [soft.changed(m, g) for m, g in zip(recordings, pulls, strict=True)]
    shape = [sagged.changed(m) for m in recordings]
    found = judge(recordings, [], [('weight', weight), ('shape', shape)])
    assert (found.verdict, found.names) == (verdict, names)


def slipping(friction):
    return {'name': 'pad_slip', 'friction': friction, 'pads': ['pad_1']}


@pytest.fixture
def flat(breast):
    """The breast, one pad a flat disc that touches it."""
    scene = breast.specimen.scene
    first, *others = scene.pads
    touching = replace(scene, pads=(replace(first, contact='touching'), *others))
    return type(breast)(specimen_of(touching, breast.specimen.mesh))


def test_t11_friction_is_not_seen_until_something_slips(flat, pushes):
    path, t = pushes(((1, 0, 0, 0), 3e-3, 5e-3), stand=0.2, idle=1.0), [1.3, 1.6]
    stuck, more, slips = (flat.run(path, t, slipping(f)) for f in (0.5, 5.0, 0.1))
    assert np.abs(stuck.optical - more.optical).max() < SAME
    np.testing.assert_allclose(stuck.force, more.force, atol=1e-6)
    assert np.abs(stuck.optical - slips.optical).max() > 1e-4


def test_t11_friction_is_tried_unless_memory_asks_for_full_runs():
    assert triable(by_name('pad_slip')) == ''
    assert 'full runs' in triable(by_name('pad_slip'), remembers=True)
