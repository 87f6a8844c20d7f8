"""Reads a table of numbers; whatever is not one is refused by file, line and column."""

import csv
import difflib
import gzip
import math
import re
import string
import zlib
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.csv_map import TIME_UNITS

MISSING = frozenset({'', 'nan'})
FEW = 12    # columns, to be named all


@dataclass(frozen=True)
class Table:
    """Rows of a file in order of time. t_ns : (n,) int64 on the file's own clock plus its offset.

    cells : (n, columns) raw values, NaN where missing;  lines : (n,) line numbers in the file
    frames : (n,) frame counter
    """

    path: str
    header: tuple
    cells: np.ndarray
    lines: np.ndarray
    t_ns: np.ndarray
    frames: np.ndarray

    def column(self, name):
        """Return one column (n,). Raises RecordingError listing the header."""
        return self.cells[:, self.index(name)]

    def index(self, name):
        """Return the position of a column in the header."""
        if name not in self.header:
            raise RecordingError(f'{self.path}: no column {name!r}; {self._offered(name)}')
        return self.header.index(name)

    def _offered(self, name):
        """What the header has, of long ones what is spelt nearly so."""
        near = difflib.get_close_matches(name, self.header, n=3)
        if near and len(self.header) > FEW:
            return f'did you mean {" or ".join(map(repr, near))}? ({len(self.header)} columns)'
        return f'the header has: {self._listed}'

    @property
    def _listed(self):
        more = len(self.header) - FEW
        return ', '.join(self.header[:FEW]) + (f' and {more} more' if more > 0 else '')

    def columns(self, pattern, names, axes=('',)):
        """Resolve a column pattern.

        Returns (our names, cells (n, names, axes)). Raises RecordingError if a column is absent or
        if no column has the pattern's form.
        """
        keys = names or {k: k for k in self._keys(pattern, axes)}
        index = [[self.index(pattern.format(key=key, axis=axis)) for axis in axes]
                 for key in keys.values()]
        return tuple(keys), self.cells[:, np.array(index)]

    def _keys(self, pattern, axes):
        axis = '(?:' + '|'.join(re.escape(a) for a in axes) + ')'
        groups = {'key': '(?P<key>.+?)', 'axis': axis, None: ''}
        form = re.compile(''.join(re.escape(text) + groups[name]
                                  for text, name, *_ in string.Formatter().parse(pattern)))
        found = [m.group('key') for m in map(form.fullmatch, self.header) if m]
        if not found:
            raise RecordingError(f'{self.path}: no column has the form {pattern!r}; the header '
                                 f'has: {self._listed}')
        return tuple(dict.fromkeys(found))


def read_table(path, options):
    """Read one CSV file (plain or .gz) as the map's `CsvFile` says.

    Raises RecordingError as file:line:column for a cell that is no number, a row of the wrong
    length, a row without a time, and for unsorted or duplicate rows unless the options admit them.
    """
    header, lines, rows = _read_rows(path, options)
    cells = _numbers(path, header, lines, rows, options)
    nothing = np.zeros(0, dtype=np.int64)
    table = Table(str(path), header, cells, lines, nothing, nothing)
    t_ns = _times(table, options)
    order = _order(path, options, lines, t_ns)
    table = replace(table, cells=cells[order], lines=lines[order], t_ns=t_ns[order])
    return replace(table, frames=_frames(table, options))


def count_frames(t_ns):
    """Number the samples of a nominally periodic stream so that lost ones leave a gap.

    t_ns : (n,) increasing. Each step counts as the nearest whole number of median periods, at
    least one; meant for jitter below half a period.
    """
    if len(t_ns) < 2:
        return np.arange(len(t_ns))
    steps = np.diff(t_ns)
    counts = np.maximum(1, np.rint(steps / np.median(steps)).astype(np.int64))
    return np.concatenate([[0], np.cumsum(counts)])


def read_header(path, options):
    """Return the names of the columns (a tuple). Raises RecordingError if there are none."""
    with _rows(path, options) as reader:
        return _header(path, next(reader, None), options)


@contextmanager
def _rows(path, options):
    """A csv.reader of a file at its header; trouble with the file is a RecordingError."""
    opener = gzip.open if str(path).endswith('.gz') else open
    try:
        with opener(path, 'rt', encoding='utf-8-sig', newline='') as stream:
            reader = csv.reader(stream, delimiter=options.delimiter, strict=True)
            for _ in range(options.header_line - 1):
                next(reader, None)
            yield reader
    except FileNotFoundError:
        raise RecordingError(f'{path}: no such file') from None
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f'{path}: cannot be read: {error}') from None


