"""The counts of a digitised signal.

Test: diagnosis/structural/test_noise.py, diagnosis/structural/test_motion.py
"""

import numpy as np

ENOUGH_VALUES = 20_000   # to see the counts


def quantum(values):
    """Step between the values that a digitised signal takes; 0 if it is continuous.

    The smallest difference between different values, if at least nine tenths of all differences
    are whole multiples of it.
    """
    levels = np.unique(values[:: max(len(values) // ENOUGH_VALUES, 1)])
    if len(levels) < 3:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * np.abs(levels).max()]
    if not len(steps):
        return 0.0
    step = float(np.percentile(steps, 1))
    multiple = steps / step
    return step if np.mean(np.abs(multiple - np.round(multiple)) < 0.02) >= 0.9 else 0.0
