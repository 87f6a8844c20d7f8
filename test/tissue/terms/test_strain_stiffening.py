"""Strain stiffening: bar and shear in closed form, third order, unseen when all moduli scale."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, face_middles, quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale
from arm_brachy.tissue.terms.strain_stiffening import StrainStiffening

L, RATIO = 0.04, 1.5
TERM = StrainStiffening(RATIO)


def body_on(mesh, nu, fixed=(), pads=(), **extra):
    """Homogeneous SoftBody."""
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.asarray(fixed, dtype=np.int64), pads, **extra)


def drawn(force, nu):
    """Cube on rollers under a dead load, evenly spread on its far face."""
    mesh = quadratic_mesh(box_mesh((L, L, L), (2, 2, 2)))
    n, sets = len(mesh.nodes), mesh.node_sets
    rollers = np.zeros((n, 3, 3))
    for axis, face in enumerate(('x0', 'y0', 'z0')):
        rollers[sets[face], axis, axis] = 1e6
    faces = boundary_faces(mesh)
    far = faces[np.isin(faces, sets['z1']).all(axis=1)]
    load = np.zeros((n, 3))
    np.add.at(load[:, 2], face_middles(mesh, far), force / (3 * len(far)))
    return body_on(mesh, nu, springs=Springs(np.arange(n), rollers), nodal_force=load)


@pytest.mark.parametrize('stretch', [0.7, 1.3, 1.6])
def test_bar(stretch):
    """Incompressible: F = A (l - l^-2) (mu + 4 c (l^2 + 2 / l - 3)); mu / kappa is 2e-4."""
    nu = 0.4999
    excess = stretch**2 + 2.0 / stretch - 3.0
    force = L**2 * moduli(6e3, nu)[0] * (stretch - stretch**-2) * (1.0 + 4.0 * RATIO * excess)
    body = drawn(force, nu)
    state = TissueSimulator(body, (TERM,)).settle()
    assert state.outcome.ok
    corner = np.linalg.norm(body.mesh.nodes - L, axis=1).argmin()
    np.testing.assert_allclose(state.x[corner] / L, [stretch**-0.5, stretch**-0.5, stretch],
                               rtol=5e-4)


@pytest.mark.parametrize('nu', [0.3, 0.49])
@pytest.mark.parametrize('shear', [0.1, 0.5])
def test_sheared_block(shear, nu):
    """Simple shear g: J = 1, Ib = 3 + g^2, P_xz = (mu + 4 c g^2) g; its virtual work is V P_xz."""
    cube = box_mesh((L, L, L), (2, 2, 2))
    for mesh in (cube, quadratic_mesh(cube)):
        body, height = TERM.prepare(body_on(mesh, nu)), mesh.nodes[:, 2]
        x = mesh.nodes + shear * np.outer(height, [1.0, 0.0, 0.0])
        work = Assembler(body).forces(x)[:, 0] @ height
        exact = L**3 * body.mu[0] * (1.0 + 4.0 * RATIO * shear**2) * shear
        assert work == pytest.approx(exact, rel=1e-11)


def block(gravity=0.0):
    """Block held below, a pad over the middle of its top."""
    mesh = quadratic_mesh(box_mesh((L, L, L), (3, 3, 3)))
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - L / 2, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([L / 2, L / 2, L]), 0.01)
    return body_on(mesh, 0.49, mesh.node_sets['z0'], (pad,),
                   gravity=np.array([0.0, 0.0, -gravity]))


def pushed(depth, *terms, body=None):
    """State after one push of `depth` [m]."""
    body = block() if body is None else body
    state = TissueSimulator(body, terms).step(1.0, [[0.0, 0.0, -depth]])
    assert state.outcome.ok
    return state


def test_it_is_of_third_order_and_even_in_direction():
    """What it adds to the force grows with the cube of depth, alike for push and pull."""
    def excess(depth):
        return (pushed(depth, TERM).pad_force - pushed(depth).pad_force)[0, 2]

    assert excess(4e-4) / excess(2e-4) == pytest.approx(8.0, rel=0.03)
    assert excess(-2e-4) == pytest.approx(-excess(2e-4), rel=0.05)
    assert excess(4e-3) > 0.1 * pushed(4e-3).pad_force[0, 2]


def test_all_moduli_times_two_double_forces_and_leave_positions():
    """Whichever of the two terms acts first."""
    one = pushed(5e-3, TERM)
    for terms in ((StiffnessScale(2.0), TERM), (TERM, StiffnessScale(2.0))):
        two = pushed(5e-3, *terms)
        np.testing.assert_allclose(two.x, one.x, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(two.pad_force, 2.0 * one.pad_force, rtol=0.0, atol=1e-11)


def test_under_gravity_density_must_scale_too():
    body = block(9.81)
    heavy = dataclasses.replace(body, density=2.0 * body.density)
    one, twice = pushed(5e-3, TERM, body=body), (TERM, StiffnessScale(2.0))
    same, other = (pushed(5e-3, *twice, body=b) for b in (heavy, body))
    np.testing.assert_allclose(same.x, one.x, rtol=0.0, atol=1e-12)
    assert np.abs(other.x - one.x).max() > 1e-5


def test_two_of_them_add_up():
    body = block()
    twice = StrainStiffening(0.5).prepare(TERM.prepare(body))
    np.testing.assert_allclose(twice.stiffening, StrainStiffening(2.0).prepare(body).stiffening)
