"""B-mode images of tissue by point scatterers: speckle that moves with the material.

Scatterers are fixed in the tissue and move with it; an image is the envelope of the sum of their
echoes. In the probe's frame (x along the elements, y across the image plane, z deep) a scatterer
of amplitude a at (x, y, z) adds to the complex baseband signal
    s(X, Z) = a exp(-y^2 / (2 sy^2)) exp(-(X-x)^2 / (2 sx^2) - (Z-z)^2 / (2 sz^2)) exp(2 i k z)
with k = 2 pi f / c: a separable point spread function, Gaussian on all axes. Echoes are gathered
on scan lines, each with the phase of its own depth, filtered along and across them, then the
signal between lines is interpolated.
Linear (first Born) scattering, one focus for all depths, attenuation taken as compensated by gain.
Sources: Goodman, Statistical Optics, sec. 2.9 (Rayleigh statistics of many scatterers); Szabo,
Diagnostic Ultrasound Imaging, 2nd ed., ch. 8 and 10.
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity, word

_HALF_WIDTH = 2.0 * np.sqrt(2.0 * np.log(2.0))   # full width at half maximum over sigma
_NARROWEST = 0.05    # lines or pixels, of the filter's sigma
_COARSEST = 0.5      # of the standard deviation across, that two scan lines are apart
_FEWEST, _MOST = 16, 4096    # pixels
_SHIFT = 15          # bits of a float32 that log compression leaves out
_PHASES = 4096       # in a turn: 1.5 mrad, 56 dB below the echo
_TURN = np.column_stack([f(2.0 * np.pi * (np.arange(_PHASES) + 0.5) / _PHASES)
                         for f in (np.cos, np.sin)]).astype(np.float32)
_REACH = 3.0         # standard deviations, beyond which a Gaussian is left out: 1 % of its peak
SLICE = 2.5          # the same across the plane: 0.04 % of the energy


@dataclass(frozen=True)
class UltrasoundParams:
    """A linear probe of the 38 mm kind and its image."""

    width: int = word('pixels along the elements', default=640)
    height: int = word('pixels with depth', default=640)
    aperture: float = quantity(38.0, 'mm', 'width of the image, along the elements', low=5.0,
                               high=100.0, source='Ultrasonix 4DL14-5/38')
    depth: float = quantity(38.0, 'mm', 'height of the image', low=5.0, high=200.0,
                            source='square pixels; two thirds of a breast phantom of 55 mm')
    frequency: float = quantity(10e6, 'Hz', 'centre frequency', low=1e6, high=3e7,
                                source='middle of the 5 to 14 MHz of that probe')
    sound: float = quantity(1540.0, 'm_s', 'speed of sound', low=1000.0, high=2000.0,
                            source='soft tissue, Szabo app. B')
    lateral: float = quantity(0.65, 'mm', 'width of the point spread function at half its height, '
                              'along the elements', low=0.05, high=10.0,
                              source='wavelength 0.15 mm times f-number 4')
    axial: float = quantity(0.40, 'mm', 'that width with depth', low=0.05, high=10.0,
                            source='five half-cycles at 10 MHz')
    elevation: float = quantity(2.0, 'mm', 'that width across the image plane', low=0.05,
                                high=20.0, source='fixed elevation lens of linear probes: 1 to 3 '
                                                  'mm')
    density: float = quantity(30.0, 'per_mm3', 'scatterers in the tissue', low=0.1, high=1e3,
                              source='19 in a resolution cell: fully developed speckle takes ten')
    dynamic_range: float = quantity(60.0, 'dB', 'from black to white', low=10.0, high=120.0,
                                    source='usual setting of B-mode')
    brightness: float = quantity(-24.0, 'dB', 'mean level of plain tissue, below white',
                                 low=-100.0, high=0.0, source='own choice: mid grey')
    rate: float = quantity(20.0, 'Hz', 'images per second', low=0.5, high=100.0,
                           source='usual frame rate at this depth')

    def __post_init__(self):
        """Raise ConfigError for a picture with too few or too many pixels."""
        for name in ('width', 'height'):
            if not _FEWEST <= getattr(self, name) <= _MOST:
                raise ConfigError(f'{name} = {getattr(self, name)}; must be {_FEWEST} to {_MOST} '
                                  'pixels')

    @property
    def pixel(self):
        """(2,) [m] between pixels along the elements and with depth."""
        return np.array([self.aperture / self.width, self.depth / self.height])

    def pixels(self, places):
        """(..., 2) [pixel] u, v of places (..., 2) [m] x, z in the image plane."""
        return np.asarray(places) / self.pixel + [0.5 * (self.width - 1), 0.0]

    def places(self, pixels):
        """(..., 2) [m] x, z in the image plane of `pixels` (..., 2) u, v."""
        return (np.asarray(pixels) - [0.5 * (self.width - 1), 0.0]) * self.pixel

    @property
    def sigma(self):
        """(3,) [m] standard deviations sx, sy, sz of the point spread function."""
        return np.array([self.lateral, self.elevation, self.axial]) / _HALF_WIDTH


class ImageFormer:
    """Turns scatterers in the probe's frame into images; holds no state between images."""

    def __init__(self, params):
        """params : UltrasoundParams"""
        self.params = params
        self._grey = _grey_levels(params)
        self._wave = 4.0 * np.pi * params.frequency / params.sound
        sigma, across = params.sigma[[0, 2]], _pixels_between_lines(params)
        self._lines, pixel = params.width // across, params.pixel * [across, 1]
        self._pitch = pixel
        # Gathering on four places is a triangle of variance 1/6 of their distance squared, to
        # interpolate at quarters between lines adds 3/16; the filter is the rest.
        spread = np.array([1.0 / 6.0 + (across - 1) * 3.0 / 16.0, 1.0 / 6.0])
        left = np.sqrt(np.maximum((sigma / pixel)**2 - spread, _NARROWEST**2))
        self._kernels = [_gaussian(s) for s in left]
        # Root mean square of the envelope of plain tissue, by Campbell's theorem.
        energy = [k.sum()**2 * w / (2.0 * np.sqrt(np.pi) * s)
                  for k, w, s in zip(self._kernels, pixel, sigma, strict=True)]
        sheet = params.density * np.sqrt(np.pi) * params.sigma[1]
        plain = float(np.sqrt(sheet * np.prod(energy) * np.prod(pixel)))
        self._kernels[0] = self._kernels[0] / plain

    def signal(self, points, amplitude):
        """Return the baseband image (height, width, 2), real and imaginary part, float32; its root
        mean square is 1 in plain tissue.

        points : (n, 3) [m] in the probe's frame, origin in the middle of its face
        amplitude : (n,) echo amplitudes, 1 = plain tissue
        """
        grid = self._empty()
        _gather(points, amplitude, grid, self._wave, self.params.sigma[1], *self._pitch, _TURN)
        return self._filtered(grid)

    def tissue(self, scatterers, nodes):
        """Return the envelope (height, width) of a body, its root mean square 1 in plain tissue.

        And how many of the scatterers lie in the image. Arguments: see `tissue_signal`.
        """
        signal, seen = self.tissue_signal(scatterers, nodes)
        return self._magnitude(signal), seen

    def tissue_signal(self, scatterers, nodes):
        """Return the baseband image of a body, see `signal`, and how many scatterers lie in it.

        scatterers : speckle.TissueScatterers;  nodes : (n, 3) [m] in the probe's frame
        """
        grid, (across, deep) = self._empty(), self._pitch
        scale = 1.0 / np.array([across, self.params.sigma[1], deep])
        steps = self._wave * deep * len(_TURN) / (2.0 * np.pi)
        seen = scatterers.gather(nodes * scale + [0.5 * (self._lines - 1), 0.0, 0.0], grid, steps,
                                 _TURN)
        return self._filtered(grid), seen

    def _empty(self):
        return np.zeros((self.params.height, self._lines, 2), dtype=np.float32)

    def _filtered(self, grid):
        """The signal (height, width, 2) of what was gathered on lines."""
        lines = cv2.sepFilter2D(grid, -1, *self._kernels, borderType=cv2.BORDER_CONSTANT)
        if self._lines == self.params.width:
            return lines
        return cv2.resize(lines, (self.params.width, self.params.height),
                          interpolation=cv2.INTER_LINEAR)

    def _magnitude(self, signal):
        return cv2.magnitude(signal[..., 0], signal[..., 1])

    def envelope(self, points, amplitude):
        """Return the envelope (height, width), its root mean square 1 in plain tissue."""
        return self._magnitude(self.signal(points, amplitude))

    def compress(self, envelope):
        """Return the picture (height, width) uint8 by log compression."""
        return self._grey[np.ascontiguousarray(envelope, np.float32).view(np.uint32) >> _SHIFT]


