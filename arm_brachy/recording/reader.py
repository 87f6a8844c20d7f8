"""Reads a bag, ours or anybody's ros2 MCAP, one message at a time: memory stays bounded."""

import difflib
import hashlib
import struct
import zlib
from collections import defaultdict
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.stream_reader import CRCValidationError
from mcap.writer import MCAP0_MAGIC
from mcap_ros2._vendor.rosidl_adapter.parser import InvalidSpecification, InvalidValue
from mcap_ros2.decoder import DecoderFactory

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.guard import MALFORMED, one_line
from arm_brachy.recording.canonical import Canonical

FOOTER = struct.Struct('<BQQQI')  # opcode, length, starts of index and of offsets, checksum
# Topics of which every cell's bag, or a laboratory's, has one: before them stands the namespace.
MARKS = ('/actuators/state', '/cell/task', '/cell/safety', '/optical/markers', '/truth/points')
# What the MCAP, compression and message libraries raise on damaged bytes.
DAMAGED = (McapError, CRCValidationError, zstandard.ZstdError, InvalidSpecification, InvalidValue,
           NameError, *MALFORMED)


@dataclass(frozen=True)
class Topic:
    """One topic of a bag. qos : the channel's YAML text;  definition : ros2msg text."""

    name: str
    type: str
    count: int
    qos: str
    type_hash: str
    definition: str


@dataclass(frozen=True)
class Record:
    """One recorded message. data : CDR bytes;  sequence : 0 if the writer kept none."""

    topic: str
    type: str
    log_time_ns: int
    publish_time_ns: int
    sequence: int
    data: bytes


class BagReader:
    """A bag directory or a bare .mcap file, open for reading.

    Raises RecordingError if it is missing, truncated (the message names the command that mends it)
    or not MCAP. Chunk checksums are verified. Channels that hold no ROS 2 messages (JSON,
    Protobuf, no schema at all: MCAP allows them) are left out; `left_out` are their topics.
    Test: recording/test_reader.py.
    """

    def __init__(self, path):
        self.path = mcap_file(path)
        _require_complete(self.path)
        self._stream = self.path.open('rb')
        with _readable(self.path):
            self._mcap = SeekingReader(self._stream, validate_crcs=True,
                                       decoder_factories=[DecoderFactory()])
            self._summary = self._mcap.get_summary()
        if self._summary is None or self._summary.statistics is None:
            raise RecordingError(f'{self.path}: has no index; {_mend(self.path)}')
        with _readable(self.path):
            self._topics, self.left_out = _topics(self._summary)

    def close(self):
        """Close the file; a second call does nothing."""
        self._stream.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def topics(self):
        """Return topic name -> Topic, sorted by name."""
        return dict(self._topics)

    @property
    def span_ns(self):
        """(first, last) log time [ns]; (0, 0) if empty."""
        statistics = self._summary.statistics
        return statistics.message_start_time, statistics.message_end_time

    def records(self, topics=None, *, start_ns=None, stop_ns=None):
        """Yield Record in order of log time, ties in order of writing.

        topics : names, None = all;  start_ns <= log time < stop_ns
        """
        for topic, schema, message in self._iterate(topics, start_ns, stop_ns):
            yield _record(topic, schema, message)

    def messages(self, topics=None, *, start_ns=None, stop_ns=None):
        """Yield (Record, decoded message), in the order of `records`."""
        decoders = DecoderFactory()
        for topic, schema, message in self._iterate(topics, start_ns, stop_ns):
            with _readable(self.path):
                decoded = decoders.decoder_for('cdr', schema)(message.data)
            yield _record(topic, schema, message), decoded

    def series(self, topic, extractor, *, clock='log'):
        """Return (t, values) of one topic as arrays.

        extractor : decoded message -> number or array of one shape, or None to leave it out
        clock : 'log' time of receipt, 'stamp' time of acquisition in the header
        t : (n,) [s];  values : (n, ...)
        Time is kept to 0.2 us at dates of this century (double precision).
        """
        if clock not in ('log', 'stamp'):
            raise RecordingError(f"clock {clock!r}; must be 'log' or 'stamp'")
        tt, values = [], []
        for record, message in self.messages([topic]):
            value = extractor(message)
            if value is not None:
                tt.append(record.log_time_ns if clock == 'log' else stamp_ns(message))
                values.append(value)
        return np.array(tt, dtype=np.int64) * 1e-9, np.array(values)

    def attachments(self):
        """Return file name -> bytes of the files kept inside the bag."""
        with _readable(self.path):
            return {a.name: a.data for a in self._mcap.iter_attachments()}

    def attachment_text(self, name):
        """Return one attached file as text. Raises RecordingError naming what the bag holds."""
        found = self.attachments()
        if name not in found:
            held = ', '.join(sorted(found)) or 'none'
            raise RecordingError(f'{self.path}: holds no attachment {name!r}; it holds: {held}')
        return found[name].decode()

    def metadata(self):
        """Return record name -> mapping of str -> str (`arm_brachy`: seed, commit, machine...)."""
        with _readable(self.path):
            return {m.name: dict(m.metadata) for m in self._mcap.iter_metadata()}

    def _iterate(self, topics, start_ns, stop_ns):
        names = list(self._topics) if topics is None else [self._known(t) for t in topics]
        return self._read(names, start_ns, stop_ns)

    def _read(self, names, start_ns, stop_ns):
        with _readable(self.path):
            for schema, channel, message in self._mcap.iter_messages(
                    names, starting_at=start_ns, ending_before=stop_ns):
                if is_ros(channel, schema):
                    yield channel.topic, schema, message

    def _known(self, topic):
        if topic in self._topics:
            return topic
        near = difflib.get_close_matches(topic, self._topics, n=3, cutoff=0.4)
        held = ', '.join(near or self._topics) or 'none'
        kind = 'nearest' if near else 'recorded'
        raise RecordingError(f'{self.path}: no topic {topic!r}; {kind}: {held}')


