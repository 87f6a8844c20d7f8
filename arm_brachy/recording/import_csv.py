"""A laboratory's CSV files -> a bag, by a column map."""

import re
import string
from pathlib import Path

import numpy as np

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.recording.cell_axes import check_axes, force_vectors
from arm_brachy.recording.csv_map import FORCE_SIGNS, FORCE_UNITS, LENGTH_UNITS, ColumnMap
from arm_brachy.recording.csv_table import read_table
from arm_brachy.recording.lab_streams import LabStreams
from arm_brachy.recording.stand_ins import without_stand_ins

KINDS = ('encoders', 'forces', 'optical', 'em')
LENGTH_OFF = 0.1    # of the length of a quaternion from one: written with two decimals at worst
TOPIC_PART = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')  # of a ROS 2 name


def import_csv(map_file, out_dir, *, folder=None, name=None, attachments=None):
    """Convert the files that a column map names into one bag.

    map_file : YAML as `csv_map.ColumnMap`;  out_dir : new bag directory
    folder : what the map's file paths are relative to; by default the folder of the map itself
    name : of the recording; None = that of the map
    attachments : file name -> text, kept in the bag (e.g. the scene)
    Times, jitter included, are kept as the files give them: nothing is resampled. A missing value
    gives a marker that is not visible, a tool without a pose, a wrench or actuator left out; so
    does a number that stands for one, `stand_ins`.
    Returns a dict: bag, messages (topic -> number), streams (topic -> rate_Hz, jitter_ms,
    longest_step_ms, rows, missing_values), absent (optional files that are not there), notes (what
    was taken out or made of a file, sentences).
    Raises ConfigError for the map, RecordingError (file:line:column) for the files.
    """
    map_file = Path(map_file)
    column_map = config.load(ColumnMap, map_file)
    return import_map(column_map, map_file, out_dir, folder=folder, name=name,
                      attachments=attachments)


def import_map(column_map, map_file, out_dir, *, folder=None, name=None, attachments=None,
               text=None):
    """As `import_csv`, of a ColumnMap that was read.

    map_file : Path that errors name and paths are relative to;  text : of the map, to be kept in
        the bag, None = that of the file
    """
    streams, absent, read = LabStreams(), [], 0
    home = map_file.parent / column_map.folder
    for kind in KINDS:
        for i, options in enumerate(getattr(column_map, kind)):
            where = f'{map_file}: {kind}[{i}]'
            _check(where, kind, options)
            path = file_of(options.csv.path, home, folder)
            if not path.exists() and options.csv.optional:
                absent.append(options.csv.path)
                continue
            if not path.exists():
                raise RecordingError(f'{path}: no such file, which {where} names; if it was '
                                     'moved, name its folder with --folder')
            table = read_table(path, options.csv)
            streams.notes += table.notes
            _BUILDERS[kind](streams, options, table, _shifted(table, column_map.start))
            read += 1
    if not read:
        raise ConfigError(f'{map_file}: names no file that is there; give encoders, forces, '
                          f'optical or em{_absent_in(folder or home, absent)}')
    info = {'name': name or column_map.name, 'source': column_map.source, 'map': map_file.name}
    text = map_file.read_text(encoding='utf-8') if text is None else text
    bag, counts = streams.write(out_dir, info, {'columns.yaml': text, **(attachments or {})})
    return {'bag': bag, 'messages': counts, 'streams': streams.report,
            'absent': list(dict.fromkeys(absent)), 'notes': list(dict.fromkeys(streams.notes))}


def file_of(path, home, folder=None):
    """Where a file of a map is: Path, there or not.

    path : as in the map;  home : folder of the map
    folder : named instead of it, where the file may also stand under the last parts of its path:
        maps made by `import scene` have a path that leads from another place
    """
    if folder is None:
        return Path(home) / path
    parts = Path(path).parts
    places = [Path(folder).joinpath(*parts[i:]) for i in range(len(parts))]
    return next((place for place in places if place.is_file()), places[0])


def _check(where, kind, options):
    """Refuse what is wrong in the map before any file is read."""
    _check_patterns(where, kind, options)
    _check_lines(where, options.csv)
    for name in options.names if kind in ('forces', 'em') else ():
        check_topic_part(f'{where}.names', name)
    if kind == 'forces':
        check_axes(where, options, 'axis' in _placeholders(where, 'columns', options.columns))
        if not options.counts > 0.0:
            raise ConfigError(f'{where}.counts = {options.counts}; must be above 0')


