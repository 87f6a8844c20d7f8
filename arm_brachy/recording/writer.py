"""Writes a bag that rosbag2, Foxglove and two Python readers accept; a kill -9 does no harm."""

import os
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer
from ruamel.yaml import YAML

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import qos as quality
from arm_brachy.recording import schema

SCENARIO = 'scenario.yaml'  # attachment: the resolved scenario
SCENE = 'scene.yaml'        # attachment: the scene
PROVENANCE = 'arm_brachy'   # metadata record: name, seed, commit, machine, start
METADATA_VERSION = 9        # of metadata.yaml, that of ROS 2 Jazzy
# A record of this name without `serialized_metadata` tells rosbag2's MCAP storage to read the
# channels' quality of service with integer enumerators (mcap_storage.cpp, read_metadata).
ROSBAG2_RECORD = {'ROS_DISTRO': 'jazzy', 'serialized_metadata': ''}
MAX_SEQUENCE = 2**32


@dataclass
class _Channel:
    """What metadata.yaml says of one topic at the end."""

    id: int
    type: str
    type_hash: str
    qos: tuple
    count: int = 0


class BagWriter:
    """A bag directory: `<name>_0.mcap` while it is written, `metadata.yaml` once it is closed.

    directory : must not exist, or be empty; made with its parents
    provenance : str -> str, kept as metadata record `arm_brachy`
        (name, seed, commit, machine, start)
    attachments : file name -> text or bytes, e.g. {SCENARIO: ..., SCENE: ...}
    flush_period : s of wall time between two writes of everything received to the operating
        system, by a thread of the writer's own so that a silent cell loses nothing either.
        A killed process loses what came after the last one; 0.2 s leaves 0.05 s for a busy
        machine to keep the promised quarter second. A power cut may lose more: only `close`
        waits for the disk.

    Calls may come from any thread. Raises RecordingError if the directory is in use; any call
    that writes does so if the disk is full.
    Test: recording/test_writer.py.
    """

    def __init__(self, directory, *, provenance=None, attachments=None, flush_period=0.2):
        self.directory = Path(directory)
        self.path = self.directory / f'{self.directory.name}_0.mcap'
        _make_empty(self.directory)
        self._channels = {}
        self._schemas = {}
        self._span = None
        self._failure = None
        self._lock = threading.Lock()
        with self._writing():
            self._stream = self.path.open('wb')
            self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
            self._writer.start(profile=Profile.ROS2, library='arm_brachy')
        self.add_metadata('rosbag2', ROSBAG2_RECORD)
        if provenance:
            self.add_metadata(PROVENANCE, provenance)
        for name, data in (attachments or {}).items():
            self.add_attachment(name, data)
        self._stop = threading.Event()
        self._flusher = threading.Thread(
            target=self._flush_until_closed, args=(flush_period,), daemon=True)
        self._flusher.start()

    @property
    def counts(self):
        """Messages written so far: topic -> number."""
        return {topic: channel.count for topic, channel in self._channels.items()}

    def add_topic(self, topic, type_name, *, qos=(), definition=None, type_hash=None):
        """Declare a topic before its first message; a second call with the same type is harmless.

        topic : with its leading slash;  type_name : 'package/msg/Type'
        qos : the publishers' offers, `qos.Qos` each
        definition, type_hash : as the graph tells them; from the installed packages when absent
        Raises RecordingError on a relative name, a second type, or an unknown definition.
        """
        if not topic.startswith('/'):
            raise RecordingError(f"topic {topic!r}; recorded names start with '/'")
        with self._writing():
            self._require_open()
            known = self._channels.get(topic)
            if known is None:
                self._register(topic, type_name, tuple(qos), definition, type_hash)
            elif known.type != type_name:
                raise RecordingError(f'topic {topic} is recorded as {known.type}; it cannot carry '
                                     f'{type_name} too')

    def _register(self, topic, type_name, qos, definition, type_hash):
        text = definition if definition is not None else schema.message_definition(type_name)
        digest = type_hash if type_hash is not None else schema.type_hash(type_name, text)
        if (type_name, text) not in self._schemas:
            self._schemas[type_name, text] = self._writer.register_schema(
                type_name, SchemaEncoding.ROS2, text.encode())
        channel = self._writer.register_channel(
            topic, MessageEncoding.CDR, self._schemas[type_name, text],
            {'offered_qos_profiles': quality.dump(qos), 'topic_type_hash': digest})
        self._channels[topic] = _Channel(channel, type_name, digest, qos)

    def write(self, topic, data, log_time_ns, publish_time_ns=None, sequence=0):
        """Append one message.

        data : CDR bytes with their 4-byte header, kept as they are
        log_time_ns : time of receipt [ns], simulated in lockstep; publish_time_ns : the same
            unless given
        sequence : the publisher's counter, 0 = none; kept modulo 2^32
        Raises RecordingError for a topic not declared, a negative time, or a full disk.
        """
        with self._writing():
            self._require_open()
            channel = self._channels.get(topic)
            if channel is None:
                raise RecordingError(f'topic {topic} was not declared; call add_topic first')
            if log_time_ns < 0:
                raise RecordingError(f'{topic}: log time {log_time_ns} ns; must be >= 0')
            published = log_time_ns if publish_time_ns is None else publish_time_ns
            self._writer.add_message(channel.id, log_time_ns, bytes(data), published,
                                     sequence % MAX_SEQUENCE)
            channel.count += 1
            first, last = self._span or (log_time_ns, log_time_ns)
            self._span = min(first, log_time_ns), max(last, log_time_ns)

    def add_attachment(self, name, data, media_type='application/yaml'):
        """Keep a file inside the bag; text is stored as UTF-8. It bears no date."""
        content = data.encode() if isinstance(data, str) else bytes(data)
        with self._writing():
            self._writer.flush()
            self._writer.add_attachment(0, 0, name, media_type, content)

    def add_metadata(self, name, mapping):
        """Keep a record of str -> str inside the bag."""
        with self._writing():
            self._writer.add_metadata(name, {k: str(v) for k, v in mapping.items()})

    def flush(self):
        """Hand everything received to the operating system: it outlives this process now."""
        with self._writing():
            if not self._stream.closed:
                self._writer.flush()

    def close(self):
        """Finish the file, wait for the disk, write metadata.yaml. A second call does nothing."""
        self._stop.set()
        self._flusher.join()
        with self._writing():
            if self._stream.closed:
                return
            try:
                self._writer.finish()
                self._stream.flush()
                os.fsync(self._stream.fileno())
            finally:
                self._stream.close()
            _write_metadata(self.directory, self.path.name, self._channels, self._span or (0, 0))
        if self._failure is not None:
            raise self._failure

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    @contextmanager
    def _writing(self):
        """Alone at the file; what the operating system refuses becomes one line."""
        with self._lock:
            try:
                yield
            except OSError as error:
                raise RecordingError(f'{self.path}: cannot be written: {error}') from None

    def _require_open(self):
        if self._failure is not None:
            raise self._failure
        if self._stream.closed:
            raise RecordingError(f'{self.directory}: the bag is closed')

    def _flush_until_closed(self, period):
        while not self._stop.wait(period):
            try:
                self.flush()
            except RecordingError as error:  # for whoever writes next: a thread has no caller
                self._failure = error
                return


