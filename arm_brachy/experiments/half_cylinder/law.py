"""The law, in the deformed body: isochoric neo-Hookean and kappa / 2 (J - 1)^2.

    W = mu / 2 (tr bb - 3) + kappa / 2 (J - 1)^2,    bb = J^(-2/3) F F^T
    tau = mu dev bb + kappa (J - 1) J 1

Symmetric tensors are vectors xx yy zz xy yz zx.
"""

from dataclasses import dataclass

import numpy as np

ONE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
# The symmetric identity, of rates whose shears are doubled.
SYMMETRIC = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
SPHERICAL = np.outer(ONE, ONE)


@dataclass(frozen=True)
class Law:
    """Stress and tangent at points with deformation gradients F (..., 3, 3), det F > 0.

    shear, bulk : mu and kappa [Pa], numbers or (...)
    Source: Simo & Hughes 1998, Computational Inelasticity, sec. 9.2 (Kirchhoff stress, spatial
    tangent).  Test: experiments/half_cylinder/test_law.py
    """

    shear: float | np.ndarray
    bulk: float | np.ndarray

    @classmethod
    def of(cls, E, nu):
        """The Law of Young's modulus E [Pa] and Poisson's ratio nu at small strain."""
        return cls(E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu)))

    def shape_stress(self, F):
        """Isochoric part of the Kirchhoff stress, (..., 6) [Pa]."""
        bb = self._stretch(F)
        return _over(self.shear, 1) * (bb - bb[..., :3].mean(-1, keepdims=True) * ONE)

    def volume_stress(self, F):
        """Volumetric part of the Kirchhoff stress, (..., 6) [Pa]."""
        J = np.linalg.det(F)
        return _over(self.bulk * (J - 1.0) * J, 1) * ONE

    def shape_tangent(self, F):
        """Spatial tangent (..., 6, 6) [Pa] of `shape_stress`: Lie rate over symmetric velocity."""
        trace = self._stretch(F)[..., :3].sum(-1)
        cross = self.shape_stress(F)[..., :, None] * ONE
        return (_over(2.0 / 3.0 * self.shear * trace, 2) * (SYMMETRIC - SPHERICAL / 3.0)
                - 2.0 / 3.0 * (cross + np.swapaxes(cross, -1, -2)))

    def volume_tangent(self, F):
        """Spatial tangent (..., 6, 6) [Pa] of `volume_stress`."""
        J = np.linalg.det(F)
        return (_over(self.bulk * J * (2.0 * J - 1.0), 2) * SPHERICAL
                - _over(2.0 * self.bulk * J * (J - 1.0), 2) * SYMMETRIC)

    @staticmethod
    def _stretch(F):
        """bb, (..., 6)."""
        return vector(F @ np.swapaxes(F, -1, -2)) * _over(np.linalg.det(F) ** (-2.0 / 3.0), 1)


def vector(tensor):
    """Components (..., 6) of symmetric tensors (..., 3, 3)."""
    return tensor[..., [0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]


def tensor(vector):
    """Symmetric tensors (..., 3, 3) of components (..., 6)."""
    return vector[..., [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]


def _over(values, axes):
    """Values (...) with so many axes of length one behind."""
    return np.reshape(values, (*np.shape(values), *(1,) * axes))
