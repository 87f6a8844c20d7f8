"""A skin surface from the point cloud of a scanner: noise smoothed, holes bridged, outliers out.

The surface is the zero set of a function f, negative inside, interpolated by radial basis
functions through points of the cloud (f = 0) and, of every few, the points moved along the
normal to either side (f = their distance). scipy's RBFInterpolator with a thin-plate spline and
smoothing does the interpolation, over all centres: nearest ones alone make f jump.
Source: Carr et al. 2001, "Reconstruction and representation of 3D objects with radial basis
functions", SIGGRAPH, sec. 2 to 4.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantity, whole

_FEWEST = 50         # patches, below which there is no surface
_SD_OF_MEDIAN = 1.4826   # a normal's sd over its median absolute deviation
_UNUSUAL = 3.0       # medians of scatter or extent, from which on a patch is no skin
_NEAREST = 0.7       # spacings between patches: closer ones say the same
_STEP = 1e-4         # m, central differences of f
_OFFSET = 3.0        # spacings between points with centres off the skin, and how far off these are


@dataclass(frozen=True)
class ScanParams:
    """How a cloud is cleaned and smoothed."""

    spacing: float = quantity(5.0, 'mm', 'between the patches that the cloud is reduced to',
                              low=0.5, high=50.0, source="a twelfth of a breast phantom's radius")
    outlier: float = quantity(3.0, '', 'standard deviations off its patch, from which on a point '
                              'is left out', low=1.0, high=20.0,
                              source='three standard deviations')
    neighbours: int = whole(60, 'points of the cloud that a patch is fitted to', low=4,
                            high=10_000)
    smoothing: float = quantity(0.3, '', "RBFInterpolator's, of distances in units of the "
                                'spacing', low=0.0, high=100.0,
                                source='noise of a tenth of the spacing (own choice)')


class ScannedSurface:
    """Skin as a scanner sees it. World frame of the cloud [m].

    points, normals : (n, 3) of the patches, normals outward, unit
    Valid near the cloud: over a wide hole, and beyond the rim, f is an extrapolation.
    """

    def __init__(self, points, normals, params):
        """Interpolate; `fit` is the way to make one from a cloud."""
        self.points, self.normals, self._spacing = points, normals, params.spacing
        some = _thinned(points, _OFFSET * params.spacing)
        offset = _OFFSET * params.spacing * normals[some]
        centres = np.vstack([points, points[some] + offset, points[some] - offset])
        values = _OFFSET * np.repeat([0.0, 1.0, -1.0], [len(points), len(some), len(some)])
        self._f = RBFInterpolator(centres / params.spacing, values, kernel='thin_plate_spline',
                                  smoothing=params.smoothing)
        self._reach = float(np.linalg.norm(np.ptp(points, axis=0)))

    @classmethod
    def fit(cls, cloud, inside, params=None):
        """Return the ScannedSurface of a cloud.

        cloud : (n, 3) [m], rows with NaN are left out
        inside : (3,) [m] a point within the body that sees all of its skin (star-shaped about it)
        Raises InputError if the cloud has too few points.
        """
        params = ScanParams() if params is None else params
        points = np.asarray(cloud, dtype=float)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < params.neighbours:
            raise InputError(f'surface scan: {len(points)} points; must be at least '
                             f'{params.neighbours}: scan closer')
        centres, normals = _patches(points, params)
        if len(centres) < _FEWEST:
            raise InputError(f'surface scan: {len(centres)} patches, {1e3 * params.spacing:g} mm '
                             f'apart; must be at least {_FEWEST}: scan more of the skin or set '
                             'spacing_mm smaller')
        flip = np.einsum('ij,ij->i', normals, centres - inside) < 0.0
        normals[flip] *= -1.0
        return cls(centres, normals, params)

    def level(self, x):
        """Return f (k,) [m] at points (k, 3): about the distance from the skin; inside < 0."""
        return self._spacing * self._f(np.atleast_2d(x) / self._spacing)

    def normal(self, x):
        """Return the outward unit normal (3,) at a point (3,) on the skin: the gradient of f."""
        steps = _STEP * np.vstack([np.eye(3), -np.eye(3)])
        f = self.level(x + steps)
        gradient = f[:3] - f[3:]
        return gradient / np.linalg.norm(gradient)

    def distance(self, x):
        """Return how far the nearest patch is from a point (3,) [m]: large over a hole."""
        return float(np.linalg.norm(self.points - x, axis=1).min())

    def intersection(self, start, direction):
        """Return where a line first leaves the body (3,) [m].

        start : (3,) [m] within the body;  direction : (3,) outward, any length
        Raises InputError if the line does not cross the skin within the size of the cloud.
        """
        u = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
        s = np.arange(0.0, self._reach, 0.5 * self._spacing)
        f = self.level(start + s[:, None] * u)
        out = np.flatnonzero((f[:-1] < 0.0) & (f[1:] >= 0.0))
        if not len(out):
            place = ', '.join(f'{1e3 * c:.1f}' for c in start)
            raise InputError(f'surface scan: the line from ({place}) mm does not meet the skin; '
                             'scan more of it or move the probe towards the needle')
        at = brentq(lambda t: self.level(start + t * u)[0], s[out[0]], s[out[0] + 1],
                    xtol=1e-6)
        return start + at * u


def _thinned(points, spacing):
    """Indices of points no two of which share a cell of a grid: the first of each."""
    cells = np.floor(points / spacing).astype(np.int64)
    return np.sort(np.unique(cells, axis=0, return_index=True)[1])


def _patches(points, params):
    """Centres (n, 3) and unit normals (n, 3) of planes through neighbours, a spacing apart.

    A plane is fitted twice, the second time without neighbours off the first one. Patches of
    stray points are left out: their neighbours are far, or not on a plane.
    """
    some = points[_thinned(points, params.spacing)]
    far, near = cKDTree(points).query(some, k=params.neighbours)
    local = points[near]
    weights = np.ones(near.shape)
    for _ in range(2):
        total = weights.sum(axis=1)
        centre = np.einsum('nk,nki->ni', weights, local) / total[:, None]
        moved = local - centre[:, None]
        scatter = np.einsum('nk,nki,nkj->nij', weights, moved, moved)
        normal = np.linalg.eigh(scatter)[1][:, :, 0]
        height = np.abs(np.einsum('nki,ni->nk', moved, normal))
        spread = _SD_OF_MEDIAN * np.median(height, axis=1, keepdims=True)
        weights = (height <= params.outlier * spread).astype(float)
    usual = (_usual(far[:, -1]) & _usual(spread[:, 0]) & _usual(np.abs(
        np.einsum('ni,ni->n', some - centre, normal)) + spread[:, 0]))
    centre, normal = centre[usual], normal[usual]
    kept = _thinned(centre, _NEAREST * params.spacing)
    return centre[kept], normal[kept].copy()


def _usual(values):
    """True where a value is not far above the median."""
    return values <= _UNUSUAL * np.median(values)
