"""Runs one command as a process that sees its own folders and the installed program, once.

`python -m arm_brachy.prove.sandbox RULES COMMAND...` gives up everything that RULES (a file) does
not allow and becomes the command. On a kernel without Landlock the command runs in its folder,
but could look elsewhere: the Outcome says so.
"""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import arm_brachy
from arm_brachy.core.paths import share_dir
from arm_brachy.prove import landlock

SYSTEM = ('/usr', '/lib', '/lib64', '/bin', '/etc', '/proc/self', '/proc/cpuinfo',
          '/proc/meminfo', '/proc/stat', '/proc/sys', '/sys/devices/system', '/dev/urandom')
DEVICES = ('/dev/null', '/dev/shm')
ANSWERED, CRASHED, SLOW = 'answered', 'crashed', 'timed out'
THREADS = ('OMP_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
KEPT = ('PATH', 'LANG', 'AMENT_PREFIX_PATH', 'PYPARDISO_MKL_RT', 'LD_LIBRARY_PATH')
TAIL = 2000     # characters of what went wrong


@dataclass(frozen=True)
class Outcome:
    """How a command ended.

    status : ANSWERED (exit 0), CRASHED or SLOW;  seconds : of the wall clock
    words : the end of what it said on stderr;  confined : False without Landlock
    """

    status: str
    seconds: float
    words: str
    confined: bool


def program_paths():
    """What the installed program needs to be able to read, absolute."""
    package, share = Path(arm_brachy.__file__).resolve().parent, share_dir()
    return tuple(dict.fromkeys(map(str, (
        sys.prefix, sys.base_prefix, Path(sys.executable).resolve().parent, package,
        share / 'config', share / 'package.xml'))))


def run(command, folder, *, readable=(), writable=(), limit):
    """Run `command` (list) in `folder` [made here, its own to write], at most `limit` [s].

    readable, writable : further paths it may use. It gets a clean environment and one thread;
    its whole process group ends with it. Returns Outcome, whatever the command does.
    """
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    rules = folder / 'rules.json'
    rules.write_text(json.dumps({
        'read': [*SYSTEM, *program_paths(), *(str(Path(p).resolve()) for p in readable)],
        'write': [*DEVICES, str(folder), *(str(Path(p).resolve()) for p in writable)]}),
        encoding='utf-8')
    launcher = [sys.executable, '-m', 'arm_brachy.prove.sandbox', str(rules), *command]
    start = time.monotonic()
    with (folder / 'stderr.txt').open('w+', encoding='utf-8', errors='replace') as said:
        process = subprocess.Popen(launcher, cwd=folder, env=_environment(folder, writable),
                                   stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                   stderr=said, start_new_session=True)
        status = _wait(process, limit)
        said.flush()
    words = (folder / 'stderr.txt').read_text(encoding='utf-8', errors='replace')[-TAIL:]
    return Outcome(status, time.monotonic() - start, words, landlock.version() > 0)


def _wait(process, limit):
    try:
        return ANSWERED if process.wait(limit) == 0 else CRASHED
    except subprocess.TimeoutExpired:
        return SLOW
    finally:    # children of its own end with it; also on Ctrl-C
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _environment(folder, writable):
    """Nothing of the caller's but where programs and libraries are; homes inside `folder`."""
    home = {name: str(folder) for name in ('HOME', 'TMPDIR', 'MPLCONFIGDIR', 'XDG_CACHE_HOME')}
    cache = {'NUMBA_CACHE_DIR': str(Path(writable[0]).resolve())} if writable else {}
    kept = {name: os.environ[name] for name in KEPT if name in os.environ}
    return {**kept, **home, **cache, **dict.fromkeys(THREADS, '1'), 'PYTHONDONTWRITEBYTECODE': '1'}


def main():
    """Give up what the rules do not allow, then become the command."""
    rules = json.loads(Path(sys.argv[1]).read_text(encoding='utf-8'))
    if landlock.version():
        landlock.confine(rules['read'], rules['write'])
    os.execv(sys.argv[2], sys.argv[2:])


if __name__ == '__main__':
    main()
