"""One process per core for the independent runs of an experiment.

Test: experiments/test_parallel.py
"""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

import numba

from arm_brachy.core.processes import end_with_parent


def process_pool(jobs):
    """Return a ProcessPoolExecutor for so many jobs, numba on one thread in each process.

    Results do not depend on it: the engine's bits are the same for any number of threads. When the
    process that made it dies, however suddenly, its processes end at once.
    """
    workers = min(len(os.sched_getaffinity(0)), jobs)
    # spawn: a fork would copy the threads' locks of numba and MKL but not the threads
    return ProcessPoolExecutor(workers, multiprocessing.get_context('spawn'), _begin)


def on_one_thread(work, *task):
    """Return work(*task), numba on one thread, in a process that `process_pool` did not start."""
    numba.set_num_threads(1)    # of the thread that calls
    return work(*task)


def _begin():
    numba.set_num_threads(1)
    end_with_parent()
