"""One-sided support by rigid ground: points of the surface press on it and never pull.

A point of the surface at u = sum_a N_a (x_a - X_a) from rest, over ground displaced by b, has the
gap d = d_0 + n . (u - b) and adds to the potential

    phi(d) + 1/2 g |u - b|^2,      force -phi'(d) along n

phi is that of contact (`contact_kernels.pressure_law`): zero for d >= 0, and below so stiff that
the tissue sinks in by a stated depth. Unlike the bodies of `contact`, ground has no edges and no
friction and knows its points beforehand, so that its potential is convex and belongs to the
tissue's own: statics, dynamics and contact find it in `Assembler`. g is glue where a bond is left.
In the tangent a point that just touches counts as closed, although phi'' starts from zero there: a
body at rest on the ground would otherwise take its first step into the ground under its own
weight, farther than Newton finds back from.
"""

from dataclasses import replace

import numpy as np
from numba import njit

from arm_brachy.tissue.body import Supports
from arm_brachy.tissue.contact import ContactLaw
from arm_brachy.tissue.contact_kernels import pressure_law
from arm_brachy.tissue.contact_surface import surface_quadrature


class SupportForces:
    """Energy, forces and tangent of Supports, on the tangent's sparsity pattern.

    supports : body.Supports;  columns : (s, a, a) as `assembly.block_columns`, of their nodes
    indptr : of the pattern
    """

    def __init__(self, supports, columns, indptr):
        self.supports, self._columns, self._indptr = supports, columns, indptr

    def add_forces(self, u, base, out):
        """Add the gradient to `out` (n, 3) [N]; return the energy [J].

        u : (n, 3) [m] displacements from rest;  base : (3,) [m] that of the base
        """
        return _add_forces(u, base, *_arrays(self.supports), out)

    def add_tangent(self, u, base, data):
        """Add the Hessian to the values of the tangent; u, base : as in `add_forces`."""
        _add_tangent(u, base, *_arrays(self.supports), self._indptr, self._columns, data)


def reactions(supports, u, base):
    """Return gap (s,) [m] and force (s,) [N], >= 0, of Supports on the tissue along the normals.

    u : (n, 3) [m] displacements from rest;  base : (3,) [m] that of the base. Glue is left out.
    """
    gap, force = np.empty((2, len(supports.nodes)))
    _reactions(u, base, *_arrays(supports), gap, force)
    return gap, force


def support_points(body, faces):
    """Return Supports at the quadrature points of boundary faces, ground where the surface rests.

    body : SoftBody;  faces : (f, 3)
    As stiff as contact.ContactLaw makes contact with a body of this modulus. No glue; the base
    carries the ground.
    """
    surface = surface_quadrature(body.mesh, faces)
    corners = body.mesh.nodes[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = -area / np.linalg.norm(area, axis=1, keepdims=True)
    f, q = surface.weights.shape
    k, onset, _ = ContactLaw().constants(body)
    return Supports(np.repeat(surface.faces, q, axis=0), np.tile(surface.shape, (f, 1)),
                    np.repeat(inward, q, axis=0), np.zeros(f * q), k * surface.weights.ravel(),
                    np.full(f * q, onset), np.zeros(f * q), np.ones(f * q))


def positions(supports, x):
    """Return where the points of Supports are, (s, 3) [m], with the nodes at x (n, 3)."""
    return np.einsum('sa,sai->si', supports.shape, x[supports.nodes])


def chosen(supports, keep):
    """Return the Supports of the points where `keep` (s,) is true."""
    return replace(supports, **{name: values[keep] for name, values in vars(supports).items()})


def _arrays(supports):
    return tuple(np.ascontiguousarray(values) for values in vars(supports).values())


@njit(cache=True, error_model='numpy')
def _offset(s, u, base, nodes, shape, carried, w):
    """Write the displacement w (3,) of point s against its ground."""
    for i in range(3):
        w[i] = -carried[s] * base[i]
        for a in range(nodes.shape[1]):
            w[i] += shape[s, a] * u[nodes[s, a], i]


@njit(cache=True, error_model='numpy')
def _gap(s, w, normal, gap):
    return gap[s] + normal[s, 0] * w[0] + normal[s, 1] * w[1] + normal[s, 2] * w[2]


@njit(cache=True, error_model='numpy')
def _add_forces(u, base, nodes, shape, normal, gap, stiffness, onset, glue, carried, out):
    w, energy = np.empty(3), 0.0
    for s in range(nodes.shape[0]):
        _offset(s, u, base, nodes, shape, carried, w)
        stored, p, _ = pressure_law(_gap(s, w, normal, gap), stiffness[s], onset[s])
        energy += stored
        for i in range(3):
            energy += 0.5 * glue[s] * w[i] * w[i]
            pull = glue[s] * w[i] - p * normal[s, i]
            for a in range(nodes.shape[1]):
                out[nodes[s, a], i] += shape[s, a] * pull
    return energy


@njit(cache=True, error_model='numpy')
def _add_tangent(u, base, nodes, shape, normal, gap, stiffness, onset, glue, carried, indptr,
                 columns, data):
    w, size = np.empty(3), nodes.shape[1]
    for s in range(nodes.shape[0]):
        _offset(s, u, base, nodes, shape, carried, w)
        d = _gap(s, w, normal, gap)
        k = stiffness[s] if d == 0.0 else pressure_law(d, stiffness[s], onset[s])[2]
        for a in range(size):
            for b in range(size):
                share = shape[s, a] * shape[s, b]
                for i in range(3):
                    at = indptr[3 * nodes[s, a] + i] + columns[s, a, b]
                    data[at + i] += share * glue[s]
                    for j in range(3):
                        data[at + j] += share * k * normal[s, i] * normal[s, j]


@njit(cache=True, error_model='numpy')
def _reactions(u, base, nodes, shape, normal, gap, stiffness, onset, glue, carried, gaps, forces):
    w = np.empty(3)
    for s in range(nodes.shape[0]):
        _offset(s, u, base, nodes, shape, carried, w)
        gaps[s] = _gap(s, w, normal, gap)
        forces[s] = pressure_law(gaps[s], stiffness[s], onset[s])[1]
