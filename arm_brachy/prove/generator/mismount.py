"""A pad beside its place: the disc moved, and the mesh slid along the surface with its rim."""
from dataclasses import replace

import numpy as np

from arm_brachy.prove.generator.mesh import normalised, straightened
from arm_brachy.prove.generator.rim import slide_to_rim


def moved_pad(dome, pad, v):
    """`pad` offset up and sideways along the surface, and turned, by the catalogue's values.

    Up is the direction across the push that is nearest to world z; sideways is push x up.
    """
    d = np.array(pad.direction)
    up = np.array([0, 0, 1.0]) - d[2] * d
    up /= np.linalg.norm(up)
    side = np.cross(d, up)
    start = np.array(pad.centre) + 1e-3 * (v['up_mm'] * up + v['side_mm'] * side)
    turned = d + np.tan(np.deg2rad(v['tilt_up_deg'])) * up
    turned = turned + np.tan(np.deg2rad(v['tilt_side_deg'])) * side
    turned /= np.linalg.norm(turned)
    centre = surface_along(dome, start, d)
    return replace(pad, centre=tuple(centre.tolist()), direction=tuple(turned.tolist()))


def surface_along(dome, start, d, steps=30):
    """Where the line through `start` along d (3,) meets the surface near `start` (3,) [m]."""
    b = normalised(to_ball(dome, start[None]))[0]
    for _ in range(steps):
        x, n = dome.place(b[None])[0], dome.normal(b[None])[0]
        on_line = start + d * ((x - start) @ n) / (d @ n)
        b = normalised(to_ball(dome, on_line[None]))[0]
    return dome.place(b[None])[0]


def to_ball(dome, x, steps=12):
    """Points of the half-ball (n, 3) that `dome` places at x (n, 3), by Newton's method."""
    b = x / [*dome.radii, dome.height]
    for _ in range(steps):
        miss = (x - dome.place(b))[:, :, None]
        b = b + np.linalg.solve(dome.jacobian(b), miss)[:, :, 0]
    return b


def moved_patch(mesh, dome, number, old, new):
    """Mesh slid, within 2.4 radii of pad `number`, so that its patch lies under `new`."""
    ball = to_ball(dome, mesh.nodes)
    shell = np.unique(mesh.surface)
    rim = shell[(np.abs(old.rim_distance(mesh.nodes[shell])) < 1e-7)
                & old.faces(mesh.nodes[shell])]
    far = np.linalg.norm(mesh.nodes - old.centre, axis=1) / old.radius
    fade = np.clip((2.4 - far) / 1.2, 0, 1)
    foot = np.clip(mesh.nodes[:, 2] / (0.3 * old.centre[2]), 0, 1)
    share = fade**2 * (3 - 2 * fade) * foot**2 * (3 - 2 * foot)
    step = to_ball(dome, np.array([new.centre])) - to_ball(dome, np.array([old.centre]))
    ball = ball + share[:, None] * step
    ball[shell] = normalised(ball[shell])
    ball[rim] = slide_to_rim(ball[rim], dome.place, new)
    return replace(mesh, nodes=straightened(dome.place(ball), mesh.tets))
