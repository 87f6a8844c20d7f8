"""A laboratory's own ROS 2 bag -> a bag that `diagnose` takes, by a topic map."""

from collections import defaultdict
from pathlib import Path

import numpy as np

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.recording.cell_axes import axes_of, check_mounting
from arm_brachy.recording.csv_map import FORCE_SIGNS, FORCE_UNITS, LENGTH_UNITS
from arm_brachy.recording.csv_table import COUNTER, count_frames
from arm_brachy.recording.import_csv import check_topic_part
from arm_brachy.recording.lab_bag import lab_bag
from arm_brachy.recording.lab_streams import LabStreams
from arm_brachy.recording.stand_ins import without_stand_ins
from arm_brachy.recording.topic_map import TopicMap

JOINTS, WRENCH = 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/WrenchStamped'
ARRAY, CLOUD = 'geometry_msgs/msg/PoseArray', 'sensor_msgs/msg/PointCloud2'
TF, OPTICAL = 'tf2_msgs/msg/TFMessage', 'arm_brachy_msgs/msg/OpticalFrame'
SINGLE = {      # -> (position, orientation or None) of a message
    'geometry_msgs/msg/PoseStamped': lambda m: (m.pose.position, m.pose.orientation),
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda m: (m.pose.pose.position,
                                                              m.pose.pose.orientation),
    'geometry_msgs/msg/PointStamped': lambda m: (m.point, None),
    'geometry_msgs/msg/TransformStamped': lambda m: (m.transform.translation,
                                                     m.transform.rotation)}
FLOATS = {7: np.dtype('f4'), 8: np.dtype('f8')}     # sensor_msgs/PointField
NOWHERE = (np.nan,) * 3
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def import_bag(bag, map_file, out_dir, *, name=None, attachments=None):
    """Convert the topics of a bag that a topic map names into one bag of ours.

    bag : path of a rosbag2 folder (MCAP or sqlite3) or .mcap file
    map_file : YAML as `topic_map.TopicMap`;  out_dir, name, attachments : as `import_csv`
    Times are kept; messages that come out of order are sorted, and of two with one time the first
    is kept, which notes tell. Numbers that stand for nothing are missing, `stand_ins`.
    Returns a dict as `import_csv`: bag, messages, streams, notes.
    Raises ConfigError for the map, RecordingError for the bag.
    """
    map_file = Path(map_file)
    topics = config.load(TopicMap, map_file)
    streams = LabStreams()
    with lab_bag(bag) as (types, messages):
        sections = list(_sections(topics, map_file, types, bag))
        tracks = _tracks(topics, sections, types, messages)
    for kind, options in sections:
        _BUILDERS[kind](streams, options, tracks, topics.start)
    info = {'name': name or topics.name, 'source': topics.source, 'map': map_file.name}
    held = {'topics.yaml': map_file.read_text(encoding='utf-8'), **(attachments or {})}
    path, counts = streams.write(out_dir, info, held)
    return {'bag': path, 'messages': counts, 'streams': streams.report,
            'notes': list(dict.fromkeys(streams.notes))}


def _sections(topics, map_file, types, bag):
    """(kind, section) of the map, checked against the bag's topics and types."""
    found = False
    for kind in ('encoders', 'forces', 'optical', 'em'):
        for i, options in enumerate(getattr(topics, kind)):
            where, found = f'{map_file}: {kind}[{i}]', True
            for topic in _topics_of(options):
                if topic not in types:
                    held = ', '.join(f'{name} ({kind_.split("/")[-1]})'
                                     for name, kind_ in sorted(types.items())) or 'none'
                    raise RecordingError(f'{bag}: has no topic {topic!r}, which {where} names; '
                                         f'it has: {held}')
            _check_section(where, kind, options, types)
            yield kind, options
    if not found:
        raise ConfigError(f'{map_file}: names no topic; give encoders, forces, optical or em; the '
                          f'bag has: {", ".join(sorted(types)) or "none"}')


def _topics_of(options):
    one = getattr(options, 'topic', '')
    return tuple(dict.fromkeys(([one] if one else []) + list(getattr(options, 'topics',
                                                                     {}).values())))


def _check_section(where, kind, options, types):
    """Refuse a type or a key that does not go with the other; ConfigError."""
    allowed = {'encoders': (JOINTS,), 'forces': (WRENCH,)}.get(kind)
    if allowed:
        _require_types(where, _topics_of(options), types, allowed)
    else:
        if bool(options.topic) == bool(options.topics):
            raise ConfigError(f'{where}: must have `topic` for a topic of all points, or `topics` '
                              'with one for each, and not both')
        if options.topics:
            _require_types(where, options.topics.values(), types, tuple(SINGLE))
        else:
            _require_types(where, [options.topic], types, (ARRAY, CLOUD, TF, OPTICAL))
            key = {ARRAY: 'order', CLOUD: 'order', TF: 'names'}.get(types[options.topic])
            if key and not getattr(options, key):
                raise ConfigError(f'{where}: {options.topic} is a {types[options.topic]}; must '
                                  f'have `{key}`, which says what its points are')
            given = [one for one in options.order if one]
            if len(set(given)) < len(given):
                raise ConfigError(f'{where}.order: has a name twice; must have each once')
    if kind == 'forces':
        check_mounting(where, options.mounted, options.topics)
    if kind == 'forces':
        names = options.topics
    elif kind == 'em':
        names = options.topics or options.names or [one for one in options.order if one]
    else:
        return      # names of joints and markers stand in messages, not in topics
    for name in names:
        check_topic_part(where, name)


