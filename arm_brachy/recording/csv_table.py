"""Reads a table of numbers; whatever is not one is refused by file, line and column.

Only columns that are asked for are read as numbers: what else stands in a file is left alone.
"""

import codecs
import csv
import gzip
import math
import re
import zlib
from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.csv_header import Header, owners_above, owners_before
from arm_brachy.recording.csv_layout import cells_of, guess_delimiter, recognise
from arm_brachy.recording.csv_map import TIME_UNITS

# As C libraries, Excel, R, pandas and data bases write it.
BLANK = ' \t\r'
MISSING = frozenset({'', 'nan', '-nan', '+nan', 'nan(ind)', '-nan(ind)', '1.#qnan', '-1.#qnan',
                     '1.#ind', '-1.#ind', '1.#snan', 'na', 'n/a', '#n/a', '#na', 'null', 'none'})
LATEST = 9e9        # s: a stamp has 63 bits of nanoseconds, and seconds of a date have ten digits
COUNTER = 2**32 - 1     # largest number of a frame in a bag
COUNTS = re.compile(r'frame|sample|sequence|index|row|count|scan', re.IGNORECASE)


@dataclass(frozen=True)
class Table:
    """Rows of a file in order of time. t_ns : (n,) int64 on the file's own clock plus its offset.

    header : csv_header.Header;  rows : of cells as text, as many as the header has
    lines : (n,) line numbers in the file;  options : csv_map.CsvFile
    frames : (n,) frame counter;  layout : csv_layout.Layout or None;  notes : sentences
    """

    path: str
    header: Header
    rows: list
    lines: np.ndarray
    options: object
    t_ns: np.ndarray = None
    frames: np.ndarray = None
    layout: object = None
    notes: tuple = ()
    _read: dict = field(default_factory=dict, compare=False)

    def column(self, name):
        """Return one column (n,) as numbers, NaN where missing. Raises RecordingError."""
        found = self._index(name)
        if found not in self._read:
            self._read[found] = _numbers(self, found, name)
        return self._read[found]

    def columns(self, pattern, names, axes=('',)):
        """Resolve a column pattern.

        Returns (our names, cells (n, names, axes)). Raises RecordingError if a column is absent or
        if no column has the pattern's form.
        """
        clock = (self.options.time, self.options.frame_column)
        keys = names or {k: k for k in self.header.keys(pattern, axes, without=clock)}
        cells = np.array([[self.column(pattern.format(key=key, axis=axis)) for axis in axes]
                          for key in keys.values()])
        return tuple(keys), np.moveaxis(cells, 2, 0)

    def words(self, pattern, names):
        """Text (n, names) of a pattern without axes."""
        index = [self._index(pattern.format(key=key, axis='')) for key in names.values()]
        return np.array([[row[i].strip() for i in index] for row in self.rows])

    def _index(self, name):
        """Number of a column; of several of one name, the first if all have the same cells."""
        found = self.header.find(name)
        if len(found) > 1 and any(row[i] != row[found[0]] for row in self.rows for i in found):
            raise self.header.repeats(name, found)
        return found[0]


def read_table(path, options):
    """Read one CSV file (plain or .gz) as the map's `CsvFile` says.

    Raises RecordingError as file:line:column for a cell that is no number, a row of the wrong
    length, a row without a time, and for unsorted or duplicate rows unless the options admit them.
    """
    lines = text_lines(path, options.encoding)
    given, (layout, options) = options, _with_layout(lines, options)
    header, first = _header(str(path), lines, options, layout)
    numbers, rows, notes = _rows(str(path), lines, options, header, first)
    if options != given:
        notes.insert(0, f'{path}: an export of {layout.kind}, by which its header was read; '
                        f'--preset {layout.preset} prints all keys for it.')
    table = Table(str(path), header, rows, np.array(numbers), options, layout=layout,
                  notes=tuple(notes))
    table, t_ns = _timed(table)
    order = _order(table, t_ns)
    table = replace(table, rows=[table.rows[i] for i in order], lines=table.lines[order],
                    t_ns=t_ns[order], _read={})
    return replace(table, frames=_frames(table))


