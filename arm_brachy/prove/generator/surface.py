"""The body as a user would have it: a fine closed triangulation of its exact shape."""
import numpy as np

from arm_brachy.prove.generator.tets import boundary, half_ball, orient


def nominal_surface(body, levels=4):
    """Vertices (v, 3) [m], outward triangles (s, 3), and which are of the base (s,) bool.

    Vertices lie on the exact surface; between them the error is below 0.1 mm.
    """
    p, tets = half_ball(levels, 0.0)
    faces, _ = boundary(orient(p, tets))
    used, inverse = np.unique(faces, return_inverse=True)
    p = p[used]
    faces = inverse.reshape(-1, 3)
    return body.dome.place(p), faces, (np.abs(p[faces][:, :, 2]) < 1e-9).all(1)
