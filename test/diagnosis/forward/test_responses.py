"""Tangent responses of every term against full nonlinear runs of the plant's equations."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.actuator_lag import ActuatorLag
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.devices.terms.force_gain import ForceGain
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.diagnosis.model import condensation
from arm_brachy.diagnosis.model.condensation import interface_change
from arm_brachy.diagnosis.model.force_rates import Rates
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.sensitivities import respond, together
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.selection.screening import triable
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.registry import TERMS, by_name
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.base_debond import BaseDebond
from arm_brachy.tissue.terms.external_force import ExternalForce
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.reference_shape import ReferenceShape
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient
from arm_brachy.tissue.terms.strain_stiffening import StrainStiffening
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

STATES = np.array([2.5, 7.4, 9.0])
ACCURACY = 0.05
PLACES = {
    'external_force': {'centre': (0.03, 0.03, 0.044), 'onset': 2.0, 'duration': 6.0},
    'inclusion': {'centre': (0.02, 0.01, 0.03), 'radius': 0.012},
    'reference_shape': {'bump_centre': (0.03, 0.03, 0.044)},
    'marker_slip': {'marker': 'tissue_3', 'onset': 5.0},
    'lost_steps': {'onset': 5.0, 'actuators': (0,)},
    'pad_misplacement': {'pads': ('pad_1',)},
    'actuator_gain': {'actuators': (0,)},
    'breathing': {'frequency': 0.25, 'phase': 0.3},
}
CONTACT = {'base_compliance', 'base_debond', 'obstacle', 'pad_slip'}
SILENT = {'damping', 'point_mass', 'actuator_lag'}  # no inertia, no gravity here; before encoders
FORWARD = [t for t in TERMS if t.spec.name not in CONTACT | SILENT]


@pytest.fixture(scope='module')
def baseline(quadratic, encoder):
    return Baseline(ForwardModel(quadratic), encoder, STATES)


def difference(baseline, terms, amplitude):
    """Change of all streams by full runs, per amplitude; and the values without."""
    model = ForwardModel(baseline.model.specimen, (*baseline.model.terms, *terms))
    new = model.predict(baseline.encoder, baseline.t)
    assert new.valid.all()
    return {kind: (new.get(kind) - old) / amplitude for kind, old in baseline.shown.items()}


def error(found, expected):
    """Largest relative error of any stream that the effect reaches."""
    noise = {'optical': 1e-7, 'em': 1e-7, 'force': 1e-4}    # left by the solver's tolerance
    return max((np.linalg.norm(found[kind] - e) / np.linalg.norm(e)
                for kind, e in expected.items() if np.linalg.norm(e) > 100.0 * noise[kind]))


@pytest.mark.parametrize('cls', FORWARD, ids=lambda cls: cls.spec.name)
def test_responses_are_those_of_full_runs(baseline, cls):
    one = hypothesis(cls, **PLACES.get(cls.spec.name, {}))
    response = respond(baseline, one)
    assert not response.exact
    # play acts whole or not at all; it moves the pads alone, which is near linear
    amplitude = 1.0 if cls is Backlash else 0.01
    for k in range(len(one.strengths)):
        expected = difference(baseline, (one.alone(k, amplitude),), amplitude)
        found = {kind: values[..., k] for kind, values in response.values.items()}
        assert error(found, expected) < ACCURACY, one.strengths[k].label


def test_a_weight_answers_where_there_is_gravity_and_nowhere_else(quadratic, encoder, baseline):
    one = hypothesis(by_name('point_mass'), centre=(0.03, 0.03, 0.044))
    body = replace(quadratic.body, gravity=np.array([0.0, 0.0, -9.81]))
    heavy = Baseline(ForwardModel(replace(quadratic, body=body)), encoder, STATES)
    expected = difference(heavy, (one.alone(0, 0.01),), 0.01)
    found = {kind: values[..., 0] for kind, values in respond(heavy, one).values.items()}
    assert np.abs(expected['optical']).max() > 1e-5
    assert error(found, expected) < ACCURACY
    assert not any(values.any() for values in respond(baseline, one).values.values())
    assert triable(type(one.alone(0, 1.0))) == ''
    assert 'gravity' in triable(type(one.alone(0, 1.0)), heavy=False)


def test_a_modulus_scales_forces_alone_at_every_depth(linear, encoder):
    """Without weight F is proportional to E; the states share a factor, not a push."""
    baseline = Baseline(ForwardModel(linear), encoder, np.array([1.28, 1.29, 1.30, 2.5]))
    assert baseline.group[0] == baseline.group[1] == baseline.group[2] != baseline.group[3]
    one = hypothesis(by_name('stiffness_scale'))
    size = one.alone(0, 1.0).prepare(baseline.model.body).mu[0] / baseline.model.body.mu[0] - 1.0
    found = {kind: values[..., 0] for kind, values in respond(baseline, one).values.items()}
    force = baseline.shown['force']
    assert np.abs(force[:, 0]).max(axis=1).min() > 0.1
    assert np.allclose(found['force'], size * force, rtol=0.0, atol=1e-3)
    assert np.abs(found['optical']).max() < 1e-6


def test_neighbours_with_one_factor_answer_to_an_inclusion_as_each_alone(linear, encoder):
    one = hypothesis(Inclusion, centre=(0.03, 0.02, 0.03), radius=0.012)
    t = np.array([1.28, 1.30])
    together = respond(Baseline(ForwardModel(linear), encoder, t), one).values
    for i in range(len(t)):
        alone = respond(Baseline(ForwardModel(linear), encoder, t[i:i + 1]), one).values
        for kind in ('optical', 'force'):
            off = together[kind][i] - alone[kind][0]
            assert np.linalg.norm(off) < 0.04 * np.linalg.norm(alone[kind][0]), (i, kind)


SUPPORTS = [('base_debond', {'centre': (0.03, 0.0, 0.0)}),
            ('base_debond', {'centre': (-0.03, -0.03, 0.0)}),
            ('obstacle', {'centre': (-0.04, 0.04, 0.03)}),
            ('obstacle', {'centre': (0.0, 0.0, 0.058)})]


@pytest.mark.parametrize(('name', 'place'), SUPPORTS)
def test_supports_are_condensed_to_the_nodes_they_act_on(baseline, name, place):
    one = hypothesis(by_name(name), **place)
    response = respond(baseline, one)
    assert not response.exact
    expected = difference(baseline, (one.alone(0, 1.0),), 1.0)
    found = {kind: values[..., 0] for kind, values in response.values.items()}
    assert error(found, expected) < ACCURACY


def test_terms_of_all_stages_together_do_what_a_full_run_has_them_do(linear, encoder):
    terms = (StiffnessGradient(gradient=(0.0, 1.0, 2.0)), BaseDebond(0.02, (0.02, 0.01, 0.0)),
             ActuatorGain(gain=0.02, actuators=(0,)), ForceGain(gain=0.05, pads=('pad_1',)))
    baseline = Baseline(ForwardModel(linear), encoder, STATES)
    found, full = together(baseline, terms), ForwardModel(linear, terms).predict(encoder, STATES)
    alone = [together(baseline, (term,)) for term in terms]
    for kind in ('optical', 'force'):
        expected = full.get(kind) - baseline.shown[kind]
        off = np.linalg.norm(found[kind] - expected)
        assert off < ACCURACY * np.linalg.norm(expected)
        assert all(np.linalg.norm(one[kind] - expected) > 3.0 * off for one in alone)


def test_a_support_that_holds_no_node_does_nothing(linear, encoder):
    """Whatever was asked of the same class before."""
    beside = Baseline(ForwardModel(linear), encoder, STATES)
    sector = hypothesis(BaseDebond, centre=(0.02, 0.01, 0.0))
    respond(beside, sector)
    change = together(beside, (BaseDebond(1e-6, (0.02, 0.01, 0.0)),))
    assert all(not np.any(values) for values in change.values())
    small = respond(beside, replace(sector, size=1e-4))
    assert small.scale == 1e-4 and all(not np.any(values) for values in small.values.values())


def test_an_obstacle_out_of_reach_does_nothing(baseline):
    far = hypothesis(by_name('obstacle'), centre=(0.0, 0.0, 0.058)).alone(0, 1e-3)
    changes = interface_change(baseline, far.prepare(baseline.model.body))
    assert np.array_equal(changes, np.zeros_like(changes))


def test_a_wall_presses_in_its_one_direction(linear, encoder, monkeypatch):
    """The same as with the nodes free to go all three ways, which it pushes in one."""
    wall = next(hypothesis(by_name(name), **place) for name, place in SUPPORTS
                if name == 'obstacle')
    at_rest = Baseline(ForwardModel(linear), encoder, STATES)
    law, _ = condensation.law_between(at_rest.model.body, wall.alone(0, wall.size).prepare(
        at_rest.model.body))
    assert law.along.shape == (1, 3)
    one = respond(at_rest, wall).values
    with monkeypatch.context() as patch:
        patch.setattr(condensation, '_shared', lambda normal: np.eye(3))
        three = respond(Baseline(ForwardModel(linear), encoder, STATES), wall).values
    for kind in ('optical', 'force'):
        assert np.abs(three[kind]).max() > 0.0
        assert np.linalg.norm(one[kind] - three[kind]) < 1e-3 * np.linalg.norm(three[kind])


@pytest.fixture(scope='module')
def slab():
    """Specimen of a slab on a base of 625 nodes that a pad on top drags along."""
    size = (0.06, 0.06, 0.02)
    above = [(x, y, size[2]) for x in (0.01, 0.03, 0.05) for y in (0.01, 0.05)]
    scene = Scene('slab', MeshFile('none.msh'), Region('set', set='z0'), material=Material(),
                  pads=(PadPatch('drag', (0.03, 0.03, 0.02), (1.0, 0.0, -0.6), radius=0.012),),
                  markers=tuple(Marker(f'm{i}', point) for i, point in enumerate(above)))
    return specimen_of(scene, quadratic_mesh(box_mesh(size, (10, 10, 3))))


@pytest.mark.parametrize(('name', 'place'), [
    ('base_debond', {'centre': (0.03, 0.02, 0.0)}), ('base_compliance', {})])
def test_corners_of_a_large_base_carry_the_middles_of_edges(slab, monkeypatch, name, place):
    """The same answers, a little smaller: an interface is stiffer whose faces cannot bend."""
    path = Path(np.array([0.0, 1.0, 2.0]), np.array([[0.0], [2e-3], [4e-3]]))
    one = hypothesis(by_name(name), **place)
    values = []
    for many in (np.inf, 0):
        monkeypatch.setattr(condensation, 'MANY', many)
        values.append(respond(Baseline(ForwardModel(slab), path, path.t[1:]), one).values)
    every, few = values
    for kind in ('optical', 'force'):
        a, b = few[kind].ravel(), every[kind].ravel()
        assert 0.8 < np.linalg.norm(a) / np.linalg.norm(b) < 1.0
        assert a @ b > 0.99 * np.linalg.norm(a) * np.linalg.norm(b)


@pytest.mark.parametrize(('name', 'place'), [SUPPORTS[0], SUPPORTS[2]])
def test_a_support_acts_alike_whatever_was_looked_at_before(linear, encoder, name, place):
    """Stiffness is that of the first state, at rest, in both."""
    one = hypothesis(by_name(name), **place)
    few, more = (respond(Baseline(ForwardModel(linear), encoder, np.array(t)), one).values
                 for t in ([0.5, 9.0], [0.5, 1.3, 2.5, 7.4, 9.0]))
    for kind, close in (('optical', 1e-7), ('force', 1e-4)):
        assert np.abs(few[kind][-1]).max() > 100.0 * close
        assert np.allclose(few[kind][-1], more[kind][-1], rtol=0.0, atol=close)


def test_no_inertia_no_answer_to_damping(baseline):
    response = respond(baseline, hypothesis(by_name('damping')))
    assert np.abs(response.values['force']).max() < 1e-9


def test_what_acts_before_the_encoders_is_refused(baseline):
    with pytest.raises(ConfigError, match='before the encoders'):
        respond(baseline, hypothesis(ActuatorLag))


def test_answers_hold_beside_terms_that_the_model_has(linear, encoder):
    known = (Gravity(added=(0.0, 0.0, -9.81)), Inclusion(centre=(0.0, 0.0, 0.03), ratio=5.0),
             OpticalScale(scale=0.2), ForceGain(gain=0.5))
    baseline = Baseline(ForwardModel(linear, known), encoder, STATES)
    one = hypothesis(StiffnessGradient)
    response = respond(baseline, one)
    expected = difference(baseline, (one.alone(0, 0.01),), 0.01)
    found = {kind: values[..., 0] for kind, values in response.values.items()}
    assert error(found, expected) < ACCURACY


def test_beside_memory_what_comes_suddenly_meets_the_sudden_modulus(linear, encoder):
    baseline = Baseline(ForwardModel(linear, (Viscoelasticity(g1=0.5, tau1=2.0),)), encoder,
                        STATES)
    one = hypothesis(ExternalForce, centre=(0.03, 0.03, 0.044), onset=STATES[-1] - 0.01,
                     duration=1.0)
    response = respond(baseline, one)
    expected = difference(baseline, (one.alone(0, 0.05),), 0.05)
    found = {kind: values[..., 0] for kind, values in response.values.items()}
    assert error(found, expected) < ACCURACY


def test_a_transmission_beside_memory_is_run_in_full(linear, encoder):
    baseline = Baseline(ForwardModel(linear, (Viscoelasticity(g1=0.3, tau1=2.0),)), encoder,
                        STATES[:2])
    assert respond(baseline, hypothesis(ActuatorGain, ('gain',))).exact


def test_sensitivity_to_nodal_forces_is_that_of_a_dead_load(baseline):
    node = int(np.argmax(baseline.model.body.mesh.nodes[:, 2]))
    force = np.zeros(baseline.model.body.mesh.nodes.shape)
    force[node] = (0.01, 0.0, -0.02)
    change = baseline.sensitivity(0).change(np.zeros_like(force), -force)
    solution = baseline.solver.solve_held(
        baseline.x(0), baseline.solver.held_positions(baseline.pads(0)),
        _loaded(baseline.fields[0], force))
    moved = baseline.model.attached.points(solution.x, baseline.pads(0), np.zeros(3))
    k = len(baseline.model.specimen.markers)
    expected = moved[:k] - baseline.truth[0]['optical']
    found = baseline.split(change)['optical']
    tissue = baseline.model.attached.inside[:k]
    assert np.linalg.norm((found - expected)[tissue]) < 0.03 * np.linalg.norm(expected[tissue])


def test_states_in_one_place_differ_by_what_comes_between_them(linear, encoder):
    one = hypothesis(ExternalForce, centre=(0.03, 0.03, 0.044), onset=2.6, duration=5.0)
    both = Baseline(ForwardModel(linear), encoder, np.array([2.5, 2.8]))
    alone = Baseline(ForwardModel(linear), encoder, np.array([2.8]))
    assert both.places() == [0]
    found = respond(both, one).values['optical'][..., 0]
    expected = respond(alone, one).values['optical'][0, ..., 0]
    assert not found[0].any()
    assert np.allclose(found[1], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('radius', [0.015, 0.1])    # a few elements, more than are worth it
def test_a_bump_changes_the_forces_of_the_elements_it_reaches(linear, encoder, radius):
    terms = (Gravity(added=(0.0, 0.0, -9.81)), StrainStiffening(ratio=0.5),
             Anisotropy(ratio=0.5))
    baseline = Baseline(ForwardModel(linear, terms), encoder, STATES)
    bump = ReferenceShape(bump_height=1e-3, bump_centre=(0.03, 0.03, 0.044), bump_radius=radius)
    body = bump.prepare(baseline.model.body)
    rates, fields = Rates(baseline, body), StepFields.of(body)
    whole = Assembler(body).forces(baseline.x(1) + rates.shift, fields) - baseline.forces[1]
    assert np.abs(whole).max() > 1e-4
    assert np.allclose(rates.at(1, fields), whole, rtol=0.0, atol=1e-11)


def _loaded(fields, force):
    fields.nodal_force = fields.nodal_force + force
    return fields


@pytest.mark.parametrize(('name', 'strength', 'places'), [
    ('reference_shape', 'height', [{}, {'bump_centre': (0.03, 0.03, 0.044)}]),
    ('viscoelasticity', 'g1', [{'tau1': 3.0}, {'tau1': 3.0, 'tau2': 40.0}]),
    pytest.param('viscoelasticity', 'g2', [
        {'tau1': 0.5, 'tau2': 40.0}, {'tau1': 3.0, 'tau2': 40.0}], marks=pytest.mark.validate)])
def test_what_another_strength_depends_on_changes_nothing_alone(quadratic, encoder, name, strength,
                                                                places):
    """Computed once for all of these, and the same if it is not."""
    kept = Baseline(ForwardModel(quadratic), encoder, STATES)
    for place in places:
        one = hypothesis(by_name(name), (strength,), **place)
        shared = respond(kept, one)
        alone = respond(Baseline(ForwardModel(quadratic), encoder, STATES), one)
        for kind, values in shared.values.items():
            np.testing.assert_array_equal(values, alone.values[kind])
    assert len(kept.columns) == 1


def test_a_bump_elsewhere_is_another_column(baseline):
    found = [respond(baseline, hypothesis(by_name('reference_shape'), ('bump_height',),
                                          bump_centre=centre)).values['optical']
             for centre in ((0.03, 0.03, 0.044), (-0.03, 0.03, 0.044))]
    assert np.linalg.norm(found[0] - found[1]) > 0.5 * np.linalg.norm(found[0])
