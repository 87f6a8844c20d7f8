"""Landlock: a Linux process gives up for good what it does not need of files and network.

No privileges are needed. Source: linux/landlock.h and Documentation/userspace-api/landlock.rst of
the kernel. What it does not hold back: the size and date of a file whose path is known (stat).
Test: prove/test_sandbox.py
"""

import ctypes
import os
import struct

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446    # the same on every architecture
ASK_VERSION, PATH_BENEATH, NO_NEW_PRIVILEGES = 1, 1, 38

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1, 2, 4, 8
OF_FILES = EXECUTE | WRITE_FILE | READ_FILE | 1 << 14 | 1 << 15    # truncate, device control
READ = EXECUTE | READ_FILE | READ_DIR
FILE_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}   # version -> how many rights of files it knows
NETWORK, SCOPES = 0b11, 0b11    # bind and connect of TCP; abstract sockets and signals


def version():
    """Version of Landlock in this kernel, 0 if it has none or it is switched off."""
    return max(_call(CREATE_RULESET, None, 0, ASK_VERSION), 0)


def confine(readable, writable):
    """This process and its children may read below `readable`, and do all below `writable`.

    readable, writable : paths; what does not exist is left out. From version 4 on TCP is closed,
    from 6 on signals and abstract sockets to others. There is no way back.
    Raises OSError if the kernel has no Landlock or refuses.
    """
    known = version()
    if not known:
        raise OSError('this kernel has no Landlock')
    every = (1 << FILE_RIGHTS.get(known, 16)) - 1
    attributes = struct.pack('QQQ', every, NETWORK if known >= 4 else 0,
                             SCOPES if known >= 6 else 0)
    size = 8 if known < 4 else 16 if known < 6 else 24
    rules = _checked(CREATE_RULESET, attributes, size, 0)
    for paths, rights in ((readable, READ), (writable, every)):
        for path in paths:
            _allow(rules, path, rights & every)
    if ctypes.CDLL(None, use_errno=True).prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), 'no_new_privs refused')
    _checked(RESTRICT_SELF, rules, 0)
    os.close(rules)


def _allow(rules, path, rights):
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    rights = rights if os.path.isdir(path) else rights & OF_FILES
    _checked(ADD_RULE, rules, PATH_BENEATH, struct.pack('=Qi', rights, handle), 0)
    os.close(handle)


def _checked(*arguments):
    answer = _call(*arguments)
    if answer < 0:
        raise OSError(ctypes.get_errno(), f'Landlock: {os.strerror(ctypes.get_errno())}')
    return answer


def _call(number, *arguments):
    libc = ctypes.CDLL(None, use_errno=True)
    plain = [ctypes.c_long(a) if isinstance(a, int) else a for a in arguments]
    return libc.syscall(ctypes.c_long(number), *plain)
