"""Compiled loops of the contact potential: signed distance, pressure, friction, per surface point.

All vectors of a point are in the frame of the rigid body: y = R' (x - c). The loops run in one
order on one thread, so results repeat to the last bit.

Arrays: x (n, 3); faces (f, a); N (q, a) shape functions; w (f, q) [m^2] rest areas; R (3, 3),
c (3,) pose of the body's core; kind, core as in `contact_shapes`; law = (k, s, k_t) as in
`contact`; limit (f, q) [Pa], normal, anchor (f, q, 3): friction, constant in one minimisation;
near : faces to look at, all others being clear of the body and free of friction.
"""

import numpy as np
from numba import njit

BOX, CYLINDER = 0, 1


@njit(cache=True, error_model='numpy')
def signed_distance(kind, core, y, g, H):
    """Return the distance [m] of y (3,) from a rounded core, negative inside.

    core : (7,) box: low (3,), high (3,), rounding radius; cylinder about z: radius, low z, high z,
        unused (3,), rounding radius [m]
    Writes gradient g (3,) and Hessian H (3, 3) [1/m]. Outside the core d is the distance to a
    convex set less the radius: H = (I - D - g g') / |y - p| with D the derivative of the
    projection p(y). Inside the core it is that of the nearest face.
    """
    if kind == BOX:
        return _box_distance(core, y, g, H)
    return _cylinder_distance(core, y, g, H)


@njit(cache=True, error_model='numpy')
def _box_distance(core, y, g, H):
    best, axis, side, squared = -np.inf, 0, 1.0, 0.0
    for i in range(3):
        low, high = core[i] - y[i], y[i] - core[3 + i]
        g[i] = -low if low > 0.0 else (high if high > 0.0 else 0.0)
        squared += g[i] * g[i]
        if max(low, high) > best:
            best, axis, side = max(low, high), i, (1.0 if high >= low else -1.0)
    H[:] = 0.0
    if squared > 0.0:
        length = np.sqrt(squared)
        for i in range(3):
            H[i, i] = 0.0 if g[i] == 0.0 else 1.0 / length
            g[i] /= length
        for i in range(3):
            for j in range(3):
                H[i, j] -= g[i] * g[j] / length
        return length - core[6]
    g[:] = 0.0
    g[axis] = side
    return best - core[6]


@njit(cache=True, error_model='numpy')
def _cylinder_distance(core, y, g, H):
    rho = np.sqrt(y[0] * y[0] + y[1] * y[1])
    u, v = (y[0] / rho, y[1] / rho) if rho > 0.0 else (0.0, 0.0)  # radial unit vector
    radial = rho - core[0]
    low, high = core[1] - y[2], y[2] - core[2]
    axial, side = (high, 1.0) if high >= low else (low, -1.0)
    length = np.sqrt(max(radial, 0.0) ** 2 + max(axial, 0.0) ** 2)
    if length > 0.0:
        d, g_r, g_z = length, max(radial, 0.0) / length, side * max(axial, 0.0) / length
        corner = 1.0 / length if radial > 0.0 and axial > 0.0 else 0.0
    elif radial > axial and rho > 0.0:
        d, g_r, g_z, corner = radial, 1.0, 0.0, 0.0
    else:
        d, g_r, g_z, corner = axial, 0.0, side, 0.0
    g[0], g[1], g[2] = g_r * u, g_r * v, g_z
    hoop = g_r / rho if rho > 0.0 else 0.0
    # In the (rho, z) plane the Hessian at a corner is t t' / length, t = (-g_z, g_r).
    t0, t1, t2 = -g_z * u, -g_z * v, g_r
    H[0, 0] = corner * t0 * t0 + hoop * v * v
    H[0, 1] = corner * t0 * t1 - hoop * u * v
    H[0, 2] = corner * t0 * t2
    H[1, 1] = corner * t1 * t1 + hoop * u * u
    H[1, 2] = corner * t1 * t2
    H[2, 2] = corner * t2 * t2
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    if core[0] == 0.0 and rho == 0.0 and length > 0.0:  # on the axis above a point: a sphere's top
        H[0, 0] = H[1, 1] = 1.0 / length
    return d - core[6]


