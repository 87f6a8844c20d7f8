"""A body of curved tetrahedra with 10 nodes: forces and tangent in the deformed body.

Nothing is shared with arm_brachy.tissue, nor with the gel block.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.experiments.half_cylinder import probe
from arm_brachy.experiments.half_cylinder.ground import Ground
from arm_brachy.experiments.half_cylinder.law import tensor
from arm_brachy.experiments.half_cylinder.shapes import POINTS, WEIGHT, slopes

BATCH = 256     # tetrahedra worked on together


@dataclass(frozen=True)
class Past:
    """What a memory makes of the shape's stress: `factor` times it, and `kept` besides.

    kept : (e, q, 3, 3) second Piola-Kirchhoff stress [Pa] that does not depend on what comes;
        None = nothing
    """

    factor: float = 1.0
    kept: np.ndarray | None = None

    def part(self, some):
        """That of the tetrahedra `some`."""
        return Past(self.factor, None if self.kept is None else self.kept[some])


NONE = Past()       # an elastic body's


class Body:
    """A mesh.Mesh with a law, its base on rigid ground.

    law : law.Law, moduli (e, 1) of the tetrahedra
    loose : middles (f, 3) [m] of faces of the base -> (f,) bool, those that are not glued, or None
    Nodal vectors are flat, (3 n,): x y z of node 0, then of node 1.
    nodes : (n, 3) [m];  dofs : (e, 30);  glued : nodes that cannot move
    Raises MeshError for a tetrahedron that is inside out.
    Test: experiments/half_cylinder/test_elements.py
    """

    def __init__(self, mesh, law, *, loose=None):
        self.nodes, self._tets, self._law = mesh.nodes, mesh.tets, law
        self.dofs = (3 * mesh.tets[:, :, None] + np.arange(3)).reshape(len(mesh.tets), -1)
        local = slopes(POINTS)
        jacobian = np.einsum('eai,qaj->eqij', self.nodes[mesh.tets], local)
        volumes = np.linalg.det(jacobian)
        if volumes.min() <= 0.0:
            raise MeshError(f'tetrahedron {np.argmin(volumes.min(axis=1))} is inside out; must '
                            'have some volume at every point; bend its edges less')
        self._gradients = local @ np.linalg.inv(jacobian)
        self.weights = WEIGHT * volumes
        self.glued, self.ground = self._on_base(mesh.faces['base'], loose)

    def _on_base(self, base, loose):
        """Nodes that are glued and the Ground of the others, None if there are none."""
        if loose is None:
            return np.unique(base), None
        off = loose(self.nodes[base[:, :3]].mean(axis=1))
        return np.unique(base[~off]), Ground(self.nodes, base[off])

    @property
    def size(self):
        """Length of a nodal vector."""
        return 3 * len(self.nodes)

    def gradient(self, u, part=slice(None)):
        """F (e, q, 3, 3) of tetrahedra at displacements u (3 n,) [m]."""
        moved = u.reshape(-1, 3)[self._tets[part]]
        return np.eye(3) + np.swapaxes(moved, 1, 2)[:, None] @ self._gradients[part]

    def forces(self, u, past=NONE):
        """What holds the nodes at displacements u (3 n,) [m], (3 n,) [N]."""
        F = self.gradient(u)
        flow = self._gradients @ np.linalg.inv(F)
        stress = self._stress(slice(None), F, past) * self.weights[..., None, None]
        out = self.gathered(self.dofs, (flow @ stress).sum(axis=1))
        return out if self.ground is None else out + self.gathered(self.ground.dofs,
                                                                   self.ground.forces(u))

    def tangents(self, u, past=NONE):
        """Derivatives of `forces` without the ground's: (e, 30, 30) [N/m]."""
        out = np.empty((*self.dofs.shape, self.dofs.shape[1]))
        for start in range(0, len(out), BATCH):
            part = slice(start, start + BATCH)
            out[part] = self._tangents(u, part, past.part(part))
        return out

    def _tangents(self, u, part, past):
        """B^T c B and g . tau g of every pair of nodes, g the gradients in the deformed body."""
        F, law = self.gradient(u, part), self._part_of_law(part)
        g = self._gradients[part] @ np.linalg.inv(F)
        weights = self.weights[part][..., None, None]
        c = past.factor * law.shape_tangent(F) + law.volume_tangent(F)
        B = _strains(g)
        out = (np.swapaxes(B, -1, -2) @ (c * weights) @ B).sum(axis=1)
        stress = self._stress(part, F, past) * weights
        pairs = (g @ stress @ np.swapaxes(g, -1, -2)).sum(axis=1)
        for axis in range(3):
            out[:, axis::3, axis::3] += pairs
        return out

    def _stress(self, part, F, past):
        """Kirchhoff stress (e, q, 3, 3) [Pa]."""
        law = self._part_of_law(part)
        stress = tensor(past.factor * law.shape_stress(F) + law.volume_stress(F))
        return stress if past.kept is None else stress + F @ past.kept @ np.swapaxes(F, -1, -2)

    def shape_stress(self, u):
        """Second Piola-Kirchhoff stress (e, q, 3, 3) [Pa] of the shape alone, elastic."""
        F = self.gradient(u)
        back = np.linalg.inv(F)
        return back @ tensor(self._law.shape_stress(F)) @ np.swapaxes(back, -1, -2)

    def _part_of_law(self, part):
        return type(self._law)(self._law.shear[part], self._law.bulk[part])

    def gathered(self, dofs, each):
        """Sum (3 n,) of values `each` at degrees of freedom `dofs`, arrays of one size."""
        return np.bincount(dofs.ravel(), each.ravel(), minlength=self.size)

    def probe(self, points):
        """Matrix (k, n) from values at nodes to values at points (k, 3) [m] of the body."""
        return probe.probe(self.nodes, self._tets, points)


def _strains(g):
    """B (..., 6, 30) of gradients (..., 10, 3): shears are doubled, order as in `law`."""
    out = np.zeros((*g.shape[:-2], 6, 3 * g.shape[-2]))
    for axis in range(3):
        after = (axis + 1) % 3
        out[..., axis, axis::3] = g[..., axis]
        out[..., 3 + axis, axis::3] = g[..., after]
        out[..., 3 + axis, after::3] = g[..., axis]
    return out