def text_lines(path, encoding='utf-8'):
    """The lines of a text file, .gz or not, without their ends. Raises RecordingError."""
    opener = gzip.open if str(path).endswith('.gz') else open
    try:
        with opener(path, 'rb') as stream:
            data = stream.read()
        text = data.decode(_encoding(data, encoding))
    except FileNotFoundError:
        raise RecordingError(f'{path}: no such file') from None
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise RecordingError(f'{path}:{line}: byte {data[error.start]:#04x} is no {encoding}; '
                             'give the encoding of the file, e.g. `encoding: cp1252`') from None
    except LookupError:
        raise RecordingError(f'{path}: encoding {encoding!r} is not known; must be one such as '
                             'utf-8, cp1252, utf-16') from None
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(f'{path}: cannot be read: {error}') from None
    if '\0' in text:
        raise RecordingError(f'{path}: cannot be read: holds a zero byte, so it is no text')
    return re.split('\r\n|\n|\r', text)


def _encoding(data, wanted):
    """That of a byte order mark, or the wanted one."""
    marks = {codecs.BOM_UTF8: 'utf-8-sig', codecs.BOM_UTF16_LE: 'utf-16',
             codecs.BOM_UTF16_BE: 'utf-16'}
    return next((name for mark, name in marks.items() if data.startswith(mark)), wanted)


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
    lines = text_lines(path, options.encoding)
    layout, options = _with_layout(lines, options)
    return _header(str(path), lines, options, layout)[0].own


def _with_layout(lines, options):
    """(Layout or None, options with what the export says of itself where the map is silent)."""
    layout = recognise(lines, options.delimiter)
    if layout is None:
        return None, options
    if options.header_line == 1 and not options.skip_below:
        options = replace(options, header_line=layout.header_line, skip_below=layout.skip_below,
                          until_blank=layout.until_blank)
    if options.header_line == layout.header_line:
        options = replace(options, name_lines=options.name_lines or layout.name_lines,
                          group=options.group or layout.group,
                          until_blank=options.until_blank or layout.until_blank)
    return layout, options


def _header(path, lines, options, layout):
    """(Header, index of the first line below it)."""
    if layout is not None and layout.header and options.header_line == layout.header_line:
        return Header(path, layout.header), layout.skip_below
    at = options.header_line - 1
    if at >= len(lines) or not lines[at].strip():
        raise RecordingError(f'{path}:{at + 1}: no header; must name the columns')
    own = tuple(cells_of(lines[at], options.delimiter))
    if len(own) == 1:
        _refuse_other_delimiter(path, lines, at, options)
    above = [cells_of(lines[i - 1], options.delimiter) for i in options.name_lines
             if 0 < i <= len(lines)]
    owners = owners_above(above, len(own)) if above else ()
    if options.group:
        own, owners = owners_before(own, options.group)
    hint = ''
    if layout is not None and layout.header_line != options.header_line:
        hint = (f' (an export of {layout.kind}: its columns are named in line '
                f'{layout.header_line}, set `header_line`, or use --preset {layout.preset})')
    return Header(path, own, owners, hint), at + 1


def _refuse_other_delimiter(path, lines, at, options):
    """Raise RecordingError where a header of one cell shows that another sign parts the cells."""
    better = guess_delimiter(lines[at:at + 1])
    if better == options.delimiter or better not in lines[at]:
        return
    below = cells_of(next((line for line in lines[at + 1:] if line.strip()), ''), better)
    comma = any(re.fullmatch(r'-?\d+,\d+', cell) for cell in below)
    shown = '"\\t"' if better == '\t' else f'"{better}"'
    raise RecordingError(
        f'{path}:{at + 1}: one column only, by the delimiter {options.delimiter!r}; must be '
        f'several: set `delimiter: {shown}`' + (' and `decimal: ","`' if comma else ''))


