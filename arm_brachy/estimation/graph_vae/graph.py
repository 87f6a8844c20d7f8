"""The graphs of a mesh, each coarser than the last, on which the network of Table 5.1 works.

Vertices are all nodes, corners and mid-edges; edges are those of the eight small tetrahedra that
an element splits into, but for its inner diagonal. Centres of a coarser graph are met breadth
first, each covering what is within stride - 1 hops; those within 2 stride - 1 hops are joined.
A coarse vertex pools what is within `radius` hops of its centre (Zhou et al. 2020, NeurIPS,
"Fully convolutional mesh autoencoder using efficient spatially varying kernels", sec. 3.2).
Test: estimation/graph_vae/test_graph.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.element import EDGES

STRIDE, RADIUS = 2, 1   # Table 5.1, of its pooling layers; its convolutions keep the vertices
POOLINGS = 3


@dataclass(frozen=True)
class Level:
    """One graph and how the next coarser one pools it.

    edges : (2, e) receiving and sending vertex, every vertex to itself too, by receiver
    centres : (c,) vertices that stand for the coarser graph's
    pool : (2, p) coarse and fine vertex of each that is pooled, by coarse vertex
    """

    edges: np.ndarray
    centres: np.ndarray
    pool: np.ndarray

    @property
    def size(self):
        """Number of vertices."""
        return int(self.edges[0].max()) + 1


def mesh_graph(mesh):
    """Return the adjacency (n, n) of a TetMesh's nodes, csr, True, no vertex with itself."""
    n = len(mesh.nodes)
    if mesh.midside is None:
        pairs = mesh.tets[:, EDGES].reshape(-1, 2)
    else:
        ends = np.array(EDGES)
        touching = np.array([(a, b) for a in range(6) for b in range(a)
                             if set(ends[a]) & set(ends[b])])
        corners = np.stack([mesh.tets[:, ends], np.repeat(mesh.midside[:, :, None], 2, axis=2)],
                           axis=-1)
        pairs = np.concatenate([corners.reshape(-1, 2), mesh.midside[:, touching].reshape(-1, 2)])
    return _symmetric(pairs, n)


def hierarchy(adjacency, start=0):
    """Return POOLINGS Levels, finest first; the last one's centres are the coarsest graph.

    start : vertex from which centres are met
    Raises MeshError if the graph is in several pieces.
    """
    pieces = connected_components(adjacency, directed=False)[0]
    if pieces != 1:
        raise MeshError(f'graph of the mesh: {pieces} pieces; must be one body')
    levels = []
    for _ in range(POOLINGS):
        centres = _centres(adjacency, start)
        near = _within(adjacency, RADIUS)[centres].tocoo()
        levels.append(Level(_sorted(_within(adjacency, 1).tocoo()), centres, _sorted(near)))
        joined = _within(adjacency, 2 * STRIDE - 1)[centres][:, centres]
        adjacency = csr_array(joined - eye_array(len(centres), dtype=int).tocsr(), dtype=int)
        adjacency.eliminate_zeros()
        start = 0
    return tuple(levels)


def _centres(adjacency, start):
    """Vertices, in the order met, none within stride - 1 hops of another."""
    reach = _within(adjacency, STRIDE - 1)
    covered, centres = np.zeros(adjacency.shape[0], dtype=bool), []
    for v in breadth_first_order(adjacency, start, directed=False,
                                 return_predecessors=False).tolist():
        if not covered[v]:
            centres.append(v)
            covered[reach.indices[reach.indptr[v]:reach.indptr[v + 1]]] = True
    return np.array(centres)


def _within(adjacency, hops):
    """(n, n) ones where a vertex is at most so many hops away."""
    step = csr_array(adjacency + eye_array(adjacency.shape[0], dtype=int).tocsr(), dtype=int)
    step.data[:] = 1
    reach = step
    for _ in range(hops - 1):
        reach = csr_array(reach @ step)
        reach.data[:] = 1
    return reach


def _symmetric(pairs, n):
    both = np.concatenate([pairs, pairs[:, ::-1]])
    graph = csr_array(coo_array((np.ones(len(both), dtype=int), both.T), shape=(n, n)))
    graph.data[:] = 1
    return graph


def _sorted(coo):
    row, column = coo.coords
    return np.array([row, column])[:, np.lexsort((column, row))].astype(np.int64)
