"""Reading: order, series, attachments, memory, and what is said of bags that are none."""

import tracemalloc

import numpy as np
import pytest
from mcap.writer import Writer

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import encode
from arm_brachy.recording.reader import BagReader, payload_hashes
from arm_brachy.recording.recover import recover
from arm_brachy.recording.writer import SCENARIO, BagWriter


def test_series_by_receipt_and_by_stamp(tmp_path):
    encoder = encode.Encoder()
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', encode.JOINT_STATE)
        for k in (2, 0, 1):  # received out of order
            data = encoder.joint_state(k * 10**8 - k, 'w', ['x'], [k])
            bag.write('/a', data, k * 10**8)
    reader = BagReader(tmp_path / 'bag')
    t, x = reader.series('/a', lambda m: m.position[0])
    np.testing.assert_allclose(t, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(x, [0, 1, 2])
    t, _ = reader.series('/a', lambda m: m.position[0], clock='stamp')
    np.testing.assert_allclose(t, [0.0, 0.1 - 1e-9, 0.2 - 2e-9], atol=1e-12)
    assert len(reader.series('/a', lambda m: None)[0]) == 0
    with pytest.raises(RecordingError, match="'log' or 'stamp'"):
        reader.series('/a', lambda m: 0.0, clock='wall')


def test_window_is_half_open(make_bag):
    reader = BagReader(make_bag())
    times = [r.log_time_ns for r in reader.records(['/actuators/state'], start_ns=10**8,
                                                   stop_ns=2 * 10**8)]
    assert times == [10**8 + k * 10**7 for k in range(10)]


def test_attachments_and_provenance(make_bag):
    reader = BagReader(make_bag(attachments={SCENARIO: 'seed: 3\n'}, provenance={'seed': 3}))
    assert reader.attachment_text(SCENARIO) == 'seed: 3\n'
    assert reader.metadata()['arm_brachy'] == {'seed': '3'}
    with pytest.raises(RecordingError, match='it holds: scenario.yaml'):
        reader.attachment_text('other.yaml')


def test_hash_tells_payload_and_time_but_not_interleaving(tmp_path):
    encoder = encode.Encoder()

    def bag(name, order, value=1.0, t=0):
        with BagWriter(tmp_path / name) as out:
            for topic in order:
                out.add_topic(topic, encode.JOINT_STATE)
                out.write(topic, encoder.joint_state(0, 'w', ['x'], [value]), t)
        return payload_hashes(tmp_path / name)

    reference = bag('a', ['/x', '/y'])
    assert bag('b', ['/y', '/x']) == reference
    assert bag('c', ['/x', '/y'], value=1.0 + 2**-52)['/x'] != reference['/x']
    assert bag('d', ['/x', '/y'], t=1)['/x'] != reference['/x']


def test_memory_stays_bounded(tmp_path):
    size, n = 2**16, 1000
    noise = np.random.default_rng(0).bytes(size)
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', encode.JOINT_STATE)
        for k in range(n):
            bag.write('/a', noise, k)
    reader = BagReader(tmp_path / 'bag')
    tracemalloc.start()
    assert sum(len(r.data) for r in reader.records()) == n * size
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < n * size / 8


def test_unknown_topic_names_its_neighbours(make_bag):
    with pytest.raises(RecordingError, match='/optical/marker.*nearest: /optical/markers'):
        list(BagReader(make_bag()).records(['/optical/marker']))


def test_what_is_no_bag_is_refused_in_one_line(tmp_path, make_bag):
    text = tmp_path / 'text.mcap'
    text.write_text('not a bag')
    empty = tmp_path / 'empty'
    empty.mkdir()
    for path, words in ((text, 'not an MCAP file'), (empty, 'holds 0 .mcap files'),
                        (tmp_path / 'absent', 'no such bag')):
        with pytest.raises(RecordingError, match=words) as caught:
            BagReader(path)
        assert '\n' not in str(caught.value)
        assert caught.value.exit_status == 2


def test_damaged_chunk_is_told_not_read(make_bag, tmp_path):
    data = bytearray(next(make_bag(n=300).glob('*.mcap')).read_bytes())
    data[data.index(b'\x28\xb5\x2f\xfd') + 30] ^= 0xFF  # in a chunk: how many there are, varies
    (tmp_path / 'bad.mcap').write_bytes(data)
    with pytest.raises(RecordingError, match='damaged'):
        list(BagReader(tmp_path / 'bad.mcap').messages())


def with_other_channels(path):
    """A ROS 2 bag that also has a channel without schema, and one of JSON with its schema."""
    encoder = encode.Encoder()
    with path.open('wb') as stream:
        out = Writer(stream)
        out.start(profile='ros2')
        ros = out.register_schema(encode.JOINT_STATE, 'ros2msg',
                                  encoder.definitions[encode.JOINT_STATE].encode())
        schema = out.register_schema('Note', 'jsonschema', b'{"type": "object"}')
        channels = {'/a': out.register_channel('/a', 'cdr', ros),
                    '/notes': out.register_channel('/notes', 'json', 0),
                    '/log': out.register_channel('/log', 'json', schema)}
        for k in range(5):
            for topic, channel in channels.items():
                data = encoder.joint_state(k, 'w', ['x'], [k]) if topic == '/a' else b'{}'
                out.add_message(channel, k, data, k)
        out.finish()
    return path


def test_channels_of_no_ros_messages_are_left_out(tmp_path):
    path = with_other_channels(tmp_path / 'x.mcap')
    with BagReader(path) as bag:
        assert list(bag.topics()) == ['/a'] and bag.left_out == ('/log', '/notes')
        assert [m.position[0] for _, m in bag.messages()] == list(range(5))
    assert list(payload_hashes(path)) == ['/a']
    recover(path, tmp_path / 'new')
    assert payload_hashes(tmp_path / 'new') == payload_hashes(path)


def test_a_damaged_index_is_refused(tmp_path):
    path = with_other_channels(tmp_path / 'x.mcap')
    data = bytearray(path.read_bytes())
    at = data.rindex(b'ros2msg')          # in the index; the data section has it before
    data[at] ^= 0x01
    path.write_bytes(bytes(data))
    with pytest.raises(RecordingError, match='checksum of the index.*arm-brachy recover'):
        BagReader(path)