@njit(cache=True, error_model='numpy')
def distances(kind, core, points, d, g, H):
    """`signed_distance` of points (m, 3) into d (m,), g (m, 3), H (m, 3, 3)."""
    for i in range(points.shape[0]):
        d[i] = signed_distance(kind, core, points[i], g[i], H[i])


@njit(cache=True, error_model='numpy')
def pressure_law(d, k, s):
    """Return energy [J/m^2], pressure [Pa] and stiffness [Pa/m] of the layer at distance d [m].

    Zero for d >= 0; pressure k e^2 / (2 s) up to the depth e = -d = s, then k (e - s / 2).
    """
    e = -d
    if e <= 0.0:
        return 0.0, 0.0, 0.0
    if e < s:
        return k * e * e * e / (6.0 * s), k * e * e / (2.0 * s), k * e / s
    return k * (e * e - e * s) / 2.0 + k * s * s / 6.0, k * (e - 0.5 * s), k


@njit(cache=True, error_model='numpy')
def _local(x, nodes, N, R, c, y):
    """Write the position in the body's frame of the surface point with shape values N (a,)."""
    p0, p1, p2 = -c[0], -c[1], -c[2]
    for a in range(nodes.shape[0]):
        p0 += N[a] * x[nodes[a], 0]
        p1 += N[a] * x[nodes[a], 1]
        p2 += N[a] * x[nodes[a], 2]
    for i in range(3):
        y[i] = R[0, i] * p0 + R[1, i] * p1 + R[2, i] * p2


@njit(cache=True, error_model='numpy')
def clearances(x, faces, spread, R, c, kind, core, out):
    """Write (f,) [m]: no point of a face is nearer than this, as distance is 1-Lipschitz.

    spread : as of `SurfaceQuadrature`
    """
    y, g, H = np.empty(3), np.empty(3), np.empty((3, 3))
    middle = np.full(faces.shape[1], 1.0 / faces.shape[1])
    for f in range(faces.shape[0]):
        _local(x, faces[f], middle, R, c, y)
        out[f] = signed_distance(kind, core, y, g, H)
        for i in range(3):
            g[i] = c[i] + R[i, 0] * y[0] + R[i, 1] * y[1] + R[i, 2] * y[2]
        radius = 0.0
        for a in range(faces.shape[1]):
            squared = 0.0
            for i in range(3):
                squared += (x[faces[f, a], i] - g[i]) ** 2
            radius = max(radius, squared)
        out[f] -= spread * np.sqrt(radius)


@njit(cache=True, error_model='numpy')
def _slip(y, normal, anchor, s):
    """Write the tangential part s (3,) of y - anchor; return its length."""
    along = 0.0
    for i in range(3):
        s[i] = y[i] - anchor[i]
        along += s[i] * normal[i]
    squared = 0.0
    for i in range(3):
        s[i] -= along * normal[i]
        squared += s[i] * s[i]
    return np.sqrt(squared)


@njit(cache=True, error_model='numpy')
def contact_forces(x, near, faces, N, w, R, c, kind, core, law, limit, normal, anchor, out):
    """Add the gradient of one body's contact potential to `out` (n, 3) [N]; return it [J]."""
    k, s, k_t = law
    y, g, t, H = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    energy = 0.0
    for f in near:
        for q in range(N.shape[0]):
            _local(x, faces[f], N[q], R, c, y)
            density, p, _ = pressure_law(signed_distance(kind, core, y, g, H), k, s)
            for i in range(3):
                g[i] *= -p
            if limit[f, q] > 0.0:
                size = _slip(y, normal[f, q], anchor[f, q], t)
                reach = limit[f, q] / k_t
                traction = k_t if size <= reach else limit[f, q] / size
                density += (0.5 * k_t * size * size if size <= reach
                            else limit[f, q] * (size - 0.5 * reach))
                for i in range(3):
                    g[i] += traction * t[i]
            energy += w[f, q] * density
            for i in range(3):
                pull = w[f, q] * (R[i, 0] * g[0] + R[i, 1] * g[1] + R[i, 2] * g[2])
                for a in range(faces.shape[1]):
                    out[faces[f, a], i] += N[q, a] * pull
    return energy


