"""One process per core for the independent runs of an experiment."""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

import numba


def process_pool(jobs):
    """Return a ProcessPoolExecutor for so many jobs, numba on one thread in each process.

    Results do not depend on it: the engine's bits are the same for any number of threads.
    """
    workers = min(len(os.sched_getaffinity(0)), jobs)
    # spawn: a fork would copy the threads' locks of numba and MKL but not the threads
    return ProcessPoolExecutor(workers, multiprocessing.get_context('spawn'),
                               numba.set_num_threads, (1,))


def on_one_thread(work, *task):
    """Return work(*task), numba on one thread, in a process that `process_pool` did not start."""
    numba.set_num_threads(1)    # of the thread that calls
    return work(*task)
