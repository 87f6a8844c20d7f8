"""Layers of Table 5.1 (corrected): spatially varying convolution, pooling, both folded into one.

Convolution (5.2), (5.3): y_i = ELU(sum_j (sum_k a_ijk B_k) x_j + b), a free for every vertex i,
neighbour j and basis matrix k, B and b shared. Its stride is 1: the table's 2 is the pooling's.
Pooling (5.4): y_i = sum_j |rho_ij| x_j / sum_j |rho_ij|, no activation; un-pooling likewise.

Fast form: sums over neighbours first, then one product with all of B (`Convolution`); of a wide x
the product first (`Upsampling`). The sums are products with sparse matrices. Un-pooling and the
convolution after it are both linear and fold into one set of coefficients of the coarse vertices,
independent of the batch.
x : (vertices, batch, features) throughout.  Test: estimation/graph_vae/test_layers.py
"""

import numpy as np
import torch
from torch import nn

from arm_brachy.estimation.graph_vae.sparse import Pattern

SPREAD = 0.05           # relative, of coefficients and weights at the start


class Convolution(nn.Module):
    """Spatially varying convolution on one graph, ELU after it if `active`."""

    def __init__(self, pairs, basis, features, generator, *, active=True):
        """pairs : (2, e) receiver and sender;  basis : M;  features : (in, out)."""
        super().__init__()
        self.a = _coefficients(pairs, basis, generator)
        self.B = _basis(basis, features, generator)
        self.b = nn.Parameter(torch.zeros(features[1]))
        self.active = active
        self.ends = pairs
        rows = pairs[0][:, None] * basis + np.arange(basis)
        self.near = Pattern(rows, np.repeat(pairs[1][:, None], basis, axis=1))

    def forward(self, x):
        """(vertices, batch, in) -> (vertices, batch, out)."""
        n, batch, features = x.shape
        summed = self.near.product(self.a, x.flatten(1)).view(n, -1, batch, features)
        y = summed.transpose(1, 2).flatten(2) @ self.B.flatten(0, 1) + self.b
        return nn.functional.elu(y) if self.active else y


class Pooling(nn.Module):
    """Weighted mean over each coarse vertex's neighbourhood (5.4)."""

    def __init__(self, pairs, generator):
        super().__init__()
        self.rho = nn.Parameter(_about_one(len(pairs[0]), generator))
        self.register_buffer('receiver', torch.from_numpy(pairs[0].copy()), persistent=False)
        self.near = Pattern(*pairs)

    def weights(self):
        """(pairs,) rho' of (5.4), which add up to 1 at every receiver."""
        size = self.rho.abs()
        total = size.new_zeros(self.near.shape[0]).index_add(0, self.receiver, size)
        return size / total[self.receiver]

    def forward(self, x):
        """(fine, batch, f) -> (coarse, batch, f)."""
        return self.near.product(self.weights(), x.flatten(1)).view(-1, *x.shape[1:])


class Upsampling(nn.Module):
    """Un-pooling, then a convolution on the finer graph, as one linear map of the coarse one."""

    def __init__(self, level, basis, features, generator, *, active=True):
        """level : graph.Level of the finer graph;  the rest as Convolution."""
        super().__init__()
        order = np.lexsort(level.pool)      # by fine vertex
        pairs = level.pool[::-1, order]
        self.unpool = Pooling(pairs, generator)
        self.a = _coefficients(level.edges, basis, generator)
        self.B = _basis(basis, features, generator)
        self.b = nn.Parameter(torch.zeros(features[1]))
        self.active = active
        self.ends = level.edges
        ends = self._fold(level.edges, pairs)
        self.near = Pattern(np.repeat(ends[0][:, None], basis, axis=1),
                            ends[1][:, None] * basis + np.arange(basis))
        self.pairs = ends.shape[1]

    def _fold(self, edges, pairs):
        """Every way receiver - fine neighbour - coarse vertex; returns its (2, p) ends."""
        count = np.bincount(pairs[0])
        begin, ways = np.cumsum(count) - count, count[edges[1]]
        edge = np.repeat(np.arange(edges.shape[1]), ways)
        within = np.arange(len(edge)) - np.repeat(np.cumsum(ways) - ways, ways)
        weight = begin[edges[1][edge]] + within
        ends = np.array([edges[0][edge], pairs[1][weight]])
        found, target = np.unique(ends, axis=1, return_inverse=True)
        for name, value in (('edge', edge), ('weight', weight), ('target', target.reshape(-1))):
            self.register_buffer(name, torch.from_numpy(value), persistent=False)
        return found

    def folded(self):
        """(pairs, M) coefficients A_ick = sum_j a_ijk rho'_jc of the coarse vertices."""
        ways = self.a[self.edge] * self.unpool.weights()[self.weight][:, None]
        return ways.new_zeros(self.pairs, ways.shape[1]).index_add(0, self.target, ways)

    def forward(self, x):
        """(coarse, batch, in) -> (fine, batch, out)."""
        return self.applied(x, self.folded(), self.near)

    def applied(self, x, coefficients, near):
        """The same with the coefficients and the Pattern given: of some receivers only."""
        basis, _, out = self.B.shape
        z = (x @ self.B.transpose(0, 1).flatten(1)).unflatten(2, (basis, out))
        z = z.transpose(1, 2).reshape(len(x) * basis, -1)
        y = near.product(coefficients, z).view(-1, x.shape[1], out) + self.b
        return nn.functional.elu(y) if self.active else y


def _coefficients(pairs, basis, generator):
    """(e, M): the mean over the neighbours, more or less."""
    count = torch.from_numpy(np.bincount(pairs[0])[pairs[0]])
    draws = torch.randn(len(count), basis, generator=generator)
    return nn.Parameter((1.0 + draws) / count[:, None])


def _basis(basis, features, generator):
    """(M, in, out), Glorot's variance shared among the M."""
    size = (2.0 / (sum(features) * basis)) ** 0.5
    return nn.Parameter(size * torch.randn(basis, *features, generator=generator))


def _about_one(count, generator):
    return 1.0 + SPREAD * torch.randn(count, generator=generator)