def check_topic_part(where, name):
    """Refuse, with a ConfigError, a name that cannot be part of a topic."""
    if not TOPIC_PART.fullmatch(name):
        raise ConfigError(f'{where}: {name!r}; must be letters, digits and _ without a digit '
                          'first, as it becomes part of a topic: give it such a name in `names`')


def _check_lines(where, options):
    for key, low in (('header_line', 1), ('skip_below', 0)):
        if getattr(options, key) < low:
            raise ConfigError(f'{where}: csv.{key} is {getattr(options, key)}; must be at least '
                              f'{low}')
    if not all(0 < line < options.header_line for line in options.name_lines):
        raise ConfigError(f'{where}: csv.name_lines is {list(options.name_lines)}; must be lines '
                          f'above header_line, which is {options.header_line}')
    for key in ('delimiter', 'decimal'):
        value = getattr(options, key)
        if len(value) != 1 or value in '"\r\n':
            raise ConfigError(f'{where}: csv.{key} is {value!r}; must be one sign; a tab is '
                              '"\\t", in double quotes')
    if options.decimal == options.delimiter:
        raise ConfigError(f'{where}: csv.decimal is {options.decimal!r}, as is csv.delimiter; '
                          "must be another sign; give the delimiter, e.g. ';'")


def _shifted(table, start):
    return table.t_ns + round(start * 1e9)


def _measured(streams, table, names, values, options, *, points=False, what='values'):
    """values (n, k, c) with NaN for numbers that stand for nothing, which notes tell."""
    found = without_stand_ins(values, codes=options.csv.codes, points=points,
                              zeros=getattr(options, 'zeros', 'place'))
    for code in dict.fromkeys(one for _, one, _ in found.found):
        rows = [(names[k], some) for k, one, some in found.found if one == code]
        count = sum(len(some) for _, some in rows)
        first = min(int(some.min()) for _, some in rows)
        of = ', '.join(f'{name} {len(some)}' for name, some in rows[:6])
        more = f' and {len(rows) - 6} more' if len(rows) > 6 else ''
        keep = ('; if it is a place (a tracker whose origin is a marker), set `zeros: place`'
                if code == '0 0 0' else '')
        streams.notes.append(
            f'{table.path}: {count} {what} are {code} and count as not measured: {of}{more}; the '
            f'first in line {table.lines[first]}{keep}.')
    for k, rows in found.kept:
        streams.notes.append(f'{table.path}: {names[k]} is at 0 0 0 in {len(rows)} rows and moves '
                             f'there by itself: taken for a place, the first in line '
                             f'{table.lines[rows[0]]}.')
    if points:
        _tell_half_missing(streams, table, names, found.values)
    return found.values


def _tell_half_missing(streams, table, names, values):
    missing = np.isnan(values)
    half = missing.any(axis=2) & ~missing.all(axis=2)
    for k in np.flatnonzero(half.any(axis=0)):
        rows = np.flatnonzero(half[:, k])
        streams.notes.append(f'{table.path}: {names[k]} lacks some of its axes in {len(rows)} '
                             f'rows, the first in line {table.lines[rows[0]]}: not measured '
                             'there.')


def _by_state(streams, table, options, names, values):
    """values (n, k, 3) with NaN where the file says in words that nothing was measured."""
    if not options.state:
        return values
    keys = {name: options.names.get(name, name) for name in names}
    words = table.words(options.state, keys)
    said = np.isin(words, options.measured)
    for k in np.flatnonzero(~said.all(axis=0)):
        rows = np.flatnonzero(~said[:, k])
        others = ', '.join(sorted(set(words[rows, k].tolist()))) or 'nothing'
        streams.notes.append(f'{table.path}: {names[k]} says {others} in {len(rows)} rows, the '
                             f'first in line {table.lines[rows[0]]}: not measured there.')
    return np.where(said[..., None], values, np.nan)


def _check_unit(table, options, units):
    """Refuse a unit of the map that is not the one which the file states."""
    stated = table.layout.unit if table.layout is not None else ''
    if stated and stated in units and stated != options.unit:
        raise RecordingError(f'{table.path}: states its values in {stated}, the map says '
                             f'{options.unit}; must be the same: set `unit: {stated}`')