class CellBag(BagReader):
    """A bag of our own cell, its topics under the names that they have without a namespace.

    namespace : of the cell that was recorded, '' at the root. Raises RecordingError for a bag that
    holds several cells, naming their namespaces.
    """

    def __init__(self, path):
        super().__init__(path)
        self.namespace = _namespace(self.path, self._topics)
        self._full = {}
        for name in self._topics:
            inside = name.startswith(self.namespace + '/')
            short = name.removeprefix(self.namespace) if inside else name
            if inside or short not in self._full:
                self._full[short] = name
        self._topics = {short: replace(self._topics[full], name=short)
                        for short, full in sorted(self._full.items())}

    def _iterate(self, topics, start_ns, stop_ns):
        names = list(self._topics) if topics is None else [self._known(t) for t in topics]
        short = {self._full[name]: name for name in names}
        for topic, schema, message in self._read(list(short), start_ns, stop_ns):
            yield short[topic], schema, message


def _namespace(path, topics):
    """What stands before the names that every cell has; '' if they stand at the root."""
    found = {name.removesuffix(mark) for name in topics for mark in MARKS if name.endswith(mark)}
    if len(found) > 1 and '' not in found:
        raise RecordingError(f'{path}: holds {len(found)} cells, {", ".join(sorted(found))}; '
                             'record each into a bag of its own')
    return '' if '' in found or not found else found.pop()


def payload_hashes(path):
    """Return topic -> SHA-256 over log times and payloads, in recorded order per topic.

    Two runs of one scenario and seed must agree in every entry. Order between topics is left out:
    it says how loaded the machine was, not what was computed. So is the padding inside a payload,
    which ROS leaves unwritten (see `canonical`); every other bit counts.
    """
    digests = defaultdict(hashlib.sha256)
    with BagReader(path) as bag:
        canonical = Canonical({t.type: t.definition for t in bag.topics().values()})
        for record in bag.records():
            data = canonical.data(record.data, record.type)
            digest = digests[record.topic]
            digest.update(struct.pack('<QI', record.log_time_ns, len(data)))
            digest.update(data)
    return {topic: digests[topic].hexdigest() for topic in sorted(digests)}


