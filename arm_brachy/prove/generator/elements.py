"""Shape functions of the ten-node tetrahedron at its integration points."""
import numpy as np

from arm_brachy.prove.generator.tets import EDGES

# Four points, exact to degree two (Keast 1986, Comput Methods Appl Mech Eng 55:339).
A, B = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20
POINTS = np.full((4, 4), B) + (A - B) * np.eye(4)
BARYCENTRIC = np.array([[-1.0, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def shapes(bary):
    """Ten quadratic shape functions (..., 10) at barycentric coordinates (..., 4)."""
    i, j = EDGES.T
    return np.concatenate([bary * (2 * bary - 1), 4 * bary[..., i] * bary[..., j]], axis=-1)


def slopes(bary):
    """Derivatives (..., 10, 3) of `shapes` by the last three barycentric coordinates."""
    i, j = EDGES.T
    corner = (4 * bary - 1)[..., None] * BARYCENTRIC
    middle = 4 * (bary[..., i, None] * BARYCENTRIC[j] + bary[..., j, None] * BARYCENTRIC[i])
    return np.concatenate([corner, middle], axis=-2)


def gradients(x, tets):
    """Slopes by position (m, 4, 10, 3) [1/m] and volumes (m, 4) [m^3] of integration points.

    x (n, 3) nodes; tets (m, 10).  Raises ValueError if an element is turned inside out.
    """
    dn = slopes(POINTS)
    jac = np.einsum('mai,qaj->mqij', x[tets], dn)
    det = np.linalg.det(jac)
    if det.min() <= 0:
        raise ValueError(f'{(det <= 0).any(1).sum()} elements are inside out at rest')
    return np.einsum('qaj,mqji->mqai', dn, np.linalg.inv(jac)), det / 24


def triangle_rule():
    """Shape functions (7, 6), their two slopes (7, 6, 2), weights (7,) of the six-node triangle.

    Seven points, exact to degree five (Radon 1948); weights sum to one half.
    """
    r = np.sqrt(15)
    a, b = (6 - r) / 21, (6 + r) / 21
    st = np.array([[1 / 3, 1 / 3], [a, a], [1 - 2 * a, a], [a, 1 - 2 * a],
                   [b, b], [1 - 2 * b, b], [b, 1 - 2 * b]])
    w = np.array([9 / 40, *[(155 - r) / 1200] * 3, *[(155 + r) / 1200] * 3]) / 2
    s, t = st.T
    l = 1 - s - t
    n = np.column_stack([l * (2 * l - 1), s * (2 * s - 1), t * (2 * t - 1),
                         4 * l * s, 4 * s * t, 4 * t * l])
    z = np.zeros_like(s)
    ds = np.column_stack([1 - 4 * l, 4 * s - 1, z, 4 * (l - s), 4 * t, -4 * t])
    dt = np.column_stack([1 - 4 * l, z, 4 * t - 1, -4 * s, 4 * s, 4 * (l - t)])
    return n, np.stack([ds, dt], axis=2), w
