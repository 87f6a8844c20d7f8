"""Elements that the study of accuracy compares, run by the engine's own kernels.

All on the energy (3.18):

linear               constant strain, the thesis' element
linear, smoothed     the same nodes; isochoric part with the strain averaged over the elements at
                     an edge, volume part over those at a node (Liu & Nguyen-Thoi, Smoothed
                     Finite Element Methods, 2010)
quadratic            as the engine has it (`tissue.element`): near nu = 0.5 one volume constraint
                     for each element
quadratic, in full   every part of the energy at all four points: four constraints
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.element import (
    EDGES,
    ElementGeometry,
    linear_tet,
    quadratic_tet,
)

LINEAR, SMOOTHED, IN_FULL, QUADRATIC = ELEMENTS = (
    'linear', 'linear, smoothed', 'quadratic, in full', 'quadratic')


@dataclass(frozen=True)
class PatchedBody(SoftBody):
    """A SoftBody that integrates over other pieces than its elements; moduli are per piece.

    pieces : ElementGeometry, several kinds of piece stacked and padded to one shape
    """

    pieces: ElementGeometry = None

    @cached_property
    def geometry(self):
        """The ElementGeometry that the engine's kernels run over."""
        return self.pieces


def with_element(body, element):
    """Return the SoftBody as an element integrates it.

    body : homogeneous SoftBody, its mesh with midside nodes if the element is quadratic
    element : one of ELEMENTS
    """
    if element in (LINEAR, QUADRATIC):
        return body
    if element == IN_FULL:
        mesh = body.mesh
        whole = quadratic_tet(mesh.nodes, mesh.connectivity, np.ones(len(mesh.tets)))
        return _patched(body, whole)
    shear, volume = _smoothed(body.mesh)
    count = len(shear[0]), len(volume[0])
    return _patched(body, _stacked(shear, volume),
                    mu=np.repeat([body.mu[0], 0.0], count),
                    kappa=np.repeat([0.0, body.kappa[0]], count),
                    density=np.repeat([body.density[0], 0.0], count))


def _patched(body, pieces, **moduli):
    own = {name: getattr(body, name) for name in body.__dataclass_fields__}
    return PatchedBody(**own | moduli, pieces=pieces)


def _stacked(*kinds):
    """ElementGeometry of pieces (connectivity, gradients, weights) of several kinds, padded.

    What is added are nodes without gradient. All points are alike; moduli tell the kinds apart.
    """
    a = max(conn.shape[1] for conn, _, _ in kinds)
    conns, gradients = [], []
    for conn, gradient, _ in kinds:
        nodes = a - conn.shape[1]
        conns.append(np.pad(conn, ((0, 0), (0, nodes)), mode='edge'))
        gradients.append(np.pad(gradient, ((0, 0), (0, 0), (0, nodes), (0, 0))))
    weights = np.concatenate([weight for _, _, weight in kinds])
    return ElementGeometry(np.concatenate(conns), np.concatenate(gradients), weights, weights,
                           np.ones(len(weights)), np.full((1, a), 1.0 / a), np.eye(a) / a)


def _smoothed(mesh):
    """Pieces around edges (isochoric part) and around nodes (volume) of linear elements."""
    edges = np.sort(mesh.tets[:, EDGES], axis=2).reshape(-1, 2)
    which = np.unique(edges, axis=0, return_inverse=True)[1].reshape(-1, len(EDGES))
    return _averaged(mesh, which), _averaged(mesh, mesh.tets)


def _averaged(mesh, domains):
    """One piece for each domain: gradients averaged over the equal shares that elements give it.

    domains : (m, k) the domains that each element gives the k-th part of its volume to
    """
    linear, k, n = linear_tet(mesh.nodes, mesh.tets), domains.shape[1], len(mesh.nodes)
    share = np.repeat(linear.weights[:, 0] / k, k)
    owner = domains.ravel()
    volume = np.bincount(owner, share)
    parts = np.repeat(linear.gradients[:, 0], k, axis=0) * (share / volume[owner])[:, None, None]
    key = owner[:, None] * n + np.repeat(mesh.tets, k, axis=0)
    pairs, slot = np.unique(key, return_inverse=True)
    summed = np.stack([np.bincount(slot.ravel(), parts[..., i].ravel()) for i in range(3)], axis=1)
    domain, node = np.divmod(pairs, n)
    start = np.searchsorted(domain, np.arange(len(volume)))
    place = np.arange(len(pairs)) - start[domain]
    conn = np.repeat(node[start][:, None], place.max() + 1, axis=1)
    gradients = np.zeros((*conn.shape, 3))
    conn[domain, place], gradients[domain, place] = node, summed
    return conn, gradients[:, None], volume[:, None]
