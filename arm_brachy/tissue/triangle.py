"""The point of a triangle that is nearest to a given point.

The arithmetic is that of `trimesh.triangles.closest_point`, to the bit. Importing it there loads
400 modules, a fifth of what a process of the cell takes to start.
Source: Ericson, Real-Time Collision Detection (2005), section 5.1.5.
Test: tissue/test_triangle.py
"""

import numpy as np

ROUNDING = 1e-13    # m^2: products of sides that count as zero


def closest_points(triangles, point):
    """Return (m, 3) [m], of each triangle the point that is nearest to `point`.

    triangles : (m, 3, 3) corners, one per row; without area they are segments or points
    point : (3,), or (m, 3) one for each triangle
    Valid for sides well over ROUNDING's root, 0.3 um.
    """
    a, b, c = (triangles[:, i] for i in range(3))
    ab, ac = b - a, c - a
    d1, d2 = _dot(ab, point - a), _dot(ac, point - a)
    d3, d4 = _dot(ab, point - b), _dot(ac, point - b)
    d5, d6 = _dot(ab, point - c), _dot(ac, point - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    d43 = d4 - d3
    flat = _ratio(1.0, va + vb + vc)
    regions = (
        ((d1 < ROUNDING) & (d2 < ROUNDING), a),
        (np.all(ab == 0.0, axis=1), a + np.clip(_ratio(d2, _dot(ac, ac)), 0.0, 1.0) * ac),
        ((d3 > -ROUNDING) & (d4 <= d3), b),
        ((vc < ROUNDING) & (d1 > -ROUNDING) & (d3 < ROUNDING), a + _ratio(d1, d1 - d3) * ab),
        ((d6 > -ROUNDING) & (d5 <= d6), c),
        ((vb < ROUNDING) & (d2 > -ROUNDING) & (d6 < ROUNDING), a + _ratio(d2, d2 - d6) * ac),
        ((va < ROUNDING) & (d43 > -ROUNDING) & (d5 - d6 > -ROUNDING),
         b + _ratio(d43, d43 + (d5 - d6)) * (c - b)))
    return np.select([where[:, None] for where, _ in regions], [there for _, there in regions],
                     a + ab * (vb[:, None] * flat) + ac * (vc[:, None] * flat))


def _dot(u, v):
    return (u * v) @ np.ones(3)


def _ratio(part, whole):
    """Quotients (m, 1), 0 of what is divided by zero."""
    return np.divide(part, whole, out=np.zeros_like(whole), where=whole != 0.0)[:, None]