def _encoders(streams, options, table, t_ns):
    names, cells = table.columns(options.columns, options.names)
    cells = _measured(streams, table, names, cells, options)
    for k in np.flatnonzero(np.isnan(cells).any(axis=(0, 2))):
        rows = np.flatnonzero(np.isnan(cells[:, k, 0]))
        streams.notes.append(f'{table.path}: {names[k]} was not read in {len(rows)} rows, the '
                             f'first in line {table.lines[rows[0]]}.')
    streams.add_encoders(t_ns, options.frame, names,
                         cells[:, :, 0] * LENGTH_UNITS[options.unit])


def _forces(streams, options, table, t_ns):
    _check_unit(table, options, FORCE_UNITS)
    names, force = force_vectors(
        options, table, lambda names, read: _measured(streams, table, names, read, options))
    for name in names:
        check_topic_part(table.path, name)
    scale = FORCE_UNITS[options.unit] * FORCE_SIGNS[options.sign] / options.counts
    streams.add_forces(t_ns, options.frame, names, force * scale)


def _points(streams, options, table):
    """(names, positions (n, k, 3) [m]) of markers or tools."""
    _check_unit(table, options, LENGTH_UNITS)
    names, points = table.columns(options.columns, options.names, options.axes)
    points = _by_state(streams, table, options, names, points)
    points = _measured(streams, table, names, points, options, points=True, what='positions')
    return names, points * LENGTH_UNITS[options.unit]


def _optical(streams, options, table, t_ns):
    names, points = _points(streams, options, table)
    streams.add_optical(t_ns, options.frame, names, points, table.frames)


def _tools(streams, options, table, t_ns):
    names, points = _points(streams, options, table)
    for name in names:
        check_topic_part(table.path, name)
    keys = options.names or dict(zip(names, names, strict=True))
    turns = quality = None
    if options.quaternion:
        turns = table.columns(options.quaternion, keys, options.quaternion_axes)[1]
        turns = np.where(np.isfinite(points).all(axis=2)[..., None], turns, np.nan)
        turns = _unit_turns(streams, table, names, turns)
    if options.quality:
        quality = table.columns(options.quality, keys)[1][:, :, 0]
    streams.add_tools(t_ns, options.frame, names, points, table.frames, turns=turns,
                      quality=quality)


def _unit_turns(streams, table, names, turns):
    """Quaternions (n, k, 4), NaN where they are none: a length far from one."""
    size = np.linalg.norm(turns, axis=2)
    bad = np.isfinite(size) & (np.abs(size - 1.0) > LENGTH_OFF)
    for k in np.flatnonzero(bad.any(axis=0)):
        rows = np.flatnonzero(bad[:, k])
        streams.notes.append(f'{table.path}: the quaternion of {names[k]} is none in {len(rows)} '
                             f'rows (length {size[rows[0], k]:.3g}), the first in line '
                             f'{table.lines[rows[0]]}: not measured there.')
    return np.where(bad[..., None], np.nan, turns)


_BUILDERS = {'encoders': _encoders, 'forces': _forces, 'optical': _optical, 'em': _tools}


def _check_patterns(where, kind, options):
    """A wrong placeholder is a mistake in the map: say so before any file is read."""
    for key, allowed in (('columns', ('key', 'axis')), ('quaternion', ('key', 'axis')),
                         ('quality', ('key',)), ('state', ('key',))):
        pattern = getattr(options, key, '')
        if kind == 'encoders':
            allowed = ('key',)
        for name in _placeholders(where, key, pattern):
            if name not in allowed:
                braces = ' and '.join('{' + a + '}' for a in allowed)
                raise ConfigError(f'{where}.{key} = {pattern!r}; may hold only '
                                  f'{braces}')
        if pattern and '{key}' not in pattern:
            raise ConfigError(f'{where}.{key} = {pattern!r}; must hold {{key}}, for which `names` '
                              "has the file's words, '' among them")


def _absent_in(folder, files):
    return f'; {folder} has no {", ".join(dict.fromkeys(files))}' if files else ''


def _placeholders(where, key, pattern):
    try:
        return [name for _, name, _, _ in string.Formatter().parse(pattern) if name is not None]
    except ValueError as error:
        raise ConfigError(f'{where}.{key} = {pattern!r}: {error}') from None
