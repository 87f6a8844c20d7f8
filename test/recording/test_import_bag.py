"""Laboratories' own bags: the streams that come out are those of the CSV route, bit for bit."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.core.paths import config_dir
from arm_brachy.recording.import_bag import import_bag
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.reader import BagReader, payload_hashes
from arm_brachy.recording.topic_map import TopicMap

ROWS = 30
STORE = get_typestore(Stores.ROS2_JAZZY)
T_NS = (10**9 + np.arange(ROWS) * 10**7).astype(np.int64)
RNG = np.random.default_rng(7)
Q = np.round(np.column_stack([np.arange(ROWS), 0.5 * np.arange(ROWS)]) * 1e-3, 6)     # m
F = np.round(RNG.normal(0.0, 1.0, (ROWS, 3)), 4)
P = np.round(np.array([[0.03, 0.0, 0.04], [-0.02, 0.01, 0.05]])
             + RNG.normal(0.0, 1e-4, (ROWS, 2, 3)), 6)     # of m1 and m2
E = np.round(np.array([0.005, 0.003, 0.022]) + RNG.normal(0.0, 1e-4, (ROWS, 3)), 6)


def make(kind, **fields):
    return STORE.types[kind](**fields)


def header(t, frame='lab'):
    stamp = make('builtin_interfaces/msg/Time', sec=int(t // 10**9), nanosec=int(t % 10**9))
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def point(p):
    return make('geometry_msgs/msg/Point', x=float(p[0]), y=float(p[1]), z=float(p[2]))


def vector(p):
    return make('geometry_msgs/msg/Vector3', x=float(p[0]), y=float(p[1]), z=float(p[2]))


NO_TURN = make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0)


def pose(p):
    return make('geometry_msgs/msg/Pose', position=point(p), orientation=NO_TURN)


def joints(t, q):
    return make('sensor_msgs/msg/JointState', header=header(t), name=['slide_w', 'slide_e'],
                position=np.array([q[1], q[0]]), velocity=np.zeros(0), effort=np.zeros(0))


def wrench(t, f):
    return make('geometry_msgs/msg/WrenchStamped', header=header(t), wrench=make(
        'geometry_msgs/msg/Wrench', force=vector(f), torque=vector([1, 2, 3])))


def pose_stamped(t, p):
    return make('geometry_msgs/msg/PoseStamped', header=header(t), pose=pose(p))


def transform(t, p, child):
    return make('geometry_msgs/msg/TransformStamped', header=header(t), child_frame_id=child,
                transform=make('geometry_msgs/msg/Transform', translation=vector(p),
                               rotation=NO_TURN))


def cloud(t, points, kind='<f8'):
    size = np.dtype(kind).itemsize
    fields = [make('sensor_msgs/msg/PointField', name=name, offset=4 + size * i,
                   datatype=8 if size == 8 else 7, count=1) for i, name in enumerate('xyz')]
    rows = b''.join(b'\0\0\0\0' + np.asarray(p, dtype=kind).tobytes() for p in points)
    return make('sensor_msgs/msg/PointCloud2', header=header(t), height=1, width=len(points),
                fields=fields, is_bigendian=kind[0] == '>', point_step=4 + 3 * size,
                row_step=len(rows), data=np.frombuffer(rows, dtype=np.uint8), is_dense=True)


def array(t, points):
    return make('geometry_msgs/msg/PoseArray', header=header(t),
                poses=[pose(p) for p in points])


MARKERS = {     # form -> (messages by topic, section of the map)
    'array': (lambda t, p: {'/m': array(t, p)}, '{topic: /m, order: [m1, m2]}'),
    'cloud': (lambda t, p: {'/m': cloud(t, p)}, '{topic: /m, order: [m1, m2]}'),
    'big endian': (lambda t, p: {'/m': cloud(t, p, '>f8')}, '{topic: /m, order: [m1, m2]}'),
    'poses': (lambda t, p: {'/m1': pose_stamped(t, p[0]), '/m2': pose_stamped(t, p[1])},
              '{topics: {m1: /m1, m2: /m2}}'),
    'transforms': (lambda t, p: {'/m1': transform(t, p[0], 'a'), '/m2': transform(t, p[1], 'b')},
                   '{topics: {m1: /m1, m2: /m2}}'),
    'tf': (lambda t, p: {'/tf': make('tf2_msgs/msg/TFMessage', transforms=[
        transform(t, p[0], 'a'), transform(t, p[1], 'b')])},
        '{topic: /tf, names: {m1: a, m2: b}}')}
MAP = """\
name: lab
encoders: [{topic: /joints, names: {east: slide_e, west: slide_w}}]
forces: [{topics: {east: /ft}, sign: on_tool}]
optical: [OPTICAL]
em: [{topics: {lump: /em}}]
"""


def write_bag(path, form='array', storage=StoragePlugin.MCAP, points=P, times=T_NS):
    with Writer(path, version=9, storage_plugin=storage) as bag:
        connections = {}
        for i, t in enumerate(times.tolist()):
            messages = {'/joints': joints(t, Q[i]), '/ft': wrench(t, F[i]),
                        '/em': pose_stamped(t, E[i]), **MARKERS[form][0](t, points[i])}
            for topic, message in messages.items():
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=STORE)
                bag.write(connections[topic], int(T_NS[i]) + 1000,
                          bytes(STORE.serialize_cdr(message, kind)))
    return path


def imported(folder, bag, form='array', old='', new=''):
    (folder / 'map.yaml').write_text(MAP.replace('OPTICAL', MARKERS[form][1]).replace(old, new))
    return import_bag(bag, folder / 'map.yaml', folder / 'out')


@pytest.fixture
def by_csv(tmp_path):
    """The same streams by way of CSV files."""
    def table(name, names, values):
        rows = [','.join(['t', *names])] + [
            ','.join([repr(t * 1e-9), *map(repr, row)]) for t, row in zip(
                T_NS.tolist(), values.tolist(), strict=True)]
        (tmp_path / name).write_text('\n'.join(rows) + '\n')

    table('q.csv', ['east', 'west'], Q)
    table('f.csv', ['east_x', 'east_y', 'east_z'], F)
    table('p.csv', [f'{m}_{a}' for m in ('m1', 'm2') for a in 'xyz'], P.reshape(ROWS, 6))
    table('e.csv', ['lump_x', 'lump_y', 'lump_z'], E)
    (tmp_path / 'columns.yaml').write_text(
        "name: lab\nencoders: [{csv: {path: q.csv, time: t}, columns: '{key}'}]\n"
        "forces: [{csv: {path: f.csv, time: t}, columns: '{key}_{axis}', sign: on_tool}]\n"
        "optical: [{csv: {path: p.csv, time: t}, columns: '{key}_{axis}'}]\n"
        "em: [{csv: {path: e.csv, time: t}, columns: '{key}_{axis}'}]\n")
    import_csv(tmp_path / 'columns.yaml', tmp_path / 'by_csv')
    return payload_hashes(tmp_path / 'by_csv')


@pytest.mark.parametrize('form, storage', [
    *((form, StoragePlugin.MCAP) for form in MARKERS), ('array', StoragePlugin.SQLITE3),
    ('tf', StoragePlugin.SQLITE3)])
def test_every_type_gives_what_the_csv_route_gives(tmp_path, by_csv, form, storage):
    bag = write_bag(tmp_path / 'lab', form, storage)
    found = imported(tmp_path, bag, form)
    hashes = payload_hashes(tmp_path / 'out')
    assert hashes == by_csv and len(hashes) == 5
    assert not found['notes']
    assert BagReader(tmp_path / 'out').attachment_text('topics.yaml')


def test_gaps_as_numbers_times_out_of_order_and_clocks(tmp_path):
    points = P.copy()
    points[5, 0] = 0.0
    points[6, 1] = -3.697314e28
    times = T_NS.copy()
    times[10], times[11], times[20] = T_NS[11], T_NS[10], T_NS[19]
    bag = write_bag(tmp_path / 'lab', points=points, times=times)
    found = imported(tmp_path, bag)
    said = '\n'.join(found['notes'])
    assert '1 values of m1 are 0 0 0' in said and '1 values of m2 are -3.697314e+28' in said
    assert 'are earlier than the one before; they were sorted' in said
    assert 'repeat the time of another; the first was kept' in said
    assert found['streams']['/optical/markers']['missing_values'] == 2
    (tmp_path / 'log').mkdir()
    found = imported(tmp_path / 'log', bag, old='name: lab', new='name: lab\nclock: log')
    t, _ = BagReader(tmp_path / 'log/out').series('/optical/markers', lambda m: 0, clock='stamp')
    np.testing.assert_allclose(t, T_NS * 1e-9 + 1e-6, atol=1e-9)


def test_a_message_with_another_number_of_points_is_left_out_and_told(tmp_path):
    bag = write_bag(tmp_path / 'lab', points=[p if i != 3 else p[:1] for i, p in enumerate(P)])
    found = imported(tmp_path, bag)
    assert '1 messages have another number of points than `order`, 2' in found['notes'][0]
    assert found['messages']['/optical/markers'] == ROWS - 1


@pytest.mark.parametrize('old, new, error, words', [
    ('/ft}', '/none}', RecordingError, r"has no topic '/none'.*it has: /em \(PoseStamped\), /ft"),
    ('/ft}', '/em}', ConfigError, 'is a geometry_msgs/PoseStamped; must be one of geom'),
    ('slide_e', 'slide_x', RecordingError, "has no 'slide_x', which is to be east; it has: slide"),
    ('[m1, m2]', '[m1, m2, m3]', RecordingError, 'messages of 2 points; `order` has 3 names'),
    (', order: [m1, m2]', '', ConfigError, 'must have `order`'),
    ('lump:', '2 lumps:', ConfigError, "'2 lumps'; must be letters"),
    ('{topics: {lump: /em}}', '{}', ConfigError, 'must have `topic`'),
    ('sign: on_tool', 'sign: up', ConfigError, 'sign')])
def test_mistakes_in_the_map(tmp_path, old, new, error, words):
    bag = write_bag(tmp_path / 'lab')
    with pytest.raises(error, match=words) as caught:
        imported(tmp_path, bag, old=old, new=new)
    assert '\n' not in str(caught.value) and not (tmp_path / 'out').exists()


def test_what_is_no_bag(tmp_path):
    (tmp_path / 'text.mcap').write_text('no bag')
    (tmp_path / 'empty').mkdir()
    sound = write_bag(tmp_path / 'sqlite', storage=StoragePlugin.SQLITE3)
    file, = sound.glob('*.db3')
    file.write_bytes(file.read_bytes()[:5000] + b'\0' * 500)
    for path, words in ((tmp_path / 'none', 'no such bag'),
                        (tmp_path / 'text.mcap', 'not an MCAP'),
                        (tmp_path / 'empty', 'must hold one'),
                        (sound, 'cannot be read as a bag')):
        with pytest.raises(RecordingError, match=words) as caught:
            imported(tmp_path, path)
        assert '\n' not in str(caught.value)


def test_the_example_is_a_topic_map():
    assert config.load(TopicMap, config_dir() / 'imports' / 'lab_bag.yaml').name == 'lab_bag'
