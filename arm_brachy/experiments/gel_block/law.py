"""The block's law: nearly incompressible, neo-Hookean or stiffening like Fung's.

    W = mu / (2 b) (exp(b (Ib - 3)) - 1) + kappa / 4 (J^2 - 1 - 2 ln J),    Ib = J^(-2/3) F : F

With b = 0 the first part is mu / 2 (Ib - 3). Its volume part is another than that of the tissue's
model; at the block's strains J stays near one, where they agree.
"""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Law:
    """Energy, stress and tangent at points with deformation gradients F (..., 3, 3), det F > 0.

    shear, bulk : mu and kappa at small strain [Pa], numbers or (...)
    stiffening : b [1]
    Source: Fung, Fronek & Patitucci 1979 (Am J Physiol 237:H620) for the exponential, isotropic
    form of Demiray 1972 (J Biomech 5:309); volume part: Simo & Taylor 1982.
    Test: experiments/gel_block/test_law.py
    """

    shear: float | np.ndarray
    bulk: float | np.ndarray
    stiffening: float = 0.0

    @classmethod
    def of(cls, E, nu, stiffening=0.0):
        """The Law of Young's modulus E [Pa] and Poisson's ratio nu at small strain."""
        return cls(E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu)), stiffening)

    def scaled(self, factor):
        """The Law with both moduli times `factor`, a number or (...)."""
        return replace(self, shear=factor * self.shear, bulk=factor * self.bulk)

    def energy(self, F):
        """Density (...) [J/m^3]."""
        J, stretch = np.linalg.det(F), self._stretch(F)
        b = self.stiffening
        shape = self.shear / 2.0 * (np.expm1(b * stretch) / b if b else stretch)
        return shape + self.bulk / 4.0 * (J * J - 1.0 - 2.0 * np.log(J))

    def stress(self, F):
        """First Piola-Kirchhoff stress (..., 3, 3) [Pa]."""
        J, inv_T = np.linalg.det(F), _inverse_transpose(F)
        pressure = self.bulk / 2.0 * (J * J - 1.0)
        return (_over(self._slope(F), 2) * self._gradient(F, J, inv_T)
                + _over(pressure, 2) * inv_T)

    def tangent(self, F):
        """Derivative A[..., i, J, k, L] = dP_iJ / dF_kL, (..., 3, 3, 3, 3) [Pa]."""
        J, inv_T = np.linalg.det(F), _inverse_transpose(F)
        slope, squares = self._slope(F), (F * F).sum((-1, -2))
        h = slope * J ** (-2.0 / 3.0)
        mixed = _outer(F, inv_T)
        both, crossed = _outer(inv_T, inv_T), np.einsum('...iL,...kJ->...iJkL', inv_T, inv_T)
        pressure = self.bulk / 2.0 * (J * J - 1.0)
        A = _over(2.0 * h, 4) * np.einsum('ik,JL->iJkL', np.eye(3), np.eye(3))
        A -= _over(4.0 / 3.0 * h, 4) * (mixed + np.moveaxis(mixed, (-2, -1), (-4, -3)))
        A += _over(4.0 / 9.0 * h * squares + self.bulk * J * J, 4) * both
        A += _over(2.0 / 3.0 * h * squares - pressure, 4) * crossed
        if self.stiffening:
            D = self._gradient(F, J, inv_T)
            A += _over(self.stiffening * slope, 4) * _outer(D, D)
        return A

    def _stretch(self, F):
        """Ib - 3."""
        return np.linalg.det(F) ** (-2.0 / 3.0) * (F * F).sum((-1, -2)) - 3.0

    def _slope(self, F):
        """dW / dIb."""
        if not self.stiffening:
            return self.shear / 2.0 * np.ones(F.shape[:-2])
        return self.shear / 2.0 * np.exp(self.stiffening * self._stretch(F))

    @staticmethod
    def _gradient(F, J, inv_T):
        """dIb / dF (..., 3, 3)."""
        squares = (F * F).sum((-1, -2))
        return _over(J ** (-2.0 / 3.0), 2) * (2.0 * F - _over(2.0 / 3.0 * squares, 2) * inv_T)


def _inverse_transpose(F):
    return np.swapaxes(np.linalg.inv(F), -1, -2)


def _outer(a, b):
    return np.einsum('...iJ,...kL->...iJkL', a, b)


def _over(values, axes):
    """Values (...) with so many axes of length one behind."""
    return np.reshape(values, (*np.shape(values), *(1,) * axes))
