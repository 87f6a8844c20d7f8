"""Winkler base: a block too stiff to deform moves as a rigid body on springs does."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.terms.base_compliance import BaseCompliance

SIDE, WIDTH, HEIGHT = 0.05, 0.03, 0.02
NORMAL, TANGENTIAL = 2e6, 5e5  # N/m^3: 2 and 0.5 kPa/mm


def stiff_block(pads=True, E=1e9):
    """Block of 50 x 30 x 20 mm, 1 GPa: four decades stiffer than its foundation."""
    mesh = box_mesh((SIDE, WIDTH, HEIGHT), (16, 4, 2))
    m, (mu, kappa) = len(mesh.tets), moduli(E, 0.3)
    lid = Pad('lid', mesh.node_sets['z1'], np.array([0.0, 0.0, -1.0]),
              np.array([SIDE / 2, WIDTH / 2, HEIGHT]), 0.01)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (lid,) if pads else ())


def test_tributary_areas_add_up_to_the_base():
    body = BaseCompliance(NORMAL, TANGENTIAL).prepare(stiff_block())
    assert len(body.fixed) == 0
    np.testing.assert_allclose(body.springs.stiffness.sum(axis=0),
                               SIDE * WIDTH * np.diag([TANGENTIAL, TANGENTIAL, NORMAL]),
                               rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(('axis', 'modulus'), [(0, TANGENTIAL), (1, TANGENTIAL), (2, NORMAL)])
def test_translation_of_a_rigid_block(axis, modulus):
    """F = k A w."""
    body = BaseCompliance(NORMAL, TANGENTIAL).prepare(stiff_block())
    push = np.zeros((1, 3))
    push[0, axis] = -1e-5
    solution = StaticSolver(body).solve(body.mesh.nodes, push)
    assert solution.outcome.ok
    assert solution.pad_force[0, axis] == pytest.approx(modulus * SIDE * WIDTH * 1e-5, rel=1e-3)


def test_tilt_of_a_rigid_block():
    """Horizontal force F at height h: theta = F h / (k_n I), I = b a^3 / 12, slip F / (k_t A)."""
    body = BaseCompliance(NORMAL, TANGENTIAL).prepare(stiff_block(pads=False))
    top, force = body.mesh.node_sets['z1'], np.zeros_like(body.mesh.nodes)
    force[top, 0] = 1e-3 / len(top)
    body = dataclasses.replace(body, nodal_force=force)
    u = StaticSolver(body).solve(body.mesh.nodes, np.zeros((0, 3))).x - body.mesh.nodes
    base = body.mesh.node_sets['z0']
    theta = 1e-3 * HEIGHT / (NORMAL * WIDTH * SIDE**3 / 12.0)
    arm = body.mesh.nodes[base, 0] - SIDE / 2
    # lumping to the corners shifts inertia by about (cell / side)^2, at most 3 % across y
    np.testing.assert_allclose(u[base, 2], -theta * arm, rtol=0.0, atol=0.03 * theta * SIDE / 2)
    assert u[base, 0].mean() == pytest.approx(1e-3 / (TANGENTIAL * SIDE * WIDTH), rel=0.01)


def test_a_stiff_foundation_is_a_fixed_base():
    soft = stiff_block(E=6e3)
    push = np.array([[1e-3, 0.0, -2e-3]])
    fixed = StaticSolver(soft).solve(soft.mesh.nodes, push)
    rigid = BaseCompliance(1e10, 1e10).prepare(soft)
    sprung = StaticSolver(rigid).solve(soft.mesh.nodes, push)
    np.testing.assert_allclose(sprung.x, fixed.x, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(sprung.pad_force, fixed.pad_force, rtol=1e-3)


def test_refuses_a_fixed_region_without_a_face():
    body = dataclasses.replace(stiff_block(), fixed=np.array([0, 1]))
    with pytest.raises(MeshError, match='none of the 2 fixed nodes'):
        BaseCompliance().prepare(body)