def stamp_ns(message):
    """Return the header stamp of a decoded message [ns]; RecordingError if it has none."""
    header = getattr(message, 'header', None)
    if header is None:
        raise RecordingError(f"{type(message).__name__} has no header; use clock='log'")
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def mcap_file(path):
    """Return the .mcap file that `path` (a file, or a directory holding one) means."""
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise RecordingError(f'{path}: no such bag; must be a bag directory or an .mcap file')
    found = sorted(path.glob('*.mcap'))
    if not found and len(list((path / 'bag').glob('*.mcap'))) == 1:
        raise RecordingError(f'{path}: is the folder of a run, not a bag; its bag is '
                             f'{path / "bag"}')
    if len(found) != 1:
        raise RecordingError(f'{path}: holds {len(found)} .mcap files; must hold one (a split bag '
                             'is joined by `ros2 bag convert`)')
    return found[0]


def _require_complete(path):
    with path.open('rb') as stream:
        head = stream.read(len(MCAP0_MAGIC))
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(MCAP0_MAGIC)))
        tail = stream.read()
    if head != MCAP0_MAGIC:
        raise RecordingError(f'{path}: is not an MCAP file: it starts with {head!r}')
    if tail != MCAP0_MAGIC or size < 2 * len(MCAP0_MAGIC):
        raise RecordingError(f'{path}: truncated, the recorder did not finish; {_mend(path)}')
    _require_sound_index(path, size)


def _require_sound_index(path, size):
    """Refuse an index that its checksum (0 = none) does not fit; `SeekingReader` does not look."""
    end = size - len(MCAP0_MAGIC)
    with path.open('rb') as stream:
        stream.seek(max(0, end - FOOTER.size))
        footer = stream.read(FOOTER.size)
        if len(footer) < FOOTER.size or footer[0] != Opcode.FOOTER:
            raise RecordingError(f'{path}: damaged (no footer); {_mend(path)}')
        *_, start, _, crc = FOOTER.unpack(footer)
        if not crc:
            return
        stream.seek(min(start, end))
        if zlib.crc32(stream.read(end - stream.tell())[:-4]) != crc:
            raise RecordingError(f'{path}: damaged (checksum of the index); {_mend(path)}')


def _mend(path):
    return f'run `arm-brachy recover {path} --out NEW_BAG`'


@contextmanager
def _readable(path):
    """Turn what the MCAP and compression libraries raise on damaged bytes into one line."""
    try:
        yield
    except DAMAGED as error:
        problem = one_line(error) or type(error).__name__
        raise RecordingError(f'{path}: damaged ({problem}); {_mend(path)}') from None


def is_ros(channel, schema):
    """Return True if an MCAP channel holds ROS 2 messages, with their definition in its schema."""
    return (schema is not None and schema.encoding == 'ros2msg'
            and channel.message_encoding == 'cdr')


def _topics(summary):
    """(topic name -> Topic of ROS 2 channels, names of the others)."""
    counts = defaultdict(int)
    for channel_id, count in summary.statistics.channel_message_counts.items():
        counts[summary.channels[channel_id].topic] += count
    found, others = {}, set()
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        if not is_ros(channel, schema):
            others.add(channel.topic)
            continue
        found[channel.topic] = Topic(
            channel.topic, schema.name, counts[channel.topic],
            channel.metadata.get('offered_qos_profiles', ''),
            channel.metadata.get('topic_type_hash', ''), schema.data.decode())
    return dict(sorted(found.items())), tuple(sorted(others - found.keys()))


def _record(topic, schema, message):
    return Record(topic, schema.name, message.log_time, message.publish_time, message.sequence,
                  message.data)
