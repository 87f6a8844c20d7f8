"""Which points of a body at rest are where now: a deformed mesh, inverted.

Linear within an element's corners, also where the mesh is quadratic. Not for points outside.
"""

import numpy as np

_ROUNDING = 1e-6    # of a barycentric coordinate
_FLAT = 1e-9        # of the largest volume, below which an element has none


def at_rest(points, positions, rest, tets):
    """Return where material points that are at `points` (k, 3) [m] lie in the body at rest.

    positions, rest : (n, 3) [m] of the nodes now and at rest;  tets : (m, 4) corners
    A point outside of every element, by more than a rounding, gives NaN. Elements without volume
    hold nothing.
    """
    corners = positions[tets]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1])
    whole = np.abs(volume) > _FLAT * np.abs(volume).max(initial=0.0)
    tets, corners = tets[whole], corners[whole]
    inverse = np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2))
    out = np.full((len(points), 3), np.nan)
    for k, point in enumerate(points):
        weights = np.einsum('mij,mj->mi', inverse, point - corners[:, 0])
        weights = np.column_stack([1.0 - weights.sum(axis=1), weights])
        best = weights.min(axis=1).argmax()
        if weights[best].min() > -_ROUNDING:
            out[k] = weights[best] @ rest[tets[best]]
    return out
