"""Compiled code in threads: a process that has one core ends."""

import os
import subprocess
import sys

PROGRAM = """
import os
os.sched_setaffinity(0, [{core}])
import arm_brachy
import numba, numpy as np

@numba.njit(parallel=True)
def squares(x):
    for i in numba.prange(len(x)):
        x[i] *= x[i]

squares(np.arange(1000.0))
print(numba.threading_layer())
"""


def test_a_process_on_one_core_ends_and_does_not_wait_for_workers_of_tbb():
    """TBB as numba's layer kept `arm-brachy run` alive for ever after its report."""
    core = min(os.sched_getaffinity(0))
    done = subprocess.run([sys.executable, '-c', PROGRAM.format(core=core)], text=True,
                          capture_output=True, timeout=300, check=False,
                          env={k: v for k, v in os.environ.items() if not k.startswith('NUMBA_')})
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == 'omp'


def test_what_the_user_chose_counts(monkeypatch):
    program = "import arm_brachy, os; print(os.environ['NUMBA_THREADING_LAYER_PRIORITY'])"
    monkeypatch.setenv('NUMBA_THREADING_LAYER_PRIORITY', 'tbb')
    done = subprocess.run([sys.executable, '-c', program], text=True, capture_output=True,
                          timeout=60, check=True)
    assert done.stdout.strip() == 'tbb'
