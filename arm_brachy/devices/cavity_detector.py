"""Outlines a fluid-filled cavity in a B-mode image, and its centre from the outlines of a sweep.

In a picture: log compression is undone, speckle is averaged by a Gaussian, and from the middle of
the darkest connected region rays go out to where the intensity is half that of plain tissue. Half
is where the edge of a cavity lies under the middle of the beam, within the plane and across it, so
that the thickness of the slice does not shrink the outline. What the needle covers is left out.
Over pictures in known planes: the sphere through all edges, by linear least squares.
Sources: starburst of rays, Li, Winfield, Parkhurst 2005, CVPR workshops, 79; sphere by linear
least squares, Coope 1993, J Optim Theory Appl 76:381; freehand 3-D from tracked planes, Prager,
Gee, Berman 1999, Med Image Anal 3:129.
Valid for a cavity that is darker than its surroundings by 10 dB or more, several beams wide, and
not far from a sphere; a centre is given once the planes span enough of it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from arm_brachy.core.quantity import quantity, whole

_COARSER = 4         # pixels of the picture to one of those that are searched
_RAYS = 48
_KNOWN = 0.3         # share of the averaging window that has to be free of the needle


@dataclass(frozen=True)
class CavityDetectorParams:
    """What counts as a cavity, and when its centre is known."""

    window: float = quantity(14.0, 'mm', 'half the size of the square that is searched, around '
                             'where the needle is expected', low=1.0, high=50.0,
                             source='a cavity of 20 mm and what the pads move')
    smoothing: float = quantity(0.7, 'mm', 'sd of the average over speckle', low=0.1, high=5.0,
                                source='2.5 widths of the beam along the elements')
    edge: float = quantity(-3.0, 'dB', 'of the outline, below plain tissue', low=-30.0, high=0.0,
                           source='half the intensity')
    core: float = quantity(-14.0, 'dB', 'of the middle, below plain tissue, at most', low=-60.0,
                           high=0.0, source='fluid is anechoic, solid masses mostly are not')
    least: float = quantity(1.5, 'mm', 'radius of the smallest outline', low=0.1, high=30.0,
                            source='twice the smoothing')
    needle: float = quantity(1.3, 'mm', 'half the width of what a needle covers', low=0.1,
                             high=10.0, source='two widths of the beam')
    tail: float = quantity(7.0, 'mm', 'that it covers below its head', low=0.1, high=50.0,
                           source='ten copies of the comet tail')
    step: float = quantity(0.2, 'mm', 'between planes that count as two', low=0.01, high=10.0,
                           source='a tenth of the width of the beam across the plane')
    planes: int = whole(3, 'fewest planes that make a centre', low=2, high=1000)
    memory: float = quantity(6.0, 's', 'for which a plane counts', low=0.1, high=600.0,
                             source='own choice: the tissue moves under needle and probe')
    refresh: float = quantity(0.5, 's', 'after which a plane in the same place takes its place',
                              low=0.0, high=60.0, source='own choice: ten pictures')
    noise: float = quantity(0.25, 'mm', 'sd of an edge', low=0.01, high=5.0,
                            source='half the correlation length of speckle across the plane')
    correlated: float = quantity(10.0, '', 'edges of an outline that say as much as one', low=1.0,
                                 high=1e3, source='5 mm of an outline of 25 mm')
    sd_most: float = quantity(1.5, 'mm', 'sd of a centre that is worth telling, in the worst '
                              'direction', low=0.01, high=10.0, source='own choice')


class CavityDetector:
    """Looks for one cavity in picture after picture; no memory."""

    def __init__(self, params, image):
        """params : CavityDetectorParams;  image : UltrasoundParams"""
        self.params, self._image = params, image
        grey = np.arange(256) / 255.0 - 1.0
        self._intensity = (10.0**(grey * image.dynamic_range / 10.0)).astype(np.float32)
        self._pixel = _COARSER * image.pixel
        self._turn = 2.0 * np.pi * np.arange(_RAYS) / _RAYS

    def outline(self, picture, expected, needle):
        """Return points (k, 2) [m] x, z of its edge in a picture, None without a cavity.

        picture : (height, width) uint8;  expected : (2,) [m] x, z around which is searched
        needle : (2,) [m] x, z of a needle's head, which is left out, or None
        """
        crop, corner = self._cropped(picture, expected)
        if min(crop.shape) < _COARSER:
            return None
        level, known = self._averaged(crop, corner, needle)
        plain = np.median(level[known > 0.5]) if np.any(known > 0.5) else 0.0
        if plain <= 0.0:
            return None
        level = level / plain
        middle = self._middle(level)
        if middle is None:
            return None
        edge = self._edge(level, known, middle)
        if edge is None:
            return None
        # The middle of a coarse pixel is that of the pixels it is made of.
        at = (edge + 0.5) * _COARSER - 0.5 + corner
        return self._image.places(at)

    def _cropped(self, picture, expected):
        """Part (h, w) of the picture within the window, and its first pixel (u, v)."""
        image = self._image
        centre = image.pixels(expected)
        reach = self.params.window / image.pixel
        low = np.clip(np.floor(centre - reach), 0, picture.shape[::-1]).astype(int)
        high = np.clip(np.ceil(centre + reach), 0, picture.shape[::-1]).astype(int)
        high = low + (high - low) // _COARSER * _COARSER
        return picture[low[1]:high[1], low[0]:high[0]], low

    def _averaged(self, crop, corner, needle):
        """Intensity (h, w) without speckle and needle; share of it that is known."""
        size = (crop.shape[1] // _COARSER, crop.shape[0] // _COARSER)
        intensity = cv2.resize(self._intensity[crop], size, interpolation=cv2.INTER_AREA)
        known = np.ones(size[::-1], dtype=np.float32)
        if needle is not None:
            self._hide(known, corner, needle)
        sigma = self.params.smoothing / self._pixel
        blur = [cv2.GaussianBlur(a, (0, 0), sigma[0], sigmaY=sigma[1],
                                 borderType=cv2.BORDER_REFLECT)
                for a in (intensity * known, known)]
        return blur[0] / np.maximum(blur[1], 1e-6), blur[1]

    def _hide(self, known, corner, needle):
        p = self.params
        u, v = (self._image.pixels(needle) - corner) / _COARSER
        side, above = p.needle / self._pixel
        top, bottom = v - above, v + p.tail / self._pixel[1]
        known[max(0, round(top)):max(0, round(bottom) + 1),
              max(0, round(u - side)):max(0, round(u + side) + 1)] = 0.0

    def _middle(self, level):
        """(u, v) of the middle of the largest region that is dark enough, None without one."""
        p = self.params
        dark = (level < _ratio(p.edge)).astype(np.uint8)
        count, labels, stats, middles = cv2.connectedComponentsWithStats(dark, connectivity=4)
        least = np.pi * p.least**2 / np.prod(self._pixel)
        best, h, w = None, *level.shape
        for k in range(1, count):
            left, top, wide, high, area = stats[k]
            inside = left > 0 and top > 0 and left + wide < w and top + high < h
            if (inside and area >= least and level[labels == k].min() < _ratio(p.core)
                    and (best is None or area > stats[best, cv2.CC_STAT_AREA])):
                best = k
        return None if best is None else middles[best]

    def _edge(self, level, known, middle):
        """(k, 2) (u, v) where rays from the middle first pass the level of the edge."""
        steps = np.arange(0.0, max(level.shape), 0.5)
        u = middle[0] + np.outer(np.cos(self._turn), steps)
        v = middle[1] + np.outer(np.sin(self._turn), steps)
        along, sure = (cv2.remap(a, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR,
                                 borderMode=cv2.BORDER_REPLICATE) for a in (level, known))
        edge = _ratio(self.params.edge)
        past = along >= edge
        first = past.argmax(axis=1)
        rays = np.flatnonzero(past.any(axis=1) & (first > 0))
        rays = rays[sure[rays, first[rays]] > _KNOWN]
        if len(rays) < _RAYS // 4:
            return None
        low, high = along[rays, first[rays] - 1], along[rays, first[rays]]
        far = steps[first[rays] - 1] + 0.5 * (edge - low) / (high - low)
        turn = self._turn[rays]
        return middle + far[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


def _ratio(decibel):
    return 10.0**(decibel / 10.0)


@dataclass(frozen=True)
class Cavity:
    """Where a cavity is: centre (3,) [m] in W, its covariance (3, 3) [m^2], radius [m]."""

    centre: np.ndarray
    covariance: np.ndarray
    radius: float


class CavityLocaliser:
    """Gathers outlines of planes; `cavity` is where they say it is.

    params : CavityDetectorParams
    """

    def __init__(self, params):
        """Has seen nothing yet."""
        self._params, self._seen = params, []

    def see(self, t, R, p, outline):
        """Take an outline (k, 2) [m] x, z in the plane of a probe at R (3, 3), p (3,) at t [s].

        outline : None without one; what is older than the memory is forgotten in any case
        """
        params = self._params
        self._seen = [s for s in self._seen if s[0] >= t - params.memory]
        if outline is None:
            return
        points = p + np.column_stack([outline[:, 0], np.zeros(len(outline)), outline[:, 1]]) @ R.T
        middle = points.mean(axis=0)
        # A plane where there was one before says what that one said, until the tissue has moved.
        near = [s for s in self._seen
                if abs((middle - s[1].mean(axis=0)) @ R[:, 1]) < params.step]
        if any(t - s[0] < params.refresh for s in near):
            return
        self._seen = [s for s in self._seen if not any(s is n for n in near)] + [(t, points)]

    @property
    def cavity(self):
        """The Cavity, None while the planes do not say where it is."""
        params = self._params
        if len(self._seen) < params.planes:
            return None
        points = np.vstack([points for _, points in self._seen])
        middle = points.mean(axis=0)
        x = points - middle
        A = np.column_stack([2.0 * x, np.ones(len(x))])
        normal = A.T @ A
        if np.linalg.cond(normal / np.sqrt(np.outer(np.diag(normal), np.diag(normal)))) > 1e8:
            return None
        a = np.linalg.solve(normal, A.T @ np.sum(x**2, axis=1))
        squared = a[3] + a[:3] @ a[:3]
        if squared <= params.least**2:
            return None
        radius = float(np.sqrt(squared))
        covariance = (2.0 * radius * params.noise)**2 * params.correlated * np.linalg.inv(
            normal)[:3, :3]
        if np.sqrt(np.linalg.eigvalsh(covariance)[-1]) > params.sd_most:
            return None
        return Cavity(middle + a[:3], covariance, radius)
