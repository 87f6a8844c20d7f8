"""Steps that stay steps where the noise may be slower than it looks.

Sensors have slow noise of which a rest of a second shows nothing, and regressors that follow the
pads take much of it out of what they leave: the first search finds steps in it.
"""

import numpy as np

from arm_brachy.diagnosis.statistics.change_points import PARTS, steps
from arm_brachy.diagnosis.statistics.reml import restricted_colour

NOTHING = 1e-3   # of a sensor's noise: less is none


def steadfast(found, t, y, valid, least, nuisance, *, alarm):
    """Steps, of those found, that are as unlikely in noise as slow as it is beside themselves.

    found : change_points.Step each;  least : (c,) standard deviations of the noise in rests,
        which no noise is below;  others as of `change_points.steps`;  returns a tuple
    A step that noise alone made takes some of its slow part away: those that are left are asked
    again until all of them stay.
    Test: diagnosis/structural/test_restricted.py
    """
    plain = np.column_stack([np.ones(len(t)), nuisance])
    while found:
        there = np.stack([t >= one.t for one in found], axis=1).astype(float)
        colour, slow = restricted_colour(t, y, valid, np.hstack([plain, there]),
                                         NOTHING * least)
        again = steps(t, y, valid, colour, np.maximum(slow, least), nuisance, alarm=alarm)
        kept = [one for one in again
                if any(f.low - PARTS <= one.t <= f.high + PARTS for f in found)]
        if len(kept) >= len(found):
            return tuple(kept)
        found = kept
    return ()
