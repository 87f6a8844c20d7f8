"""Padding carries nothing; everything else does."""

import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import encode
from arm_brachy.recording.canonical import Canonical
from arm_brachy.recording.reader import payload_hashes
from arm_brachy.recording.writer import BagWriter


@pytest.fixture
def payload():
    """A tool status and which of its bytes are padding, found by what decoding ignores."""
    encoder = encode.Encoder()
    data = encoder.tool_status(1, 'w', 'tool', 3, True, 0.5)
    canonical = Canonical(encoder.definitions)
    message = canonical.decode(data, encode.TOOL_STATUS)
    padding = []
    for i in np.flatnonzero(np.frombuffer(data, dtype=np.uint8)[4:] == 0) + 4:
        spoiled = data[:i] + b'\x5a' + data[i + 1:]
        try:
            if canonical.decode(spoiled, encode.TOOL_STATUS) == message:
                padding.append(int(i))
        except RecordingError:
            continue  # a length: no padding
    return canonical, data, padding


def test_padding_is_zeroed_and_nothing_else(payload):
    canonical, data, padding = payload
    assert len(padding) >= 7  # after a 2-byte string, a 5-byte string, a uint8
    spoiled = bytearray(data)
    for i in padding:
        spoiled[i] = 0x5A
    assert canonical.data(bytes(spoiled), encode.TOOL_STATUS) == data
    assert canonical.data(bytes(spoiled) + b'surplus!', encode.TOOL_STATUS) == data
    spoiled[-1] ^= 1
    assert canonical.data(bytes(spoiled), encode.TOOL_STATUS) != data


def test_hashes_ignore_padding(payload, tmp_path):
    _, data, padding = payload
    spoiled = bytearray(data)
    spoiled[padding[0]] = 0x5A
    hashes = []
    for name, content in (('a', data), ('b', bytes(spoiled))):
        with BagWriter(tmp_path / name) as bag:
            bag.add_topic('/s', encode.TOOL_STATUS)
            bag.write('/s', content, 0)
        hashes.append(payload_hashes(tmp_path / name))
    assert data != bytes(spoiled)
    assert hashes[0] == hashes[1]


def test_bytes_that_do_not_fit_are_refused(payload):
    canonical, data, _ = payload
    for bad, words in ((data[:20], 'do not fit'), (b'', 'plain CDR'), (b'\x05\x00', 'plain CDR')):
        with pytest.raises(RecordingError, match=words):
            canonical.decode(bad, encode.OPTICAL)
