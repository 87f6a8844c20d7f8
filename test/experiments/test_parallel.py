"""Processes of a pool: no orphans are left when what made them is killed."""

import os
import signal
import subprocess
import sys
import time

PROGRAM = """
import os, sys, time
from arm_brachy.experiments.parallel import process_pool
if __name__ == '__main__':
    with process_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 60.0).result()
"""
WITHIN = 10.0       # s


def test_a_pool_ends_with_the_process_that_made_it(tmp_path):
    """Killed, it can call nothing off; the process that sleeps for a minute ends with it."""
    program = tmp_path / 'program.py'
    program.write_text(PROGRAM)
    parent = subprocess.Popen([sys.executable, program], stdout=subprocess.PIPE, text=True)
    try:
        child = int(parent.stdout.readline())
        os.kill(child, 0)
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    until = time.monotonic() + WITHIN
    while _lives(child):
        assert time.monotonic() < until, f'process {child} goes on'
        time.sleep(0.1)


def _lives(process):
    """True if a process of that number is there and not a zombie that nobody has waited for."""
    try:
        with open(f'/proc/{process}/stat', encoding='utf-8') as stat:
            return stat.read().rsplit(')', 1)[1].split()[0] != 'Z'
    except FileNotFoundError:
        return False
