"""The one guard around readers of foreign files: what they raise becomes one line.

Readers that trust what a file says of itself (C++, or a library that allocates by a count in a
header) run in a process of their own with limits on memory and time.
"""

import os
import re
import signal
import struct
import subprocess
import sys
import tokenize
import zipfile
import zlib
from contextlib import contextmanager
from pathlib import Path

# What parsers raise on bytes that are not what they take them for.
MALFORMED = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, OSError,
             EOFError, MemoryError, RecursionError, NotImplementedError, AssertionError,
             SyntaxError, tokenize.TokenError, struct.error, zlib.error, zipfile.BadZipFile)
LONGEST = 300                   # characters of a foreign message that are passed on
MEMORY, MEMORY_PER_BYTE = 768e6, 30.0   # bytes of address space; 300 MB are the libraries'
SECONDS, SECONDS_PER_BYTE = 3.0, 4e-6   # of processor time; one is the interpreter's start
BOOT = ('import resource as r, runpy, sys; m, s = int(sys.argv[1]), int(sys.argv[2]); '
        'r.setrlimit(r.RLIMIT_AS, (m, m)); r.setrlimit(r.RLIMIT_CPU, (s, s + 1)); '
        'r.setrlimit(r.RLIMIT_CORE, (0, 0)); sys.argv = sys.argv[3:]; '
        'runpy.run_path(sys.argv[0], run_name="__main__")')


@contextmanager
def guarded(path, error, what, advice):
    """Turn what a parser raises on malformed bytes into `error`, one line.

    path : file;  error : ArmBrachyError class;  what : 'a readable ... file';  advice : what to do
    """
    try:
        yield
    except MALFORMED as problem:
        raise error(f'{path}: not {what} ({type(problem).__name__}: {one_line(problem)}); '
                    f'{advice}') from None


def file_bytes(path, error):
    """Return the bytes of a regular file; raise `error` in one line where there is none."""
    path = Path(path)
    if not path.is_file():
        kind = 'is no regular file' if path.exists() else 'no such file'
        raise error(f'{path}: {kind}; give the path of a file')
    try:
        return path.read_bytes()
    except OSError as problem:
        raise error(f'{path}: cannot be read: {problem.strerror}') from None


def decoded(data):
    """Return the text of bytes: UTF-8, or Latin-1 where they are none; never fails."""
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('latin-1')


def one_line(text):
    """Return text in one line of at most LONGEST characters."""
    line = ' '.join(str(text).split())
    return line if len(line) <= LONGEST else line[:LONGEST - 3] + '...'


def confined(script, path, error, what, advice):
    """Return what `script` writes to standard output about a file; it runs with limits.

    script : path of a Python file that gets `path` as its argument and imports nothing of ours
    error, what, advice : as `guarded`, for a script that fails, dies or passes a limit
    Limits: address space and processor time, both growing with the file.
    """
    size = Path(path).stat().st_size
    memory, seconds = (int(base + rate * size) for base, rate in (
        (MEMORY, MEMORY_PER_BYTE), (SECONDS, SECONDS_PER_BYTE)))
    threads = {f'{name}_NUM_THREADS': '1' for name in ('OMP', 'OPENBLAS', 'MKL')}
    command = [sys.executable, '-I', '-c', BOOT, str(memory), str(seconds), str(script), str(path)]
    try:
        done = subprocess.run(command, capture_output=True, env={**os.environ, **threads},
                              stdin=subprocess.DEVNULL, timeout=10.0 * seconds, check=False)
    except subprocess.TimeoutExpired:
        raise error(f'{path}: not {what}: its reader did not end within {10 * seconds} s; '
                    f'{advice}') from None
    if done.returncode == 0:
        return done.stdout
    raise error(f'{path}: not {what}: {_reason(done, memory, seconds)}; {advice}')


def _reason(done, memory, seconds):
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return f'its reader did not end within {seconds} s of processor time'
    said = re.sub(r'\x1b\[[0-9;]*m', '', decoded(done.stderr))
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    if any('MemoryError' in line or 'bad_alloc' in line for line in lines[-3:]):
        return f'its reader asked for more than {memory // 10**6} MB'
    if done.returncode < 0:
        return f'its reader crashed ({signal.Signals(-done.returncode).name})'
    if 'Traceback' in said:
        lines = lines[-1:]
    return one_line(' '.join(lines)) or f'its reader ended with status {done.returncode}'