def _require_types(where, topics, types, allowed):
    for topic in topics:
        if types[topic] not in allowed:
            short = ', '.join(one.replace('/msg/', '/') for one in allowed)
            raise ConfigError(f'{where}: {topic} is a {types[topic].replace("/msg/", "/")}; must '
                              f'be one of {short}')


def _tracks(topics, sections, types, messages):
    """(topic, item) -> ([t_ns], [values]); item is a joint, child frame or place in an array."""
    tracks = defaultdict(lambda: ([], []))
    wanted = dict.fromkeys(topic for _, options in sections for topic in _topics_of(options))
    for topic, received, message in messages(list(wanted)):
        for t, item, value in _items(types[topic], message):
            t = received if topics.clock == 'log' else t
            if t == 0:
                raise RecordingError(f'{topic}: a header without a stamp; set `clock: log` to '
                                     'take the times of receipt')
            times, values = tracks[topic, item]
            times.append(t)
            values.append(value)
    return dict(tracks)


def _items(kind, message):
    """Yield (stamp [ns], item, value) of a message; values of points are x y z and quaternion."""
    if kind == TF:
        for one in message.transforms:
            yield _stamp(one), one.child_frame_id, _point(*SINGLE[
                'geometry_msgs/msg/TransformStamped'](one))
        return
    t = _stamp(message)
    if kind in SINGLE:
        yield t, '', _point(*SINGLE[kind](message))
    elif kind == JOINTS:
        for i, value in enumerate(message.position):
            yield t, message.name[i] if i < len(message.name) else str(i), (float(value),)
    elif kind == WRENCH:
        f = message.wrench.force
        yield t, '', (f.x, f.y, f.z)
    elif kind == OPTICAL:
        for one, point, visible in zip(message.ids, message.points, message.visible,
                                       strict=True):
            yield t, one, _point(point) if visible else (*NOWHERE, *NO_TURN)
    else:
        points = ([_point(one.position, one.orientation) for one in message.poses]
                  if kind == ARRAY else [(*p, *NO_TURN) for p in _cloud(message)])
        for i, value in enumerate(points):
            yield t, (i, len(points)), value



def _stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _point(position, turn=None):
    q = NO_TURN if turn is None else (turn.x, turn.y, turn.z, turn.w)
    return (position.x, position.y, position.z, *q)


def _cloud(message):
    """Points (n, 3) of a PointCloud2. Raises RecordingError for one without x, y, z as floats."""
    fields = {field.name: field for field in message.fields}
    if not {'x', 'y', 'z'} <= set(fields) or any(fields[a].datatype not in FLOATS for a in 'xyz'):
        raise RecordingError(f'a PointCloud2 with the fields {", ".join(fields) or "none"}; must '
                             'have x, y and z as floats')
    count = message.width * message.height
    data = np.frombuffer(bytes(message.data), dtype=np.uint8)
    step, order = message.point_step, '>' if message.is_bigendian else '<'
    if count and len(data) < count * step:
        raise RecordingError(f'a PointCloud2 of {count} points with {len(data)} bytes; must have '
                             f'{count * step}')
    rows = data[:count * step].reshape(count, step) if count else np.zeros((0, step), np.uint8)
    out = []
    for axis in 'xyz':
        kind, at = FLOATS[fields[axis].datatype].newbyteorder(order), fields[axis].offset
        out.append(np.ascontiguousarray(rows[:, at:at + kind.itemsize]).view(kind)[:, 0]
                   if count else np.zeros(0))
    return np.stack(out, axis=1).astype(float).tolist()


def _series(streams, options, tracks, keys, width, start):
    """(t_ns (n,), values (n, k, width)) of tracks; NaN where another has a time and one has not.

    keys : name -> (topic, item)
    """
    parts = {}
    for name, key in keys.items():
        if key not in tracks:
            topic, item = key
            held = sorted({str(one) for there, one in tracks if there == topic and one})
            raise RecordingError(f'{topic}: has no {item or "message"!r}, which is to be {name}; '
                                 f'it has: {", ".join(held) or "none"}')
        t, values = np.array(tracks[key][0], dtype=np.int64), np.array(tracks[key][1], dtype=float)
        parts[name] = _in_order(streams, key[0], name, t, values[:, :width])
    times = np.unique(np.concatenate([t for t, _ in parts.values()]))
    out = np.full((len(times), len(parts), width), np.nan)
    for k, (t, values) in enumerate(parts.values()):
        out[np.searchsorted(times, t), k] = values
    return times + round(start * 1e9), out


