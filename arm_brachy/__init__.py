"""arm_brachy: a robotic cell for permanent-seed breast brachytherapy as a ROS 2 graph."""

import os

__version__ = '0.1.0'

# Numba's first choice, TBB, never ends a process that has one core: it waits for a worker that it
# does not have. Read by numba when it is imported; what the user has set counts.
os.environ.setdefault('NUMBA_THREADING_LAYER_PRIORITY', 'omp tbb workqueue')
