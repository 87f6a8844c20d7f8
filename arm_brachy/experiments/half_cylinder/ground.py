"""A part of the base without glue: it lies on rigid ground without friction, and may lift off.

Test: experiments/half_cylinder/test_elements.py
"""

import numpy as np

from arm_brachy.experiments.half_cylinder.shapes import face_areas, face_values

STIFFNESS = 1.5e8       # Pa/m: gives way by 7 um under 1 kPa


class Ground:
    """Presses from below against faces (f, 6) of a body's base, where they sink, never pulls.

    nodes : (n, 3) [m], their third coordinate up
    """

    def __init__(self, nodes, faces):
        self._up = 3 * faces + 2
        self._values = face_values()
        self._weights = STIFFNESS * face_areas(nodes[faces])

    @property
    def dofs(self):
        """Degrees of freedom (f, 6) on which it acts."""
        return self._up

    def forces(self, u):
        """What holds the nodes of each face at displacements u (3 n,), (f, 6) [N]."""
        depth = u[self._up] @ self._values.T
        return (self._weights * np.minimum(depth, 0.0)) @ self._values

    def tangents(self, u):
        """Derivatives of `forces`, (f, 6, 6) [N/m]."""
        touching = self._weights * (u[self._up] @ self._values.T < 0.0)
        return np.einsum('fq,qa,qb->fab', touching, self._values, self._values)