@njit(cache=True, error_model='numpy')
def contact_tangent(x, near, faces, N, w, R, c, kind, core, law, limit, normal, anchor, convex,
                    mu, indptr, column, data):
    """Add the Hessian of one body's contact potential to the values of a CSR matrix.

    convex : leave out - p H, the turning of the pressure with the body's surface, which is what
        can make the Hessian indefinite
    mu : 0, or the friction coefficient to let the limit mu p grow with the pressure where points
        slip: the derivative of Coulomb's law, unsymmetric and no Hessian any more
    indptr : (3n + 1,) of the matrix;  column : (f, a, a) where in its row a block begins
    """
    k, s, k_t = law
    y, g, t = np.empty(3), np.empty(3), np.empty(3)
    H, B = np.empty((3, 3)), np.empty((3, 3))
    n_local = faces.shape[1]
    for f in near:
        for q in range(N.shape[0]):
            _local(x, faces[f], N[q], R, c, y)
            _, p, stiffness = pressure_law(signed_distance(kind, core, y, g, H), k, s)
            if p == 0.0 and limit[f, q] == 0.0:
                continue
            turning = 0.0 if convex else p
            for i in range(3):
                for j in range(3):
                    H[i, j] = stiffness * g[i] * g[j] - turning * H[i, j]
            if limit[f, q] > 0.0:
                _add_friction(y, normal[f, q], anchor[f, q], k_t, limit[f, q], mu * stiffness, g,
                              t, H)
            _rotate(R, H, B)
            for a in range(n_local):
                for b in range(n_local):
                    share = w[f, q] * N[q, a] * N[q, b]
                    for i in range(3):
                        at = indptr[3 * faces[f, a] + i] + column[f, a, b]
                        for j in range(3):
                            data[at + j] += share * B[i, j]


@njit(cache=True, error_model='numpy')
def _add_friction(y, normal, anchor, k_t, limit, growth, g, t, H):
    """Add k_t T where the point sticks, limit / |t| (T - t t' / |t|^2) where it slips.

    There the limit besides grows by `growth` [Pa/m] into the body, against the gradient g (3,).
    """
    size = _slip(y, normal, anchor, t)
    sticks = size <= limit / k_t
    factor = k_t if sticks else limit / size
    for i in range(3):
        H[i, i] += factor
        for j in range(3):
            H[i, j] -= factor * normal[i] * normal[j]
            if not sticks:
                H[i, j] -= factor * t[i] * t[j] / (size * size) + growth * t[i] * g[j] / size


@njit(cache=True, error_model='numpy')
def _rotate(R, H, B):
    """B = R H R'."""
    for i in range(3):
        for j in range(3):
            B[i, j] = 0.0
            for m in range(3):
                for n in range(3):
                    B[i, j] += R[i, m] * H[m, n] * R[j, n]


@njit(cache=True, error_model='numpy')
def contact_points(x, near, faces, N, R, c, kind, core, law, position, gap, pressure, normal):
    """Write position (f, q, 3), signed distance and pressure (f, q), normal (f, q, 3) of points.

    Positions and normals in the body's frame; of points on faces not `near`, only the position.
    """
    H = np.empty((3, 3))
    for f in range(faces.shape[0]):
        for q in range(N.shape[0]):
            _local(x, faces[f], N[q], R, c, position[f, q])
    for f in near:
        for q in range(N.shape[0]):
            gap[f, q] = signed_distance(kind, core, position[f, q], normal[f, q], H)
            pressure[f, q] = pressure_law(gap[f, q], law[0], law[1])[1]