def _pixels_between_lines(params):
    """2 where the point spread function is wide enough for a line every second pixel, else 1."""
    wide = 2.0 * params.pixel[0] <= _COARSEST * params.sigma[0]
    return 2 if wide and params.width % 2 == 0 else 1


def _grey_levels(params):
    """Grey level (65536,) uint8 by the upper half of a positive float32: 8 bits of mantissa.

    The middle of each such interval is within 0.03 dB of its ends, an eighth of a grey level.
    """
    bits = (np.arange(2**16, dtype=np.uint32) << _SHIFT) + (1 << (_SHIFT - 1))
    with np.errstate(invalid='ignore', divide='ignore'):
        decibel = 20.0 * np.log10(bits.view(np.float32).astype(float)) + params.brightness
    level = np.clip(1.0 + decibel / params.dynamic_range, 0.0, 1.0)
    return np.rint(255.0 * np.nan_to_num(level)).astype(np.uint8)


def scatterers(inside, low, high, density, rng):
    """Return points (n, 3) [m] spread evenly through a body, and amplitudes (n,) of +-1.

    inside : function of points (k, 3) -> (k,) bool;  low, high : (3,) [m] of a box around it
    density : [1/m3]
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    n = rng.poisson(density * np.prod(high - low))
    points = low + (high - low) * rng.random((n, 3))
    points = points[inside(points)]
    return points, rng.choice([-1.0, 1.0], size=len(points))


def _gaussian(sigma):
    """Taps of a Gaussian of `sigma` pixels, peak 1: a scatterer's echo keeps its amplitude."""
    reach = int(np.ceil(_REACH * sigma))
    return np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma)**2)


@numba.njit(cache=True, fastmath=True)
def _gather(points, amplitude, grid, wave, sy, dx, dz, turn):
    """Add every echo to its four places; turn : (k, 2) cosine and sine over one turn of phase."""
    height, width, _ = grid.shape
    steps = len(turn) / (2.0 * np.pi)
    for n in range(len(points)):
        y = points[n, 1] / sy
        if y * y > SLICE * SLICE:
            continue
        u = points[n, 0] / dx + 0.5 * (width - 1)
        v = points[n, 2] / dz
        if not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
            continue
        i, j = int(u), int(v)
        fu, fv = np.float32(u - i), np.float32(v - j)
        a = np.float32(amplitude[n] * np.exp(-0.5 * y * y))
        at = int(wave * points[n, 2] * steps) % len(turn)
        one = np.float32(1.0)
        for part in range(2):
            echo = a * turn[at, part]
            grid[j, i, part] += (one - fu) * (one - fv) * echo
            grid[j, i + 1, part] += fu * (one - fv) * echo
            grid[j + 1, i, part] += (one - fu) * fv * echo
            grid[j + 1, i + 1, part] += fu * fv * echo
