"""Points of a C3D file: where its frames lie, which of them were seen, what each point is.

Header and parameters state the same counts twice. Where they differ, the one statement that fills
the file exactly holds; where none or several do, the file is refused.
Source: The C3D File Format, User Guide, Motion Lab Systems 2021, chapters "3D Point Data" and
"Analog Data Storage".
"""

from collections import Counter
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.guard import guarded
from arm_brachy.recording.c3d_parameters import BLOCK, read_sections

# Groups of POINT that name results of a body model kept among the points.
MODEL_OUTPUTS = ('ANGLES', 'FORCES', 'MOMENTS', 'POWERS', 'SCALARS', 'REACTIONS')
SATURATED = 65535   # largest frame number that header and POINT:FRAMES hold
SAME_RATE = 5e-4    # relative: 119.88 and 120 Hz are two rates, 119.88 and 119.880119 one


@dataclass(frozen=True)
class Layout:
    """Where frames lie. start : byte of the first;  analog : values behind the points of each."""

    start: int
    points: int
    analog: int
    frames: int
    floats: bool

    @property
    def size(self):
        """Bytes of all frames."""
        return self.frames * self.row * self.word

    @property
    def row(self):
        """Values in a frame."""
        return 4 * self.points + self.analog

    @property
    def word(self):
        """Bytes of a value."""
        return 4 if self.floats else 2


@dataclass(frozen=True)
class C3dFile:
    """Points of a file, all of them.

    labels : k names, '' where a point has none;  values : (n, k, 3) in `unit`, NaN = not seen
    resolution : step of the values, 0 for floats;  model_outputs : label -> its group
    rate : [Hz];  first : number of the first frame, from 0;  notes : what a person should know
    """

    labels: tuple
    values: np.ndarray
    resolution: float
    unit: str
    model_outputs: dict
    rate: float
    first: int
    notes: tuple


