"""Rests without a push, and by how much they differ beyond what the noise says.

Test: diagnosis/structural/test_rests.py
"""

from itertools import pairwise

import numpy as np

from arm_brachy.diagnosis.signals.motion import motion_of
from arm_brachy.diagnosis.signals.stream import ENCODER
from arm_brachy.diagnosis.statistics.noise_process import MEDIAN_CHI2

SETTLING = 0.2       # s after the pads have stopped that are no idle
ENOUGH_IDLE = 5.0    # s of idle before the first push: later stretches tell less of fast noise
FEWEST_RESTS = 3     # with the pads back where they began
MOST_EXCESS = 3.0    # times the variance: what differs more between rests is no noise


def rest_spans(evidence):
    """Rests without a push, tuples (t_start, t_end) [s]; none if they are fewer than FEWEST_RESTS.
    """
    motion = motion_of(evidence)
    if motion is None:
        return ()
    stills, first = motion.stills(), evidence.get(ENCODER).t[0]
    rests = [(start if start == first else start + SETTLING, end)
             for start, end, pushed in stills if not pushed and end - start > 2.0 * SETTLING]
    return tuple(rests) if len(rests) >= FEWEST_RESTS else ()


def undisturbed(rests, events):
    """The longest run of `rests`, tuples (t_start, t_end) [s], with none of `events` [s] within.

    What happens, a step that an actuator loses or a tool that is knocked, sets all that follows
    off, which no noise does. Empty if the run has fewer than FEWEST_RESTS.
    """
    ends = [-np.inf, *sorted(events), np.inf]
    runs = [[rest for rest in rests if start <= rest[0] and rest[1] <= end]
            for start, end in pairwise(ends)]
    best = max(runs, key=lambda run: run[-1][1] - run[0][0] if run else 0.0)
    return tuple(best) if len(best) >= FEWEST_RESTS else ()


def excess(stream, noise, rests):
    """Variance of means over single rests over what a Noise says of it, 1 to MOST_EXCESS.

    From the steps between neighbouring rests, so that a drift counts little (von Neumann 1941,
    Ann Math Stat 12:367), in their median over rests and channels, so that a jump does not, nor
    what shows in a few channels; and one standard deviation more, since few rests tell little.
    """
    if len(rests) < FEWEST_RESTS:
        return 1.0
    rows = [slice(*np.searchsorted(stream.t, span)) for span in rests]
    count = np.array([stream.valid[some].sum(axis=0) for some in rows])
    mean = np.array([_mean(stream.values[some], stream.valid[some]) for some in rows])
    t = np.array([0.5 * (start + end) for start, end in rests])
    own = noise.mean_variance(np.maximum(count, 1))
    shared = noise.colour.correlation(np.diff(t))[:, None, None] * noise.sd**2
    expected = np.maximum(own[1:] + own[:-1] - 2.0 * shared, 1e-3 * (own[1:] + own[:-1]))
    step = np.where((count[1:] > 0)[..., None] & (count[:-1] > 0)[..., None],
                    np.diff(mean, axis=0)**2 / expected, np.nan)
    seen = step[np.isfinite(step)]
    if not len(seen):
        return 1.0
    # steps share their ends: two of three are independent; a median of squares, 1.4 times a mean
    sure = 1.4 * np.sqrt(2.0 / (len(seen) / 1.5))
    found = float(np.median(seen)) / MEDIAN_CHI2
    return float(np.clip(found * (1.0 + sure), 1.0, MOST_EXCESS))


def _mean(values, valid):
    """Mean (k, c) of samples (n, k, c) where valid (n, k); 0 where there is none."""
    total = np.where(valid[..., None], values, 0.0).sum(axis=0)
    return total / np.maximum(valid.sum(axis=0), 1)[:, None]
