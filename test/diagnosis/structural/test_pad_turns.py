"""Several markers on a pad: said once what the pad does, and told apart from a pad that turns."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.scene import Marker
from arm_brachy.diagnosis.isolation.handover import given
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.registry import parse_terms

AXIS = np.array([0.0, 0.6, 0.8])
ASIDE = ((0.0, 0.018, 0.0), (0.0, 0.0, 0.018))      # m, from the marker that the scene has there


@pytest.fixture(scope='module')
def clusters(laboratory):
    """Function to a Laboratory with more markers on pad_0, that may turn by rate [rad/m]."""
    scene = laboratory().scene
    first = next(m for m in scene.markers if m.body == 'pad_0')
    pad = scene.pads[0]

    def make(terms=(), seed=1, rate=0.0, aside=ASIDE, off=None):
        """off : marker -> [m] by which it is not where the scene has it"""
        more = [Marker(f'pad_0_{i}', tuple(np.add(first.position, a)), 'pad_0')
                for i, a in enumerate(aside)]
        rest = {m.name: np.array(m.position) for m in (first, *more)}

        def turn(t, names, points):
            out = points.copy()
            travel = (points[names.index('pad_0')] - rest['pad_0']) @ np.array(pad.direction)
            turning = Rotation.from_rotvec(rate * travel * AXIS).as_matrix()
            for name, place in rest.items():
                lever = place - pad.centre
                out[names.index(name)] += turning @ lever - lever + (off or {}).get(name, 0.0)
            return out

        return laboratory(parse_terms(terms, 'test'), seed, markers=more, disturb=turn)

    return make


@pytest.fixture
def seen(short_pushes):
    """Function from a Laboratory to the Recorded of its short protocol."""
    return lambda lab: look(evidence_of(lab.record(short_pushes()), lab.scene))


@pytest.mark.parametrize('seed', [
    0, *(pytest.param(seed, marks=pytest.mark.validate) for seed in (1, 2))])
def test_a_sound_pad_with_several_markers_has_no_findings(clusters, seen, seed):
    assert seen(clusters(seed=seed)).structure.findings == ()


@pytest.mark.parametrize('entry, name', [
    ({'name': 'actuator_gain', 'gain': -0.06}, 'gain'),
    pytest.param({'name': 'backlash', 'width_mm': 0.4}, 'width', marks=pytest.mark.validate)])
def test_what_an_actuator_does_is_said_once(clusters, seen, entry, name):
    """Given to the model once for every marker, it would be there three times."""
    lab = clusters(({**entry, 'actuators': [0]},))
    term, = given((seen(lab),)).terms
    planted, = parse_terms([{**entry, 'actuators': [0]}], 'test')
    assert getattr(term, name) == pytest.approx(getattr(planted, name), rel=0.1)


@pytest.mark.parametrize('aside, share, least', [(ASIDE, 1.0, ''), (
    ASIDE[:1], np.hypot(AXIS[0], AXIS[2]), 'at least ')], ids=['three', 'two along y'])
def test_a_pad_that_turns_is_told_with_its_rate_and_is_no_gain(clusters, seen, aside, share,
                                                               least):
    """Two markers do not show what turns about the line through them."""
    rate = np.radians(1.0) / 1e-3
    one = seen(clusters(rate=rate, aside=aside))
    finding, = one.structure.findings
    assert finding.nameless
    assert f'pad_0 show that it turns by {least}{share:.2f} deg' in finding.statement
    assert finding.value == pytest.approx(share * rate, rel=0.02)
    theirs = one.prepared.evidence.get(OPTICAL).on('pad_0')
    assert np.isnan(one.states.streams[OPTICAL].values[:, theirs]).all()
    assert given((one,)).terms == ()


def test_steps_that_all_markers_on_a_pad_show_are_its_own(clusters, seen):
    """Lost between encoder and pad; forces and tissue follow."""
    lab = clusters(({'name': 'lost_steps', 'shortfall_mm': 0.5, 'onset_s': 8.0,
                     'actuators': [0]},))
    finding, = seen(lab).structure.findings
    assert finding.term == 'lost_steps' and finding.rivals == ()
    assert finding.value == pytest.approx(0.5e-3, rel=0.1)


def test_a_step_that_one_of_several_markers_on_a_pad_shows_is_the_markers(clusters, seen):
    lab = clusters(({'name': 'marker_slip', 'marker': 'pad_0_1', 'onset_s': 8.0,
                     'offset_mm': [0.5, 0.0, 0.0]},))
    finding, = seen(lab).structure.findings
    assert finding.term == 'marker_slip' and finding.parameters['marker'] == 'pad_0_1'


def test_a_pad_beside_its_place_is_told_by_all_of_its_markers(clusters, seen):
    """One marker may be glued elsewhere, not all of them alike."""
    aside = np.array([0.0, 3e-3, 0.0])
    lab = clusters(off={'pad_0': aside, 'pad_0_0': aside, 'pad_0_1': aside})
    finding, = (f for f in seen(lab).structure.findings if f.term == 'pad_misplacement')
    assert finding.rivals == () and finding.parameters['pads'] == ('pad_0',)
    assert np.hypot(finding.parameters['up'], finding.parameters['side']) == pytest.approx(
        3e-3, rel=0.15)


def test_one_marker_beside_its_place_is_no_pad_beside_it(clusters, seen):
    found = seen(clusters(off={'pad_0_1': np.array([0.0, 3e-3, 0.0])})).structure.findings
    assert {f.term for f in found} == {'marker_slip'}
    assert {f.channel for f in found} == {'pad_0_1'}
