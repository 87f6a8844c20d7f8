"""Loads on the tissue that the cell measures: the probe that presses, the needle that drags.

A load is a force and where it acts, spread over the tissue there as a normal density.
What holds a needle sideways is not measured and left out.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError

NARROWEST = 5e-3     # m, sd of a load in any direction: what a mesh of the model's size resolves
LEAST = 0.1          # N, below which a force has no centre of pressure
UNDER = 2.5          # sds of a load's spread within which a point is under it
TIP_SHARE = 0.5      # of a needle's force that acts at its tip, the rest along its shaft


@dataclass(frozen=True)
class KnownLoad:
    """What something presses the tissue with.

    place : (3,) [m] of its middle;  force : (3,) [N] on the tissue
    spread : (3, 3) [m^2] covariance of the density that it is spread by. World frame.
    """

    place: np.ndarray
    force: np.ndarray
    spread: np.ndarray


def probe_load(R, p, wrench, width, thickness):
    """Return the KnownLoad of a probe's face, at its centre of pressure.

    R (3, 3), p (3,) [m] : of its face, x along the elements, z out of it
    wrench : (6,) [N, N m] of the tissue on the probe, about the middle of its face, in its axes
    width, thickness : [m] of the face along x and y
    A face that is pressed at a part of it loads that part: as much of it as lies around the
    centre of pressure.
    """
    half = 0.5 * np.array([width, thickness])
    at = np.zeros(2)
    if abs(wrench[2]) > LEAST:
        at = np.clip(np.array([-wrench[4], wrench[3]]) / wrench[2], -half, half)
    sds = (half - 0.5 * np.abs(at)) / np.sqrt(3.0)
    return KnownLoad(p + R[:, :2] @ at, -(R @ wrench[:3]), _spread(R, (*sds, 0.0)))


def needle_loads(R, p, effort, inside):
    """Return the KnownLoads of a needle: of its tip and of its shaft.

    R (3, 3), p (3,) [m] : of the tip, z along the needle
    effort : [N] that the tissue holds it back with;  inside : [m] length in the tissue
    """
    along = R[:, 2]
    shaft = _spread(R, (0.0, 0.0, inside / np.sqrt(12.0)))
    return (KnownLoad(np.asarray(p, dtype=float), TIP_SHARE * effort * along,
                      _spread(R, (0.0, 0.0, 0.0))),
            KnownLoad(p - 0.5 * inside * along, (1.0 - TIP_SHARE) * effort * along, shaft))


def instrument_loads(probe, needle, face, skin=0.0):
    """Return the KnownLoads of a cell's instruments.

    probe : (R, p, wrench), arguments of `probe_load`, None while it touches nothing
    needle : (R, p, effort, depth), as of `needle_loads`, the depth [m] from the template on; None
        where its tip is not told
    face : has width and thickness [m];  skin : [m] of the needle's way before the tissue
    Raises InputError for what is no number.
    """
    told = [np.ravel(part) for one in (probe, needle) if one is not None for part in one]
    if told and not np.isfinite(np.concatenate(told)).all():
        raise InputError('pose or force of probe or needle is no number; must be finite: look at '
                         'force sensor and encoders; the estimate does not count on them')
    loads = () if probe is None else (probe_load(*probe, face.width, face.thickness),)
    if needle is not None and needle[3] > skin:
        loads += needle_loads(*needle[:3], needle[3] - skin)
    return loads


def beside(loads, points):
    """Return (k,) True where points (k, 3) [m] are not under one of the loads (KnownLoads).

    How the tissue gives right there depends on the shape of what presses.
    """
    out = np.ones(len(points), dtype=bool)
    for load in loads:
        out &= ~(_squared(load, points) < UNDER**2)
    return out


def nodal_forces(loads, x, volume):
    """Return what loads (KnownLoads) put on each node, (n, 3) [N].

    x : (n, 3) [m] nodes now;  volume : (n,) [m^3] of each
    The whole of a load acts, on the nodes that are there; one far from the body acts on its
    nearest nodes.
    """
    out = np.zeros_like(x)
    for load in loads:
        squared = _squared(load, x)
        weight = volume * np.exp(-0.5 * (squared - squared.min()))
        out += np.outer(weight / weight.sum(), load.force)
    return out


def _squared(load, points):
    """(k,) squared distance of points (k, 3) [m] from the place of a load, in its spread."""
    off = points - load.place
    return np.einsum('ni,ij,nj->n', off, np.linalg.inv(load.spread), off)


def _spread(R, sds):
    """(3, 3) [m^2] of sds (3,) [m] along the columns of R, none narrower than a mesh resolves."""
    return (R * np.maximum(sds, NARROWEST) ** 2) @ R.T
