"""A layer under the curved surface, thinner than the elements, integrated on its own points."""
from dataclasses import dataclass

import numpy as np
from numba import njit

from arm_brachy.prove.generator.assembly import deformation, dot
from arm_brachy.prove.generator.elements import BARYCENTRIC, slopes, triangle_rule
from arm_brachy.prove.generator.law import cofactor
from arm_brachy.prove.generator.tets import FACES

DEPTHS, DEPTH_WEIGHTS = np.array([0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)]), [0.5, 0.5]


@njit(cache=True)
def excess_forces(u, tets, dn, volume, mu, f):
    """Add to f (n, 3) the forces of the stress mu (F - cof F) at the layer's points."""
    for e in range(tets.shape[0]):
        for q in range(volume.shape[1]):
            F = deformation(u, tets[e], dn[e, q])
            P = mu * volume[e, q] * (F - cofactor(F)[1])
            for n in range(tets.shape[1]):
                for i in range(3):
                    f[tets[e, n], i] += dot(P[i], dn[e, q, n])


@njit(cache=True)
def excess_stiffness(u, tets, dn, volume, mu, where, data):
    """Add to `data`, at the places `where` (f, d, d), the derivative of these forces."""
    for e in range(tets.shape[0]):
        for q in range(volume.shape[1]):
            F = deformation(u, tets[e], dn[e, q])
            d = dn[e, q]
            w = mu * volume[e, q]
            for n in range(tets.shape[1]):
                for o in range(tets.shape[1]):
                    # d cof F / dF is linear in F: i, m and what is left over, l, by their order.
                    c = np.cross(d[n], d[o])
                    same = w * dot(d[n], d[o])
                    for i in range(3):
                        for m in range(3):
                            k = same if i == m else 0.0
                            if i != m:
                                left = 3 - i - m
                                turn = 1.0 if (m - i) % 3 == 1 else -1.0
                                k -= turn * w * dot(c, F[left])
                            at = where[e, 3 * n + i, 3 * o + m]
                            if at >= 0:
                                data[at] += k


@dataclass(frozen=True)
class Layer:
    """What a stiffer layer adds, as a load on the elements `owners` with nodes `tets`.

    slopes (f, q, 10, 3), volume (f, q) of its points; mu [Pa]: its excess of shear modulus.
    The excess stress is mu (F - cof F), which is neo-Hookean where volume is kept and, unlike
    laws with a power of J, finite where the field between integration points is poor, as beside
    a rim.
    """

    owners: np.ndarray
    tets: np.ndarray
    slopes: np.ndarray
    volume: np.ndarray
    mu: float

    def add(self, u, f):
        """Add the forces of the layer's excess stress."""
        excess_forces(u, self.tets, self.slopes, self.volume, self.mu, f)

    def stiffen(self, u, data, pattern):
        """Add the derivative of these forces."""
        excess_stiffness(u, self.tets, self.slopes, self.volume, self.mu,
                         pattern.where[self.owners], data)


def make_layer(grid, thickness, excess):
    """`Layer` of `thickness` [m] under the surface, its shear modulus greater by `excess` [Pa].

    thickness : a number, or a function of places (f, 7, 3) on the surface [m] that gives (f, 7)
    Points: seven on the face by two in depth, in every element with a face on the surface.
    """
    owners, opposite = owners_of(grid.mesh)
    x = grid.nodes[grid.mesh.tets[owners]]
    n, _, w = triangle_rule()
    flat = n[:, :3] + 0.5 * n[:, [3, 4, 5]] + 0.5 * n[:, [5, 3, 4]]
    face = inward(flat, opposite, np.zeros((len(owners), 7)))
    if callable(thickness):
        thickness = thickness(np.einsum('fqa,fai->fqi', face, x[:, :4]))
    share = np.minimum(thickness * steepness(x, face, opposite), 1.0)
    bary = np.hstack([inward(flat, opposite, share * d) for d in DEPTHS])
    dn = slopes(bary)
    jac = np.einsum('mai,mqaj->mqij', x, dn)
    # What of the layer lies in elements with a mere edge on the surface is counted here too.
    normal = np.linalg.norm(np.cross(*tangents(x, face, opposite)), axis=2) * w * thickness
    volume = np.hstack([normal * dw for dw in DEPTH_WEIGHTS])
    return Layer(owners, grid.mesh.tets[owners],
                 np.einsum('mqaj,mqji->mqai', dn, np.linalg.inv(jac)),
                 volume, excess)


def inward(flat, opposite, s):
    """Barycentric coordinates (f, 7, 4): points `flat` (7, 3) of a face, by share s (f, 7) of
    the way to the corner `opposite` (f,).
    """
    others = np.array([[j for j in range(4) if j != o] for o in range(4)])[opposite]
    bary = np.zeros((*s.shape, 4))
    f, q = np.indices(s.shape)
    for k in range(3):
        bary[f, q, others[:, [k]]] = (1 - s) * flat[:, k]
    bary[f, q, opposite[:, None]] = s
    return bary


def steepness(x, bary, opposite):
    """Growth (f, 7) [1/m] of the coordinate of corner `opposite` along the normal of its face."""
    inverse = np.linalg.inv(np.einsum('mai,mqaj->mqij', x, slopes(bary)))
    growth = np.einsum('cj,mqji->mqci', BARYCENTRIC, inverse)
    f, q = np.indices(bary.shape[:2])
    return np.linalg.norm(growth[f, q, opposite[:, None]], axis=-1)


def tangents(x, bary, opposite):
    """Two tangents (f, 7, 3) of the face across from corner `opposite`, by its coordinates."""
    others = np.array([[j for j in range(4) if j != o] for o in range(4)])[opposite]
    jac = np.einsum('mai,mqaj->mqij', x, slopes(bary))
    steps = np.eye(4)[others] @ np.vstack([np.zeros(3), np.eye(3)])
    return [np.einsum('mqij,mj->mqi', jac, steps[:, k] - steps[:, 0]) for k in (1, 2)]


def owners_of(mesh):
    """Elements with a face on the curved surface (f,), and which of their corners is off it."""
    n = mesh.corners
    corners = np.sort(mesh.tets[:, FACES], axis=2).astype(np.int64)
    keys = (corners[..., 0] * n + corners[..., 1]) * n + corners[..., 2]
    outer = np.sort(mesh.surface[:, :3], axis=1).astype(np.int64)
    wanted = (outer[:, 0] * n + outer[:, 1]) * n + outer[:, 2]
    return np.nonzero(np.isin(keys, wanted))
