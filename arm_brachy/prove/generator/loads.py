"""What acts on the body besides its pads: springs, contact, weight, a finger; all dead or local.

Each has `add(u, f)`, which adds to internal forces f (n, 3) what the load exerts, with its sign
turned, and `stiffen(u, data, pattern)`, which adds its derivative to the matrix.
"""
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.prove.generator.elements import POINTS, shapes


@dataclass(frozen=True)
class Dead:
    """Constant nodal forces (n, 3) [N]."""

    nodal: np.ndarray

    def add(self, u, f):
        """Take the load from the internal forces."""
        f -= self.nodal

    def stiffen(self, u, data, pattern):
        """Nothing: the load does not follow."""


def weight(grid, density, acceleration):
    """`Dead` load of density [kg/m^3], a number or (m, q), times acceleration (3,) [m/s^2]."""
    nodal = np.zeros(grid.nodes.shape)
    share = np.einsum('mq,qa->ma', density * grid.slopes[1], shapes(POINTS))
    np.add.at(nodal, grid.mesh.tets.ravel(), share.reshape(-1, 1) * np.asarray(acceleration))
    return Dead(nodal)


def biweight(x, centre, radius):
    """Biweight kernel (...) about `centre` of points (..., 3)."""
    r2 = ((x - centre)**2).sum(-1) / radius**2
    return np.where(r2 < 1, (1 - np.minimum(r2, 1))**2, 0.0)


def disc(x, centre, radius):
    """Kernel (...) that is one within `radius` of `centre`, with an edge of a tenth of that."""
    away = np.sqrt(((x - centre)**2).sum(-1)) / radius
    return np.clip((1.05 - away) / 0.1, 0.0, 1.0)


def finger(grid, force, centre, radius, kernel=biweight):
    """`Dead` load of `force` (3,) [N] spread over the surface by a kernel."""
    x, area, n = grid.face_points(grid.mesh.surface)
    b = kernel(x, np.asarray(centre), radius) * np.linalg.norm(area, axis=2)
    nodal = np.zeros(grid.nodes.shape)
    share = np.einsum('fq,qa->fa', b, n) / b.sum()
    np.add.at(nodal, grid.mesh.surface.ravel(), share.reshape(-1, 1) * np.asarray(force))
    return Dead(nodal)


@dataclass(frozen=True)
class Support:
    """Elastic or one-sided support of faces (f, 6) at their integration points.

    shape (7, 6); start (f, 7, 3) [m] their positions at rest; springs (f, 7, 3, 3) [N/m] that
    always act; wall (f, 7) [N/m] stiffness against positions beyond `offset` (f, 7) [m] along
    the unit vector `normal` (3,); on_base: it goes with the base, by `shift` [m], (3,) or
    (f, 7, 3).
    """

    faces: np.ndarray
    shape: np.ndarray
    start: np.ndarray
    springs: np.ndarray
    wall: np.ndarray
    normal: np.ndarray
    offset: np.ndarray
    on_base: bool = False
    shift: tuple = (0.0, 0.0, 0.0)

    def carried(self, shift):
        """The support with the base moved by `shift`, a function of places (..., 3) [m]."""
        return replace(self, shift=shift(self.start)) if self.on_base else self

    def _pressing(self, u):
        moved = np.einsum('qa,fai->fqi', self.shape, u[self.faces]) - self.shift
        beyond = (self.start + moved) @ self.normal - self.offset
        return moved, np.where(beyond > 0, beyond, 0.0)

    def add(self, u, f):
        """Add the resistance of the support."""
        moved, beyond = self._pressing(u)
        push = np.einsum('fqij,fqj->fqi', self.springs, moved)
        push += (self.wall * beyond)[..., None] * self.normal
        np.add.at(f, self.faces.ravel(),
                  np.einsum('qa,fqi->fai', self.shape, push).reshape(-1, 3))

    def stiffen(self, u, data, pattern):
        """Add the derivative of the resistance."""
        _, beyond = self._pressing(u)
        k = self.springs + np.where(beyond > 0, self.wall, 0.0)[..., None, None] * np.outer(
            self.normal, self.normal)
        entries = np.einsum('qa,fqij,qb->faibj', self.shape, k, self.shape)
        dofs = 3 * self.faces[:, :, None] + np.arange(3)
        rows = np.broadcast_to(dofs[:, :, :, None, None], entries.shape)
        columns = np.broadcast_to(dofs[:, None, None], entries.shape)
        upper = rows <= columns
        np.add.at(data, pattern.find(rows[upper], columns[upper]), entries[upper])


def springs(grid, normal, tangential, factor=None):
    """Winkler foundation under the whole base, moduli along and across its normal [Pa/m].

    factor : on both, a function of places (..., 3) [m]
    """
    x, area, shape = grid.face_points(grid.mesh.base)
    k = np.diag([tangential, tangential, normal])
    size = np.linalg.norm(area, axis=2)
    if factor is not None:
        size = size * factor(x)
    none = np.zeros(size.shape)
    return Support(grid.mesh.base, shape, x, size[..., None, None] * k, none,
                   np.array([0, 0, 1.0]), none, on_base=True)


def loose_base(grid, loose, stiff):
    """Base glued, by springs `stiff` [Pa/m], but where it can only press on the plate.

    loose : function of places (f, 7, 3) and their areas (f, 7) that gives where (f, 7), bool
    """
    x, area, shape = grid.face_points(grid.mesh.base)
    size = np.linalg.norm(area, axis=2) * stiff
    free = loose(x, size / stiff)
    glue = np.where(free, 0.0, size)[..., None, None] * np.eye(3)
    return Support(grid.mesh.base, shape, x, glue, np.where(free, size, 0.0),
                   np.array([0, 0, -1.0]), np.zeros(size.shape), on_base=True)


def wall(grid, centre, radius, normal, gap, stiff, bend=0.0):
    """Wall `gap` [m] off the surface round `centre`, with outward normal (3,) of that.

    bend : curvature of the wall, which bulges towards the body where it is positive [1/m]
    """
    x, area, shape = grid.face_points(grid.mesh.surface)
    b = biweight(x, np.asarray(centre), radius)
    near = (b > 0).any(1)
    x, area, b = x[near], area[near], b[near]
    arm = x - centre
    aside = (arm**2).sum(-1) - (arm @ normal)**2
    away = bend * aside / 2
    reach = (x @ normal - away)[b > 0].max() + gap
    stiffness = stiff * b * np.linalg.norm(area, axis=2)
    return Support(grid.mesh.surface[near], shape, x, np.zeros((*b.shape, 3, 3)), stiffness,
                   np.asarray(normal), reach + away)
