"""A slender strip under its own weight: the elastica, far beyond small bending."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.resting import rest
from arm_brachy.tissue.simulator import TissueSimulator

LENGTH, HEIGHT, DENSITY, GRAVITY = 0.15, 0.01, 1070.0, 9.81


def elastica_sag(load):
    """Sag / length of an inextensible clamped strip; load = q L^3 / (E I) of its own weight.

    theta'' = -load (1 - s) cos theta with theta(0) = theta'(1) = 0, and sag' = sin theta.
    """
    s = np.linspace(0.0, 1.0, 200)
    guess = np.zeros((3, len(s)))
    for part in np.linspace(0.1, 1.0, 10):
        found = solve_bvp(
            lambda s, y, part=part: np.array([y[1], -part * load * (1.0 - s) * np.cos(y[0]),
                                              np.sin(y[0])]),
            lambda a, b: np.array([a[0], b[1], a[2]]), s, guess, tol=1e-8, max_nodes=20000)
        s, guess = found.x, found.y
    assert found.success
    return guess[2, -1]


def strip(E, divisions=(16, 1, 1), gravity=GRAVITY):
    mesh = quadratic_mesh(box_mesh((LENGTH, HEIGHT, HEIGHT), divisions))
    mu, kappa = moduli(E, 0.49)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, DENSITY),
                    np.flatnonzero(mesh.nodes[:, 0] < 1e-9), gravity=np.array([0, 0, -gravity]))


def load(E):
    return 12.0 * DENSITY * GRAVITY * LENGTH ** 3 / (E * HEIGHT ** 2)


def sag(body, x):
    tip = body.mesh.nodes[:, 0] > LENGTH - 1e-9
    return float(-(x - body.mesh.nodes)[tip, 2].mean() / LENGTH)


def test_small_loads_of_the_elastica_are_the_beams():
    assert elastica_sag(0.01) == pytest.approx(0.01 / 8.0, rel=1e-4)


def test_a_strip_sags_as_the_elastica():
    body = strip(3e5, (20, 2, 2))
    state = TissueSimulator(body).settle()
    assert state.outcome is Outcome.OK
    assert sag(body, state.x) == pytest.approx(elastica_sag(load(3e5)), rel=5e-3)


@pytest.mark.parametrize(('E', 'dynamics'), [
    (3e5, 'implicit'), pytest.param(1e5, 'quasi_static', marks=pytest.mark.validate)])
def test_softer_and_implicit_strips_find_their_rest(E, dynamics):
    """One element across, and strains that a thin rod has not: 1.5 % softer than the elastica."""
    body = strip(E)
    assert not StaticSolver(body).solve(body.mesh.nodes, np.zeros((0, 3))).outcome.ok
    state = TissueSimulator(body, dynamics=dynamics).settle()
    assert state.outcome is Outcome.OK
    assert sag(body, state.x) == pytest.approx(elastica_sag(load(E)), rel=2e-2)


def test_a_body_that_newton_brings_to_rest_gets_its_bits():
    body = strip(3e5, gravity=1.0)
    none = np.zeros((0, 3))
    plain, found = StaticSolver(body).solve(body.mesh.nodes, none), rest(
        StaticSolver(body), body.mesh.nodes, none)
    assert plain.outcome is Outcome.OK and np.array_equal(plain.x, found.x)
    assert plain.factorisations == found.factorisations
