"""Compiled code in threads: a process that has one core ends."""

import os
import subprocess
import sys

import pytest

PROGRAM = """
import os
os.sched_setaffinity(0, {cores})
import arm_brachy
import numba, numpy as np

@numba.njit(parallel=True)
def squares(x):
    for i in numba.prange(len(x)):
        x[i] *= x[i]

squares(np.arange(1000.0))
print(numba.threading_layer())
"""


def layer_on(cores):
    """Name of numba's threading layer in a process that has some cores, and has ended."""
    done = subprocess.run([sys.executable, '-c', PROGRAM.format(cores=cores)], text=True,
                          capture_output=True, timeout=300, check=False,
                          env={k: v for k, v in os.environ.items() if not k.startswith('NUMBA_')})
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_process_on_one_core_ends_and_does_not_wait_for_workers_of_tbb():
    """TBB as numba's layer kept `arm-brachy run` alive for ever after its report."""
    assert layer_on([min(os.sched_getaffinity(0))]) == 'omp'


@pytest.mark.skipif(len(os.sched_getaffinity(0)) == 1, reason='one core')
def test_on_more_cores_threads_do_not_spin():
    """Two processes with threads of OpenMP on two cores take nearly twice as long as with TBB."""
    assert layer_on(sorted(os.sched_getaffinity(0))) == 'tbb'


def test_what_the_user_chose_counts(monkeypatch):
    program = ("import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); "
               "import arm_brachy; print(os.environ['NUMBA_THREADING_LAYER_PRIORITY'])")
    monkeypatch.setenv('NUMBA_THREADING_LAYER_PRIORITY', 'tbb')
    done = subprocess.run([sys.executable, '-c', program], text=True, capture_output=True,
                          timeout=60, check=True)
    assert done.stdout.strip() == 'tbb'
