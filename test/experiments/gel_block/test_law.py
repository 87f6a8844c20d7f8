"""The block's law: stress and tangent are derivatives, small strains are Hooke's."""

import numpy as np
import pytest

from arm_brachy.experiments.gel_block.law import Law

E, NU = 12e3, 0.45
LAWS = [Law.of(E, NU), Law.of(E, NU, stiffening=1.5)]
names = pytest.mark.parametrize('law', LAWS, ids=['neo-Hookean', 'stiffening'])


def gradients(size):
    rng = np.random.default_rng(1)
    return np.eye(3) + size * rng.uniform(-1.0, 1.0, (20, 3, 3))


def along(function, F, d, h=1e-6):
    """Central difference: wrong by h^2 = 1e-12 and by rounding, 1e-16 / h = 1e-10."""
    return (function(F + h * d) - function(F - h * d)) / (2.0 * h)


@names
def test_stress_is_the_derivative_of_energy(law):
    F, d = gradients(0.2), np.random.default_rng(2).normal(size=(20, 3, 3))
    slope = (law.stress(F) * d).sum((-1, -2))
    np.testing.assert_allclose(slope, along(law.energy, F, d), rtol=0, atol=1e-8 * E)


@names
def test_tangent_is_the_derivative_of_stress(law):
    F, d = gradients(0.2), np.random.default_rng(3).normal(size=(20, 3, 3))
    change = np.einsum('...iJkL,...kL->...iJ', law.tangent(F), d)
    np.testing.assert_allclose(change, along(law.stress, F, d), rtol=0, atol=1e-7 * E)


@names
def test_at_rest_it_is_hookes(law):
    """lambda = kappa - 2 mu / 3 in A = lambda dd + mu (dd + dd)."""
    mu, bulk, d = E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU)), np.eye(3)
    hooke = ((bulk - 2 * mu / 3) * np.einsum('iJ,kL->iJkL', d, d)
             + mu * (np.einsum('ik,JL->iJkL', d, d) + np.einsum('iL,Jk->iJkL', d, d)))
    np.testing.assert_allclose(law.tangent(np.eye(3)), hooke, atol=1e-10 * E)
    np.testing.assert_allclose(law.stress(np.eye(3)), 0.0, atol=1e-10 * E)


def test_stiffening_begins_with_the_second_power():
    """mu / (2 b) (exp(b s) - 1) = mu / 2 s + mu b / 4 s^2 + O(s^3), s = Ib - 3: the ratio b / 4
    that `cases` calls the truth of strain_stiffening."""
    b, k = 1.5, 1.05
    F = np.diag([k, k ** -0.5, k ** -0.5])          # det F = 1: no volume part
    s = k ** 2 + 2.0 / k - 3.0
    more = Law.of(E, NU, b).energy(F) - Law.of(E, NU).energy(F)
    mu = E / (2 * (1 + NU))
    assert more == pytest.approx(mu * b / 4.0 * s ** 2, rel=b * s)     # the third, b s / 3
