"""Stress softening: cycles of one element in closed form, dissipation, and a block under a pad."""

import math

import numpy as np
import pytest
from scipy.integrate import simpson

from arm_brachy.tissue.body import Fibres, Pad, SoftBody, StepFields, TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import energy, moduli, stress
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stress_softening import StressSoftening, isochoric_energy
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

MU, KAPPA = moduli(6e3, 0.49)
TERM = StressSoftening(damage=0.3, energy=50.0)


def one_element():
    """A single tetrahedron; its deformation is prescribed."""
    mesh = TetMesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.01,
                   np.array([[0, 1, 2, 3]]))
    return SoftBody(mesh, np.array([MU]), np.array([KAPPA]), np.array([1e3]), np.zeros(0, int))


def gradient(stretch):
    """Isochoric uniaxial stretch."""
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])


def density(stretch):
    """Isochoric energy density of that stretch."""
    return 0.5 * MU * (stretch**2 + 2.0 / stretch - 3.0)


def drive(stretches, term=TERM, memory=None):
    """Nominal stress along x, P11 - P22 l^(-3/2) without lateral load, and the last memory."""
    body = one_element()
    memory = term.memory(body) if memory is None else memory
    out = []
    for k, stretch in enumerate(stretches):
        fields = StepFields.of(body)
        term.before_step(body, memory, k, 1.0, fields)
        P = stress(gradient(stretch), fields.mu[0], fields.kappa[0])
        out.append(P[0, 0] - P[1, 1] * stretch**-1.5)
        memory = term.after_step(body, memory, body.mesh.nodes @ gradient(stretch).T, k, 1.0)
    return np.array(out), memory


def undamaged(stretches):
    """Incompressible Neo-Hookean bar: mu (l - l^-2)."""
    l = np.asarray(stretches)
    return MU * (l - l**-2)


def damage(stretch):
    """D after a largest stretch."""
    return TERM.damage * (1.0 - math.exp(-density(stretch) / TERM.energy))


BEYOND = {'stiffening': np.array([0.8 * MU]),
          'fibres': Fibres(np.array([0.5 * MU]), np.array([[0.6, 0.0, 0.8]]))}


@pytest.mark.parametrize('law', [{}, BEYOND], ids=['neo-hooke', 'beyond'])
def test_energy_is_that_of_the_solvers_material(law):
    """No bulk modulus, and the mean of an element over its volume: quadratic, bent."""
    mesh = quadratic_mesh(one_element().mesh)
    body = SoftBody(mesh, np.array([MU]), np.array([KAPPA]), np.array([1e3]), np.zeros(0, int),
                    **law)
    F = np.eye(3) + 0.3 * np.random.default_rng(1).uniform(-1.0, 1.0, (3, 3))
    np.testing.assert_allclose(isochoric_energy(body, mesh.nodes @ F.T),
                               energy(F, MU, 0.0, body.beyond[0]))
    X = mesh.nodes / 0.01
    bent = mesh.nodes + 0.002 * np.column_stack([X[:, 2] ** 2, X[:, 0] ** 2, 0.0 * X[:, 0]])
    got = isochoric_energy(body, bent)[0]
    L = np.random.default_rng(2).dirichlet(np.ones(4), 200000)[:, 1:]  # uniform in the element
    F = np.zeros((len(L), 3, 3)) + np.eye(3)
    F[:, 0, 2], F[:, 1, 0] = 0.4 * L[:, 2], 0.4 * L[:, 0]
    assert got == pytest.approx(energy(F, MU, 0.0, body.beyond[0]).mean(), rel=5e-3)


def test_first_loading_softens_as_it_goes():
    """P = (1 - D(W)) P0 in the limit of small steps, with an error of first order."""
    errors = []
    for n in (100, 200):
        path = np.linspace(1.0, 1.4, n + 1)[1:]
        P, _ = drive(path)
        exact = (1.0 - damage(1.4)) * undamaged(1.4)
        errors.append(abs(P[-1] / exact - 1.0))
    assert errors[1] < 5e-3
    assert math.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)


def test_unloading_and_second_cycle_are_one_curve():
    up = np.linspace(1.0, 1.4, 41)
    _, memory = drive(up)
    unloading, memory = drive(up[::-1], memory=memory)
    again, memory = drive(up, memory=memory)
    np.testing.assert_allclose(unloading[::-1], again, rtol=1e-12)
    np.testing.assert_allclose(again, (1.0 - damage(1.4)) * undamaged(up), rtol=1e-9, atol=1e-9)
    first, _ = drive(up)
    assert np.all(first[5:] > again[5:])


