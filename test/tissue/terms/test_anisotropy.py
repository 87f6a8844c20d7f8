"""Anisotropy: bars along and across, shear, rotation, and what the pads' azimuth shows."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import energy, moduli
from arm_brachy.tissue.mesh import boundary_faces, face_middles, quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

L, RATIO, QUARTER = 0.04, 0.5, np.pi / 2.0


def body_on(mesh, nu, fixed=(), pads=(), **extra):
    """Homogeneous SoftBody."""
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.asarray(fixed, dtype=np.int64), pads, **extra)


def drawn(force, nu):
    """Cube on rollers under a dead load along z, evenly spread on its far face."""
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


def stretches(term, stress, nu=0.4999):
    """Stretches (3,) of the cube under a nominal stress [Pa] along z."""
    body = drawn(stress * L**2, nu)
    state = TissueSimulator(body, (term,)).settle()
    assert state.outcome.ok
    return state.x[np.linalg.norm(body.mesh.nodes - L, axis=1).argmin()] / L


@pytest.mark.parametrize('stretch', [0.85, 1.3])
def test_bar_along_the_fibres(stretch):
    """Incompressible: P = mu (l - l^-2) + 2 k (l^2 - 1) l; mu / kappa is 2e-4."""
    mu = moduli(6e3, 0.4999)[0]
    P = mu * (stretch - stretch**-2) + 2.0 * RATIO * mu * (stretch**2 - 1.0) * stretch
    got = stretches(Anisotropy(RATIO, elevation=QUARTER), P)
    np.testing.assert_allclose(got, [stretch**-0.5, stretch**-0.5, stretch], rtol=5e-4)


@pytest.mark.parametrize('stretch', [0.75, 1.3])
def test_bar_across_the_fibres(stretch):
    """Fibres along x resist its change: a of mu a^2 + 2 k (a^2 - 1) a^2 = mu b^2, b = 1 / (l a).

    Both sides are free of stress, which gives the pressure mu b^2 and P = mu (l - b^2 / l).
    """
    mu = moduli(6e3, 0.4999)[0]
    a = brentq(lambda a: (a**2 + 2.0 * RATIO * (a**2 - 1.0) * a**2 - (stretch * a) ** -2), 0.5, 2)
    b = 1.0 / (stretch * a)
    got = stretches(Anisotropy(RATIO), mu * (stretch - b**2 / stretch))
    np.testing.assert_allclose(got, [a, b, stretch], rtol=5e-4)
    assert abs(a / b - 1.0) > 0.05  # it does not thin evenly


@pytest.mark.parametrize(('azimuth', 'elevation'), [(0.0, 0.7), (0.4, -0.5), (2.0, 1.2)])
def test_sheared_block(azimuth, elevation):
    """Simple shear g: P_xz = mu g + 2 k (|F a|^2 - 1) (a_x + g a_z) a_z; virtual work V P_xz."""
    cube, g, term = box_mesh((L, L, L), (2, 2, 2)), 0.4, Anisotropy(RATIO, azimuth, elevation)
    a = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
         np.sin(elevation)]
    Fa = [a[0] + g * a[2], a[1], a[2]]
    for mesh in (cube, quadratic_mesh(cube)):
        body, height = term.prepare(body_on(mesh, 0.49)), mesh.nodes[:, 2]
        x = mesh.nodes + g * np.outer(height, [1.0, 0.0, 0.0])
        work = Assembler(body).forces(x)[:, 0] @ height
        P = g + 2.0 * RATIO * (np.dot(Fa, Fa) - 1.0) * Fa[0] * a[2]
        assert work == pytest.approx(L**3 * body.mu[0] * P, rel=1e-11)


def block(turn=0.0):
    """Block held below, a pad on its side at +x, all turned about z by `turn` [rad]."""
    mesh = quadratic_mesh(box_mesh((L, L, L), (3, 3, 3)))
    Q = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
    side = mesh.node_sets['x1']
    disc = side[np.linalg.norm(mesh.nodes[side, 1:] - L / 2, axis=1) < 0.012]
    pad = Pad('pad', disc, Q @ [-1.0, 0.0, 0.0], Q @ [L, L / 2, L / 2], 0.01)
    mesh = dataclasses.replace(mesh, nodes=mesh.nodes @ Q.T)
    return body_on(mesh, 0.49, mesh.node_sets['z0'], (pad,))


def pushed(body, *terms, depth=4e-3):
    """State after one push along the pad's direction."""
    state = TissueSimulator(body, terms).step(1.0, [depth * body.pads[0].direction])
    assert state.outcome.ok
    return state