def _rows(path, lines, options, header, first):
    """(line numbers, rows of as many cells as the header has, notes)."""
    numbers, rows, notes = [], [], []
    start = first + options.skip_below if options.header_line else first
    reader = csv.reader(lines[start:], delimiter=options.delimiter, strict=True)
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                numbers.append(start + reader.line_num)
                rows.append(row)
            elif options.until_blank and rows:
                break
    except csv.Error as error:
        raise RecordingError(f'{path}:{start + reader.line_num}: cannot be read: {error}'
                             ) from None
    if not rows:
        raise RecordingError(f'{path}: holds no rows below the header')
    width = len(header.own)
    for row in rows:        # a delimiter at the end of a line makes an empty cell
        while len(row) > width and not row[-1].strip():
            row.pop()
    lacking = width - max(map(len, rows))
    if lacking > 0 and not any(header.own[-lacking:]):
        rows = [row + [''] * lacking for row in rows]
    bad = [i for i, row in enumerate(rows) if len(row) != width]
    if not bad:
        return numbers, rows, notes
    short = [i for i in bad if len(rows[i]) < width]
    if len(short) < len(bad) or options.incomplete == 'refuse':
        raise _wrong_length(path, numbers, rows, bad, width, options)
    notes.append(_told(path, numbers, short, 'end early', options))
    if options.incomplete == 'skip':
        gone = set(short)
        numbers, rows = ([x for i, x in enumerate(some) if i not in gone]
                         for some in (numbers, rows))
    return numbers, [row + [''] * (width - len(row)) for row in rows], notes


def _told(path, numbers, index, what, options):
    """A sentence on rows that `incomplete` admits."""
    done = {'skip': 'left out', 'missing': 'taken for not measured there'}[options.incomplete]
    return (f'{path}: {len(index)} of {len(numbers)} rows {what} and were {done}, the first in '
            f'line {numbers[index[0]]}.')


def _wrong_length(path, numbers, rows, bad, width, options):
    """RecordingError that says of rows with too many or too few cells what to do."""
    row = rows[bad[0]]
    place = f'{path}:{numbers[bad[0]]}: {len(row)} cells; must be {width} as in the header'
    every = len(bad) == len(rows)
    if len(row) > width and options.delimiter == ',' and every:
        return RecordingError(f'{place}, and so in all {len(rows)} rows: are there commas before '
                              'the decimals? export with points, or with another `delimiter` and '
                              '`decimal: ","`')
    if bad == [len(rows) - 1] and len(row) < width:
        return RecordingError(f'{place}: the file ends in the midst of its last row; set '
                              '`incomplete: skip` to read it without that row')
    if len(row) < width:
        return RecordingError(f'{place}, and so in {len(bad)} of {len(rows)} rows; set '
                              '`incomplete: missing` if cells at the end were not measured, or '
                              '`incomplete: skip` to leave such rows out')
    return RecordingError(f'{place}, and so in {len(bad)} of {len(rows)} rows; set `delimiter`, '
                          '`header_line` or `skip_below` as the file has them')


def _numbers(table, index, name):
    """One column as floats (n,). Cell by cell only if need be: numpy is ten times faster."""
    options, texts = table.options, [row[index] for row in table.rows]
    values = None
    if not options.missing and options.decimal == '.' and all(
            '_' not in text and text.isprintable() for text in texts):
        try:
            values = np.array(texts, dtype=float)
        except ValueError:
            values = None
    if values is None:
        missing = MISSING.union(options.missing)
        values = np.array([_number(table.path, line, name, text, missing, options)
                           for line, text in zip(table.lines, texts, strict=True)])
    bad = np.flatnonzero(np.isinf(values))
    if len(bad):
        raise _bad_cell(table.path, table.lines[bad[0]], name, texts[bad[0]], options)
    return values


def _number(path, line, name, cell, missing, options):
    text = cell.strip(BLANK)
    if text in missing or text.lower() in missing:
        return math.nan
    try:
        # Python's digits, and control characters that it takes for blanks: nobody's instrument
        if '_' in text or not text.isascii() or not text.isprintable():
            raise ValueError
        # Where decimals follow a comma a point parts thousands, perhaps: no number is guessed.
        return float(text if options.decimal == '.' else
                     text.replace('.', ' ').replace(options.decimal, '.'))
    except ValueError:
        raise _bad_cell(path, line, name, cell, options) from None


