"""Independent parts of one step of a diagnosis, done by processes that are forked for it.

A fork has all that was found before it (states, adjoints, factors) without a copy and without a
message; what it adds to that is lost with it, and results alone come back. Each part is done by
one process as one process alone would do it, and results are taken in the order of the parts: the
answer has the same bits for any number of processes.
Test: diagnosis/test_forked.py
"""

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

import numba
from threadpoolctl import threadpool_limits

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.processes import end_with_parent

_HELD = {}      # in a fork: what it works on, 'work' and 'parts'


def cores():
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def processes(jobs):
    """Number of processes that do so many jobs at a time; 1 = this one alone, nothing is forked.

    No more than there are cores. One where numba took GNU OpenMP for its threads, not TBB, its
    first choice: that ends a process which was forked. One where the system gives no semaphores,
    as a sandbox may.
    """
    if jobs == 1 or numba.threading_layer() == 'omp':
        return 1
    try:
        multiprocessing.get_context('fork').Lock()
    except OSError:
        return 1
    return min(jobs, cores())


def each(work, parts, jobs, size, finished):
    """Return [work(part) of every part], in their order, done by so many processes at a time.

    work : function of a part; what it returns or raises is pickled
    size : function of a part; the larger ones are begun first, lest one is left for the end
    finished : called here with every part that is done, as they come
    Raises what the first part raises, of those that do, once all are done; ArmBrachyError if no
    process can be made, or one is ended from outside. No process outlives the call.
    """
    order = sorted(range(len(parts)), key=lambda i: size(parts[i]), reverse=True)
    with _forked(min(jobs, len(parts)), work, parts) as pool:
        futures = _begun(pool, order)
        for future in as_completed(futures):
            finished(parts[futures[future]])
        try:
            return [future.result() for future in sorted(futures, key=futures.get)]
        except BrokenProcessPool:
            raise ArmBrachyError('a process of the diagnosis was ended from outside, as the '
                                 'kernel does where memory is short; must run to its end; give '
                                 'fewer --jobs') from None


def _begun(pool, order):
    """Future -> number of its part, the parts in an order; all processes are forked here."""
    with _signals_held_back():
        try:
            return {pool.submit(_act, i): i for i in order}
        except OSError as error:
            raise ArmBrachyError(f'no process can be made for --jobs ({error.strerror}); must be '
                                 'as many as given, with little memory of their own; give fewer '
                                 '--jobs') from None


@contextmanager
def _forked(count, work, parts):
    """Context: a pool of so many forks of this process, ended with it whatever they do then."""
    others = multiprocessing.active_children()
    pool = ProcessPoolExecutor(count, multiprocessing.get_context('fork'), _begin, (work, parts))
    try:
        yield pool
    finally:
        # After Ctrl-C or at a time limit they are in the middle of what nobody waits for.
        for child in multiprocessing.active_children():
            if child not in others:
                child.kill()
        # One that was ended while it wrote a result has left a part of it in the pipe. The pool
        # would wait for the rest as long as somebody may write, as this process itself may.
        pool._result_queue._writer.close()
        pool.shutdown(cancel_futures=True)


@contextmanager
def _signals_held_back():
    """Context in which Ctrl-C and time limits wait; forks made in it never hear of either.

    A fork keeps the mask of signals that it was made with.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGALRM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(work, parts):
    """Be a fork that does some of the parts, on one core: the others have others."""
    numba.set_num_threads(1)
    threadpool_limits(1)
    end_with_parent()
    _HELD.update(work=work, parts=parts)


def _act(i):
    return _HELD['work'](_HELD['parts'][i])
