"""Free vibrations of a body about a state: its lowest modes.

Test: diagnosis/test_free_model.py (against integration in time)
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import LinearOperator, eigsh

from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.mass import mass_matrix


@dataclass(frozen=True)
class Modes:
    """Of the free coordinates of a body, M-orthonormal, lowest first.

    square : (j,) [1/s^2] angular frequencies squared;  shapes : (f, j) [1/sqrt(kg)]
    mass, stiffness : (3n, 3n) [kg], [N/m] of all coordinates;  dofs : (f,) those that are free
    factor : solver of the free part of the stiffness, good until the StaticSolver's next one
    """

    square: np.ndarray
    shapes: np.ndarray
    mass: csc_array
    stiffness: csc_array
    dofs: np.ndarray
    factor: object


def modes_of(solver, x, fields, count):
    """Return the `count` lowest Modes about x (n, 3) [m], or as many as there are.

    solver : newton.StaticSolver of the body;  fields : body.StepFields
    Raises NotConverged where x is no stable equilibrium.
    """
    tangent, factor = solver.linearise(x, fields)
    dofs, K = solver.free.dofs, tangent.tocsc()
    M = mass_matrix(solver.assembler, DynamicOptions().mass).tocsc()
    free = K[dofs][:, dofs]
    square, shapes = eigsh(free, min(count, len(dofs) - 1), M[dofs][:, dofs], sigma=0.0,
                           v0=np.ones(len(dofs)),
                           OPinv=LinearOperator(free.shape, matvec=factor.solve))
    return Modes(square, shapes, M, K, dofs, factor)