def _read_rows(path, options):
    with _rows(path, options) as reader:
        header = _header(path, next(reader, None), options)
        for _ in range(options.skip_below):
            next(reader, None)
        lines, rows = [], []
        for row in reader:
            if not row:
                continue
            if len(row) != len(header):
                raise RecordingError(
                    f'{path}:{reader.line_num}: {len(row)} cells; must be {len(header)} as in '
                    'the header (a file cut off while it was written? delete the line)')
            lines.append(reader.line_num)
            rows.append(row)
    if not rows:
        raise RecordingError(f'{path}: holds no rows below the header')
    return header, np.array(lines), rows


def _header(path, row, options):
    if not row:
        raise RecordingError(f'{path}:{options.header_line}: no header; must name the columns')
    header = tuple(name.strip() for name in row)
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise RecordingError(f'{path}:{options.header_line}: column {twice[0]!r} appears twice')
    return header


def _numbers(path, header, lines, rows, options):
    """Cells as floats (n, columns). Word by word only if need be: numpy is ten times faster."""
    plain = not options.missing and options.decimal == '.'
    try:
        cells = np.array(rows, dtype=float) if plain else None
    except ValueError:
        cells = None
    if cells is None:
        missing = MISSING.union(options.missing)
        cells = np.array([[_number(path, line, name, cell, missing, options.decimal)
                           for name, cell in zip(header, row, strict=True)]
                          for line, row in zip(lines, rows, strict=True)])
    bad = np.argwhere(np.isinf(cells))
    if len(bad):
        row, column = bad[0]
        raise _bad_cell(path, lines[row], header[column], rows[row][column])
    return cells


def _number(path, line, name, cell, missing, decimal):
    text = cell.strip()
    if text in missing or text.lower() in missing:
        return math.nan
    try:
        # Where decimals follow a comma a point parts thousands, perhaps: no number is guessed.
        return float(text if decimal == '.' else text.replace('.', ' ').replace(decimal, '.'))
    except ValueError:
        raise _bad_cell(path, line, name, cell) from None


def _bad_cell(path, line, name, cell):
    return RecordingError(f'{path}:{line}:{name}: {cell!r} is no number; must be one, or empty or '
                          'NaN for "not measured" (add other words to `missing` in the map; '
                          'a line of units below the names is skipped by `skip_below: 1`)')


def _times(table, options):
    t = table.column(options.time) * TIME_UNITS[options.time_unit] + options.clock_offset
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        raise RecordingError(f'{table.path}:{table.lines[bad[0]]}:{options.time}: no time in this '
                             'row; every row needs one (delete the line)')
    return np.rint(t * 1e9).astype(np.int64)


def _frames(table, options):
    if not options.frame_column:
        return count_frames(table.t_ns)
    frames = table.column(options.frame_column)
    bad = np.flatnonzero(~np.isfinite(frames) | (frames < 0) | (frames != np.floor(frames)))
    if len(bad):
        place = f'{table.path}:{table.lines[bad[0]]}:{options.frame_column}'
        raise RecordingError(f'{place}: no frame counter; must be a whole number >= 0 everywhere')
    return frames.astype(np.int64)


def _order(path, options, lines, t_ns):
    """Indices of the rows to keep, in order of time."""
    order = np.arange(len(t_ns))
    back = np.flatnonzero(np.diff(t_ns) < 0)
    if len(back):
        if options.unsorted == 'refuse':
            raise RecordingError(
                f'{path}:{lines[back[0] + 1]}: earlier than the row before it; sort the file or '
                'set `unsorted: sort` in the map')
        order = np.argsort(t_ns, kind='stable')
    same = np.diff(t_ns[order]) == 0
    if not same.any():
        return order
    if options.duplicates == 'refuse':
        second = order[np.flatnonzero(same)[0] + 1]
        raise RecordingError(
            f'{path}:{lines[second]}: a second row with the same time; delete it or set '
            '`duplicates: first` or `duplicates: last` in the map')
    keep = (np.concatenate([[True], ~same]) if options.duplicates == 'first'
            else np.concatenate([~same, [True]]))
    return order[keep]
