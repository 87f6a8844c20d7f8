"""Where the scissor linkage stands in the cell."""

import numpy as np

from arm_brachy.robot.scissor_stiffness import layout

_UPRIGHT = 0.999     # of the first hinge's axis, from which on theta_0 = 0 points along x of W


def base_axes(axis):
    """Return R_WC (3, 3): z along the first hinge's axis (3,), any length; theta_0 = 0 upright."""
    z = np.asarray(axis, dtype=float)
    z = z / np.linalg.norm(z)
    x = np.eye(3)[2] if abs(z[2]) < _UPRIGHT else np.eye(3)[0]
    x = x - z * (z @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def linkage_line(own, q):
    """Return (k, 3) [m] in W: from the carrier along one branch to the first hinge, and back.

    own : ScissorHolderParams;  q : (4,) as in `scissor_loop`
    """
    hinges, arcs = layout(own.linkage, q[1])
    left = [arc.end for arc in arcs[:own.linkage.links]]
    right = [arc.end for arc in arcs[own.linkage.links:]]
    points = np.array([hinges[name] for name in (*right[::-1], arcs[0].start, *left)])
    middle = points[0] + points[-1]
    carrier = own.linkage.radius * middle / np.linalg.norm(middle)
    points = np.vstack([carrier, points, carrier])
    c, s = np.cos(q[0]), np.sin(q[0])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array(own.centre) + points @ (base_axes(own.axis) @ turn).T
