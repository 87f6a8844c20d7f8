"""A cube that remembers: it begins as the elastic one, and relaxes to its share."""

import numpy as np
import pytest

from arm_brachy.experiments.half_cylinder.elements import NONE, Body
from arm_brachy.experiments.half_cylinder.equilibrium import Solver
from arm_brachy.experiments.half_cylinder.law import Law
from arm_brachy.experiments.half_cylinder.memory import SHARE, TAU, Memory

E = 9e3
SIDE = 0.03     # m, as in conftest


@pytest.fixture(scope='module')
def sheared(cube):
    """(u, past) -> Body, displacements and force [N] of a cube sheared by 4 mm: no volume part."""
    mesh = cube(1)
    one, alike = Law.of(E, 0.48), np.ones((len(mesh.tets), 1))
    body = Body(mesh, Law(one.shear * alike, one.bulk * alike))
    outer = np.any((mesh.nodes < 1e-9) | (mesh.nodes > SIDE - 1e-9), axis=1)
    held = np.flatnonzero(np.repeat(outer, 3))
    to = np.zeros((len(mesh.nodes), 3))
    to[:, 0] = 4e-3 * mesh.nodes[:, 2] / SIDE
    solver, top = Solver(body, held), 3 * np.flatnonzero(mesh.nodes[:, 2] > SIDE - 1e-9)

    def made(share, u, past):
        u = solver.solve(share * to.ravel()[held], u, past)
        return body, u, body.forces(u, past)[top].sum()
    return made


def course(sheared, steps):
    """Forces [N] after steps (share of the shear, duration [s]) from rest."""
    body, u, _ = sheared(0.0, np.zeros(3 * 27), NONE)
    memory, forces = Memory(*np.zeros((2, *body.weights.shape, 3, 3))), []
    for share, step in steps:
        body, u, force = sheared(share, u, memory.ahead(step))
        memory = memory.after(step, body.shape_stress(u))
        forces.append(force)
    return np.array(forces)


def test_a_sudden_step_relaxes(sheared):
    """f(t) = e (1 - g + g exp(-t / tau)) after a step of a microsecond, in steps of any length."""
    elastic = sheared(1.0, np.zeros(3 * 27), NONE)[2]
    waits = np.array([0.5, 0.1, 3.0, 40.0])
    forces = course(sheared, [(1.0, 1e-6), *((1.0, wait) for wait in waits)])
    t = np.concatenate([[0.0], np.cumsum(waits)])
    assert forces == pytest.approx(elastic * (1.0 - SHARE + SHARE * np.exp(-t / TAU)), rel=1e-5)


def test_a_slow_ramp_lags_by_its_rate(sheared):
    """At the end of a ramp of duration T: e (1 - g + g tau / T (1 - exp(-T / tau))), as force is
    nearly in proportion to shear."""
    elastic, T = sheared(1.0, np.zeros(3 * 27), NONE)[2], 40.0
    end = course(sheared, [(s, T / 10) for s in np.arange(1, 11) / 10])[-1]
    over = SHARE * TAU / T * (1.0 - np.exp(-T / TAU))
    assert end == pytest.approx(elastic * (1.0 - SHARE + over), rel=2e-3)
