"""The half-cylinder's law: stress and tangent are derivatives of the energy as it is written."""

import numpy as np
import pytest

from arm_brachy.experiments.half_cylinder.law import Law, tensor, vector

E, NU = 9e3, 0.48
LAW = Law.of(E, NU)


def energy(F):
    """mu / 2 (J^(-2/3) F : F - 3) + kappa / 2 (J - 1)^2 [J/m^3]."""
    J = np.linalg.det(F)
    shape = J ** (-2.0 / 3.0) * (F * F).sum((-1, -2)) - 3.0
    return LAW.shear / 2.0 * shape + LAW.bulk / 2.0 * (J - 1.0) ** 2


def stress(F):
    return LAW.shape_stress(F) + LAW.volume_stress(F)


@pytest.fixture
def F():
    return np.eye(3) + 0.2 * np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3, 3))


@pytest.fixture
def velocity():
    """Gradients (20, 3, 3) of velocities in the deformed body."""
    return np.random.default_rng(2).normal(size=(20, 3, 3))


def along(function, F, velocity, h=1e-6):
    """Central difference: wrong by h^2 = 1e-12 and by rounding, 1e-16 / h = 1e-10."""
    d = velocity @ F
    return (function(F + h * d) - function(F - h * d)) / (2.0 * h)


def test_stress_is_the_derivative_of_energy(F, velocity):
    """dW = tau : l, with l the gradient of the velocity."""
    power = (tensor(stress(F)) * velocity).sum((-1, -2))
    np.testing.assert_allclose(power, along(energy, F, velocity), rtol=0, atol=1e-8 * E)


def test_tangent_is_the_lie_rate_of_stress(F, velocity):
    """d tau - l tau - tau l^T = c : d, with d the symmetric part of l, its shears doubled."""
    tau = tensor(stress(F))
    rate = along(lambda F: tensor(stress(F)), F, velocity)
    rate -= velocity @ tau + tau @ np.swapaxes(velocity, -1, -2)
    strain = vector(velocity + np.swapaxes(velocity, -1, -2)) * [0.5, 0.5, 0.5, 1, 1, 1]
    c = LAW.shape_tangent(F) + LAW.volume_tangent(F)
    np.testing.assert_allclose(np.einsum('...ij,...j->...i', c, strain), vector(rate), rtol=0,
                               atol=1e-6 * LAW.bulk)


def test_at_rest_it_is_hookes():
    mu, bulk = E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU))
    lame = bulk - 2 * mu / 3
    hooke = np.diag([2 * mu] * 3 + [mu] * 3)
    hooke[:3, :3] += lame
    rest = LAW.shape_tangent(np.eye(3)) + LAW.volume_tangent(np.eye(3))
    np.testing.assert_allclose(rest, hooke, atol=1e-10 * E)
    np.testing.assert_allclose(stress(np.eye(3)), 0.0, atol=1e-10 * E)
