"""A rigid probe that touches the free surface: where, what it remembers, what it feels."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.tissue import contact_kernels as kernels
from arm_brachy.tissue.contact import ContactLaw
from arm_brachy.tissue.contact_poses import checked_poses
from arm_brachy.tissue.contact_surface import PointStates, surface_quadrature
from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.probe_patch import ProbePatch

# Softer than under pads: gel lies between, and a stiffer layer lets the facets of a coarse surface
# catch on the probe's edges as it slides. At 10 kPa skin of 6 kPa lies 0.3 mm behind the face.
GEL = ContactLaw(depth=1e-4, onset=3e-4)
# The face is narrower than the triangles of a usual mesh: quadrature points every 1 to 2 mm.
FINEST = 1.5e-3
MARGIN = 3e-4   # m by which faces must be clear of the probe to be left out of an iteration


@dataclass(frozen=True)
class ProbeState:
    """What is remembered of a probe between two instants.

    X_WP : (4, 4) its pose;  points : PointStates of the whole surface;  force : (n, 3) [N] the
    gradient of the contact potential: what the tissue exerts on the probe, node by node
    """

    X_WP: np.ndarray
    points: PointStates
    force: np.ndarray


class ProbeContact:
    """The free surface of a SoftBody as a ProbeFace meets it. Holds no state.

    body : SoftBody;  face : probe_face.ProbeFace;  law : contact.ContactLaw
    Raises InputError for a body without free surface.
    """

    def __init__(self, body, face, law):
        self.face, self.law = face, law.constants(body)
        faces = boundary_faces(body.mesh)
        faces = faces[~np.isin(faces, held_nodes(body)).all(axis=1)]
        if not len(faces):
            raise InputError('probe: the body has no surface that can move; nothing to touch')
        corners = body.mesh.nodes[faces]
        edge = np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1))
        divisions = max(1, int(np.ceil(edge / (3.0 * FINEST))))
        self.surface = surface_quadrature(body.mesh, faces, law.points, divisions)
        self._n = len(body.mesh.nodes)

    def start(self, x, R, p):
        """Return the ProbeState of a probe at R (3, 3), p (3,) [m] that has not touched before.

        x : (n, 3) [m]. Raises InputError for a pose that is not rigid.
        """
        X = self.pose(R, p)
        s, shape = self.surface, self.surface.weights.shape
        none, local, unused = np.zeros(shape), np.empty((*shape, 3)), np.zeros((*shape, 3))
        kernels.contact_points(x, np.zeros(0, dtype=np.int64), s.faces, s.shape, *self._core(X),
                               *self.face.shape.core, self.law, local, none, none, unused)
        points = PointStates(local, none + np.inf, none, unused, local.copy(), none.copy())
        return ProbeState(X, points, np.zeros((self._n, 3)))

    def pose(self, R, p):
        """Return X_WP (4, 4) of R (3, 3), p (3,) [m]; raises InputError if it is not rigid."""
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = R, p
        return checked_poses(X[None], (self,))[0]

    @property
    def name(self):
        """For messages."""
        return 'probe'

    def gaps(self, x, X_WP):
        """Return (f,) [m]: distance of each face's nearest point from a probe at X_WP.

        x : (n, 3) [m]. Where it is sure to exceed MARGIN, a lower bound.
        """
        s, body = self.surface, (*self._core(X_WP), *self.face.shape.core)
        least = np.empty(len(s.faces))
        kernels.clearances(x, s.faces, s.spread, *body, least)
        near = np.flatnonzero(least <= MARGIN)
        if len(near):
            shape = (len(near), len(s.shape))
            gap, normal = np.empty(shape), np.empty((*shape, 3))
            kernels.contact_points(x, np.arange(len(near)), s.faces[near], s.shape, *body,
                                   self.law, np.empty_like(normal), gap, np.empty(shape), normal)
            least[near] = gap.min(axis=1)
        return least

    def patch(self, x, X_WP, state):
        """Return the ProbePatch of faces near a probe at X_WP, anchors as of `state`; or None.

        x : (n, 3) [m]
        """
        loaded = state.points.limit.any(axis=1) | state.points.pressure.any(axis=1)
        chosen = np.flatnonzero(loaded | (self.gaps(x, X_WP) <= MARGIN))
        if not len(chosen):
            return None
        nodes, faces = np.unique(self.surface.faces[chosen], return_inverse=True)
        points = PointStates(**{name: np.ascontiguousarray(values[chosen])
                                for name, values in vars(state.points).items()})
        shape = self.face.shape
        return ProbePatch(chosen, nodes, faces.reshape(-1, self.surface.faces.shape[1]),
                          self.surface.shape, np.ascontiguousarray(self.surface.weights[chosen]),
                          *self._core(X_WP), shape.core, shape.depth, self.law,
                          self.face.friction, points)

    def _core(self, X_WP):
        return np.ascontiguousarray(X_WP[:3, :3]), np.ascontiguousarray(X_WP[:3, 3])

    def reached(self, state, x, X_WP, patch, q):
        """Return the ProbeState after a step that ended at X_WP, anchors drawn along.

        state : before it;  x : (n, 3) [m];  patch, q : as `ProbePatch.balanced` gave them; patch
        None for a probe that is clear of everything
        """
        new = self.start(x, X_WP[:3, :3], X_WP[:3, 3])
        if patch is None:
            return new
        p = patch.points
        size = np.linalg.norm(p.slip, axis=-1)
        elastic = np.minimum(size, p.limit / self.law[2])
        share = np.divide(elastic, size, out=np.zeros_like(size), where=size > 0.0)
        drawn = replace(p, anchor=p.position - share[..., None] * p.slip)
        for name, values in vars(drawn).items():
            getattr(new.points, name)[patch.chosen] = values
        new.force[patch.nodes] = q
        return new
