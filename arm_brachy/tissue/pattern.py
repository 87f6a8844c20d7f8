"""Where blocks lie in the sparsity pattern of a tangent."""

import numpy as np


def block_columns(pattern, groups):
    """Return where (g, a, a) in its rows the 3 x 3 block of two nodes of a group begins.

    pattern : (indptr, indices) of a matrix of 3 x 3 blocks, columns sorted
    groups : (g, a) nodes that share an element, so that the pattern has their blocks
    """
    indptr, indices = pattern
    if not groups.size:
        return np.zeros((*groups.shape, groups.shape[1]), dtype=np.int64)
    first = 3 * np.repeat(groups[:, :, None], groups.shape[1], axis=2)
    column = np.swapaxes(first, 1, 2)
    width = 3 * int(groups.max()) + 3
    rows = np.repeat(np.arange(len(indptr) - 1, dtype=np.int64), np.diff(indptr))
    keys = rows * max(width, int(indices.max()) + 1) + indices
    wanted = first * max(width, int(indices.max()) + 1) + column
    return np.searchsorted(keys, wanted) - indptr[first]