def read_file(path):
    """Read a C3D file as C3dFile; a point is not seen where its residual is negative or NaN.

    Raises RecordingError naming file and contradiction.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f'{path}: no such file')
    try:
        data = np.memmap(path, np.uint8, 'r') if path.stat().st_size else np.zeros(0, np.uint8)
    except OSError as error:
        raise RecordingError(f'{path}: cannot be read: {error.strerror}') from None
    head = bytes(data[:2 * 256 * BLOCK])  # parameters begin in one of 255 blocks and fill 255
    header, parameters, numbers = read_sections(path, head)
    with guarded(path, RecordingError, 'a readable C3D file', 'export it again'):
        layout, notes = _layout(path, header, parameters, len(data))
    labels, more = _labels(parameters, layout.points)
    scale = parameters.number('POINT', 'SCALE')
    scale = abs(header.scale if scale is None else scale)
    if not (layout.floats or 0.0 < scale < np.inf):
        raise RecordingError(f'{path}: POINT:SCALE = {scale:g}; must be > 0 for points kept as '
                             'integers; export it again')
    values = _values(data, layout, numbers, scale)
    units = parameters.texts('POINT', 'UNITS')
    return C3dFile(labels, values, 0.0 if layout.floats else scale, units[0] if units else '',
                   _model_outputs(parameters), _rate(path, header, parameters),
                   header.first - 1, (*notes, *more))


def _layout(path, header, parameters, size):
    """The Layout that header and parameters agree upon or that fills the file, and notes."""
    stated = _stated(header, parameters)
    choices = [Layout(*values) for values in product(*stated.values())]
    if len(choices) == 1:
        chosen = choices[0]
        room = size - chosen.start
        if not (chosen.start >= 2 * BLOCK and chosen.size <= room and chosen.frames > 0):
            raise RecordingError(
                f'{path}: says {chosen.frames} frames of {chosen.row * chosen.word} bytes from '
                f'byte {chosen.start}; the file has {max(room, 0)} bytes there: it is cut short '
                'or damaged; export it again')
        return _with_the_rest(chosen, header, room)
    fitting = [c for c in choices if c.start >= 2 * BLOCK and c.frames > 0
               and 0 <= size - c.start - c.size < BLOCK]
    differing = '; '.join(f'{name} {" or ".join(str(v) for v in values)}'
                          for name, values in stated.items() if len(values) > 1)
    if len(fitting) != 1:
        raise RecordingError(f'{path}: header and parameters differ ({differing}) and '
                             f'{len(fitting)} of the {len(choices)} readings fill the file of '
                             f'{size} bytes; must be one; export it again')
    return fitting[0], (f'header and parameters differ ({differing}); read as what fills '
                        f'the file: {fitting[0].frames} frames of {fitting[0].points} points and '
                        f'{fitting[0].analog} analog values',)


def _with_the_rest(layout, header, room):
    """The layout, with the frames beyond the last number that can be stated, and notes."""
    left = room - layout.size
    if left < BLOCK:
        return layout, ()
    if header.last == SATURATED and layout.frames < SATURATED + 1:
        frames = room // (layout.row * layout.word)
        return replace(layout, frames=frames), (
            f'states {layout.frames} frames, the most it can; holds {frames}, all read',)
    return layout, (f'{left} bytes after the last frame are left out',)


def _stated(header, parameters):
    """What the file states of its layout: name -> distinct values, in the order of Layout."""
    def both(first, name):
        second = parameters.number('POINT', name)
        return _distinct([first, second if second is None else int(second)])
    scale = parameters.number('POINT', 'SCALE')
    return {'first byte': [(start - 1) * BLOCK for start in both(header.start, 'DATA_START')],
            'points': both(header.points, 'USED'),
            'analog values': _analog(header, parameters),
            'frames': _frames(header, parameters),
            'floats': _distinct([header.scale < 0.0, None if scale is None else scale < 0.0])}


def _analog(header, parameters):
    used = parameters.number('ANALOG', 'USED')
    samples = [header.samples]
    rates = parameters.number('ANALOG', 'RATE'), parameters.number('POINT', 'RATE')
    if used and all(rates):
        samples.append(round(rates[0] / rates[1]))
    return _distinct([header.analog, *(int(used or 0) * n for n in samples if n or not used)])


def _frames(header, parameters):
    """Counts of frames; those that may have run over are left out where there are others."""
    counts = [header.last - header.first + 1]
    if (frames := parameters.number('POINT', 'FRAMES')) is not None:
        counts.append(int(frames))
    long = []
    if (frames := parameters.number('POINT', 'LONG_FRAMES')) is not None:
        long.append(int(frames))
    ends = [parameters.numbers('TRIAL', f'ACTUAL_{end}_FIELD') for end in ('START', 'END')]
    if all(len(end) == 2 for end in ends):
        first, last = (int(end[0]) + int(end[1]) * 65536 for end in ends)
        long.append(last - first + 1)
    if long and (max(long) > SATURATED or header.last == SATURATED):
        return _distinct(long)
    return _distinct(counts + long)


def _distinct(values):
    return list(dict.fromkeys(v for v in values if v is not None))


def _values(data, layout, numbers, scale):
    """Points (n, k, 3) in the file's unit, NaN where not seen."""
    raw = data[layout.start:layout.start + layout.size]
    words = numbers.floats(raw) if layout.floats else numbers.integers(raw, signed=True)
    points = words.reshape(layout.frames, layout.row)[:, :4 * layout.points]
    points = points.reshape(layout.frames, layout.points, 4)
    values = points[:, :, :3].astype(float)
    if not layout.floats:
        values *= scale
    hidden = ~(points[:, :, 3] >= 0)  # residual and cameras; NaN is hidden too
    values[hidden | ~np.isfinite(values).all(axis=2)] = np.nan
    return values


def _labels(parameters, count):
    """`count` labels, and notes; labels beyond the points belong to none."""
    labels = parameters.texts('POINT', 'LABELS')
    notes = []
    if any(labels[count:]):
        notes.append(f'{len(labels)} labels for {count} points: the first {count} belong to them')
    labels = labels[:count] + [''] * (count - len(labels))
    if '' in labels:
        notes.append(f'{labels.count("")} of {count} points have no label and are left out')
    return tuple(labels), notes


def _model_outputs(parameters):
    return {label: group for group in MODEL_OUTPUTS
            for label in parameters.texts('POINT', group) if label}


def _rate(path, header, parameters):
    rate = parameters.number('POINT', 'RATE') or header.rate
    if not 0.0 < rate < np.inf:
        raise RecordingError(f'{path}: frame rate {rate:g} Hz; must be > 0')
    if header.rate > 0.0 and not abs(header.rate / rate - 1.0) <= SAME_RATE:
        raise RecordingError(f'{path}: frame rate {header.rate:g} Hz in the header, {rate:g} Hz '
                             'in POINT:RATE; must be the same; export it again')
    return rate


def doubled(labels):
    """Return the labels that more than one point has, in order."""
    return [label for label, n in Counter(labels).items() if n > 1 and label]
