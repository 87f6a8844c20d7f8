"""A mesh with all that does not change while it is solved on: slopes, volumes, pattern."""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm_brachy.prove.generator.elements import POINTS, gradients, shapes, triangle_rule
from arm_brachy.prove.generator.mesh import Mesh
from arm_brachy.prove.generator.sparse import Pattern


@dataclass(frozen=True)
class Grid:
    """Discrete body.

    mesh : ten-node tetrahedra, displacements at all nodes.  pressure : 'nodal', continuous and
    linear (Taylor & Hood 1973), or 'cell', one value per element.
    nodes (n, 3) : stress-free positions, those of the mesh where none are given [m].
    """

    mesh: Mesh
    pressure: str = 'nodal'
    moved: np.ndarray | None = None

    @property
    def nodes(self):
        """Stress-free positions of the nodes (n, 3) [m]."""
        return self.mesh.nodes if self.moved is None else self.moved

    @property
    def offset(self):
        """How far the body's material points are from where the label has them (n, 3) [m]."""
        return self.nodes - self.mesh.nodes

    @cached_property
    def slopes(self):
        """Slopes of the shape functions (m, q, 10, 3) and volumes (m, q)."""
        return gradients(self.nodes, self.mesh.tets)

    @property
    def cells(self):
        """Pressure unknowns of each element (m, b)."""
        if self.pressure == 'nodal':
            return self.mesh.tets[:, :4]
        return np.arange(len(self.mesh.tets))[:, None]

    @property
    def pressures(self):
        """Number of pressure unknowns."""
        return self.mesh.corners if self.pressure == 'nodal' else len(self.mesh.tets)

    @property
    def pressure_shapes(self):
        """Pressure functions at the integration points (q, b)."""
        return POINTS if self.pressure == 'nodal' else np.ones((len(POINTS), 1))

    @cached_property
    def points(self):
        """Integration points at rest (m, q, 3) [m]."""
        return np.einsum('qa,mai->mqi', shapes(POINTS), self.nodes[self.mesh.tets])

    @cached_property
    def pattern(self):
        """Pattern of the matrix: three displacements per node, then the pressures."""
        n = 3 * len(self.nodes)
        tets = self.mesh.tets
        dofs = np.hstack([(3 * tets[:, :, None] + np.arange(3)).reshape(len(tets), -1),
                          n + self.cells])
        return Pattern(dofs, n + self.pressures)

    def face_points(self, faces):
        """Positions (f, 7, 3), area vectors (f, 7, 3) [m^2] and shapes (7, 6) on faces (f, 6)."""
        n, dn, w = triangle_rule()
        x = self.nodes[faces]
        ds, dt = np.einsum('qak,fai->kfqi', dn, x)
        return np.einsum('qa,fai->fqi', n, x), np.cross(ds, dt) * w[:, None], n


def nodes_to_dofs(nodes):
    """Displacement unknowns (3 k,) of `nodes` (k,)."""
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
