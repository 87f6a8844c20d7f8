"""Few short rests leave open how loud slow noise is: within that, what is left over tells.

What no cause explains may be noise that outlasts the rests it was taken from. Then it is alike in
most states and channels of a stream: the median tells it from physics, which shows in some. And it
comes and goes within LONGEST_MEMORY: states further apart differ by it, where what drifts or
creeps is still much the same.
Test: diagnosis/test_loudness.py
"""

from collections import defaultdict

import numpy as np

from arm_brachy.diagnosis.results.formatting import STREAMS
from arm_brachy.diagnosis.selection.problem import left_over
from arm_brachy.diagnosis.signals.rest_noise import LONGEST_MEMORY
from arm_brachy.diagnosis.statistics.noise_process import MEDIAN_CHI2

LEAST = 1.05        # times the variance: less changes no verdict


def louder(assembly, explanations):
    """kind -> factor of the variance that the noise of a stream may have, where it seems louder.

    explanations : judge.Explanation each. It seems louder by what nuisances and they leave; the
    factor is what is in doubt (`noise.Noise.doubt`), for something strange has to stand out from
    all noise that there may be. Null recordings show noise alone: beside them no doubt counts but
    theirs.
    """
    left = left_over(assembly, explanations)
    ends = np.cumsum([len(m.observables.rows) for m in assembly.matched])[:-1]
    steps = [_steps(m, part) for m, part in zip(assembly.matched, np.split(left, ends),
                                                strict=True)]
    sound = assembly.matched[len(assembly.matched) - assembly.sound:]
    out = {}
    for kind in sorted(set().union(*steps)):
        most = max((m.recorded.prepared.noise[kind].doubt for m in sound or assembly.matched
                    if kind in m.recorded.prepared.noise), default=1.0)
        square = np.concatenate([one[kind] for one in steps if kind in one])
        seen = float(np.median(square)) / MEDIAN_CHI2
        if min(seen, most) > LEAST:
            out[kind] = most
    return out


def _steps(m, left):
    """kind -> (k,) half the squared steps of what is left (N,), of each channel and axis of a
    Matched, from every state to the next one that is LONGEST_MEMORY later.
    """
    t, traces, out = m.recorded.states.t, defaultdict(list), defaultdict(list)
    for row, value in zip(m.observables.rows, left, strict=True):
        traces[row.kind, row.channel, row.axis].append((t[row.state], value))
    for (kind, *_), trace in traces.items():
        times, values = np.array(trace).T
        later = np.searchsorted(times, times + LONGEST_MEMORY)
        known = later < len(times)
        if known.any():
            out[kind].append(0.5 * (values[later[known]] - values[known])**2)
    return {kind: np.concatenate(some) for kind, some in out.items()}


def said(factors):
    """A sentence for each stream of `louder`."""
    return tuple(
        f'The noise of the {STREAMS[kind][0]} was taken as {np.sqrt(factor):.1f} times what it is '
        'within single rests, which are too few and short to tell: that it may be.'
        for kind, factor in factors.items())
