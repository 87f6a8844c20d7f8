"""Bags against two independent readers, and against a kill -9."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosReliability
from ruamel.yaml import YAML

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import encode, qos
from arm_brachy.recording.reader import BagReader
from arm_brachy.recording.recover import recover
from arm_brachy.recording.writer import BagWriter

PROMISED_LOSS = 0.25  # s of wall time that a killed recorder may lose

# Writes 500 messages a second and says when each was handed over (system-wide monotonic clock).
VICTIM = """
import sys, time
from arm_brachy.recording import encode
from arm_brachy.recording.writer import BagWriter
encoder = encode.Encoder()
bag = BagWriter(sys.argv[1])
bag.add_topic('/actuators/state', encode.JOINT_STATE)
for k in range(10**6):
    bag.write('/actuators/state', encoder.joint_state(k, 'world', ['a'], [k]), k, sequence=k)
    print(time.monotonic(), flush=True)
    time.sleep(0.002)
"""


def test_two_readers_agree_on_directory_and_bare_file(make_bag):
    directory = make_bag(n=80)
    ours = {name: t.count for name, t in BagReader(directory).topics().items()}
    assert set(ours.values()) == {80}
    file = next(directory.glob('*.mcap'))
    counts = dict.fromkeys(ours, 0)
    with file.open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, _ in reader.iter_decoded_messages():
            counts[channel.topic] += 1
    assert counts == ours
    for path in (directory, file):
        with AnyReader([path]) as bag:
            assert {c.topic: c.msgcount for c in bag.connections} == ours
            last = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages()
                    if c.topic == '/actuators/state'][-1]
            assert last.position[0] == pytest.approx(0.079)


def test_quality_of_service_in_both_spellings(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', encode.JOINT_STATE, qos=[qos.SENSOR_DATA])
        bag.write('/a', encode.Encoder().joint_state(0, 'w', [], []), 0)
    text = BagReader(tmp_path / 'bag').topics()['/a'].qos
    assert qos.parse(text) == (qos.SENSOR_DATA,)
    assert 'reliability: 2' in text
    information = YAML(typ='safe').load(tmp_path / 'bag' / 'metadata.yaml')[
        'rosbag2_bagfile_information']
    assert (information['version'], information['custom_data']) == (9, {})
    offered = information['topics_with_message_count'][0]['topic_metadata']['offered_qos_profiles']
    assert offered[0]['reliability'] == 'best_effort'
    for path in (tmp_path / 'bag', next((tmp_path / 'bag').glob('*.mcap'))):
        with AnyReader([path]) as bag:
            assert bag.connections[0].ext.offered_qos_profiles[0].reliability is (
                QosReliability.BEST_EFFORT)


def test_killed_recorder_loses_at_most_a_quarter_second(tmp_path):
    victim = subprocess.Popen([sys.executable, '-c', VICTIM, str(tmp_path / 'bag')],
                              stdout=subprocess.PIPE, text=True,
                              cwd=Path(__file__).resolve().parents[2])
    written = [float(victim.stdout.readline())]
    while written[-1] < written[0] + 1.3:  # not a multiple of the flush period
        written.append(float(victim.stdout.readline()))
    killed = time.monotonic()
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    with pytest.raises(RecordingError, match='arm-brachy recover'):
        BagReader(tmp_path / 'bag')
    report = recover(tmp_path / 'bag', tmp_path / 'mended')
    promised = sum(t < killed - PROMISED_LOSS for t in written)
    assert report['messages']['/actuators/state'] >= promised > 100
    numbers = [r.sequence for r in BagReader(tmp_path / 'mended').records()]
    assert numbers == list(range(len(numbers)))


def test_flush_needs_no_further_message(tmp_path):
    with BagWriter(tmp_path / 'bag', flush_period=0.02) as bag:
        bag.add_topic('/a', encode.JOINT_STATE)
        before = bag.path.stat().st_size
        bag.write('/a', encode.Encoder().joint_state(0, 'w', ['x'], [1.0]), 0)
        limit = time.monotonic() + 5.0
        while bag.path.stat().st_size == before:
            assert time.monotonic() < limit, 'a silent recorder kept its last message in memory'
            time.sleep(0.005)


def test_close_twice_then_write(tmp_path):
    bag = BagWriter(tmp_path / 'bag')
    bag.close()
    bag.close()
    with pytest.raises(RecordingError, match='closed'):
        bag.add_topic('/a', encode.JOINT_STATE)
    assert BagReader(tmp_path / 'bag').topics() == {}


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    full = Path('/dev/full').open('wb')
    with monkeypatch.context() as patch:
        patch.setattr(Path, 'open', lambda *_: full)
        bag = BagWriter(tmp_path / 'bag', flush_period=60.0)
    bag.add_topic('/a', encode.JOINT_STATE)
    noise = np.random.default_rng(1).bytes(2_000_000)  # more than one chunk, incompressible
    with pytest.raises(RecordingError, match='cannot be written: .*No space left'):
        bag.write('/a', noise, 0)
    with pytest.raises(RecordingError, match='cannot be written'):
        bag.close()
    bag.close()


def test_misuse_is_refused_in_one_line(tmp_path, make_bag):
    used = make_bag()
    with pytest.raises(RecordingError, match='not empty'):
        BagWriter(used)
    with BagWriter(tmp_path / 'new') as bag:
        with pytest.raises(RecordingError, match='not declared'):
            bag.write('/a', b'', 0)
        with pytest.raises(RecordingError, match="start with '/'"):
            bag.add_topic('a', encode.JOINT_STATE)
        bag.add_topic('/a', encode.JOINT_STATE)
        bag.add_topic('/a', encode.JOINT_STATE)
        with pytest.raises(RecordingError, match='recorded as sensor_msgs'):
            bag.add_topic('/a', encode.POSE)
        with pytest.raises(RecordingError, match='must be >= 0'):
            bag.write('/a', b'', -1)
