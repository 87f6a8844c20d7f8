"""A structured-light scanner over the body: a cloud of points of the skin, with noise and holes.

A point is measured if camera and projector both see it: neither more slanted than `slant`, nor
behind a pad or the template. Noise lies along the camera's line of sight and grows as the surface
slants away, sd / cos(angle), since a stripe is located across that line. Some points are lost by
chance, and some patches (gloss, a fold of the drape) as a whole.
Sources: Salvi, Fernandez, Pribanic, Llado 2010, Pattern Recognition 43:2666 (structured light);
Nguyen, Izadi, Lovell 2012, 3DIMPVT (noise against angle).
The body hides no part of itself: valid for bodies as convex as a breast.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity

_SLICES = 5          # discs that a pad's body is made of, front to back
_SKIN = 1e-4         # m off the skin, from which a line of sight starts


@dataclass(frozen=True)
class ScannerParams:
    """Where the scanner stands and how well it sees."""

    camera: tuple = quantity([-80.0, 0.0, 500.0], 'mm', 'of the camera, world frame', shape=(3,),
                             source='over the bed (own choice)')
    projector: tuple = quantity([80.0, 0.0, 500.0], 'mm', 'of the projector, world frame',
                                shape=(3,), source='a base of 160 mm (own choice)')
    density: float = quantity(0.5, 'per_mm2', 'points of the cloud on skin that is seen', low=0.01,
                              high=10.0, source='1.4 mm between points at 0.5 m')
    noise: float = quantity(0.2, 'mm', 'standard deviation along the line of sight, square to the '
                            'skin', low=0.0, high=10.0, source='handheld structured-light '
                                                               'scanners: 0.1 to 0.5 mm')
    slant: float = quantity(75.0, 'deg', 'largest angle between normal and line of sight',
                            low=1.0, high=90.0, source='own choice: a quarter of the light')
    lost: float = quantity(0.03, '', 'share of points lost by chance', low=0.0, high=1.0,
                           source='own choice')
    patches: float = quantity(3.0, '', 'mean number of patches that are lost', low=0.0, high=100.0,
                              source='own choice')
    patch_radius: float = quantity(4.0, 'mm', 'of such a patch', low=0.0, high=50.0,
                                   source='own choice: a gloss')
    pad_depth: float = quantity(30.0, 'mm', 'length of the rod behind a pad that is as wide as '
                                'the pad', low=0.0, high=500.0, source='own choice')
    margin: float = quantity(10.0, 'mm', "of the template's plate around its holes", low=0.0,
                             high=200.0, source='own choice')


@dataclass(frozen=True)
class PadShadow:
    """A pad: centre (3,) [m] and direction (3,) into the tissue at rest, radius [m], its nodes."""

    centre: np.ndarray
    direction: np.ndarray
    radius: float
    nodes: np.ndarray


@dataclass(frozen=True)
class Plate:
    """The template: R (3, 3) with z along the needles, p (3,) [m], half its size (2,) [m]."""

    R: np.ndarray
    p: np.ndarray
    half: np.ndarray


class SurfaceScanner:
    """Simulated scanner. params : ScannerParams;  rest : (n, 3) [m] nodes at rest

    triangles : (s, 3) of nodes, normals outward;  pads : of PadShadow;  plate : Plate or None
    rng : numpy Generator;  two scans of the same body differ in noise, holes and points
    Test: devices/test_surface_scanner.py
    """

    def __init__(self, params, rest, triangles, pads, plate, rng):
        """Set it up; see the class."""
        self.params, self._rest, self._triangles = params, np.array(rest), np.array(triangles)
        self._pads, self._plate, self._rng = tuple(pads), plate, rng

    def scan(self, x):
        """Return the cloud (n, 3) [m] of the skin where the nodes are at x (n, 3) [m]."""
        p, eye, light = self.params, *map(np.array, (self.params.camera, self.params.projector))
        points, normals = self._points(np.asarray(x, dtype=float))
        cosine = np.minimum(_facing(points, normals, eye), _facing(points, normals, light))
        seen = cosine >= np.cos(p.slant)
        seen &= self._rng.random(len(points)) >= p.lost
        seen &= ~self._in_patch(points)
        points, normals, cosine = points[seen], normals[seen], cosine[seen]
        starts = points + _SKIN * normals
        for disc in self._discs(x):
            seen = ~(_through_disc(starts, eye, *disc) | _through_disc(starts, light, *disc))
            starts, points, cosine = starts[seen], points[seen], cosine[seen]
        if self._plate is not None:
            seen = ~(_through_plate(starts, eye, self._plate)
                     | _through_plate(starts, light, self._plate))
            points, cosine = points[seen], cosine[seen]
        sight = points - eye
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        noise = p.noise / cosine * self._rng.standard_normal(len(points))
        return points + noise[:, None] * sight

    def _points(self, x):
        """Points spread evenly over the skin, and their outward normals."""
        a, b, c = (x[self._triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        twice = np.linalg.norm(normal, axis=1)
        which = np.repeat(np.arange(len(a)), self._rng.poisson(0.5 * self.params.density * twice))
        r, s = self._rng.random((2, len(which), 1))
        r, s = np.where(r + s > 1.0, 1.0 - r, r), np.where(r + s > 1.0, 1.0 - s, s)
        return (a[which] + r * (b - a)[which] + s * (c - a)[which],
                (normal / twice[:, None])[which])

    def _in_patch(self, points):
        count = self._rng.poisson(self.params.patches)
        middles = points[self._rng.integers(0, len(points), count)]
        far = np.linalg.norm(points[:, None] - middles, axis=2)
        return (far < self.params.patch_radius).any(axis=1)

    def _discs(self, x):
        """Centre, normal and radius of the discs that the pads are made of, where they are now."""
        for pad in self._pads:
            moved = (x[pad.nodes] - self._rest[pad.nodes]).mean(axis=0)
            for back in np.linspace(0.0, self.params.pad_depth, _SLICES):
                yield pad.centre + moved - back * pad.direction, pad.direction, pad.radius


def _facing(points, normals, eye):
    """Cosine of the angle between normal and line of sight (n,)."""
    sight = eye - points
    return np.einsum('ni,ni->n', normals, sight) / np.linalg.norm(sight, axis=1)


def _meets(points, eye, centre, normal):
    """Where the lines from points to an eye meet a plane (n, 3), and whether on the way."""
    ahead, slope = (centre - points) @ normal, (eye - points) @ normal
    share = np.divide(ahead, slope, out=np.full(len(points), -1.0), where=slope != 0.0)
    return points + share[:, None] * (eye - points), (share > 0.0) & (share < 1.0)


def _through_disc(points, eye, centre, normal, radius):
    at, between = _meets(points, eye, centre, normal)
    return between & (np.linalg.norm(at - centre, axis=1) < radius)


def _through_plate(points, eye, plate):
    at, between = _meets(points, eye, plate.p, plate.R[:, 2])
    return between & np.all(np.abs((at - plate.p) @ plate.R[:, :2]) < plate.half, axis=1)
