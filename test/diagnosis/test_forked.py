"""Parts of a step done by forks: in order, and none of them outlives what asked for it."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numba
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from arm_brachy.cli.progress import TimeIsOver, ended_after
from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.diagnosis import forked


def each(work, parts, jobs=2, size=lambda part: 0, finished=lambda part: None):
    return forked.each(work, parts, jobs, size, finished)


def slow(seconds):
    """A part that takes so long; negative ones fail then."""
    time.sleep(abs(seconds))
    if seconds < 0.0:
        raise InputError(f'{seconds} s; must not be negative')
    return seconds


def test_results_are_in_the_order_of_the_parts_whichever_is_done_first():
    last, done = multiprocessing.get_context('fork').Event(), []

    def work(part):
        if part == 'first':
            assert last.wait(60.0)
            time.sleep(0.2)     # until that one's result has come
        if part == 'last':
            last.set()
        return part, os.getpid()

    parts = ('first', 'second', 'last')
    found = each(work, parts, finished=done.append)
    assert tuple(part for part, _ in found) == parts
    assert sorted(done) == sorted(parts) and done[-1] == 'first'
    assert os.getpid() not in {process for _, process in found}


def test_the_largest_part_is_begun_first():
    begun = each(lambda part: time.monotonic(), (3, 1, 2), jobs=1, size=lambda part: part)
    assert begun[0] < begun[2] < begun[1]


def test_a_fork_has_what_was_found_before_without_a_message():
    known = {'lock': multiprocessing.Lock()}    # what cannot be pickled
    assert each(lambda part: known['lock'] is not None and part, (1, 2)) == [1, 2]


def test_what_fails_is_raised_as_it_is_and_of_several_the_first():
    with pytest.raises(InputError, match=r'^-0.5 s; must not be negative$') as failed:
        each(slow, (0.0, -0.5, -0.1))
    assert failed.value.exit_status == 2 and not multiprocessing.active_children()


def test_a_process_that_is_ended_from_outside_is_told_in_one_line():
    with pytest.raises(ArmBrachyError, match='ended from outside.* give fewer --jobs'):
        each(lambda part: os.kill(os.getpid(), signal.SIGKILL), (1, 2))


def test_no_process_goes_on_after_the_time_limit():
    begun = time.monotonic()
    with pytest.raises(TimeIsOver), ended_after(0.5):
        each(slow, (60.0, 60.0, 60.0))
    assert time.monotonic() - begun < 20.0 and not multiprocessing.active_children()


def test_forks_leave_ctrl_c_to_the_process_that_made_them():
    masks = each(lambda part: signal.pthread_sigmask(signal.SIG_BLOCK, ()), (1, 2))
    assert all(signal.SIGINT in mask for mask in masks)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_fork_has_one_thread():
    def threads(part):
        return numba.get_num_threads(), {pool['num_threads'] for pool in threadpool_info()}

    with threadpool_limits(2):
        assert each(threads, (1, 2)) == [(1, {1})] * 2


def refuse(number):
    def refused(*_, **__):
        raise OSError(number, os.strerror(number))
    return refused


def test_where_no_process_can_be_made_it_is_told_in_one_line(monkeypatch):
    monkeypatch.setattr(os, 'fork', refuse(errno.ENOMEM))
    with pytest.raises(ArmBrachyError, match=r'\(Cannot allocate memory\).* fewer --jobs'):
        each(len, ('', 'a'))


def test_there_are_no_more_processes_than_cores_and_one_where_numba_cannot_fork(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda process: set(range(3)))
    monkeypatch.setattr(numba, 'threading_layer', lambda: 'tbb')
    assert [forked.processes(jobs) for jobs in (1, 2, 8)] == [1, 2, 3]
    monkeypatch.setattr(multiprocessing.get_context('fork'), 'Lock', refuse(errno.EACCES),
                        raising=False)
    assert forked.processes(8) == 1
    monkeypatch.undo()
    monkeypatch.setattr(numba, 'threading_layer', lambda: 'omp')
    assert forked.processes(8) == 1


STOPPED = """
import sys, time
from arm_brachy.diagnosis import forked

def work(part):
    return bytes(part)

def finished(part):
    if part == 0:                   # the other one is writing its result, 0.4 GB
        time.sleep(float(sys.argv[1]))
        raise KeyboardInterrupt

try:
    forked.each(work, (400_000_000, 0), 2, lambda part: part, finished)
except KeyboardInterrupt:
    print('over')
"""


@pytest.mark.parametrize('late', [0.2, 0.5, 0.8])     # s; some while it writes, on any machine
def test_a_result_that_is_half_written_when_its_fork_is_ended_holds_nobody_up(late):
    done = subprocess.run([sys.executable, '-c', STOPPED, str(late)], capture_output=True,
                          text=True, timeout=30, check=False)
    assert done.stdout == 'over\n', done.stderr
