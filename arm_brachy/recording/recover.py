"""Saves what a killed or cut recording still holds."""

import struct
import zlib
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.guard import one_line
from arm_brachy.recording import qos
from arm_brachy.recording.reader import DAMAGED, is_ros, mcap_file
from arm_brachy.recording.writer import BagWriter

FRAME = struct.Struct('<BQ')          # opcode, length of the body (MCAP specification, "Records")
CHUNK_HEAD = struct.Struct('<QQQII')  # start, end, size, crc, length of the compression's name
ROSBAG2 = 'rosbag2'                   # the writer makes this metadata record anew


def recover(src, dst):
    """Rewrite every complete message of a truncated or damaged bag into a valid one.

    src : bag directory or .mcap file, untouched;  dst : new bag directory
    Complete chunks with a wrong checksum are left out and counted; of a chunk cut short, the
    messages before the cut are kept.
    Returns a dict: source, bag, messages (topic -> number), damaged_chunks, unread_bytes (tail of
    the file that holds no complete record).
    Raises RecordingError if the file is not MCAP or holds no header.
    """
    path = mcap_file(src)
    with path.open('rb') as stream:
        _require_header(stream, path)
        salvage = _Salvage(stream, path.stat().st_size)
        with BagWriter(dst) as bag:
            for record in salvage.records():
                _copy(record, salvage, bag)
    return {'source': str(path), 'bag': str(bag.directory), 'messages': bag.counts,
            'damaged_chunks': salvage.damaged_chunks, 'unread_bytes': salvage.unread_bytes}


class _Salvage:
    """Walks the records of a file that may end anywhere."""

    def __init__(self, stream, size):
        self._stream = stream
        self._size = size
        self.schemas = {}
        self.channels = {}
        self.damaged_chunks = 0
        self.unread_bytes = 0

    def records(self):
        """Yield Schema, Channel, Message, Attachment and Metadata records up to the cut."""
        while True:
            start = self._stream.tell()
            head = self._stream.read(FRAME.size)
            if len(head) < FRAME.size:
                self.unread_bytes = len(head)
                return
            opcode, length = FRAME.unpack(head)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            body = self._stream.read(min(length, self._size))
            if len(body) < length:
                self.unread_bytes = self._size - start
                yield from self._cut_short(opcode, body)
                return
            yield from self._complete(opcode, body)

    def _complete(self, opcode, body):
        if opcode != Opcode.CHUNK:
            yield from self._sound(_parse(opcode, body))
            return
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            data, size = get_chunk_data_stream(chunk, validate_crc=True)
            content = data.read(size)
        except DAMAGED:
            self.damaged_chunks += 1
            return
        yield from self._sound(_unpack(content))

    def _sound(self, records):
        """Records up to the first that is malformed; that is counted with its chunk."""
        try:
            yield from records
        except DAMAGED:
            self.damaged_chunks += 1

    def _cut_short(self, opcode, body):
        """The messages of an incomplete chunk that lie before the cut."""
        if opcode != Opcode.CHUNK or len(body) < CHUNK_HEAD.size:
            return
        name_length = CHUNK_HEAD.unpack_from(body)[-1]
        start = CHUNK_HEAD.size + name_length
        name = body[CHUNK_HEAD.size:start]
        data = body[start + 8:]  # after the length of the compressed data
        if name == b'zstd':
            try:
                data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
            except zstandard.ZstdError:
                return
        elif name:
            return
        yield from self._sound(_unpack(data))


def _unpack(content):
    """Records in the uncompressed content of a chunk, up to the last complete one."""
    position = 0
    while position + FRAME.size <= len(content):
        opcode, length = FRAME.unpack_from(content, position)
        position += FRAME.size
        if position + length > len(content):
            return
        yield from _parse(opcode, content[position:position + length])
        position += length


def _parse(opcode, body):
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.MESSAGE:
        yield Message.read(stream, len(body))
    elif opcode == Opcode.SCHEMA:
        yield Schema.read(stream)
    elif opcode == Opcode.CHANNEL:
        yield Channel.read(stream)
    elif opcode == Opcode.METADATA:
        yield Metadata.read(stream)
    elif opcode == Opcode.ATTACHMENT and _attachment_sound(body):
        yield Attachment.read(stream)


def _attachment_sound(body):
    crc = struct.unpack('<I', body[-4:])[0]
    return crc == 0 or crc == zlib.crc32(body[:-4])


def _copy(record, salvage, bag):
    if isinstance(record, Message):
        channel = salvage.channels.get(record.channel_id)
        if channel is not None:
            bag.write(channel.topic, record.data, record.log_time, record.publish_time,
                      record.sequence)
    elif isinstance(record, Schema):
        salvage.schemas[record.id] = record
    elif isinstance(record, Channel) and is_ros(record, salvage.schemas.get(record.schema_id)):
        schema = salvage.schemas[record.schema_id]
        salvage.channels[record.id] = record
        bag.add_topic(record.topic, schema.name, definition=schema.data.decode(),
                      type_hash=record.metadata.get('topic_type_hash', ''),
                      qos=qos.parse(record.metadata.get('offered_qos_profiles', '')))
    elif isinstance(record, Metadata) and record.name != ROSBAG2:
        bag.add_metadata(record.name, record.metadata)
    elif isinstance(record, Attachment):
        bag.add_attachment(record.name, record.data, record.media_type)


def _require_header(stream, path):
    head = stream.read(len(MCAP0_MAGIC))
    if head != MCAP0_MAGIC:
        raise RecordingError(f'{path}: is not an MCAP file: it starts with {head!r}')
    frame = stream.read(FRAME.size)
    if len(frame) < FRAME.size or frame[0] != Opcode.HEADER:
        raise RecordingError(f'{path}: ends before its header; nothing can be recovered')
    length = FRAME.unpack(frame)[1]
    body = stream.read(min(length, path.stat().st_size))
    if len(body) < length:
        raise RecordingError(f'{path}: ends before its header; nothing can be recovered')
    try:
        profile = Header.read(ReadDataStream(BytesIO(body))).profile
    except DAMAGED as error:
        raise RecordingError(f'{path}: damaged header ({one_line(error)}); nothing can be '
                             'recovered') from None
    if profile != 'ros2':
        raise RecordingError(f"{path}: MCAP profile {profile!r}; must be 'ros2'")
