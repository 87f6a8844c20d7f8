"""Reads anybody's ROS 2 bag, MCAP or sqlite3, one message at a time, without ROS.

MCAP files carry their definitions; those of sqlite3 bags are the ones that ROS 2 Jazzy ships.
Test: recording/test_import_bag.py
"""

import sqlite3
import struct
from contextlib import contextmanager
from pathlib import Path

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag2 import ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_typestore

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.reader import BagReader

DAMAGE = (AnyReaderError, ReaderError, SerdeError, TypesysError, sqlite3.Error, struct.error,
          OSError, UnicodeDecodeError, KeyError, ValueError)


@contextmanager
def lab_bag(path):
    """Context: (topic -> type, messages(topics)) of a bag (path).

    messages yields (topic, time of receipt [ns], decoded message) in order of that time.
    Raises RecordingError in one line for what is no bag, or a damaged one.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f'{path}: no such bag; must be a folder with metadata.yaml, or an '
                             '.mcap file')
    if path.suffix == '.db3' and path.is_file():
        path = path.parent
    if path.is_dir() and (list(path.glob('*.db3*')) or len(list(path.glob('*.mcap'))) > 1):
        yield from _any(path)
        return
    with BagReader(path) as reader:
        def messages(topics):
            for record, message in reader.messages(topics) if topics else ():
                yield record.topic, record.log_time_ns, message
        yield {name: topic.type for name, topic in reader.topics().items()}, messages


def _any(path):
    """What `lab_bag` yields, of sqlite3 and split bags."""
    if not (path / 'metadata.yaml').is_file():
        raise RecordingError(f'{path}: has no metadata.yaml; make it with `ros2 bag reindex '
                             f'{path}`')
    store = get_typestore(Stores.ROS2_JAZZY)
    with _readable(path):
        reader = AnyReader([path], default_typestore=store)
        reader.open()
    try:
        def messages(topics):
            wanted = [c for c in reader.connections if c.topic in topics]
            with _readable(path):
                for connection, time, data in reader.messages(connections=wanted):
                    yield connection.topic, time, reader.deserialize(data, connection.msgtype)
        yield {c.topic: c.msgtype for c in reader.connections}, messages
    finally:
        reader.close()


@contextmanager
def _readable(path):
    """Turn what the libraries raise on damaged bytes into one line."""
    try:
        yield
    except DAMAGE as error:
        problem = ' '.join(str(error).split()) or type(error).__name__
        raise RecordingError(f'{path}: cannot be read as a bag: {problem}') from None