def test_beyond_the_old_maximum_it_is_the_virgin_curve():
    _, memory = drive(np.linspace(1.0, 1.2, 201))
    on, _ = drive(np.linspace(1.0, 1.4, 401), memory=memory)
    virgin, _ = drive(np.linspace(1.0, 1.4, 401))
    np.testing.assert_allclose(on[205:], virgin[205:], rtol=1e-9)


def test_a_cycle_dissipates_what_the_damage_takes():
    """int W dD = d e [1 - (1 + w) exp(-w)], w = W_max / e; a second cycle takes nothing."""
    up = np.linspace(1.0, 1.4, 4001)
    first, memory = drive(up)
    back, memory = drive(up[::-1], memory=memory)
    loss = simpson(first, x=up) - simpson(back[::-1], x=up)
    w = density(1.4) / TERM.energy
    exact = TERM.damage * TERM.energy * (1.0 - (1.0 + w) * math.exp(-w))
    assert loss == pytest.approx(exact, rel=3e-3)
    second, _ = drive(up, memory=memory)
    assert abs(simpson(second, x=up) - simpson(back[::-1], x=up)) < 1e-9 * exact


def test_nothing_heals_however_long_it_rests():
    body = one_element()
    _, memory = drive([1.3])
    rested = TERM.after_step(body, memory, body.mesh.nodes, 1e6, np.inf)
    np.testing.assert_array_equal(rested, memory)


def test_remembered_stress_softens_along():
    """Modulus and added stress of a relaxing element keep their ratio."""
    body, visco = one_element(), Viscoelasticity(g1=0.4)
    visco_memory = visco.after_step(body, visco.memory(body),
                                    body.mesh.nodes @ gradient(1.3).T, 0.1, 0.1)
    _, memory = drive([1.3])
    seen = []
    for softens in (False, True):
        fields = StepFields.of(body)
        visco.before_step(body, visco_memory, 0.2, 0.1, fields)
        if softens:
            TERM.before_step(body, memory, 0.2, 0.1, fields)
        seen.append(fields)
    left = 1.0 - damage(1.3)
    np.testing.assert_allclose(seen[1].mu, left * seen[0].mu)
    np.testing.assert_allclose(seen[1].stress, left * seen[0].stress)
    np.testing.assert_array_equal(seen[1].kappa, seen[0].kappa)


def block():
    """Block of 40 mm held below, a pad over the middle of its top."""
    mesh = box_mesh((0.04, 0.04, 0.04), (4, 4, 4))
    top, m = mesh.node_sets['z1'], len(mesh.tets)
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.02, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.04]), 0.02)
    return SoftBody(mesh, np.full(m, MU), np.full(m, KAPPA), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def cycles(simulator, depths, n=8):
    """Force at every step of pushes to each of the depths [m] and back, n steps each way."""
    out, begin = [], simulator.state.t + 1.0
    for k, depth in enumerate(depths):
        way = np.concatenate([np.arange(1, n + 1), np.arange(n - 1, -1, -1)]) * depth / n
        states = [simulator.step(begin + k + 0.05 * i, [[0.0, 0.0, -d]])
                  for i, d in enumerate(way)]
        assert all(state.outcome.ok for state in states)
        out.append(np.array([state.pad_force[0, 2] for state in states]))
    return out


def test_block_is_softer_the_second_time_and_the_same_the_third():
    first, second, third = cycles(TissueSimulator(block(), (TERM,)), [6e-3] * 3)
    assert np.all(second[1:8] < first[1:8])
    assert 0.7 < second[3] / first[3] < 0.98
    np.testing.assert_allclose(third, second, rtol=2e-3, atol=1e-5)
    np.testing.assert_allclose(third[:7], third[8:15][::-1], rtol=2e-3, atol=1e-5)  # up and down


def test_a_failed_step_leaves_no_damage_and_repetition_gives_the_same_bits():
    forces = []
    for fails in (False, False, True):
        simulator = TissueSimulator(block(), (TERM,))
        cycles(simulator, [3e-3])
        if fails:
            assert not simulator.step(simulator.state.t + 0.1, [[0.0, 0.0, -0.1]]).outcome.ok
        forces.append(cycles(simulator, [3e-3])[0])
    np.testing.assert_array_equal(forces[1], forces[0])
    np.testing.assert_allclose(forces[2], forces[0], rtol=0.0, atol=1e-6)
