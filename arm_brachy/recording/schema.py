"""Message definitions without ROS: the .msg files of installed packages and their type hashes."""

import functools
import os
import re
import sys
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from arm_brachy.core.errors import RecordingError

SEPARATOR = '=' * 80
# The primitive types of the ROS 2 interface language (design.ros2.org, "Interface definition").
PRIMITIVES = frozenset(
    'bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 '
    'string wstring'.split())


def share_directories():
    """Directories that hold `<package>/msg/*.msg`: the ament prefixes, then this Python's own."""
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    return tuple(dict.fromkeys(Path(p) / 'share' for p in [*prefixes, sys.prefix]))


def message_definition(type_name):
    """Return the ros2msg text of a type: its .msg, then one block per dependency.

    type_name : 'package/msg/Type'
    Blocks are parted by a line of 80 '=' and open with `MSG: package/Type`, each type once, in the
    order met (the form that rosbag2's MCAP storage writes).
    Raises RecordingError if a .msg file is not installed.
    """
    return _definition(type_name, share_directories())


def type_hash(type_name, definition=None):
    """Return the type hash (REP-2016, 'RIHS01_...') of a type.

    definition : its ros2msg text; looked up in the installed packages when absent
    """
    text = message_definition(type_name) if definition is None else definition
    return _hash(type_name, text)


def typestore(definitions):
    """Return a rosbags type store that knows the types in `definitions` (name -> ros2msg text)."""
    store = get_typestore(Stores.EMPTY)
    for name, text in definitions.items():
        store.register(get_types_from_msg(text, name))
    return store


@functools.cache
def _hash(type_name, text):
    return typestore({type_name: text}).hash_rihs01(type_name)


@functools.cache
def _definition(type_name, directories):
    blocks, done, queue = [], set(), [type_name]
    while queue:
        name = queue.pop(0)
        if name in done:
            continue
        done.add(name)
        text = _read(name, directories)
        package, _, short = name.split('/')
        blocks.append(f'{SEPARATOR}\nMSG: {package}/{short}\n{text}' if blocks else text)
        queue.extend(_dependencies(text, package))
    return '\n'.join(blocks)


def _read(name, directories):
    parts = name.split('/')
    if len(parts) != 3 or parts[1] != 'msg':
        raise RecordingError(f"message type {name!r}; must be 'package/msg/Type'")
    for directory in directories:
        path = directory / parts[0] / 'msg' / f'{parts[2]}.msg'
        if path.is_file():
            return path.read_text(encoding='utf-8')
    places = ', '.join(str(d) for d in directories)
    raise RecordingError(f'no definition of {name} under {places}; install package {parts[0]} '
                         'or set AMENT_PREFIX_PATH')


def _dependencies(text, package):
    """Full names of the non-primitive types that the fields of one .msg file use."""
    found = []
    for line in text.splitlines():
        words = line.split('#')[0].split()
        if len(words) < 2:
            continue
        base = re.split(r'[\[<]', words[0])[0]
        if base in PRIMITIVES:
            continue
        head, _, short = base.rpartition('/')
        found.append(f'{head.split("/")[0] or package}/msg/{short}')
    return found
