"""One byte string per message content: CDR leaves padding free, and Fast CDR does not write it.

Before an aligned number the serialiser of ROS skips up to seven bytes without clearing them, and
`rclpy.serialization` leaves the unused rest of its worst-case buffer at the end, so two
serialisations of one message may differ by whatever the memory held. Comparing recordings, and
publishing them, needs both gone.
"""

import struct

from rosbags.serde import SerdeError

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import schema

ENCAPSULATIONS = (b'\x00\x00', b'\x00\x01')  # plain CDR, big and little endian (DDSI-RTPS 10.2)


class Canonical:
    """Rewrites CDR payloads with zero padding and nothing after the last field.

    definitions : type name -> ros2msg text of every type that will be met
    Test: recording/test_canonical.py.
    """

    def __init__(self, definitions):
        self._store = schema.typestore(definitions)

    def decode(self, data, type_name):
        """Return the message; bytes after its last field are ignored.

        Raises RecordingError if the bytes end early or are no CDR.
        """
        if bytes(data[:2]) not in ENCAPSULATIONS:
            raise RecordingError(f'{type_name}: starts with {bytes(data[:4])!r}; must be '
                                 'plain CDR')
        definition = self._store.get_msgdef(type_name)
        read = (definition.deserialize_cdr_be if data[1] == 0 else definition.deserialize_cdr_le)
        try:
            return read(memoryview(data)[4:], 0, definition.cls, self._store)[0]
        except (SerdeError, struct.error, ValueError) as error:
            raise RecordingError(f'{type_name}: {len(data)} bytes that do not fit the definition: '
                                 f'{error}') from None

    def encode(self, message, type_name):
        """Return CDR bytes, little endian, padding zero."""
        return bytes(self._store.serialize_cdr(message, type_name))

    def data(self, data, type_name):
        """Return the payload `data` with padding zero and no surplus."""
        return self.encode(self.decode(data, type_name), type_name)
