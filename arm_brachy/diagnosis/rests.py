"""Noise that outlasts single rests: the pads come back, an elastic body with them.

Within rests of a second a memory of a second or two cannot be told from a constant; between rests
without a push whatever differs is noise, a drift, or the tissue's past.
Test: diagnosis/structural/test_noise.py
"""

import numpy as np

from arm_brachy.diagnosis.colour import (
    LONGEST_LAG,
    MEDIAN_CHI2,
    Stretch,
    fit_colour,
    lags_for,
    variogram,
)
from arm_brachy.diagnosis.motion import motion_of
from arm_brachy.diagnosis.stream import ENCODER

SETTLING = 0.2       # s after the pads have stopped that are no idle
ENOUGH_IDLE = 5.0    # s of idle before the first push that make later stretches needless
LONGEST_MEMORY = 2.0    # s of noise that is told from a drift over rests up to twice as far apart
FEWEST_RESTS = 3     # with the pads back where they began
FEWEST_PAIRS = 5     # of samples of a channel at a lag
MOST_EXCESS = 3.0    # times the variance: what differs more between rests is no noise


def rest_spans(evidence):
    """Rests without a push, tuples (t_start, t_end) [s]; none if the first alone is idle enough.
    """
    motion = motion_of(evidence)
    stills = () if motion is None else motion.stills()
    if not stills or stills[0][1] - stills[0][0] >= ENOUGH_IDLE:
        return ()
    first = evidence.get(ENCODER).t[0]
    rests = [(start if start == first else start + SETTLING, end)
             for start, end, pushed in stills if not pushed and end - start > 2.0 * SETTLING]
    return tuple(rests) if len(rests) >= FEWEST_RESTS else ()


def over_rests(stream, rests):
    """(Colour, variance over that at the shortest lag) from samples in different rests as well.

    rests : of `rest_spans`. None where the noise is white as far as they tell, or where they
    differ ever more with the time between them: that is no noise but a drift, or tissue that
    remembers. The median over channels is taken: a fault, or tissue that recovers under one pad,
    shows in few of them.
    """
    at_rest = np.zeros(len(stream.t), dtype=bool)
    for start, end in rests:
        at_rest |= (stream.t >= start) & (stream.t < end)
    index = np.flatnonzero(at_rest)
    if not len(index):
        return None
    k, c = stream.values.shape[1:]
    whole = Stretch(int(index[0]), int(index[-1]) + 1)
    lags = lags_for(int(min(LONGEST_LAG * (index[-1] - index[0]),
                            2.0 * LONGEST_MEMORY / stream.period)))
    gamma, pairs = variogram(stream.values.reshape(len(stream.t), k * c),
                             np.repeat(stream.valid & at_rest[:, None], c, axis=1), lags, [whole])
    known = (pairs >= FEWEST_PAIRS) & (gamma[0] > 0.0)
    some = known.any(axis=1)
    if not some[0]:
        return None
    relative = np.where(known, gamma / np.where(gamma[0] > 0.0, gamma[0], 1.0), np.nan)[some]
    colour, variance = fit_colour(np.nanmedian(relative, axis=1), pairs[some].sum(axis=1),
                                  lags[some], stream.period)
    return (colour, max(variance, 1.0)) if 0.0 < colour.time < LONGEST_MEMORY else None


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
