"""Few short rests leave open how loud slow noise is: within that, what is left over tells.

What no cause explains may be noise that outlasts the rests it was taken from. Then it is alike in
most states and channels of a stream: the median tells it from physics, which shows in some.
Test: diagnosis/test_loudness.py
"""

import numpy as np

from arm_brachy.diagnosis.colour import MEDIAN_CHI2
from arm_brachy.diagnosis.conclude import left_over
from arm_brachy.diagnosis.words import STREAMS

LEAST = 1.05        # times the variance: less changes no verdict


def louder(assembly, decision):
    """kind -> factor of the variance that the noise of a stream may have, where it seems louder.

    decision : decide.Decision. It seems louder by what nuisances and its best candidate leave; the
    factor is what is in doubt (`noise.Noise.doubt`), for something strange has to stand out from
    all noise that there may be.
    """
    best = decision.ranked[0].explanations if decision.ranked else ()
    left = left_over(assembly, best)
    kinds = np.array([row.kind for m in assembly.matched for row in m.observables.rows])
    out = {}
    for kind in np.unique(kinds).tolist():
        most = max((m.recorded.prepared.noise[kind].doubt for m in assembly.matched
                    if kind in m.recorded.prepared.noise), default=1.0)
        seen = float(np.median(left[kinds == kind]**2)) / MEDIAN_CHI2
        if min(seen, most) > LEAST:
            out[kind] = most
    return out


def said(factors):
    """A sentence for each stream of `louder`."""
    return tuple(
        f'The noise of the {STREAMS[kind][0]} was taken as {np.sqrt(factor):.1f} times what it is '
        'within single rests, which are too few and short to tell: that it may be.'
        for kind, factor in factors.items())