def _in_order(streams, topic, name, t, values):
    """One channel sorted by time, the first of several at one time; notes say so."""
    order = np.argsort(t, kind='stable')
    if np.any(np.diff(t) < 0):
        streams.notes.append(f'{topic}: {int(np.sum(np.diff(t) < 0))} messages of {name or topic} '
                             'are earlier than the one before; they were sorted.')
    keep = np.concatenate([[True], np.diff(t[order]) > 0])
    if not keep.all():
        streams.notes.append(f'{topic}: {int(np.sum(~keep))} messages of {name or topic} repeat '
                             'the time of another; the first was kept.')
    return t[order][keep], values[order][keep]


def _measured(streams, where, names, values, options, points):
    """values with NaN for numbers that stand for nothing, which notes tell."""
    found = without_stand_ins(values, codes=getattr(options, 'codes', ()), points=points,
                              zeros=getattr(options, 'zeros', 'place'))
    for k, code, rows in found.found:
        keep = '; if that is a place, set `zeros: place`' if code == '0 0 0' else ''
        streams.notes.append(f'{where}: {len(rows)} values of {names[k]} are {code} and count as '
                             f'not measured{keep}.')
    return found.values


def _encoders(streams, options, tracks, start):
    joints = sorted(item for topic, item in tracks if topic == options.topic)
    names = options.names or {joint: joint for joint in joints}
    strange = [one for one in options.reversed if one not in names]
    if strange:
        raise ConfigError(f'{options.topic}: `reversed` has {", ".join(strange)}; must be some of '
                          f'{", ".join(names)}')
    t, q = _series(streams, options, tracks, {
        name: (options.topic, joint) for name, joint in names.items()}, 1, start)
    q = _measured(streams, options.topic, tuple(names), q, options, False)[:, :, 0]
    sign = np.array([-1.0 if name in options.reversed else 1.0 for name in names])
    streams.add_encoders(t, options.frame, tuple(names), q * sign * LENGTH_UNITS[options.unit])


def _forces(streams, options, tracks, start):
    scale = FORCE_UNITS[options.unit] * FORCE_SIGNS[options.sign]
    for name, topic in options.topics.items():      # each cell at its own times
        t, f = _series(streams, options, tracks, {name: (topic, '')}, 3, start)
        f = _measured(streams, topic, (name,), f, options, False)
        turn = axes_of(*options.mounted[name]) if name in options.mounted else np.eye(3)
        streams.add_forces(t, options.frame, (name,), scale * f @ turn)


def _point_keys(streams, options, tracks):
    if options.topics:
        return {name: (topic, '') for name, topic in options.topics.items()}
    if options.order:
        count = len(options.order)
        others = sum(len(times) for (topic, item), (times, _) in tracks.items()
                     if topic == options.topic and item[0] == 0 and item[1] != count)
        held = [item[1] for topic, item in tracks if topic == options.topic]
        if count not in held:
            raise RecordingError(f'{options.topic}: has messages of '
                                 f'{", ".join(map(str, sorted(set(held)))) or "no"} points; '
                                 f'`order` has {count} names: must be as many')
        if others:
            streams.notes.append(f'{options.topic}: {others} messages have another number of '
                                 f'points than `order`, {count}: which is which is not known, '
                                 'they are left out.')
        return {name: (options.topic, (i, count)) for i, name in enumerate(options.order) if name}
    names = options.names or {item: item for topic, item in sorted(tracks)
                              if topic == options.topic}
    return {name: (options.topic, item) for name, item in names.items()}


def _points(streams, options, tracks, start):
    """(t_ns, names, positions (n, k, 3) [m], turns (n, k, 4), frame numbers)."""
    keys = _point_keys(streams, options, tracks)
    names = tuple(keys)
    t, values = _series(streams, options, tracks, keys, 7, start)
    where = options.topic or next(iter(options.topics.values()))
    points = _measured(streams, where, names, values[:, :, :3], options, True)
    return (t, names, points * LENGTH_UNITS[options.unit], values[:, :, 3:],
            count_frames(t) % (COUNTER + 1))


def _optical(streams, options, tracks, start):
    t, names, points, _, frames = _points(streams, options, tracks, start)
    streams.add_optical(t, options.frame, names, points, frames)


def _tools(streams, options, tracks, start):
    t, names, points, turns, frames = _points(streams, options, tracks, start)
    for k, name in enumerate(names):        # each tool at its own times
        own = np.isfinite(turns[:, k]).all(axis=1)
        streams.add_tools(t[own], options.frame, (name,), points[own, k:k + 1], frames[own],
                          turns=turns[own, k:k + 1])


_BUILDERS = {'encoders': _encoders, 'forces': _forces, 'optical': _optical, 'em': _tools}
