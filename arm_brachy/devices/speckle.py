"""Scatterers fixed in a tetrahedral mesh: an image's echoes straight from the nodes' positions.

Every element holds a Poisson number of scatterers at fixed barycentric coordinates, so that they
move with the material; elements with nodes in the middle of their edges are cut into eight parts
(Bey 1995, Computing 55:355), within which motion is taken as linear. A body of half a litre has
sixteen million scatterers. They are not stored: elements take runs of one pool of a million
points, each from a place of its own. Two elements may share points, at other places of the image
and in other shapes, so that their echoes do not agree.
Regions (spheres of the body at rest) may echo more or less than plain tissue.
"""

from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.ultrasound import SLICE

_PER_SD = np.float32(400.0)   # entries of a table of a Gaussian in a standard deviation
_BELL = np.exp(-0.5 * (np.arange(SLICE * _PER_SD + 1) / _PER_SD)**2).astype(np.float32)
_POOL = 2**20        # scatterers that the elements take theirs from
# Nodes of the eight parts of an element whose nodes are four corners, then the middles of its
# edges 01, 02, 03, 12, 13, 23.
_PARTS = np.array([[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3],
                   [4, 5, 6, 8], [4, 5, 7, 8], [5, 6, 8, 9], [5, 7, 8, 9]])


@dataclass(frozen=True)
class EchoRegion:
    """A sphere of the body at rest whose tissue echoes differently.

    centre : (3,) [m];  radius : [m];  gain : amplitude of its echoes over those of plain tissue
    """

    centre: tuple
    radius: float
    gain: float


class TissueScatterers:
    """The scatterers of a body.

    rest : (n, 3) [m] nodes of the stress-free body
    elements : (m, 4) corners, or (m, 10) with the middles of the edges 01, 02, 03, 12, 13, 23
    density : [1/m^3];  regions : of EchoRegion, a later one wins;  rng : numpy Generator
    """

    def __init__(self, rest, elements, density, regions, rng):
        """Draw numbers and places. Raises ConfigError for elements too large for the pool."""
        self.rest = np.array(rest, dtype=float)
        elements = np.asarray(elements)
        if elements.shape[1] > 4:
            elements = elements[:, _PARTS].reshape(-1, 4)
        corners = self.rest[elements]
        volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
        self.elements = np.ascontiguousarray(elements, dtype=np.int64)
        self.count = rng.poisson(density * volume)
        if self.count.max(initial=0) > _POOL:
            raise ConfigError(f'ultrasound: an element of {1e6 * volume.max():.0f} cm3 holds '
                              f'{self.count.max()} scatterers; must be at most {_POOL}: refine '
                              'the mesh, or lower image.density_per_mm3')
        self.first = rng.integers(0, _POOL - self.count, endpoint=True)
        self.pool = _pool(rng)
        spheres = [[*r.centre, r.radius**2, r.gain] for r in regions]
        self._regions = np.array(spheres, dtype=float).reshape(-1, 5)
        self._mixed = np.zeros(len(elements), dtype=bool)
        for region in regions:
            middle = corners.mean(axis=1)
            size = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
            self._mixed |= np.linalg.norm(middle - region.centre, axis=1) < region.radius + size

    def gather(self, nodes, grid, steps, turn):
        """Add the echoes of all scatterers to a grid; returns how many lie in the image.

        nodes : (n, 3) along the elements [pixel], across the plane [standard deviations], deep
            [pixel];  grid : (height, width, 2) float32
        steps : of `turn` a pixel of depth;  turn : (k, 2) cosine and sine over one turn of phase,
            k a power of two
        """
        return _gather_elements(nodes.astype(np.float32), self.elements, self.first, self.count,
                                self.pool, self.rest, self._mixed, self._regions, grid, steps,
                                _BELL, turn)


