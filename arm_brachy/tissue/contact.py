"""Contact of the tissue's surface with rigid bodies, added to the tissue's own forces.

Every surface point q (quadrature points of the boundary triangles, rest area w_q) at signed
distance d_q from a body carries

    Pi_c = sum_q w_q (phi(d_q) + psi(s_q)),      pressure p = -phi'(d)

phi : C2, zero for d >= 0, so that contact never pulls and a body that lifts off loses its force
    exactly; pressure k (e - s / 2) at the depth e = -d, run in smoothly over the first `onset` s.
psi : Coulomb friction over the tangential distance s_q from the point's anchor,
        psi = k_t |s|^2 / 2                      while k_t |s| <= mu p*     (sticks)
              mu p* (|s| - mu p* / (2 k_t))      beyond                     (slips),
    whose gradient is the radial return of elastic-plastic Coulomb friction. A state in balance
    has mu p* = mu p (`renew`); with mu p* held (lagged), Pi_c is a potential. After a step the
    anchor is drawn along to s = t / k_t.

Why so. (1) A log barrier (Incremental Potential Contact, Li et al. 2020, ACM TOG 39:49) cannot
start from a penetration, and every step of a pad that is *moved* into tissue does; a penalty can,
and leaves a known depth: p / k + s / 2, or (2 s p / k)^1/2 below s. (2) That paper's friction
counts slip from the start of the step, so a pad that holds creeps; anchors remember (Simo &
Laursen 1992, Comput Struct 42:97; Wriggers, Computational Contact Mechanics, 2006, sec. 5.2).
(3) Coulomb's derivative, p not lagged, is unsymmetric and belongs to no potential: `linearised`
has it, for `contact_newton`; lagged, it is symmetric and can be factorised. (4) Quadrature over
faces, not nodes: coarse faces are seldom wholly in contact (test: Hertz); the sparsity stays.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.tissue import contact_kernels as kernels
from arm_brachy.tissue.contact_poses import checked_poses
from arm_brachy.tissue.contact_shapes import AbstractShape
from arm_brachy.tissue.contact_surface import PointStates, surface_quadrature
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.pattern import block_columns

# Fraction of the body's diagonal by which faces must be clear of a rigid body to be left out.
MARGIN = 0.05


@dataclass(frozen=True)
class ContactPair:
    """A rigid body and the tissue it may touch.

    shape : contact_shapes.AbstractShape;  friction : Coulomb coefficient mu >= 0
    faces : (f, 3) boundary triangles it may touch, None = all;  name : for messages
    relief : (n, 3) [m] taken off the nodes' positions before distances are, None = nothing: how
        far a face that fits the tissue rises above the shape that stands for it. Such a body may
        be shifted, not turned
    Raises ConfigError for a negative coefficient.
    """

    name: str
    shape: AbstractShape
    friction: float = 0.0
    faces: np.ndarray | None = None
    relief: np.ndarray | None = None

    def __post_init__(self):
        if not 0.0 <= self.friction < np.inf:
            raise ConfigError(f'contact {self.name}: friction = {self.friction}; must be >= 0')


@dataclass(frozen=True)
class ContactLaw:
    """Stiffness of the contact layer and resolution of the surface.

    depth, onset : [m] come in fully, the layer is so stiff that the tissue's mean Young's modulus
        costs `depth`; it comes in over the first `onset`. Pads 6 mm into the breast in quadratic
        elements bear 0.6 % less than on a layer five and more times stiffer, their force vectors
        are within 1 %; a tick of 0.2 mm is a fifth cheaper at twice both, forces 2 % off
    stick_ratio : tangential over normal stiffness of the layer: where the pressure is p, a point
        gives way by mu p depth / (stick_ratio E) before it slides
    points : quadrature points per face, 3 or 6
    """

    depth: float = 5e-6
    onset: float = 1e-5
    stick_ratio: float = 0.1
    points: int = 6

    def __post_init__(self):
        for name in ('depth', 'onset', 'stick_ratio'):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f'{name} = {getattr(self, name)}; must be > 0')

    def constants(self, body):
        """Return (k [Pa/m], s [m], k_t [Pa/m]) for a SoftBody; E = 9 kappa mu / (3 kappa + mu)."""
        E = float(np.mean(9.0 * body.kappa * body.mu / (3.0 * body.kappa + body.mu)))
        k = E / self.depth
        return k, self.onset, self.stick_ratio * k


class ContactAssembler:
    """An Assembler's face, with the contact potential of rigid bodies added.

    inner : assembly.Assembler;  pairs : ContactPair objects;  law : ContactLaw
    `evaluate`, `energy`, `forces`, `tangent`, `pattern`, `lumped_mass`, `n`, `body` are those of
    Assembler, for tissue and contact together. `place` and `renew` set the poses and the lagged
    friction. Holds that state, so it is not to be shared between solvers.
    """

    def __init__(self, inner, pairs, law=None):
        self.inner, self.body, self.n = inner, inner.body, inner.n
        self.pairs = tuple(pairs)
        self.law = ContactLaw() if law is None else law
        self._law = self.law.constants(self.body)
        self._surfaces = [self._surface(pair) for pair in self.pairs]
        self._columns = [block_columns(inner.pattern, s.faces) for s in self._surfaces]
        self._poses = [_core_pose(pair.shape, np.eye(4)) for pair in self.pairs]
        self._margin = MARGIN * np.linalg.norm(np.ptp(self.body.mesh.nodes, axis=0))
        # As far as a component of a node may move before a point can have used up the margin.
        self._reach = self._margin / np.sqrt(3.0) / max(s.spread for s in self._surfaces)
        self._near, self._near_at = None, None
        self.points = tuple(self._untouched(surface) for surface in self._surfaces)

    def _surface(self, pair):
        faces = boundary_faces(self.body.mesh) if pair.faces is None else np.asarray(pair.faces)
        held = np.isin(faces, self.body.fixed).all(axis=1)
        if held.all():
            raise InputError(f'contact {pair.name}: none of its {len(faces)} faces can move; '
                             'give it faces off the fixed region')
        return surface_quadrature(self.body.mesh, faces[~held], self.law.points)

    def _untouched(self, surface):
        scalar = np.zeros(surface.weights.shape)
        vector = np.zeros((*surface.weights.shape, 3))
        return PointStates(vector, scalar + np.inf, scalar, vector, vector, scalar)

    def _near_faces(self, b, x):
        """Faces body b may touch at x: what was clear by the margin stays so while x moves less.

        Only saves time: the faces left out add nothing.
        """
        if self._near is None or np.abs(x - self._near_at).max() > self._reach:
            self._near, self._near_at = [], x.copy()
            for i, (surface, points) in enumerate(zip(self._surfaces, self.points, strict=True)):
                clear = np.empty(len(surface.faces))
                kernels.clearances(self._flat(i, x), surface.faces, surface.spread,
                                   *self._body(i), clear)
                loaded = points.limit.any(axis=1)
                self._near.append(np.flatnonzero(loaded | (clear <= self._margin)))
        return self._near[b]

    @property
    def pattern(self):
        """(indptr, indices) of every `tangent`."""
        return self.inner.pattern

    @property
    def surfaces(self):
        """The SurfaceQuadrature of each pair."""
        return tuple(self._surfaces)

    def lumped_mass(self):
        """Return (n,) [kg], as Assembler."""
        return self.inner.lumped_mass()

    def place(self, X_WB, points):
        """Put the bodies at poses X_WB (b, 4, 4), with friction as `points` (PointStates) has it.

        Raises InputError for poses of the wrong shape or not rigid.
        """
        X_WB = checked_poses(X_WB, self.pairs)
        self._poses = [_core_pose(pair.shape, X) for pair, X in zip(self.pairs, X_WB, strict=True)]
        self.points, self._near = tuple(points), None

    def renew(self, x):
        """Renew pressure, normal and friction limit of every point from x (n, 3) [m]."""
        self.points = tuple(
            dataclasses.replace(seen, limit=pair.friction * seen.pressure)
            for pair, seen in zip(self.pairs, self.seen(x), strict=True))

    def seen(self, x):
        """Return the PointStates at x (n, 3) [m], anchors and friction limits as they are.

        Points clear of the body have the gap inf and no normal.
        """
        x = np.ascontiguousarray(x, dtype=float)
        found = []
        for b, (surface, points) in enumerate(zip(self._surfaces, self.points, strict=True)):
            new = dataclasses.replace(points, position=np.empty_like(points.position),
                                      gap=np.full_like(points.gap, np.inf),
                                      pressure=np.zeros_like(points.gap),
                                      normal=np.zeros_like(points.normal))
            kernels.contact_points(self._flat(b, x), self._near_faces(b, x), surface.faces,
                                   surface.shape, *self._body(b), self._law, new.position,
                                   new.gap, new.pressure, new.normal)
            found.append(new)
        return tuple(found)

    def least_gap(self, b, x):
        """Return the smallest signed distance [m] of the points of x (n, 3) [m] from body b."""
        s = self._surfaces[b]
        at = np.einsum('qa,fai->fqi', s.shape, self._flat(b, x)[s.faces]).reshape(-1, 3)
        return float(self._distances(b, at).min())

    def node_gaps(self, b, x):
        """Return (n,) [m]: distances of the nodes of x (n, 3) body b may touch, inf elsewhere."""
        nodes = np.unique(self._surfaces[b].faces)
        gaps = np.full(self.n, np.inf)
        gaps[nodes] = self._distances(b, self._flat(b, x)[nodes])
        return gaps

    def _distances(self, b, points):
        R, p = self._poses[b]
        y, d = np.ascontiguousarray((points - p) @ R), np.empty(len(points))
        kernels.distances(*self.pairs[b].shape.core, y, d, np.empty_like(y),
                          np.empty((len(y), 3, 3)))
        return d

    def evaluate(self, x, fields=None):
        """Return the Evaluation of tissue and contact at x (n, 3) [m]; `fields` as Assembler."""
        state = self.inner.evaluate(x, fields)
        x = np.ascontiguousarray(x, dtype=float)
        forces, energy = state.forces.copy(), state.energy
        for b in range(len(self.pairs)):
            energy += self._add_forces(b, x, forces)
        return dataclasses.replace(state, energy=energy, forces=forces)

    def energy(self, x, fields=None):
        """Return the potential [J] of tissue and contact at x (n, 3) [m]."""
        return self.evaluate(x, fields).energy

    def forces(self, x, fields=None):
        """Return its gradient (n, 3) [N]; raises InvertedElement as Assembler."""
        forces = self.inner.forces(x, fields).copy()
        for b in range(len(self.pairs)):
            self._add_forces(b, np.ascontiguousarray(x, dtype=float), forces)
        return forces

    def contact_forces(self, x):
        """Return (b, n, 3) [N]: the gradient of each body's share of the contact potential."""
        out = np.zeros((len(self.pairs), self.n, 3))
        for b in range(len(self.pairs)):
            self._add_forces(b, np.ascontiguousarray(x, dtype=float), out[b])
        return out

    def tangent(self, x, fields=None, *, convex=False):
        """Return d forces / d x (3n, 3n) [N/m] on the tissue's pattern, friction limits lagged.

        convex : not the derivative but a matrix near it, as Assembler; of the contact potential
            its positive semi-definite part
        """
        matrix = self.inner.tangent(x, fields, convex=convex)
        for b in range(len(self.pairs)):
            self._add_tangent(b, x, convex, matrix.data)
        return matrix

    def linearised(self, stiffness, x):
        """Return the derivative (3n, 3n) [N/m] of `forces` with friction renewed at each x.

        stiffness : the tissue's tangent, on `pattern`;  x : (n, 3) [m] where `renew` was called.
        Unsymmetric where points slip: there the friction limit follows the pressure.
        """
        data = stiffness.data.copy()
        for b, pair in enumerate(self.pairs):
            self._add_tangent(b, x, False, data, pair.friction)
        return csr_array((data, stiffness.indices, stiffness.indptr), shape=stiffness.shape)

    def contact_tangent(self, b, x):
        """Return the share (3n, 3n) [N/m] of body b in `tangent`."""
        indptr, indices = self.pattern
        data = np.zeros(len(indices))
        self._add_tangent(b, x, False, data)
        return csr_array((data, indices, indptr), shape=(3 * self.n, 3 * self.n))

    def _flat(self, b, x):
        """Positions (n, 3) [m] as the shape of body b sees them."""
        relief = self.pairs[b].relief
        return x if relief is None else x - relief

    def _body(self, b):
        return (*self._poses[b], *self.pairs[b].shape.core)

    def _friction(self, b):
        points = self.points[b]
        return points.limit, points.normal, points.anchor

    def _add_forces(self, b, x, out):
        s = self._surfaces[b]
        return kernels.contact_forces(self._flat(b, x), self._near_faces(b, x), s.faces, s.shape,
                                      s.weights, *self._body(b), self._law, *self._friction(b),
                                      out)

    def _add_tangent(self, b, x, convex, data, mu=0.0):
        s, x = self._surfaces[b], np.ascontiguousarray(x, dtype=float)
        kernels.contact_tangent(self._flat(b, x), self._near_faces(b, x), s.faces, s.shape,
                                s.weights, *self._body(b), self._law, *self._friction(b), convex,
                                mu, self.pattern[0], self._columns[b], data)


def _core_pose(shape, X_WB):
    """Rotation and origin of a shape's core in the world."""
    R, p = shape.mount
    return np.ascontiguousarray(X_WB[:3, :3] @ R), X_WB[:3, :3] @ p + X_WB[:3, 3]
