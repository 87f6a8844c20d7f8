"""Products with sparse matrices of a fixed pattern whose entries are learned.

Test: estimation/graph_vae/test_layers.py
"""

import warnings

import numpy as np
import torch
from torch import nn

# torch says of every sparse CSR tensor that its interface may change; the version is pinned.
warnings.filterwarnings('ignore', message='Sparse CSR tensor support', category=UserWarning)


class Pattern(nn.Module):
    """Where a sparse matrix has entries: rows and columns, any shape, in the order of the values.

    Every row and column up to the largest exists; size : (rows, columns) where that is not so
    """

    def __init__(self, rows, columns, size=None):
        super().__init__()
        rows, columns = np.ravel(rows), np.ravel(columns)
        self.shape = size or (int(rows.max()) + 1, int(columns.max()) + 1)
        order, across = np.lexsort((columns, rows)), np.lexsort((rows, columns))
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        tables = {'order': order, 'begin': _begin(rows, self.shape[0]), 'column': columns[order],
                  'row': rows[order], 'across': place[across],
                  'begin_t': _begin(columns, self.shape[1]), 'column_t': rows[across]}
        for name, table in tables.items():
            self.register_buffer(name, torch.from_numpy(table), persistent=False)

    def product(self, values, x):
        """Matrix with these values (as many as entries, any shape) times x (columns, f)."""
        return _Product.apply(values.flatten()[self.order], x, self)

    def matrix(self, values):
        """The matrix; values in the order of its rows."""
        return torch.sparse_csr_tensor(self.begin, self.column, values, self.shape,
                                       check_invariants=False)

    def transposed(self, values):
        """Its transpose."""
        return torch.sparse_csr_tensor(self.begin_t, self.column_t, values[self.across],
                                       self.shape[::-1], check_invariants=False)


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values, x, pattern):
        ctx.save_for_backward(values, x)
        ctx.pattern = pattern
        return pattern.matrix(values) @ x

    @staticmethod
    def backward(ctx, slope):
        values, x = ctx.saved_tensors
        of_values = of_x = None
        slope = slope.contiguous()
        if ctx.needs_input_grad[0]:
            zero = ctx.pattern.matrix(torch.zeros_like(values))
            of_values = torch.sparse.sampled_addmm(zero, slope, x.T).values()
        if ctx.needs_input_grad[1]:
            of_x = ctx.pattern.transposed(values) @ slope
        return of_values, of_x, None


def _begin(rows, count):
    return np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=count))])
