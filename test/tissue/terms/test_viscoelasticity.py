"""Viscoelasticity against closed-form relaxation, an ODE integrator and marker invariance."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import BodyTerm
from arm_brachy.tissue.body import Fibres, Pad, SoftBody, StepFields, Steps, TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli, stress
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity, relaxing_stress

TERM = Viscoelasticity(g1=0.3, tau1=3.0, g2=0.2, tau2=40.0)
LONG_TERM = 1.0 - 0.3 - 0.2
MU, KAPPA = moduli(6e3, 0.49)
LAWS = {'neo-hooke': {}, 'beyond': {'stiffening': np.array([MU]),
                                    'fibres': Fibres(np.array([0.5 * MU]),
                                                     np.array([[0.6, 0.0, 0.8]]))}}


def one_element(law='neo-hooke'):
    """A single tetrahedron; its deformation is prescribed."""
    mesh = TetMesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.01,
                   np.array([[0, 1, 2, 3]]))
    return SoftBody(mesh, np.array([MU]), np.array([KAPPA]), np.array([1e3]), np.zeros(0, int),
                    **LAWS[law])


def stretched(stretch):
    """Positions of the element under isochoric uniaxial stretch with some shear."""
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    F[0, 1] = stretch - 1.0
    return one_element().mesh.nodes @ F.T


def isochoric(stretch, law='neo-hooke'):
    """S_iso (3, 3) of the element, long-term."""
    body = one_element(law)
    return relaxing_stress(body.geometry, body, stretched(stretch))[0, 0]


def stresses(times, stretch_of, law='neo-hooke'):
    """Isochoric stress (k, 3, 3) as the solver would see it: scaled modulus plus added stress."""
    body = one_element(law)
    memory, out, before = TERM.memory(body), [], 0.0
    for t in times:
        fields = StepFields.of(body)
        TERM.before_step(body, memory, t, t - before, fields)
        x = stretched(stretch_of(t))
        out.append(relaxing_stress(body.geometry, fields, x)[0, 0] + fields.stress[0, 0])
        memory = TERM.after_step(body, memory, x, t, t - before)
        before = t
    return np.array(out)


def relaxation(t):
    """Prony series over its long-term value."""
    return (LONG_TERM + 0.3 * math.exp(-t / 3.0) + 0.2 * math.exp(-t / 40.0)) / LONG_TERM


@pytest.mark.parametrize('law', LAWS)
def test_what_relaxes_is_the_stress_of_the_solvers_material(law):
    """S_iso = F^-1 P with no bulk modulus."""
    body = one_element(law)
    F = np.eye(3) + 0.3 * np.random.default_rng(1).uniform(-1.0, 1.0, (3, 3))
    x = body.mesh.nodes @ F.T + [0.1, 0.2, 0.3]
    S = relaxing_stress(body.geometry, body, x)[0, 0]
    P = stress(F, MU, 0.0, body.beyond[0])
    np.testing.assert_allclose(S, np.linalg.solve(F, P), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize('law', LAWS)
def test_step_stretch_relaxes_as_the_prony_series(law):
    """After a step at t = 0: S_iso times the relaxation function, for any step size."""
    times = np.concatenate([[1e-9], np.geomspace(0.01, 300.0, 25)])
    got = stresses(times, lambda t: 1.3, law)
    expected = np.array([relaxation(t) for t in times])[:, None, None] * isochoric(1.3, law)
    np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-7 * MU)


def test_ramp_against_an_ode_integrator():
    """dQ/dt = -Q/tau + beta dS/dt through ramp and hold, DOP853; second order in dt."""
    def stretch_of(t):
        return 1.0 + 0.1 * min(t, 2.0)

    def rate(t, Q):
        h = 1e-5
        dS = (isochoric(1.0 + 0.1 * (t + h)) - isochoric(1.0 + 0.1 * (t - h))) / (2 * h)
        dS = dS.ravel()[:, None] if t <= 2.0 else np.zeros((9, 1))
        Q = Q.reshape(9, 2)
        return (-Q / [3.0, 40.0] + dS * [0.3 / LONG_TERM, 0.2 / LONG_TERM]).ravel()

    def reference(t_end):
        Q = solve_ivp(rate, (0.0, min(t_end, 2.0)), np.zeros(18), method='DOP853',
                      rtol=1e-10, atol=1e-8).y[:, -1]
        Q = Q.reshape(9, 2) * np.exp(-max(t_end - 2.0, 0.0) / np.array([3.0, 40.0]))
        return isochoric(stretch_of(t_end)) + Q.sum(axis=1).reshape(3, 3)

    exact = reference(5.0)
    errors = []
    for n in (10, 20):
        times = 5.0 / n * np.arange(1, n + 1)
        errors.append(np.abs(stresses(times, stretch_of)[-1] - exact).max())
    assert errors[1] < 1e-3 * np.abs(exact).max()
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_resting_for_ever_is_the_elastic_body():
    """dt = inf fades every memory: the given modulus is the long-term one."""
    body = one_element()
    memory = TERM.after_step(body, TERM.memory(body), stretched(1.2), 0.0, 0.5)
    fields = StepFields.of(body)
    TERM.before_step(body, memory, 0.0, np.inf, fields)
    np.testing.assert_array_equal(fields.mu, body.mu)
    np.testing.assert_array_equal(fields.stress, 0.0)
    rested = TERM.after_step(body, memory, stretched(1.2), 0.0, np.inf)
    np.testing.assert_array_equal(rested.over, 0.0)


def test_overstress_carries_no_pressure():
    """S : C = 0 for an isochoric stress; the recursion keeps it as long as the stretch is held."""
    F = np.linalg.solve(one_element().mesh.nodes[1:], stretched(1.3)[1:]).T
    for S in stresses([0.5, 1.0, 4.0], lambda t: 1.3):
        assert abs(np.sum(S * (F.T @ F))) < 1e-9 * MU


def held_block(nu, E=6e3):
    """Block under a pad, small push."""
    mesh = box_mesh((0.04, 0.04, 0.04), (4, 4, 4))
    mu, kappa = moduli(E, nu)
    top, m = mesh.node_sets['z1'], len(mesh.tets)
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.02, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.04]), 0.01)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def relaxing(nu, push=1e-5):
    """(relative marker drift, force ratio) between a sudden push and the end of its hold."""
    body = held_block(nu)
    simulator = TissueSimulator(body, (TERM,))
    now = simulator.step(1e-6, [[0.0, 0.0, -push]])
    for t in (10.0, 100.0, 1000.0, 10000.0):
        end = simulator.step(t, [[0.0, 0.0, -push]])
    return np.abs(end.x - now.x).max() / push, now.pad_force[0, 2] / end.pad_force[0, 2]


def test_homogeneous_nearly_incompressible_tissue_hides_it_from_markers():
    """Forces halve while markers stay, up to a share of order mu / kappa."""
    drift_soft, _ = relaxing(0.4999)
    drift, ratio = relaxing(0.49999)
    assert drift < 2e-3
    assert drift_soft / drift == pytest.approx(10.0, rel=0.3)  # linear in mu / kappa
    assert ratio == pytest.approx(1.0 / LONG_TERM, rel=2e-2)


def test_the_hold_ends_where_the_elastic_body_is():
    body = held_block(0.45)
    push = [[0.0, 0.0, -4e-3]]
    elastic = TissueSimulator(body).step(1.0, push)
    simulator = TissueSimulator(body, (TERM,))
    for t in (0.1, 100.0, 500.0, 2000.0):
        end = simulator.step(t, push)
    np.testing.assert_allclose(end.x, elastic.x, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(end.pad_force, elastic.pad_force, rtol=1e-5, atol=1e-6)


def test_release_recovers_slowly():
    """After a hold and a sudden return the pad is pulled: the tissue has crept and lags behind."""
    simulator = TissueSimulator(held_block(0.45), (TERM,))
    simulator.step(20.0, [[0.0, 0.0, -4e-3]])
    simulator.step(60.0, [[0.0, 0.0, -4e-3]])
    back = [simulator.step(t, [[0.0, 0.0, 0.0]]).pad_force[0, 2] for t in (60.1, 70.0, 300.0)]
    assert back[0] < back[1] < back[2] < 0.0


def test_nothing_elastic_left_is_refused():
    with pytest.raises(ConfigError, match='g1 \\+ g2 = 1.1'):
        Viscoelasticity(g1=0.6, g2=0.5)


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('lasting', [False, True], ids=['as it goes', 'lasting'])
def test_weighing_positions_that_return_is_stepping_through_them(law, lasting):
    """Sixty steps between five places, swollen from the middle on, of which some are asked for."""
    rng, body = np.random.default_rng(4), one_element(law)
    places = np.stack([stretched(s) for s in (1.0, 1.1, 1.25, 0.9, 1.4)])
    dt = np.append(np.inf, rng.uniform(0.02, 6.0, 59))
    steps = Steps(np.cumsum(np.append(0.0, dt[1:])), dt, np.full(60, np.inf) if lasting else dt,
                  places[rng.integers(0, 5, 60)], np.where(np.arange(60) < 30, 1.0, 1.02),
                  np.array([0, 1, 7, 31, 55]))
    ways = []
    for carried in (BodyTerm.carried, Viscoelasticity.carried):
        ways.append([StepFields.of(body) for _ in steps.at])
        carried(TERM, body, steps, ways[-1])
    for stepped, weighed in zip(*ways, strict=True):
        np.testing.assert_allclose(weighed.stress, stepped.stress, rtol=1e-10, atol=1e-9 * MU)
        np.testing.assert_allclose(weighed.mu, stepped.mu, rtol=1e-14)
    assert (np.abs(ways[0][2].stress).max() > 0.01 * MU) != lasting