def test_turned_with_the_body_the_fibres_give_the_turned_answer():
    turn = 0.7
    Q = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
    here = pushed(block(), Anisotropy(RATIO, 0.3, 0.4))
    there = pushed(block(turn), Anisotropy(RATIO, 0.3 + turn, 0.4))
    np.testing.assert_allclose(there.x, here.x @ Q.T, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(there.pad_force, here.pad_force @ Q.T, rtol=0.0, atol=1e-6)


def test_the_response_depends_on_the_azimuth_of_the_push():
    """Stiffest along the fibres; where they lie aslant, a marker on top is carried aside."""
    body = block()
    top = np.linalg.norm(body.mesh.nodes - [L / 2, L / 2, L], axis=1).argmin()

    def seen(turn, ratio=RATIO):
        """Force along the push [N], marker's way across it [m]."""
        state = pushed(body, Anisotropy(ratio, azimuth=turn))
        return state.pad_force[0, 0], (state.x - body.mesh.nodes)[top, 1]

    (along, _), (across, even), (plain, none) = seen(0.0), seen(QUARTER), seen(0.0, 0.0)
    assert along > 1.03 * across > 1.03 * plain
    left, right = seen(-0.5 * QUARTER)[1], seen(0.5 * QUARTER)[1]
    assert left > 5e-5 > -5e-5 > right
    assert max(abs(even), abs(none)) < 2.5e-5  # the mesh is not quite symmetric


@pytest.mark.parametrize('ratio', [0.7, 2.0])
def test_fibres_kink_where_the_documentation_says(ratio):
    """Energy of layers that slide along the fibres, shortened to l, sides free to move.

    Positive second derivative above l^2 = 1 - 1 / (2 ratio) and negative below it.
    """
    law = np.array([0.0, ratio, 0.0, 0.0, 1.0])
    critical = np.sqrt(1.0 - 0.5 / ratio)

    def curvature(stretch, t=1e-3):
        F = np.diag([stretch**-0.5, stretch**-0.5, stretch])
        slide = np.outer([stretch, 0.0, 0.0], [0.0, 0.0, 1.0])  # across, of planes that fibres cut
        W = [energy(F + s * slide, 1.0, 0.0, law) for s in (-t, 0.0, t)]
        return (W[0] - 2.0 * W[1] + W[2]) / t**2

    assert curvature(1.01 * critical) > 1e-3 > -1e-3 > curvature(0.99 * critical)


def test_a_direction_and_its_opposite_are_the_same_fibres():
    body = block()
    one = Anisotropy(RATIO, 0.5, 0.3)
    other = Anisotropy(RATIO, 0.5 - np.pi, -0.3)
    np.testing.assert_allclose(one.direction, -other.direction, atol=1e-15)
    np.testing.assert_allclose(pushed(body, other).x, pushed(body, one).x, rtol=0.0, atol=1e-12)


def test_all_moduli_times_two_double_forces_and_leave_positions():
    """Whichever of the two terms acts first."""
    body, term = block(), Anisotropy(RATIO, 0.3, 0.4)
    one = pushed(body, term)
    for terms in ((StiffnessScale(2.0), term), (term, StiffnessScale(2.0))):
        two = pushed(body, *terms)
        np.testing.assert_allclose(two.x, one.x, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(two.pad_force, 2.0 * one.pad_force, rtol=0.0, atol=1e-11)


def test_a_second_family_is_refused():
    once = Anisotropy(RATIO).prepare(block())
    with pytest.raises(ConfigError, match='anisotropy: the body has fibres already; must be one'):
        Anisotropy(RATIO, azimuth=1.0).prepare(once)
