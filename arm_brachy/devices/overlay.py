"""What a person sees over an ultrasound image.

The template's holes, the tip as told and as seen, a cavity's outline, a scale of depth. And what
somebody steers by: where the tip will be at the target's depth, and where it is to be, two marks
that are to be brought together.
"""

import cv2
import numpy as np

_GREEN, _RED, _YELLOW, _WHITE = (0, 200, 0), (255, 60, 60), (255, 220, 0), (200, 200, 200)
_BLUE, _MAGENTA, _CYAN = (90, 170, 255), (255, 80, 255), (0, 230, 230)
_HOLE, _TIP, _CROSS, _DOT = 3, 12, 6, 1     # pixels: radii of the circles, half a cross
_AIM, _BOLD = 11, 2  # pixels: half a mark of where the tip will be, and is to be; its line
_TICK, _DEPTH = 8, 5e-3             # pixels long;  m between them
_SHIFT = 4                          # binary digits of a pixel's fraction that cv2 draws with
_FAR = 1e4                          # pixels off the image, beyond which nothing is drawn


def overlay(picture, pixel, holes, expected, found, outline=None, aim=None):
    """Return a picture (height, width) as (height, width, 3) uint8 with what is known drawn in.

    pixel : (2,) [m] of a pixel
    holes : (columns, rows, 2) [pixel] where the axes of the holes pierce the image, or None; the
        middle one is filled
    expected, found : (2,) [pixel] of the tip as told (cross), as seen (circle), or None
    outline : (k, 2) [pixel] of a cavity as seen (dots), or None
    aim : (2, 2) [pixel] where the tip will be (diamond) and where it is to be (square), or None
    """
    out = cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)
    for v in np.arange(0.0, picture.shape[0], _DEPTH / pixel[1]):
        cv2.line(out, (0, round(v)), (_TICK, round(v)), _WHITE)
    if holes is not None:
        size = np.array(picture.shape[::-1])
        middle = tuple(n // 2 for n in holes.shape[:2])
        for where in zip(*np.nonzero(np.all((holes > -_HOLE) & (holes < size + _HOLE), axis=2)),
                         strict=True):
            _circle(out, holes[where], _HOLE, _GREEN, cv2.FILLED if where == middle else 1)
    if expected is not None:
        _mark(out, expected, cv2.MARKER_CROSS, _CROSS, _YELLOW)
    for point in () if outline is None else outline:
        _circle(out, point, _DOT, _BLUE, cv2.FILLED)
    if found is not None:
        _circle(out, found, _TIP, _RED, 1)
    if aim is not None:
        _mark(out, aim[1], cv2.MARKER_SQUARE, _AIM, _CYAN, _BOLD)
        _mark(out, aim[0], cv2.MARKER_DIAMOND, _AIM, _MAGENTA, _BOLD)
    return out


def _mark(image, place, kind, half, colour, thickness=1):
    if np.abs(place).max() < _FAR:
        cv2.drawMarker(image, tuple(int(round(c)) for c in place), colour, kind, 2 * half,
                       thickness)


def _circle(image, centre, radius, colour, thickness):
    u, v = np.rint(np.asarray(centre) * 2**_SHIFT).astype(int).tolist()
    cv2.circle(image, (u, v), radius * 2**_SHIFT, colour, thickness, cv2.LINE_AA, _SHIFT)
