"""Header and parameter section of a C3D file, every length held to the file's own.

Written out here because readers in C++ trust the lengths that a file states: one changed byte of
a 10 kB file asked for 12.5 GB, another ended the process (ezc3d 1.7.2).
Source: The C3D File Format, User Guide, Motion Lab Systems 2021, chapters "Header" and
"Parameters".
"""

import math
import re
from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import RecordingError

BLOCK = 512                                   # bytes
KEY = 0x50                                    # second byte of header and parameter section
INTEL, DEC, MIPS = 84, 85, 86                 # the parameter section's fourth byte
ITEM_SIZE = {-1: 1, 1: 1, 2: 2, 4: 4}         # text, bytes, integers, floats


@dataclass(frozen=True)
class Header:
    """First block. first, last : frame numbers, from 1;  analog : values in a frame, all channels.

    scale : negative if values are floats;  start : block of the first frame, from 1
    samples : of each analog channel in a frame;  rate : of the frames [Hz]
    """

    points: int
    analog: int
    first: int
    last: int
    scale: float
    start: int
    samples: int
    rate: float


@dataclass(frozen=True)
class Numbers:
    """How a processor writes its numbers."""

    kind: int

    @property
    def order(self):
        """Byte order as NumPy names it."""
        return '>' if self.kind == MIPS else '<'

    def integers(self, data, *, signed=False):
        """Return 16-bit integers (k,) of bytes."""
        return np.frombuffer(data, self.order + ('i2' if signed else 'u2'))

    def floats(self, data):
        """Return floats (k,) of bytes; DEC's are VAX F: words exchanged, four times as large."""
        if self.kind != DEC:
            return np.frombuffer(data, self.order + 'f4')
        words = np.frombuffer(data, '<u2').reshape(-1, 2)[:, ::-1]
        with np.errstate(invalid='ignore'):
            return np.ascontiguousarray(words).view('<f4').ravel() / np.float32(4.0)


class Parameters:
    """Parameters by (GROUP, NAME): text as a list of str, numbers as a 1-D array."""

    def __init__(self, values):
        self._values = values

    def number(self, group, name):
        """Return the first number of a parameter as float, None where there is none."""
        found = self._values.get((group, name))
        if isinstance(found, np.ndarray) and len(found) and math.isfinite(found[0]):
            return float(found[0])
        return None

    def numbers(self, group, name):
        """Return all numbers of a parameter, an empty array where there are none."""
        found = self._values.get((group, name))
        return found if isinstance(found, np.ndarray) else np.zeros(0)

    def texts(self, group, name):
        """Return the texts of a parameter and of those that continue it: NAME, NAME2, NAME3..."""
        found = {int(match[1] or 1): value for (at, key), value in self._values.items()
                 if at == group and isinstance(value, list)
                 and (match := re.fullmatch(re.escape(name) + r'(\d*)', key))}
        return [text for _, value in sorted(found.items()) for text in value]


def read_sections(path, data):
    """Return (Header, Parameters, Numbers) of the bytes of a C3D file; path : for messages.

    Raises RecordingError where a length or a pointer leads out of the file.
    """
    if len(data) < 2 * BLOCK or data[1] != KEY:
        raise RecordingError(f'{path}: not a readable C3D file: it has {len(data)} bytes and '
                             f'starts with {bytes(data[:2])!r}; must have a header and a '
                             'parameter section, the second byte 0x50; export it again')
    at = (data[0] - 1) * BLOCK
    if at < BLOCK or at + 4 > len(data):
        raise RecordingError(f'{path}: not a readable C3D file: parameters from block {data[0]}; '
                             f'must be 2 to {len(data) // BLOCK}; export it again')
    kind = data[at + 3]
    if kind not in (INTEL, DEC, MIPS):
        raise RecordingError(f'{path}: not a readable C3D file: processor type {kind}; must be '
                             '84 (Intel), 85 (DEC) or 86 (MIPS); export it again')
    numbers = Numbers(kind)
    header = _header(data[:BLOCK], numbers)
    return header, _Walk(path, data, at, header, numbers).parameters(), numbers


def _header(block, numbers):
    words = numbers.integers(block[2:20]).tolist()
    scale, rate = (float(numbers.floats(block[k:k + 4])[0]) for k in (12, 20))
    return Header(words[0], words[1], words[2], words[3], scale, words[7], words[8], rate)


class _Walk:
    """Steps through the records of a parameter section."""

    def __init__(self, path, data, at, header, numbers):
        self._path, self._data, self._numbers = path, data, numbers
        self._at, self._begin = at + 4, at + 4
        # The section's own count of blocks is wrong in some files; frames begin after it.
        start = (header.start - 1) * BLOCK
        stated = at + data[at + 2] * BLOCK
        self._end = min(max(stated, start if start > at else stated), len(data))

    def parameters(self):
        """Return the Parameters."""
        groups, found = {}, []
        while self._at + 2 <= self._end:
            length = abs(_signed(self._data[self._at]))
            number = _signed(self._data[self._at + 1])
            if length == 0 or number == 0:
                break
            name = _text(self._take(self._at + 2, length)).upper()
            pointer = self._at + 2 + length
            step = int(self._numbers.integers(self._take(pointer, 2))[0])
            if number < 0:
                groups[-number] = name
            else:
                found.append((number, name, self._value(name, pointer + 2)))
            if step == 0:
                break
            if step < 2:
                self._refuse(f'parameter {name!r} points to itself')
            self._at = pointer + step
        if ('POINT' not in groups.values()):
            self._refuse('no group POINT in the parameter section')
        return Parameters({(groups.get(number, ''), name): value
                           for number, name, value in found})

    def _value(self, name, at):
        kind, rank = _signed(self._take(at, 1)[0]), self._take(at + 1, 1)[0]
        if kind not in ITEM_SIZE or rank > 7:
            self._refuse(f'parameter {name!r} has type {kind} and {rank} dimensions; must be -1, '
                         '1, 2 or 4 and at most 7')
        shape = list(self._take(at + 2, rank))
        data = self._take(at + 2 + rank, math.prod(shape) * ITEM_SIZE[kind])
        if kind == -1:
            width = shape[0] if shape else 1
            return [_text(data[k:k + width]).strip(' \0')
                    for k in range(0, len(data), width)] if width else []
        if kind == 1:
            return np.frombuffer(data, np.uint8)
        return self._numbers.integers(data) if kind == 2 else self._numbers.floats(data)

    def _take(self, at, length):
        if at + length > self._end:
            self._refuse(f'a record of {length} bytes at byte {at} leads out of the parameter '
                         f'section, which ends at byte {self._end}')
        return self._data[at:at + length]

    def _refuse(self, problem):
        raise RecordingError(f'{self._path}: not a readable C3D file: {problem}; the file is '
                             'damaged: export it again')


def _signed(byte):
    return byte - 256 if byte > 127 else byte


def _text(data):
    try:
        return bytes(data).decode()
    except UnicodeDecodeError:
        return bytes(data).decode('latin-1')