def _bad_cell(path, line, name, cell, options):
    what = ('add other words to `missing` in the map; a line of units below the names is skipped '
            'by `skip_below: 1`')
    if options.decimal == '.' and re.fullmatch(r'\s*[-+]?\d+,\d+\s*', cell):
        what = '`decimal: ","` if a comma comes before the decimals'
    elif options.decimal == ',' and re.fullmatch(r'\s*[-+]?[\d.]+\s*', cell):
        what = '`decimal: "."` if a point comes before the decimals'
    return RecordingError(f'{path}:{line}:{name}: {cell!r} is no number; must be one, or empty or '
                          f'NaN for "not measured" ({what})')


def _timed(table):
    """(Table without rows that have no time where they may be skipped, t_ns (n,))."""
    options = table.options
    t, rate = _seconds(table)
    bad = np.flatnonzero(~(np.abs(t) < LATEST))
    if len(bad) and options.incomplete == 'skip':
        note = _told(table.path, table.lines, bad, 'have no time', options)
        keep = np.setdiff1d(np.arange(len(t)), bad)
        table = replace(table, rows=[table.rows[i] for i in keep], lines=table.lines[keep],
                        notes=(*table.notes, note), _read={})
        t = t[keep]
    elif len(bad):
        said = 'no time in this row' if np.isnan(t[bad[0]]) else f'{t[bad[0]]:g} s is no time'
        raise RecordingError(f'{table.path}:{table.lines[bad[0]]}:{options.time}: {said}; every '
                             'row needs one: mend it, or set `incomplete: skip` to leave such '
                             'rows out')
    if not len(t):
        raise RecordingError(f'{table.path}: holds no row with a time')
    if rate:
        table = replace(table, notes=(*table.notes, rate))
    return table, np.rint((t + options.clock_offset) * 1e9).astype(np.int64)


def _seconds(table):
    """(times (n,) [s], a sentence on where they come from or '')."""
    options, layout = table.options, table.layout
    stated = layout.rate if layout is not None else 0.0
    rate = options.rate or stated
    if not options.time:
        if not rate:
            raise RecordingError(f'{table.path}: `time` is empty, so rows are counted; must have '
                                 '`rate_Hz`')
        return np.arange(len(table.rows)) / rate, ''
    values = table.column(options.time)
    known = values[np.isfinite(values)]
    whole = bool(len(known)) and bool(np.all(known == np.rint(known)))
    if options.rate:
        return values / options.rate, ''
    if not (whole and COUNTS.search(options.time) and options.time_unit == 's'):
        return values * TIME_UNITS[options.time_unit], (
            f'{table.path}: the times in {options.time!r} are whole seconds, one by one; if they '
            'count samples, set `rate_Hz`.' if whole and options.time_unit == 's'
            and len(known) > 2 and np.all(np.diff(known) == 1.0) else '')
    if stated:
        return values / stated, (f'{table.path}: {options.time!r} counts frames; the file states '
                                 f'{stated:g} Hz, by which they are times.')
    raise RecordingError(f'{table.path}: column {options.time!r} counts frames, and no rate is '
                         'known; must be a time, or set `rate_Hz` in the map: the frames a '
                         f'second that the counter counts{_usual(layout)}')


def _usual(layout):
    return ' (of NDI 60 on Polaris, 40 on Aurora)' if layout and layout.preset == 'ndi' else ''


def _frames(table):
    options = table.options
    if not options.frame_column:
        return count_frames(table.t_ns)
    frames = table.column(options.frame_column)
    bad = np.flatnonzero(~((frames >= 0) & (frames <= COUNTER) & (frames == np.floor(frames))))
    if len(bad):
        place = f'{table.path}:{table.lines[bad[0]]}:{options.frame_column}'
        raise RecordingError(f'{place}: no frame counter; must be a whole number >= 0 everywhere, '
                             f'at most {COUNTER}')
    return frames.astype(np.int64)


def _order(table, t_ns):
    """Indices of the rows to keep, in order of time."""
    path, options, lines = table.path, table.options, table.lines
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
            f'{path}:{lines[second]}: a second row with the same time; set `duplicates: first` or '
            '`duplicates: last` in the map to keep one of them')
    keep = (np.concatenate([[True], ~same]) if options.duplicates == 'first'
            else np.concatenate([~same, [True]]))
    return order[keep]
