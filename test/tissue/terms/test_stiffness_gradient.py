"""Stiffness gradient against bars in series and in parallel."""

import math

import numpy as np
import pytest

from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import volumes
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient

E, WIDTH, LENGTH, STRAIN = 6e3, 0.02, 0.08, 1e-5


def bar(cells=8):
    """Bar along z of nu = 0, held below, its whole top moved; `cells` along its length."""
    mesh = box_mesh((WIDTH, WIDTH, LENGTH), (4, 2, cells))
    m, (mu, kappa) = len(mesh.tets), moduli(E, 0.0)
    end = Pad('end', mesh.node_sets['z1'], np.array([0.0, 0.0, 1.0]),
              np.array([WIDTH / 2, WIDTH / 2, LENGTH]), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (end,))


def pulled(term, cells=8):
    """State of the bar stretched by STRAIN."""
    return TissueSimulator(bar(cells), (term,)).step(1.0, [[0.0, 0.0, STRAIN * LENGTH]])


def test_series_bar():
    """E = E0 exp(g (z - L/2)): F = E0 A strain (g L / 2) / sinh(g L / 2); second order."""
    g = 2.0 * math.log(1.4) / LENGTH * 2.0
    half = 0.5 * g * LENGTH
    exact = E * WIDTH**2 * STRAIN * half / math.sinh(half)
    errors = [abs(-pulled(StiffnessGradient((0.0, 0.0, g)), n).pad_force[0, 2] / exact - 1.0)
              for n in (4, 8)]
    assert errors[1] < 5e-3
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


def test_parallel_bar_bears_force_off_its_axis_and_moves_as_before():
    """E = E0 exp(g (x - w/2)): uniform strain; F = E0 A strain sinh(a) / a, a = g w / 2, and
    M_y = -strain E0 w int x exp(g x) dx about the axis, on the pad."""
    g = 2.0 * math.log(1.4) / WIDTH
    plain, graded = pulled(StiffnessGradient()), pulled(StiffnessGradient((g, 0.0, 0.0)))
    np.testing.assert_allclose(graded.x, plain.x, rtol=0.0, atol=1e-3 * STRAIN * LENGTH)
    a = 0.5 * g * WIDTH
    force = E * WIDTH**2 * STRAIN * math.sinh(a) / a
    assert -graded.pad_force[0, 2] == pytest.approx(force, rel=5e-3)
    first_moment = 2.0 * (a * math.cosh(a) - math.sinh(a)) / g**2
    assert graded.pad_moment[0, 1] == pytest.approx(STRAIN * E * WIDTH * first_moment, rel=0.08)
    assert abs(plain.pad_moment[0, 1]) < 1e-5 * graded.pad_moment[0, 1]  # 0, as nearly as solved


def test_poissons_ratio_stays_and_opposite_gradients_are_mirror_images():
    body, g = bar(), np.array([3.0, -2.0, 5.0])
    up, down = (StiffnessGradient(tuple(s * g)).prepare(body) for s in (1.0, -1.0))
    np.testing.assert_allclose(up.kappa / up.mu, body.kappa / body.mu)
    np.testing.assert_allclose(up.mu * down.mu, body.mu**2)
    logarithm = np.log(up.mu / body.mu)
    assert abs(logarithm @ volumes(body.mesh)) < 1e-12  # zero at the centroid
