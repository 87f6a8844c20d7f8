"""Shapes over time as one JSON value, small enough to lie inside a page; `stage.js` plays it.

A shape that recurs, a pad at rest or the template, is written once. Coordinates are whole
multiples of UNIT, shades one character a corner.
"""

import json

import numpy as np

from arm_brachy.viewing.shapes import SHADES, Kind, palette, shade_index

UNIT = 2e-5       # m
_TURN = 3         # decimals of a rotation matrix: 0.03 deg
_DIGITS = '0123456789abcdefghijklmnopqrstuv'    # of a shade, as many as SHADES
_POSED = (Kind.DISC, Kind.ELLIPSOID, Kind.BOX)


class Film:
    """Frames of shapes, added in order of time."""

    def __init__(self, full_colour):
        """full_colour : displacement [m] of the last colour, for the legend."""
        self._full_colour = full_colour
        self._shapes, self._layers, self._meshes, self._frames = {}, {}, {}, []

    def add(self, t, shapes):
        """Append a frame: t [s], Shape each."""
        self._frames.append([round(float(t), 3), [self._number(one) for one in shapes]])

    def __len__(self):
        """Number of frames."""
        return len(self._frames)

    def _number(self, shape):
        """Number of a shape in the table; equal ones share it."""
        text = json.dumps(self._written(shape), separators=(',', ':'))
        return self._shapes.setdefault(text, len(self._shapes))

    def _written(self, shape):
        out = {'l': self._layers.setdefault(shape.layer, len(self._layers)),
               'k': shape.kind.value, 'c': [round(float(c), 3) for c in shape.colour],
               'p': whole(shape.points)}
        if shape.size:
            out['z'] = whole(shape.size)
        if shape.triangles is not None:
            triangles = json.dumps(np.asarray(shape.triangles).ravel().tolist(),
                                   separators=(',', ':'))
            out['m'] = self._meshes.setdefault(triangles, len(self._meshes))
        if shape.shades is not None:
            out['h'] = ''.join(_DIGITS[k] for k in shade_index(shape.shades))
        if shape.kind in _POSED:
            out['a'] = np.round(shape.axes, _TURN).ravel().tolist()
            out['d'] = whole(shape.scale)
        return out | ({'x': shape.text} if shape.text else {})

    def text(self, **more):
        """The whole as JSON text; `more` : further keys, JSON values."""
        head = {'unit': UNIT, 'full_colour': self._full_colour,
                'palette': np.round(palette()[:SHADES], 3).tolist(),
                'layers': list(self._layers), 'frames': self._frames, **more}
        body = json.dumps(head, separators=(',', ':'), allow_nan=False)
        return (f'{body[:-1]},"shapes":[{",".join(self._shapes)}],'
                f'"meshes":[{",".join(self._meshes)}]}}')


def whole(lengths):
    """Lengths [m] as a flat list of multiples of UNIT, or one number."""
    found = np.round(np.asarray(lengths, dtype=float) / UNIT).astype(int)
    return found.ravel().tolist() if found.ndim else int(found)
