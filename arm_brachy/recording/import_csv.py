"""A laboratory's CSV files -> a bag, by a column map."""

import heapq
import string
from pathlib import Path

import numpy as np

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.recording import encode
from arm_brachy.recording.cell_axes import check_axes, force_vectors
from arm_brachy.recording.csv_map import FORCE_SIGNS, FORCE_UNITS, LENGTH_UNITS, ColumnMap
from arm_brachy.recording.csv_table import read_table
from arm_brachy.recording.sampling import sampling
from arm_brachy.recording.writer import BagWriter

QUATERNION_AXES = ('x', 'y', 'z', 'w')


def import_csv(map_file, out_dir, *, folder=None, name=None, attachments=None):
    """Convert the files that a column map names into one bag.

    map_file : YAML as `csv_map.ColumnMap`;  out_dir : new bag directory
    folder : what the map's file paths are relative to; by default the folder of the map itself
    name : of the recording; None = that of the map
    attachments : file name -> text, kept in the bag (e.g. the scene)
    Times, jitter included, are kept as the files give them: nothing is resampled. A missing value
    gives a marker that is not visible, a tool without a pose, a wrench or actuator left out.
    Returns a dict: bag, messages (topic -> number), streams (topic -> rate_Hz, jitter_ms,
    longest_step_ms, rows, missing_values), absent (optional files that are not there).
    Raises ConfigError for the map, RecordingError (file:line:column) for the files.
    """
    map_file = Path(map_file)
    folder = map_file.parent if folder is None else Path(folder)
    column_map = config.load(ColumnMap, map_file)
    encoder = encode.Encoder()
    streams, report, absent = [], {}, []
    for kind, build in _BUILDERS.items():
        for i, options in enumerate(getattr(column_map, kind)):
            where = f'{map_file}: {kind}[{i}]'
            _check_patterns(where, kind, options)
            _check_lines(where, options.csv)
            if kind == 'forces':
                check_axes(where, options,
                           'axis' in _placeholders(where, 'columns', options.columns))
            if options.csv.optional and not (folder / options.csv.path).exists():
                absent.append(options.csv.path)
                continue
            table = read_table(folder / options.csv.path, options.csv)
            t_ns = _shifted(table, column_map.start)
            topics, records = build(encoder, options, table, t_ns, report)
            streams.append((topics, records))
    if not streams:
        raise ConfigError(f'{map_file}: names no file that is there; give encoders, forces, '
                          f'optical or em{_absent_in(folder, absent)}')
    info = {'name': name or column_map.name, 'source': column_map.source, 'map': map_file.name}
    held = {'columns.yaml': map_file.read_text(encoding='utf-8'), **(attachments or {})}
    with BagWriter(out_dir, provenance=info, attachments=held) as bag:
        for topics, _ in streams:
            for topic, type_name in topics:
                bag.add_topic(topic, type_name, definition=encoder.definitions[type_name])
        merged = heapq.merge(*(records for _, records in streams), key=lambda record: record[0])
        for t, topic, sequence, data in merged:
            bag.write(topic, data, t, sequence=sequence)
    return {'bag': str(bag.directory), 'messages': bag.counts, 'streams': report,
            'absent': list(dict.fromkeys(absent))}


def _check_lines(where, options):
    for key, low in (('header_line', 1), ('skip_below', 0)):
        if getattr(options, key) < low:
            raise ConfigError(f'{where}: csv.{key} is {getattr(options, key)}; must be at least '
                              f'{low}')
    if options.decimal == options.delimiter:
        raise ConfigError(f'{where}: csv.decimal is {options.decimal!r}, as is csv.delimiter; '
                          "must be another sign; give the delimiter, e.g. ';'")


def _shifted(table, start):
    t_ns = table.t_ns + round(start * 1e9)
    if t_ns[0] < 0:
        raise RecordingError(f'{table.path}: time {t_ns[0] * 1e-9:g} s is negative; set `start_s` '
                             'in the map so that every stream begins at 0 or later')
    return t_ns


def _encoders(encoder, options, table, t_ns, report):
    topic = '/actuators/state'
    names, cells = table.columns(options.columns, options.names)
    position = cells[:, :, 0] * LENGTH_UNITS[options.unit]
    report[topic] = sampling(t_ns, np.isnan(position))

    def records():
        for k, t in enumerate(t_ns.tolist()):
            known = np.flatnonzero(np.isfinite(position[k]))
            if len(known):
                data = encoder.joint_state(t, options.frame, [names[i] for i in known],
                                           position[k, known])
                yield t, topic, k, data
    return [(topic, encode.JOINT_STATE)], records()


def _forces(encoder, options, table, t_ns, report):
    names, force = force_vectors(options, table)
    force = force * (FORCE_UNITS[options.unit] * FORCE_SIGNS[options.sign])
    topics = [f'/force/{name}/wrench' for name in names]
    known = np.isfinite(force).all(axis=2)
    for i, topic in enumerate(topics):
        report[topic] = sampling(t_ns, ~known[:, i:i + 1])

    def records():
        for k, t in enumerate(t_ns.tolist()):
            for i in np.flatnonzero(known[k]):
                yield t, topics[i], k, encoder.wrench(t, options.frame, force[k, i])
    return [(topic, encode.WRENCH) for topic in topics], records()


def _optical(encoder, options, table, t_ns, report):
    topic = '/optical/markers'
    names, points = table.columns(options.columns, options.names, options.axes)
    points = points * LENGTH_UNITS[options.unit]
    report[topic] = sampling(t_ns, np.isnan(points).any(axis=2))

    def records():
        for k, t in enumerate(t_ns.tolist()):
            yield t, topic, k, encoder.optical_frame(t, options.frame, int(table.frames[k]), names,
                                                     points[k])
    return [(topic, encode.OPTICAL)], records()


def _tools(encoder, options, table, t_ns, report):
    names, points = table.columns(options.columns, options.names, options.axes)
    points = points * LENGTH_UNITS[options.unit]
    keys = options.names or dict(zip(names, names, strict=True))
    turns = np.broadcast_to(encode.IDENTITY, (*points.shape[:2], 4))
    if options.quaternion:
        turns = table.columns(options.quaternion, keys, QUATERNION_AXES)[1]
    quality = np.full(points.shape[:2], encode.NOT_MEASURED)
    if options.quality:
        quality = table.columns(options.quality, keys)[1][:, :, 0]
    known = np.isfinite(points).all(axis=2) & np.isfinite(turns).all(axis=2)
    topics = []
    for i, name in enumerate(names):
        report[f'/em/{name}/pose'] = sampling(t_ns, ~known[:, i:i + 1])
        topics += [(f'/em/{name}/pose', encode.POSE), (f'/em/{name}/status', encode.TOOL_STATUS)]

    def records():
        for k, t in enumerate(t_ns.tolist()):
            for i, name in enumerate(names):
                if known[k, i]:
                    yield t, f'/em/{name}/pose', k, encoder.pose(
                        t, options.frame, points[k, i], turns[k, i])
                yield t, f'/em/{name}/status', k, encoder.tool_status(
                    t, options.frame, name, int(table.frames[k]), known[k, i], quality[k, i])
    return topics, records()


_BUILDERS = {'encoders': _encoders, 'forces': _forces, 'optical': _optical, 'em': _tools}


def _check_patterns(where, kind, options):
    """A wrong placeholder is a mistake in the map: say so before any file is read."""
    for key, allowed in (('columns', ('key', 'axis')), ('quaternion', ('key', 'axis')),
                         ('quality', ('key',))):
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
