"""The key of one run of the cell, and what is proved with it: who sent a message, who may release.

A seal is written behind the CDR bytes of a message, so that message and proof cannot come apart:

    payload | 0 to 3 zeros | b'ABSEAL1' | number of zeros | sequence (8) | HMAC-SHA256 (32)

The HMAC covers topic, sequence and payload, and the payload holds the stamp. Whoever reads a
message by its type stops before the seal and is not disturbed by it. What a seal proves: the
sender can read the key file, which only the user that started the cell can. What it does not:
which of the cell's nodes sent it (all share the key); and nothing is encrypted.
"""

import hashlib
import hmac
import os
import secrets
import stat
import struct
from pathlib import Path

from arm_brachy.core.errors import ConfigError

KEY_BYTES = 32
MARK = b'ABSEAL1'
_TAIL = struct.Struct('<7sBQ32s')
_ALIGN = 4               # DDS pads what it carries to this; a seal stays at the very end
TICKET_LIFE_S = 60.0     # of a release: long enough to carry it to a service by hand
# What a person does to end a hold or a stop, for the messages of all who refuse meanwhile.
RUN_AGAIN = ('arm-brachy release BAG; in a cell without a key supervisor/reset, after a STOP also '
             'actuator_driver/release')

# The same for moves of a scenario that were interrupted.
RESUME = 'arm-brachy release BAG --resume'
RESUME_OR_CALL = f'{RESUME}; in a cell without a key push_protocol/resume'


class SealError(Exception):
    """Why a message is not from this cell, in a few words."""


class Session:
    """The key, and what this process has sealed and opened with it."""

    def __init__(self, key):
        """key : bytes, KEY_BYTES long."""
        self._key = key
        self._sent, self._heard, self._used = {}, {}, {}

    @classmethod
    def create(cls, path, domain='', namespace=''):
        """Write a new key to `path`, mode 0600, in place of an old one; returns its Session.

        domain, namespace : of the cell, noted in the file for whoever looks for the cell
        """
        path = Path(path)
        path.unlink(missing_ok=True)
        key = secrets.token_bytes(KEY_BYTES)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), 'w') as file:
            file.write(f'{key.hex()}\n{domain}\n{namespace}\n')
        return cls(key)

    @classmethod
    def load(cls, path):
        """Read a key file. Raises ConfigError if others than its owner could, or it is no key."""
        try:
            with open(path, encoding='ascii') as file:
                mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
                text = file.readline(4 * KEY_BYTES)
            key = bytes.fromhex(text)
        except OSError as error:
            raise ConfigError(f'{path}: no session key ({error.strerror}); a cell that is running '
                              'has one beside its bag') from None
        except ValueError:
            key = b''
        if len(key) != KEY_BYTES:
            raise ConfigError(f'{path}: holds no session key; must be {2 * KEY_BYTES} hexadecimal '
                              'digits')
        if mode & 0o077:
            raise ConfigError(f'{path}: mode {mode:04o} lets others read the session key; must be '
                              f'0600: chmod 600 {path}, then start the cell again')
        return cls(key)

    def seal(self, topic, payload, now_ns):
        """The CDR bytes `payload` with a seal for `topic` (full name) behind them.

        now_ns : time on the wall; where sequences begin, so that a sender that was started again
        goes on above what it sent before
        """
        sequence = max(self._sent.get(topic, 0) + 1, now_ns)
        self._sent[topic] = sequence
        zeros = -len(payload) % _ALIGN
        return (payload + bytes(zeros)
                + _TAIL.pack(MARK, zeros, sequence, self._mac(topic, sequence, payload)))

    def open(self, topic, data):
        """The payload of sealed bytes. Raises SealError: no seal, a wrong one, or one seen."""
        payload, sequence, mac = _split(data)
        if mac is None:
            raise SealError('no seal')
        if not hmac.compare_digest(mac, self._mac(topic, sequence, payload)):
            raise SealError('wrong seal')
        if sequence <= self._heard.get(topic, 0):
            raise SealError('sent again or out of order')
        self._heard[topic] = sequence
        return payload

    def ticket(self, action, now_ns):
        """Text that lets whoever holds it do `action` once, within TICKET_LIFE_S."""
        mac = self._mac('ticket ' + action, now_ns, b'')
        return f'{action}:{now_ns}:{mac.hex()}'

    def refusal(self, ticket, action, now_ns):
        """Why `ticket` does not allow `action`, in a few words; '' if it does, once."""
        name, _, rest = ticket.partition(':')
        number, _, mac = rest.partition(':')
        if name != action or not number.isascii() or not number.isdigit() or len(number) > 19:
            return f'no ticket for {action}'
        t_ns = int(number)
        if not hmac.compare_digest(mac.encode(), self._mac('ticket ' + action, t_ns, b'').hex()
                                   .encode()):
            return 'a ticket of another session'
        if abs(now_ns - t_ns) > TICKET_LIFE_S * 1e9:
            return f'a ticket older than {TICKET_LIFE_S:.0f} s'
        if t_ns <= self._used.get(action, 0):
            return 'a ticket that was used'
        old = now_ns - 2 * TICKET_LIFE_S * 1e9      # refused for its age in any case
        self._used = {a: t for a, t in self._used.items() if t >= old} | {action: t_ns}
        return ''

    def _mac(self, topic, sequence, payload):
        head = topic.encode() + b'\0' + struct.pack('<Q', sequence)
        return hmac.new(self._key, head + payload, hashlib.sha256).digest()


def place_of(path):
    """(ROS_DOMAIN_ID, namespace) noted in a key file; where no domain is, that of this process."""
    with open(path, encoding='ascii') as file:
        _, domain, namespace = (file.readline().strip() for _ in range(3))
    return domain or os.environ.get('ROS_DOMAIN_ID', '0'), namespace


def unsealed(data):
    """The payload of bytes that may carry a seal, which is not checked."""
    return _split(data)[0]


def _split(data):
    """(payload, sequence, mac), the last two None where there is no seal."""
    if len(data) < _TAIL.size:
        return data, None, None
    mark, zeros, sequence, mac = _TAIL.unpack_from(data, len(data) - _TAIL.size)
    end = len(data) - _TAIL.size - zeros
    if mark != MARK or zeros >= _ALIGN or end < 0:
        return data, None, None
    return data[:end], sequence, mac