def _make_empty(directory):
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise RecordingError(f'{directory}: exists and is not empty; name another directory')
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f'{directory}: cannot be made: {error}') from None


def _write_metadata(directory, file_name, channels, span):
    start, count = span[0], sum(c.count for c in channels.values())
    duration = {'nanoseconds': span[1] - start}
    begin = {'nanoseconds_since_epoch': start}
    information = {
        'version': METADATA_VERSION,
        'storage_identifier': 'mcap',
        'duration': duration,
        'starting_time': begin,
        'message_count': count,
        'topics_with_message_count': [_topic(name, c) for name, c in channels.items()],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file_name],
        'files': [{'path': file_name, 'starting_time': dict(begin), 'duration': dict(duration),
                   'message_count': count}],
        'custom_data': {},
        'ros_distro': 'jazzy',
    }
    yaml = YAML()
    with (directory / 'metadata.yaml').open('w', encoding='utf-8') as stream:
        yaml.dump({'rosbag2_bagfile_information': information}, stream)


def _topic(name, channel):
    return {
        'topic_metadata': {
            'name': name,
            'type': channel.type,
            'serialization_format': 'cdr',
            'offered_qos_profiles': [q.mapping(names=True) for q in channel.qos],
            'type_description_hash': channel.type_hash,
        },
        'message_count': channel.count,
    }
