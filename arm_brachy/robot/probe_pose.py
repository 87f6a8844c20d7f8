"""Where the probe shall be so that its image plane holds the needle's tip.

Probe frame P: origin in the middle of the face, z out of the face into the tissue, x along the
transducer's elements, y across the image plane (elevation). The tip is in the image when
y . (p_BN - p_BP) = 0. All vectors in the base frame B, equation numbers of the thesis, chapter 6.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.robot.reference import rotation

_PARALLEL = 1e-9     # sine of an angle below which an axis of rotation says nothing
_CLOSEST = 1e-3      # m from the contact point, below which the tip gives no direction


@dataclass(frozen=True)
class ProbeGoal:
    """Pose of the probe: R (3, 3) of P in B, p (3,) [m] of the face's middle on the skin."""

    R: np.ndarray
    p: np.ndarray


def out_of_plane(R, p, tip):
    """Return the signed distance [m] of a point from the image plane of a probe at R, p."""
    return float(R[:, 1] @ (np.asarray(tip) - p))


def turned_onto(z, z_goal):
    """Return the rotation (3, 3) about z x z_goal that turns unit vector z onto z_goal.

    (6.1)-(6.3). Parallel vectors: the identity; antiparallel ones: half a turn about the axis
    across z that is nearest to the coordinate axis z is least along, since any would do.
    """
    axis = np.cross(z, z_goal)
    sine, cosine = np.linalg.norm(axis), z @ z_goal
    if sine > _PARALLEL:
        return rotation(axis / sine * np.arctan2(sine, cosine))
    if cosine > 0.0:
        return np.eye(3)
    across = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    return rotation(np.pi * across / np.linalg.norm(across))


def orientation_goal(R, contact, tip):
    """Turn the probe about its contact point until its axis points at the tip (6.1)-(6.3).

    R : (3, 3) of the probe now;  contact : (3,) [m] where it touches, kept;  tip : (3,) [m]
    Returns ProbeGoal. Raises InputError if the tip lies within 1 mm of the contact point.
    """
    towards = np.asarray(tip, dtype=float) - contact
    distance = np.linalg.norm(towards)
    if distance < _CLOSEST:
        raise InputError(f'probe: the tip is {1e3 * distance:.2f} mm from the contact point; must '
                         f'be at least {1e3 * _CLOSEST:g} mm: withdraw the needle')
    return ProbeGoal(turned_onto(R[:, 2], towards / distance) @ R, np.array(contact, dtype=float))


def translational_goal(surface, contact, tip, needle):
    """Move the probe over the skin until it stands over the tip, across the needle (6.4)-(6.8).

    The line L_N starts at the tip, is perpendicular to the needle and lies in the plane of needle
    and contact point; where it leaves the skin the probe shall be. (6.6) as printed equates
    normals, which does not put the point on the line: the line is intersected with the surface.

    surface : surface_scan.ScannedSurface;  contact : (3,) [m] of the probe now
    tip : (3,) [m];  needle : (3,) direction of insertion
    Returns ProbeGoal, z along the line into the tissue, y along the needle. Raises InputError if
    the contact point lies on the needle's axis or the line meets no skin.
    """
    along = np.asarray(needle, dtype=float) / np.linalg.norm(needle)
    up = np.asarray(contact, dtype=float) - tip
    up = up - along * (along @ up)
    length = np.linalg.norm(up)
    if length < _CLOSEST:
        raise InputError('probe: its contact point lies on the axis of the needle; must stand '
                         f'at least {1e3 * _CLOSEST:g} mm off it')
    up = up / length
    x = np.cross(along, -up)
    return ProbeGoal(np.column_stack([x, along, -up]), surface.intersection(tip, up))


def centre_goal(surface, centre, tip, needle):
    """Turn the probe about a fixed centre until its axis goes through centre and tip.

    (6.1)-(6.3) with another remote centre: of the body, not of the contact. The plane of the
    picture then holds the centre as well as the tip, and stands as much across the needle as a
    plane through both can.
    surface : as in `translational_goal`;  centre, tip : (3,) [m];  needle : (3,) of insertion
    Returns ProbeGoal, y along the needle. Raises InputError if the tip lies within 1 mm of the
    centre, the needle points at the centre, or the line from the centre meets no skin.
    """
    out = np.asarray(tip, dtype=float) - centre
    distance = np.linalg.norm(out)
    if distance < _CLOSEST:
        raise InputError(f'probe: the tip is {1e3 * distance:.2f} mm from the centre that the '
                         f'probe turns about; must be at least {1e3 * _CLOSEST:g} mm: move the '
                         'template')
    up = out / distance
    y = needle - up * (up @ needle)
    length = np.linalg.norm(y)
    if length < _PARALLEL * np.linalg.norm(needle):
        raise InputError('probe: the needle points at the centre that the probe turns about; must '
                         'pass beside it: move the template')
    y = y / length
    return ProbeGoal(np.column_stack([np.cross(y, -up), y, -up]), surface.intersection(tip, up))
