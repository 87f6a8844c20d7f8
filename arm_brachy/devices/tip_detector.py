"""Finds a needle's cross-section in a B-mode image: matched filter for head and comet tail.

Normalised cross-correlation of the picture with the picture of a needle, as the imaging model
draws it, over a window around where the needle is expected; the peak is refined by a parabola.
Source: normalised cross-correlation, Lewis 1995, "Fast template matching", Vision Interface;
matching of needle cross-sections is compared by Groves et al. 2019 (0.62 and 0.74 mm RMSE axially
and laterally on water and tissue).
Valid for a needle within 30 degrees of the plane's normal; a steeper one is drawn out.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.devices.needle_echo import NeedleEcho
from arm_brachy.devices.ultrasound import ImageFormer


@dataclass(frozen=True)
class TipDetectorParams:
    """When a peak counts as a needle."""

    window: float = quantity(6.0, 'mm', 'half the size of the square that is searched', low=0.5,
                             high=50.0, source='several times what the tip as told is wrong by; '
                                               'told straight, 8 mm after 80 mm of an arc')
    least: float = quantity(0.45, '', 'correlation below which no needle is reported', low=0.0,
                            high=1.0, source='own choice, above what speckle alone reaches')
    head: float = quantity(1.5, 'mm', 'template around and above the head', low=0.2, high=10.0,
                           source='three widths of the beam')
    tail: float = quantity(3.0, 'mm', 'template below the head', low=0.2, high=30.0,
                           source='four copies of the tail')


@dataclass(frozen=True)
class Detection:
    """Where the needle was seen.

    found : False = no needle;  x, z : [m] in the image plane, probe frame
    correlation : -1 to 1, of the picture with that of a needle
    """

    found: bool
    x: float
    z: float
    correlation: float


class TipDetector:
    """Looks for one needle in picture after picture; no memory."""

    def __init__(self, params, image, needle):
        """params : TipDetectorParams;  image : UltrasoundParams;  needle : NeedleEchoParams"""
        self.params, self._image = params, image
        self._template, self._head = self._drawn(needle)

    def _drawn(self, needle):
        """Template (h, w) uint8 and the pixel (u, v) of the head within it."""
        p, pixel = self.params, self._image.pixel
        middle = np.array([0.0, 0.0, 0.5 * self._image.depth])
        echo = NeedleEcho(needle, self._image).envelope(middle, np.array([0.0, 1.0, 0.0]))
        picture = ImageFormer(self._image).compress(np.maximum(echo, np.float32(1.0)))
        u, v = self._image.pixels(middle[[0, 2]])
        side, above, below = (round(length / w) for length, w in (
            (p.head, pixel[0]), (p.head, pixel[1]), (p.tail, pixel[1])))
        top, left = round(v) - above, round(u) - side
        if min(top, left) < 0 or round(v) + below >= self._image.height:
            raise ConfigError(f'tip detector: head = {1e3 * p.head:g} mm and tail = '
                              f'{1e3 * p.tail:g} mm do not fit into half of an image of '
                              f'{1e3 * self._image.aperture:g} x {1e3 * self._image.depth:g} mm; '
                              'must be shorter, or the image larger')
        return (picture[top:round(v) + below + 1, left:round(u) + side + 1],
                np.array([u - left, v - top]))

    def find(self, picture, expected):
        """Return the Detection in a picture (height, width) uint8.

        expected : (2,) [m] x, z in the image plane, around which is searched
        """
        centre = self._image.pixels(expected)
        reach = self.params.window / self._image.pixel
        size = self._template.shape[::-1]
        low = np.maximum(np.floor(centre - reach - self._head), 0).astype(int)
        high = np.minimum(np.ceil(centre + reach - self._head) + size,
                          picture.shape[::-1]).astype(int)
        if np.any(high - low < size):
            return Detection(False, np.nan, np.nan, np.nan)
        window = picture[low[1]:high[1], low[0]:high[0]]
        match = cv2.matchTemplate(window, self._template, cv2.TM_CCOEFF_NORMED)
        v, u = np.unravel_index(match.argmax(), match.shape)
        at = np.array([u + _peak(match[v], u), v + _peak(match[:, u], v)]) + low + self._head
        x, z = self._image.places(at)
        best = float(match[v, u])
        if best < self.params.least:
            return Detection(False, np.nan, np.nan, best)
        return Detection(True, float(x), float(z), best)


def _peak(values, at):
    """Offset of a parabola's maximum from its middle sample; 0 at an end."""
    if not 0 < at < len(values) - 1:
        return 0.0
    left, middle, right = values[at - 1:at + 2]
    bend = left - 2.0 * middle + right
    return 0.0 if bend >= 0.0 else float(0.5 * (left - right) / bend)