def _pool(rng):
    """(n, 4) float32: barycentric coordinates 1 to 3, even in a tetrahedron, and sign.

    Gaps between three sorted uniform numbers are even on the simplex (Devroye 1986, Non-Uniform
    Random Variate Generation, sec. V.2).
    """
    pool = np.empty((_POOL, 4), dtype=np.float32)
    cuts = np.sort(rng.random((_POOL, 3), dtype=np.float32), axis=1)
    pool[:, 0] = cuts[:, 0]
    for k, (low, high) in enumerate(pairwise(range(3)), start=1):
        pool[:, k] = cuts[:, high] - cuts[:, low]
    pool[:, 3] = rng.choice(np.array([-1.0, 1.0], dtype=np.float32), _POOL)
    return pool


@numba.njit(cache=True, fastmath=True)
def _gather_elements(nodes, elements, first, count, pool, rest, mixed, regions, grid, steps, bell,
                     turn):
    # One function, single precision throughout: cut into several it takes twice as long.
    height, width, _ = grid.shape
    seen, mask, one = 0, len(turn) - 1, np.float32(1.0)
    for e in range(len(elements)):
        i0, i1, i2, i3 = elements[e]
        y0, y1, y2, y3 = nodes[i0, 1], nodes[i1, 1], nodes[i2, 1], nodes[i3, 1]
        if min(y0, y1, y2, y3) >= SLICE or max(y0, y1, y2, y3) <= -SLICE:
            continue
        u0, u1, u2, u3 = nodes[i0, 0], nodes[i1, 0], nodes[i2, 0], nodes[i3, 0]
        v0, v1, v2, v3 = nodes[i0, 2], nodes[i1, 2], nodes[i2, 2], nodes[i3, 2]
        if (min(u0, u1, u2, u3) >= width or max(u0, u1, u2, u3) <= 0.0
                or min(v0, v1, v2, v3) >= height or max(v0, v1, v2, v3) <= 0.0):
            continue
        u1, u2, u3, y1, y2, y3 = u1 - u0, u2 - u0, u3 - u0, y1 - y0, y2 - y0, y3 - y0
        v1, v2, v3 = v1 - v0, v2 - v0, v3 - v0
        special = mixed[e]
        for n in range(first[e], first[e] + count[e]):
            r, s, t = pool[n, 0], pool[n, 1], pool[n, 2]
            y = abs(y0 + r * y1 + s * y2 + t * y3)
            if y >= np.float32(SLICE):
                continue
            u, v = u0 + r * u1 + s * u2 + t * u3, v0 + r * v1 + s * v2 + t * v3
            if u < 0 or v < 0 or u >= width - 1 or v >= height - 1:
                continue
            i, j = int(u), int(v)
            fu, fv = u - np.float32(i), v - np.float32(j)
            a = pool[n, 3] * bell[int(y * _PER_SD)]
            if special:
                a *= np.float32(_gain(r, s, t, i0, i1, i2, i3, rest, regions))
            at = int(v * steps) & mask
            re, im = a * turn[at, 0], a * turn[at, 1]
            w11 = fu * fv
            w01, w10 = fu - w11, fv - w11
            w00 = one - fu - w10
            grid[j, i, 0] += w00 * re
            grid[j, i, 1] += w00 * im
            grid[j, i + 1, 0] += w01 * re
            grid[j, i + 1, 1] += w01 * im
            grid[j + 1, i, 0] += w10 * re
            grid[j + 1, i, 1] += w10 * im
            grid[j + 1, i + 1, 0] += w11 * re
            grid[j + 1, i + 1, 1] += w11 * im
            seen += 1
    return seen


@numba.njit(cache=True)
def _gain(r, s, t, i, j, k, m, rest, regions):
    gain = 1.0
    for n in range(len(regions)):
        distance = 0.0
        for axis in range(3):
            x = ((1.0 - r - s - t) * rest[i, axis] + r * rest[j, axis] + s * rest[k, axis]
                 + t * rest[m, axis])
            distance += (x - regions[n, axis])**2
        if distance < regions[n, 3]:
            gain = regions[n, 4]
    return gain
