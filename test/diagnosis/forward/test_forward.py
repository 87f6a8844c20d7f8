"""Predictions at single instants against the plant stepped tick by tick, and identities."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.cell import Body, push_back
from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.devices.terms.actuator_compliance import ActuatorCompliance
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.actuator_lag import ActuatorLag
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.devices.terms.clock_offset import ClockOffset
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.memory_trajectory import Alongside
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.model.trajectory import evolve, grid
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver
from arm_brachy.tissue.terms.breathing import Breathing
from arm_brachy.tissue.terms.external_force import ExternalForce
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.stress_softening import StressSoftening
from arm_brachy.tissue.terms.swelling_drift import SwellingDrift
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

STATES = np.array([2.5, 4.5, 7.4, 9.0])     # two holds of pad 1, pad 2 on its way out, and back
TOP = (-0.7e-3, -5.1e-3, 57.9e-3)           # m, the highest node


@pytest.fixture(scope='module')
def specimen(linear):
    return linear


@pytest.fixture(scope='module')
def elastic(specimen, encoder):
    return ForwardModel(specimen).predict(encoder, STATES)


@pytest.fixture(scope='module')
def plant(coarse_scene, encoder):
    """(points, forces) of the plant at STATES, stepped through the samples of the encoders."""
    def run(terms, every=1):
        body = Body(coarse_scene('linear'), terms)
        readings = [body.step(t, q) for t, q in zip(encoder.t[::every], encoder.q[::every],
                                                    strict=True)]
        kept = [r for r in readings if np.abs(STATES - r.t).min() < 1e-9]
        return np.array([r.points for r in kept]), np.array([r.pad_force for r in kept])
    return run


def test_elastic_states_are_those_of_the_plant(plant, elastic):
    points, forces = plant((), every=5)
    assert elastic.valid.all()
    found = np.concatenate([elastic.optical, elastic.em], axis=1)
    assert np.abs(found - points).max() < 1e-7
    assert np.abs(elastic.force - forces).max() < 1e-4


@pytest.mark.parametrize('term', [Viscoelasticity(g1=0.4, tau1=2.0), StressSoftening(damage=0.4)])
def test_a_body_with_memory_is_followed_through_the_kinks(specimen, encoder, plant, term):
    terms = (Gravity(added=(0.0, 0.0, -9.81)), term)
    _, forces = plant(terms)
    _, plain = plant(terms[:1], every=5)
    found = ForwardModel(specimen, terms).predict(encoder, STATES)
    effect = np.abs(forces - plain).max()
    assert effect > 0.05
    assert np.abs(found.force - forces).max() < 0.03 * effect


@pytest.mark.parametrize('term', [
    Breathing(amplitude=1e-3, frequency=0.3), StiffnessDrift(rate=0.02), SwellingDrift(rate=1e-3),
    ExternalForce(force=(0.0, 0.3, -0.3), centre=TOP, onset=3.0, duration=5.0)])
def test_what_follows_the_clock_needs_no_steps(specimen, encoder, plant, elastic, term):
    """States at single instants are those of a plant that was stepped to them."""
    points, forces = plant((term,), every=5)
    model = ForwardModel(specimen, (term,))
    found = model.predict(encoder, STATES)
    assert model.timed and not model.remembers and found.valid.all()
    assert np.abs(np.concatenate([found.optical, found.em], axis=1) - points).max() < 1e-7
    assert np.abs(found.force - forces).max() < 1e-4 < np.abs(found.force - elastic.force).max()


def test_an_equilibrium_is_sought_once(specimen, encoder, monkeypatch):
    """Bit for bit the same from what is known; pads elsewhere are sought."""
    follow, made = StaticSolver.follow, []

    def counted(*args, **more):
        made.append(1)
        return follow(*args, **more)

    monkeypatch.setattr(StaticSolver, 'follow', counted)
    model = ForwardModel(specimen)
    first, sought = model.predict(encoder, STATES, nodes=True), len(made)
    assert sought > 3 and np.array_equal(model.predict(encoder, STATES, nodes=True).x, first.x)
    assert len(made) == sought
    model.predict(encoder, STATES + 0.03)
    assert len(made) > sought


def test_what_follows_the_clock_begins_where_a_model_alike_was(specimen, encoder, monkeypatch):
    """The same states, by half the corrections at most."""
    follow, made = StaticSolver.follow, []

    def counted(*args, **more):
        made.append(follow(*args, **more))
        return made[-1]

    def corrections(model):
        made.clear()
        found = model.predict(encoder, STATES)
        return found, sum(one.iterations for one in made)

    monkeypatch.setattr(StaticSolver, 'follow', counted)
    before, afresh, led = (ForwardModel(specimen, (Breathing(amplitude=a, frequency=0.3),))
                           for a in (1e-3, 1.01e-3, 1.01e-3))
    corrections(before)
    led.equilibria.begin_from(before.equilibria)
    (expected, many), (found, few) = map(corrections, (afresh, led))
    np.testing.assert_allclose(found.force, expected.force, atol=1e-5)
    np.testing.assert_allclose(found.optical, expected.optical, atol=1e-8)
    assert few < 0.5 * many


def test_memory_carried_along_its_own_trajectory_is_that_of_the_simulator(specimen, encoder):
    model = ForwardModel(specimen, (Viscoelasticity(g1=0.4, tau1=2.0),))
    states = model.trajectory(model.pad_path(encoder, STATES), STATES)
    solver = StaticSolver(model.body)
    for x, fields in zip(states.x, evolve(model.body, model.body_terms, states), strict=True):
        assert np.abs(solver.assembler.forces(x, fields)[solver.free.free]).max() < 1e-5


def test_play_sees_a_reversal_between_two_instants(specimen):
    t = np.arange(101) * 0.02
    q = np.interp(t, [0.0, 0.5, 1.0, 1.2, 1.4, 2.0], [0.0, 0.0, 5e-3, 3e-3, 3.2e-3, 3.2e-3])
    encoder = Path(t, np.outer(q, [1.0, 0.0, 0.0, 0.0]))
    model = ForwardModel(specimen, (Backlash(width=5e-4, actuators=(0,)),))
    pads = model.predict(encoder, np.array([0.2, 1.8])).pads
    # Without the reversal the pad would end at 3.2 - 0.5 = 2.7 mm; it was drawn back to 3 mm.
    assert np.linalg.norm(pads[1, 0]) == pytest.approx(3.0e-3, abs=1e-9)


def test_yielding_pads_balance_the_force_that_they_bring_about(specimen, encoder, elastic):
    compliance = 0.2e-3
    model = ForwardModel(specimen, (ActuatorCompliance(compliance=compliance),))
    found = model.predict(encoder, STATES)
    push = np.array([push_back(force, specimen.directions) for force in found.force])
    pads = np.einsum('npi,pi->np', found.pads, specimen.directions)
    yielded = encoder.at(STATES) - pads
    assert yielded.max() > 2e-4
    assert np.abs(yielded - compliance * push).max() < 5e-6


def test_terms_before_the_encoders_change_nothing(specimen, encoder, elastic):
    found = ForwardModel(specimen, (ActuatorLag(time_constant=0.2),)).predict(encoder, STATES)
    assert np.array_equal(found.optical, elastic.optical)


def test_a_late_stream_shows_what_was_before(specimen, encoder, elastic):
    late = ForwardModel(specimen, (ClockOffset(delay=0.1, stream='optical'),))
    instants = STATES - 1.0     # the third is on a ramp
    then = ForwardModel(specimen).predict(encoder, instants - 0.1)
    found = late.predict(encoder, instants)
    assert np.abs(found.optical - then.optical).max() < 1e-8
    now = ForwardModel(specimen).predict(encoder, instants)
    assert np.abs(found.force - now.force).max() < 1e-5


def test_sensing_terms_act_on_their_stream_alone(specimen, encoder, elastic):
    scaled = ForwardModel(specimen, (OpticalScale(scale=0.01),)).predict(encoder, STATES)
    assert np.allclose(scaled.optical, 1.01 * elastic.optical, rtol=0.0, atol=1e-12)
    assert np.array_equal(scaled.em, elastic.em)


def test_base_markers_breathe_and_pad_markers_ride(specimen, encoder, elastic):
    breath = Breathing(amplitude=1e-3, frequency=0.25, direction=(0.0, 0.0, 1.0))
    gain = ActuatorGain(gain=0.1)
    found = ForwardModel(specimen, (breath, gain)).predict(encoder, STATES)
    base = [i for i, body in enumerate(specimen.carriers) if body == 'base']
    rise = found.optical[:, base] - specimen.rest[base]
    expected = 1e-3 * np.sin(2.0 * np.pi * 0.25 * STATES)
    assert np.allclose(rise[..., 2], expected[:, None], rtol=0.0, atol=1e-12)
    rider = specimen.carriers.index('pad_1')
    moved = found.optical[:, rider] - specimen.rest[rider]
    assert np.allclose(moved, 1.1 * encoder.at(STATES)[:, :1] * specimen.directions[0],
                       rtol=0.0, atol=1e-12)


def test_a_state_that_is_not_found_is_told_and_left_empty(specimen):
    t = np.arange(101) * 0.02
    crushed = Path(t, np.outer(np.interp(t, [0.0, 1.0], [0.0, 0.09]), np.ones(4)))
    found = ForwardModel(specimen).predict(crushed, np.array([0.02, 2.0]))
    assert found.valid.tolist() == [True, False]
    assert np.isnan(found.optical[1]).all() and np.isfinite(found.optical[0]).all()


def test_grid_holds_instants_and_corners_in_order(encoder):
    path = encoder
    times = grid(path, STATES)
    assert (np.diff(times) > 1e-6).all() and np.isin(STATES, times).all()
    assert np.abs(times[:, None] - [3.0, 3.6, 5.0]).min(axis=0).max() < 0.03
    assert times[0] == path.t[0] and times[-1] == STATES[-1]


def test_what_has_no_forward_model_is_refused(specimen, encoder, coarse_scene):
    with pytest.raises(ConfigError, match='no pads'):
        specimen_of(replace(coarse_scene(), pads=()))
    with pytest.raises(InputError, match='must lie within'):
        ForwardModel(specimen).predict(encoder, np.array([1.0, 99.0]))


def test_steps_begun_alongside_another_motion_end_where_plain_ones_do(specimen, encoder):
    """The motion without the memory; to the solver's tolerance at every step."""
    plain, terms = ForwardModel(specimen), (Viscoelasticity(g1=0.4, tau1=1.5),)
    t = np.array([2.0, 5.4, 9.0])
    path = plain.pad_path(encoder, t)
    alike = Alongside(plain.trajectory(path, t, kinks=True), plain.body.mesh.nodes)
    options = NewtonOptions(tolerance=1e-9)
    found, stepped = (ForwardModel(specimen, terms, options=options, alike=one).trajectory(path, t)
                      for one in (alike, None))
    assert np.array_equal(found.t, stepped.t) and found.valid.all()
    assert np.abs(found.x - stepped.x).max() < 1e-7
    assert np.abs(found.force - stepped.force).max() < 1e-4 * np.abs(stepped.force).max()
