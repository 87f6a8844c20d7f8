"""Modulus scale: invisible in positions, a plain factor in forces; gravity breaks the tie."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

FACTOR = 1.3
PUSH = np.array([[1e-3, 0.0, -6e-3]])


def block(gravity=0.0):
    """Block of 40 mm, 6 kPa, held below, a pad over the middle of its top."""
    mesh = box_mesh((0.04, 0.04, 0.04), (5, 5, 5))
    mu, kappa = moduli(6e3, 0.45)
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.02, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.04]), 0.01)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,), gravity=np.array([0.0, 0.0, -gravity]))


def pushed(body, *terms):
    """State after one push."""
    return TissueSimulator(body, terms).step(1.0, PUSH)


def test_positions_stay_and_forces_scale_under_displacement_control():
    plain, scaled = pushed(block()), pushed(block(), StiffnessScale(FACTOR))
    assert np.abs(plain.x - plain.x[0]).max() > 1e-2  # there is something to compare
    np.testing.assert_allclose(scaled.x, plain.x, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(scaled.pad_force, FACTOR * plain.pad_force, rtol=1e-6)
    np.testing.assert_allclose(scaled.pad_moment, FACTOR * plain.pad_moment,
                               rtol=1e-6, atol=1e-9)


def test_gravity_makes_it_visible_unless_density_scales_too():
    body = block(gravity=9.81)
    plain, scaled = pushed(body), pushed(body, StiffnessScale(FACTOR))
    assert np.abs(scaled.x - plain.x).max() > 1e-4
    heavier = dataclasses.replace(body, density=FACTOR * body.density)
    same = pushed(heavier, StiffnessScale(FACTOR))
    np.testing.assert_allclose(same.x, plain.x, rtol=0.0, atol=1e-9)


def test_poissons_ratio_stays():
    body = block()
    scaled = StiffnessScale(0.4).prepare(body)
    np.testing.assert_allclose(scaled.kappa / scaled.mu, body.kappa / body.mu)
    assert scaled.mu[0] == pytest.approx(0.4 * body.mu[0])
