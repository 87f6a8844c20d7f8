"""The rigid face of a pad above a few nodes: the contact potential of the plant on these alone.

Layer, friction and anchors are those of `tissue.contact`, by its compiled loops.
Test: diagnosis/forward/test_slip.py
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from arm_brachy.tissue import contact_kernels as kernels
from arm_brachy.tissue.contact_surface import PointStates, SurfaceQuadrature


@dataclass(frozen=True)
class Face:
    """The rigid face of a pad above some of k nodes.

    surface : SurfaceQuadrature, nodes as 0 to k - 1
    turn, origin : (3, 3), (3,) [m] of the core at zero displacement;  core : as the kernels take
        it;  friction : Coulomb coefficient;  law : (k, s, k_t) of `contact`
    relief : (k, 3) [m] or 0, as `contact.ContactPair` has it, of these nodes
    """

    surface: SurfaceQuadrature
    turn: np.ndarray
    origin: np.ndarray
    core: tuple
    friction: float
    law: tuple
    relief: np.ndarray | float = 0.0

    def untouched(self, y, way):
        """Return the PointStates at y (k, 3) [m] of points that have borne nothing yet."""
        scalar = np.zeros(self.surface.weights.shape)
        vector = np.zeros((*scalar.shape, 3))
        points = PointStates(vector, scalar, scalar, vector, vector, scalar)
        found = self.seen(y, way, points, lagged=True)
        return dataclasses.replace(found, anchor=found.position)

    def seen(self, y, way, points, lagged=False):
        """Return the PointStates with nodes at y (k, 3) [m], the face displaced by way (3,) [m].

        points : PointStates, of which the anchors stay, and if `lagged` all that makes friction
        """
        s, gap = self.surface, np.empty(self.surface.weights.shape)
        position, normal = np.empty((2, *gap.shape, 3))
        pressure = np.empty_like(gap)
        kernels.contact_points(y - self.relief, np.arange(len(s.faces)), s.faces, s.shape,
                               self.turn, self.origin + way, *self.core, self.law, position, gap,
                               pressure, normal)
        if lagged:
            return PointStates(position, gap, pressure, points.normal, points.anchor, points.limit)
        return PointStates(position, gap, pressure, normal, points.anchor,
                           self.friction * pressure)

    def gradient(self, y, way, points):
        """Return the gradient (k, 3) [N] of the contact potential by y, and the potential [J]."""
        s, out = self.surface, np.zeros_like(y)
        energy = kernels.contact_forces(y - self.relief, _bearing(points), s.faces, s.shape,
                                        s.weights, self.turn, self.origin + way, *self.core,
                                        self.law, points.limit, points.normal, points.anchor,
                                        out)
        return out, energy

    def bearing(self, points):
        """Return the nodes of the faces of the surface that bear."""
        return self.surface.faces[_bearing(points)].ravel()

    def add_tangent(self, y, way, points, nodes, out, lagged=False, convex=False):
        """Add the derivative of `gradient` to out (3a, 3a) [N/m], of the nodes (a,) that bear.

        lagged : limits of friction stay, else they follow the pressure
        convex : without the turning of the pressure, which may make it indefinite
        """
        s, near, size = self.surface, _bearing(points), len(out)
        faces = np.searchsorted(nodes, s.faces[near])
        columns = np.repeat(3 * faces[:, None, :], faces.shape[1], axis=1)
        kernels.contact_tangent((y - self.relief)[nodes], np.arange(len(near)), faces, s.shape,
                                s.weights[near], self.turn, self.origin + way, *self.core,
                                self.law, points.limit[near], points.normal[near],
                                points.anchor[near], convex, 0.0 if lagged else self.friction,
                                size * np.arange(size + 1), columns, out.reshape(-1))

    def drawn(self, points):
        """Return the PointStates with anchors drawn along to where the points slid."""
        size = np.linalg.norm(points.slip, axis=-1)
        elastic = np.minimum(size, points.limit / self.law[2])
        share = np.divide(elastic, size, out=np.zeros_like(size), where=size > 0.0)
        return dataclasses.replace(points, anchor=points.position - share[..., None] * points.slip)


def _bearing(points):
    """Faces of the surface with a point that bears, or that friction holds."""
    return np.flatnonzero(((points.pressure > 0.0) | (points.limit > 0.0)).any(axis=1))
