"""What a steel needle adds to an ultrasound image that it crosses: a bright head, a comet tail.

Where the needle's axis pierces the image plane it is a strong reflector as wide as the beam. Sound
that runs to and fro within the steel comes back later: copies below the head, a fixed distance
apart, each weaker by a constant factor. When the plane lies beyond the tip, the head fades as the
beam's profile across the plane does.
Sources: Zhu, UBC MASc thesis 2009 (needle visibility); Reusz, Sarkany, Gatt, Spencer, Br J Anaesth
2014, 112:794 (comet tail of needles); Huang, Triedman, Vasilyev, Suematsu, Cleveland, Dupont 2007,
Ultrasound Med Biol 33:1132 (reverberation within metal).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from arm_brachy.core.quantity import quantity

_FAINTEST = 0.05     # of plain tissue: copies below it end the tail


@dataclass(frozen=True)
class NeedleEchoParams:
    """How a needle looks across the image."""

    brightness: float = quantity(24.0, 'dB', 'of the head, above plain tissue', low=0.0, high=60.0,
                                 source='saturates B-mode at usual gain')
    decay: float = quantity(-5.0, 'dB', 'from one copy of the tail to the next', low=-60.0,
                            high=-0.1, source='tails of some millimetres, Reusz et al. 2014')
    spacing: float = quantity(0.7, 'mm', 'between copies', low=0.05, high=10.0,
                              source='through 1.27 mm of steel (18 G) and back at 5790 m/s, seen '
                                     'at 1540 m/s: 0.34 mm; every second copy is strong')


class NeedleEcho:
    """Envelope of a needle across an image."""

    def __init__(self, params, image):
        """params : NeedleEchoParams;  image : UltrasoundParams, for grid and beam"""
        self._image = image
        self._head = 10.0**(params.brightness / 20.0)
        self._decay, self._spacing = 10.0**(params.decay / 20.0), params.spacing

    def envelope(self, tip, axis):
        """Return the envelope (height, width) in units of plain tissue; 0 where there is no echo.

        tip : (3,) [m] in the probe's frame;  axis : (3,) unit vector of insertion there
        """
        image = np.zeros((self._image.height, self._image.width), dtype=np.float32)
        self.add_to(image, tip, axis)
        return image

    def add_to(self, envelope, tip, axis):
        """Add the echo to the envelope (height, width) float32 of the tissue, in place.

        Amplitudes add as independent ones do; a strong reflector hides the speckle.
        """
        pierced, visible = self.crossing(tip, axis)
        columns, _ = _span(pierced[0], pierced[2], self._image)
        if not len(columns):
            return
        band = np.zeros((self._image.height, len(columns)), dtype=np.float32)
        level, at = self._head * visible, pierced[2]
        while level > _FAINTEST:
            _add_spot(band, pierced[0], at, level, self._image)
            level, at = level * self._decay, at + self._spacing
        part = envelope[:, columns[0]:columns[-1] + 1]
        part[...] = cv2.magnitude(np.ascontiguousarray(part), band)

    def crossing(self, tip, axis):
        """Return where the plane sees the needle (3,) [m], and how brightly, 0 to 1.

        The place is where the axis pierces the plane if the tip is through it, else the tip.
        """
        tip, axis = np.asarray(tip, dtype=float), np.asarray(axis, dtype=float)
        through = tip[1] * np.sign(axis[1]) >= 0.0 and axis[1] != 0.0
        if through:
            return tip - axis * (tip[1] / axis[1]), 1.0
        sy = self._image.sigma[1]
        return tip, float(np.exp(-0.5 * (tip[1] / sy)**2))


def _span(x, z, params):
    """Columns and rows of the image that a spot at (x, z) [m] reaches."""
    pixel, sigma = params.pixel, params.sigma[[0, 2]]
    centre = params.pixels([x, z])
    reach = np.ceil(3.0 * sigma / pixel).astype(int)
    return tuple(np.arange(max(0, int(c) - r), min(n, int(c) + r + 2))
                 for c, r, n in zip(centre, reach, (params.width, params.height), strict=True))


def _add_spot(band, x, z, level, params):
    """Add a Gaussian of the beam's width at (x, z) [m] to the columns that it reaches."""
    u, v = _span(x, z, params)
    if not len(v):
        return
    across, down = (np.exp(-0.5 * ((k - c) * w / s)**2) for k, c, w, s in
                    zip((u, v), params.pixels([x, z]), params.pixel, params.sigma[[0, 2]],
                        strict=True))
    band[v[0]:v[-1] + 1] += level * np.outer(down, across).astype(np.float32)
