"""Recovery from a cut at any byte, and from a flipped one."""

import numpy as np
import pytest
from mcap.opcode import Opcode
from rosbags.highlevel import AnyReader

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import encode
from arm_brachy.recording.reader import BagReader, payload_hashes
from arm_brachy.recording.recover import FRAME, recover
from arm_brachy.recording.writer import SCENARIO, BagWriter


@pytest.fixture
def flushed(tmp_path):
    """A file of 12 chunks with 20 messages each, and where its chunks end."""
    encoder = encode.Encoder()
    with BagWriter(tmp_path / 'src', attachments={SCENARIO: 'seed: 1\n'},
                   provenance={'seed': 1}) as bag:
        bag.add_topic('/a', encode.JOINT_STATE)
        for k in range(240):
            bag.write('/a', encoder.joint_state(k, 'w', ['x'], [k]), k, sequence=k)
            if k % 20 == 19:
                bag.flush()
        path = bag.path
    data = path.read_bytes()
    ends, position = [], 8
    while position < len(data) - 8:
        opcode, length = FRAME.unpack_from(data, position)
        position += FRAME.size + length
        if opcode == Opcode.CHUNK:
            ends.append(position)
    return path, np.array(ends)


def test_no_complete_chunk_is_lost_wherever_the_file_ends(flushed, tmp_path):
    path, ends = flushed
    data = path.read_bytes()
    assert len(ends) == 12
    rng = np.random.default_rng(2)
    for trial, cut in enumerate(rng.integers(100, len(data) - 1, size=25)):
        short = tmp_path / f'cut_{trial}.mcap'
        short.write_bytes(data[:cut])
        with pytest.raises(RecordingError) as caught:
            BagReader(short)
        assert 'arm-brachy recover' in str(caught.value) and '\n' not in str(caught.value)
        report = recover(short, tmp_path / f'mended_{trial}')
        complete = 20 * int(np.sum(ends <= cut))
        got = report['messages'].get('/a', 0)
        assert got >= complete
        assert [r.sequence for r in BagReader(tmp_path / f'mended_{trial}').records()] == (
            list(range(got)))
        with AnyReader([tmp_path / f'mended_{trial}']) as bag:
            assert bag.message_count == got


def test_messages_before_the_cut_inside_a_large_chunk_are_kept(tmp_path):
    noise = np.random.default_rng(0).bytes(4096)
    with BagWriter(tmp_path / 'src', flush_period=60.0) as bag:
        bag.add_topic('/a', encode.JOINT_STATE)
        for k in range(200):
            bag.write('/a', noise, k)
        bag.flush()
        (tmp_path / 'cut.mcap').write_bytes(bag.path.read_bytes()[:600_000])
    report = recover(tmp_path / 'cut.mcap', tmp_path / 'mended')
    assert report['messages']['/a'] > 100  # whole compressed blocks of 128 KiB: 4 of them = 128


def test_intact_bag_comes_back_whole(flushed, tmp_path):
    path, _ = flushed
    report = recover(path, tmp_path / 'mended')
    assert (report['damaged_chunks'], report['unread_bytes']) == (0, 0)
    assert payload_hashes(tmp_path / 'mended') == payload_hashes(path)
    bag = BagReader(tmp_path / 'mended')
    assert bag.attachment_text(SCENARIO) == 'seed: 1\n'
    assert bag.metadata()['arm_brachy'] == {'seed': '1'}


def test_damaged_chunk_is_counted_and_the_rest_kept(flushed, tmp_path):
    path, ends = flushed
    data = bytearray(path.read_bytes())
    data[ends[5] - 30] ^= 0xFF
    (tmp_path / 'bad.mcap').write_bytes(data)
    report = recover(tmp_path / 'bad.mcap', tmp_path / 'mended')
    assert report['damaged_chunks'] == 1
    assert report['messages']['/a'] == 220


@pytest.mark.parametrize('size', [0, 5, 8, 12, 20])
def test_nothing_to_recover_is_said_so(flushed, tmp_path, size):
    (tmp_path / 'stub.mcap').write_bytes(flushed[0].read_bytes()[:size])
    with pytest.raises(RecordingError, match='not an MCAP|before its header'):
        recover(tmp_path / 'stub.mcap', tmp_path / 'mended')
    assert not (tmp_path / 'mended').exists()
