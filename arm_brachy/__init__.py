"""arm_brachy: a robotic cell for permanent-seed breast brachytherapy as a ROS 2 graph."""

import os

__version__ = '0.1.0'

# TBB, numba's first choice, never ends a process that has one core: it waits for a worker that it
# does not have. On more it beats OpenMP, whose threads spin. Read by numba when it is imported;
# what the user has set counts.
if len(os.sched_getaffinity(0)) == 1:
    os.environ.setdefault('NUMBA_THREADING_LAYER_PRIORITY', 'omp tbb workqueue')
