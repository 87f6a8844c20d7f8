"""Gravity against a column, a shear layer, the weight, and a trough that pressure fills."""

import dataclasses
import math

import numpy as np
import pytest

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.gravity import Gravity

E, DENSITY = 6e3, 1e3


def block(size, cells, nu=0.0, held=('z0',)):
    """Block without gravity of its own, quadratic elements."""
    mesh = quadratic_mesh(box_mesh(size, cells))
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    fixed = np.unique(np.concatenate([mesh.node_sets[name] for name in held]))
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, DENSITY), fixed)


def sag(body, added):
    """Displacements (n, 3) [m] of the body at rest under the added gravity."""
    return TissueSimulator(body, (Gravity(tuple(added)),)).settle().x - body.mesh.nodes


def test_column_under_its_own_weight():
    """Top sinks by rho g L^2 / (2 E), to first order in it."""
    body = block((0.01, 0.01, 0.04), (1, 1, 4))
    u = sag(body, [0.0, 0.0, -0.01])
    np.testing.assert_allclose(u[body.mesh.node_sets['z1'], 2],
                               -DENSITY * 0.01 * 0.04**2 / (2.0 * E), rtol=2e-4)


def test_tilt_shears_a_wide_layer():
    """Far from its rim: u = rho g (h z - z^2 / 2) / mu."""
    body, h, g = block((0.12, 0.12, 0.01), (12, 12, 1)), 0.01, 0.02
    X = body.mesh.nodes
    middle = np.flatnonzero(np.linalg.norm(X[:, :2] - 0.06, axis=1) < 1e-9)
    z = X[middle, 2]
    np.testing.assert_allclose(sag(body, [g, 0.0, 0.0])[middle, 0],
                               DENSITY * g * (h * z - z**2 / 2.0) / (E / 2.0), rtol=5e-3,
                               atol=1e-12)


def test_the_base_bears_the_weight_of_tissue_and_hanging_masses():
    plain = block((0.03, 0.03, 0.03), (2, 2, 2))
    carried = np.zeros(len(plain.mesh.nodes))
    carried[plain.mesh.node_sets['z1'][0]] = 0.002
    body = dataclasses.replace(plain, gravity=np.array([0.0, 0.0, -1.0]), nodal_mass=carried)
    simulator = TissueSimulator(body, (Gravity((0.5, 0.0, 0.2)),))
    x = simulator.settle().x
    reaction = Assembler(simulator.body).forces(x)[body.fixed].sum(axis=0)
    mass = DENSITY * 0.03**3 + 0.002
    np.testing.assert_allclose(reaction, -mass * np.array([0.5, 0.0, -0.8]), rtol=0.0, atol=1e-5)


def test_the_documented_tilt_is_a_rotation():
    """A lean by 15 deg keeps the size of gravity and turns it by 15 deg."""
    lean, plain = math.radians(15.0), block((0.01, 0.01, 0.01), (1, 1, 1))
    body = dataclasses.replace(plain, gravity=np.array([0.0, 0.0, -9.81]))
    tilted = Gravity((9.81 * math.sin(lean), 0.0, 9.81 * (1.0 - math.cos(lean)))).prepare(body)
    assert np.linalg.norm(tilted.gravity) == pytest.approx(9.81)
    assert -tilted.gravity[2] / 9.81 == pytest.approx(math.cos(lean))
    assert tilted.gravity[0] == pytest.approx(2.54, abs=0.01)


def test_pressure_bears_gravity_normal_to_a_plane_surface():
    """A trough filled with nearly incompressible tissue: only the tilt moves it.

    Elements whose pressure is constant leave a rest that falls with their size.
    """
    walls, down = ('z0', 'x0', 'x1', 'y0', 'y1'), []
    for n in (1, 2):
        body = block((0.06, 0.06, 0.02), (6 * n, 6 * n, 2 * n), 0.4999, walls)
        down.append(np.abs(sag(body, [0.0, 0.0, -9.81])).max())
    along = np.abs(sag(body, [9.81, 0.0, 0.0])).max()
    assert down[1] < 0.4 * down[0]
    assert down[1] < 0.02 * along
