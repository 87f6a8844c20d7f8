"""Colour of noise that outlasts single rests: the pads come back, an elastic body with them.

Within rests of seconds a memory of seconds cannot be told from a constant; between rests without
a push whatever differs is noise, a drift, or the tissue's past. White noise plus a first-order
Markov part has a likelihood in closed form, by the Kalman filter, gaps between rests included;
restricted to what no constant can change (one per channel), since a few rests have their mean
taken out (Harville 1977, J Am Stat Assoc 72:320). Of the channels the middle third counts: a
fault, or tissue that recovers under one pad, shows in few of them. What is found has to hold
within single rests as well, each about a constant of its own. A drift that is faint is a tracker's
own, as EM trackers wander, where another one sees the body come back.
Test: diagnosis/structural/test_rest_colour.py
"""

import numpy as np
from numba import njit
from scipy.optimize import minimize
from scipy.special import expit, logit

from arm_brachy.diagnosis.statistics.noise_process import SIGNIFICANT, Colour

LONGEST_MEMORY = 2.0    # s of noise that is told from the tissue's past by its time alone
LONGEST_SLOW = 12.0     # s, where channels have it independently of each other, or it is faint:
FAINT = 0.25            # of the variance: of a tracker that a witness speaks for,
FAINT_OF_FEW = 0.35     # and of the middle one of few channels. Cells with 0.2 were seen at 0.29
STEADY = 0.5            # of what the means of rests differ by: the body moved less than that. Own
                        # choice, with a silicone finger in sight: up to 0.2 in ten recordings
PART = 0.25             # of the time from the first rest to the last: a longer memory is a drift
FEWEST_RESTS, FEWEST_CHANNELS = 5, 6     # of them, for their means to tell noise from the past
IN_COMMON = 0.5         # that squared correlations may exceed those of noise by, relative, where
                        # SIGNIFICANT errors are less. The half-cylinder, noise alone: 0.52 at most
                        # of limits from 0.5 to 1.2; what relaxes or yields there lasts too long
SHARES = (0.02, 0.06, 0.15, 0.35, 0.7, 0.95)    # of the variance, first guesses
TIMES = 7               # memories, first guesses, from SHORTEST sampling periods on
SHORTEST = 3.0
LOOSE, TRIES = 0.01, 80     # of logarithms, evaluations of the search
SURE = 0.5 * SIGNIFICANT**2     # log likelihood that a number more has to gain
HELD = 0.5              # that a channel may lose within rests by what is found between them, SURE
                        # that all may
MOST_SAMPLES = 20_000   # of a channel; of longer rests the beginnings count


def over_rests(stream, rests, witness=None):
    """(Colour, variance over that at the shortest lag) of a Stream at rest; None = not to be told.

    rests : tuples (t_start, t_end) [s], of `rests.rest_spans`
    witness : Stream of another tracker's points in the same body, None = none
    None where the noise is white as far as they tell, or lasts so long that it may be a drift, or
    the tissue's past.
    """
    kept = _kept(stream.t, rests)
    if not len(kept):
        return None
    t, (y, valid) = stream.t[kept], _series(stream, kept)
    number = np.searchsorted([end for _, end in rests], t, side='right')
    between, within = (_Likelihood(t, y, valid, stream.period, one)
                       for one in (np.zeros_like(number), number))
    means = _means(stream, rests)
    colour, gain = between.likeliest(_longest(rests) if _few(means) else np.inf)
    if gain < SURE or not (_is_noise(colour, stream, rests, means)
                           or _wanders(colour, means, rests, witness)):
        return None
    if within.likeliest()[1] - within.gain(colour) > max(HELD * y.shape[1], SURE):
        return None
    return colour, 1.0 / (1.0 - float(colour.correlation(stream.period)))


def _longest(rests):
    """[s] memory that is no drift yet."""
    return min(LONGEST_SLOW, PART * (rests[-1][1] - rests[0][0]))


def _kept(t, rests):
    """Numbers of the samples at rest, MOST_SAMPLES at most."""
    each = [np.arange(*np.searchsorted(t, span)) for span in rests]
    share = min(1.0, MOST_SAMPLES / max(sum(map(len, each)), 1))
    return np.concatenate([one[:int(np.ceil(share * len(one)))] for one in each] or [[]]).astype(
        int)


def _series(stream, kept):
    """(values (n, c), where they are known (n, c)) at samples `kept` (n,), about their means."""
    y = stream.values[kept].reshape(len(kept), -1)
    valid = np.repeat(stream.valid[kept], stream.values.shape[2], axis=1) & np.isfinite(y)
    y = np.where(valid, y, 0.0)
    return np.where(valid, y - y.sum(axis=0) / np.maximum(valid.sum(axis=0), 1), 0.0), valid


class _Likelihood:
    """Log likelihood of colours over that of white noise: the middle channels', for all of them.

    t : (n,) [s];  y, valid : (n, c);  period : [s];  number : (n,) of the constant of each sample
    """

    def __init__(self, t, y, valid, period, number):
        self._given = t, y, valid, number
        self._span = np.log([SHORTEST * period, max(t[-1] - t[0], 2.0 * SHORTEST * period)])
        self._white = _costs(*self._given, 0.0, 1.0)

    def gain(self, colour):
        """Of a Colour; 0 where no channel is known."""
        gains = self._white - _costs(*self._given, colour.share, colour.time)
        gains = np.sort(gains[np.isfinite(gains)])
        aside = len(gains) // 3
        middle = gains[aside:len(gains) - aside]
        return float(len(gains) * middle.mean()) if len(middle) else 0.0

    def likeliest(self, longest=np.inf):
        """(Colour, gain) of the likeliest with a memory of `longest` [s] at most."""
        def cost(point):
            return -self.gain(_colour(point))

        first, last = self._span
        span = first, max(min(last, np.log(longest)), first)
        guesses = [(logit(share), time) for share in SHARES for time in np.linspace(*span, TIMES)]
        found = minimize(cost, min(guesses, key=cost), method='Nelder-Mead',
                         bounds=[(-8.0, 8.0), span],
                         options={'maxfev': TRIES, 'xatol': LOOSE, 'fatol': LOOSE})
        return _colour(found.x), -float(found.fun)


def _colour(point):
    return Colour(float(expit(point[0])), float(np.exp(point[1])))


@njit(cache=True)
def _costs(t, y, valid, number, share, time):
    """-log restricted likelihood (c,), less a constant, of each channel at its likeliest variance.

    t, number : (n,) [s], of the constant of each sample, its slow noise independent of the
    others';  y, valid : (n, c). NaN for channels that are not known or never change.
    """
    out, white = np.full(y.shape[1], np.nan), 1.0 - share
    for c in range(y.shape[1]):
        free, square, volume, now = 0, 0.0, 0.0, -1
        last, slow, at_y, at_1 = 0.0, 0.0, 0.0, 0.0     # variance, means of the slow part of y, 1
        yy, y1, ones = 0.0, 0.0, 0.0                    # of one constant
        for i in range(len(t)):
            if not valid[i, c]:
                continue
            if number[i] != now:
                if ones > 0.0:
                    free, square, volume = free - 1, square + yy - y1**2 / ones, volume + np.log(
                        ones)
                now, slow, at_y, at_1 = number[i], share, 0.0, 0.0
                yy, y1, ones = 0.0, 0.0, 0.0
            else:
                kept = np.exp(-(t[i] - last) / time)
                at_y, at_1 = kept * at_y, kept * at_1
                slow = kept**2 * slow + share * (1.0 - kept**2)
            free, last, variance = free + 1, t[i], slow + white
            off_y, off_1 = y[i, c] - at_y, 1.0 - at_1
            yy, y1, ones = (yy + off_y**2 / variance, y1 + off_y * off_1 / variance,
                            ones + off_1**2 / variance)
            volume += np.log(variance)
            gain = slow / variance
            at_y, at_1, slow = at_y + gain * off_y, at_1 + gain * off_1, slow * (1.0 - gain)
        if ones > 0.0:
            free, square, volume = free - 1, square + yy - y1**2 / ones, volume + np.log(ones)
        if free > 2 and square > 0.0:
            out[c] = 0.5 * (free * np.log(square / free) + volume)
    return out


def _is_noise(colour, stream, rests, means):
    """True if what has a Colour between rests is no drift and not the tissue's past.

    means : of `_means`. Noise is every channel's own, while tissue that remembers, a frame or a
    base that moves shows in many. Squared correlations of their means are 1 / n on average where
    they have nothing in common, n being the number of independent rests less one (Bartlett 1935,
    J R Stat Soc 98:536), with a variance of 2 (n - 1) / (n + 2) times the square of that. Axes of
    one channel may have noise in common.
    Where rests or channels are too few to tell, what lasts for LONGEST_MEMORY is taken for noise,
    and what is FAINT_OF_FEW: better nothing is said of a past that is no more than that.
    """
    if _few(means):
        return colour.time < LONGEST_MEMORY or colour.share <= FAINT_OF_FEW
    if colour.time >= _longest(rests):
        return False
    means, channel, spans = means
    unit = means / np.linalg.norm(means, axis=0)
    i, j = _pairs(channel)
    independent = _independent(colour, stream, spans)
    alike = (unit.T @ unit)[i, j]**2 * independent
    error = np.sqrt(2.0 * max(independent - 1.0, 0.0) / (independent + 2.0) / len(alike))
    return alike.mean() < 1.0 + max(IN_COMMON, SIGNIFICANT * error)


def _wanders(colour, means, rests, witness):
    """True if a Colour is faint and the body came back better than that by a witness.

    By the middle one of its series the body moved from rest to rest by less than STEADY times
    what the middle one of the stream's `_means` differs by.
    """
    if witness is None or colour.share > FAINT or _few(_means(witness, rests)):
        return False
    return _moved(witness, rests) < STEADY**2 * np.median(means[0].var(axis=0, ddof=1))


def _moved(witness, rests):
    """Variance [m^2] between rests of the middle series of a Stream, less that of its noise.

    The halves of a rest differ by noise alone. Infinite where too few rests show all channels in
    both.
    """
    halves = [_halves(one) for one in _means(witness, rests)[2]]
    halves = [both for both in halves if all(witness.valid[half].any(axis=0).all()
                                             for half in both)]
    if len(halves) < FEWEST_RESTS:
        return np.inf
    first, second = (np.array([_mean_of(witness, half) for half in some])
                     for some in zip(*halves, strict=True))
    noise = 0.25 * np.mean((first - second)**2, axis=0)
    return float(np.median(np.var(0.5 * (first + second), axis=0, ddof=1) - noise))


def _halves(span):
    """Both halves of a slice."""
    middle = (span.start + span.stop) // 2
    return slice(span.start, middle), slice(middle, span.stop)


def _few(means):
    """True if rests or channels of `_means` are too few to tell what channels have in common."""
    values, channel, _ = means
    return (len(values) < FEWEST_RESTS or values.shape[1] < FEWEST_CHANNELS
            or not len(_pairs(channel)[0]))


def _pairs(channel):
    """(i, j) numbers of series that are of different channels; channel : (c,) of each."""
    i, j = np.triu_indices(len(channel), 1)
    other = channel[i] != channel[j]
    return i[other], j[other]


def _independent(colour, stream, spans):
    """What a sum of squares of means over `spans`, noise of a Colour, about their mean counts as.

    The number of independent ones less one; less the longer noise lasts against what is between.
    """
    t = np.array([stream.t[one].mean() for one in spans])
    count = np.array([one.stop - one.start for one in spans])
    covariance = np.array(colour.correlation(t[:, None] - t))
    np.fill_diagonal(covariance, colour.mean_variance(count, stream.period))
    about = covariance - covariance.mean(axis=0)
    about = about - about.mean(axis=1)[:, None]
    return float(np.trace(about)**2 / np.sum(about**2))


def _means(stream, rests):
    """(means (r, c), channel (c,), slices (r,)) of what changes, where all channels are seen."""
    spans = [slice(*np.searchsorted(stream.t, span)) for span in rests]
    spans = [one for one in spans if stream.valid[one].any(axis=0).all()]
    means = [_mean_of(stream, one) for one in spans]
    k, axes = stream.values.shape[1:]
    means = np.array(means).reshape(len(means), k * axes)
    means = means - means.mean(axis=0) if len(means) else means
    kept = means.any(axis=0)
    return means[:, kept], np.repeat(np.arange(k), axes)[kept], spans


def _mean_of(stream, span):
    """(k, c) means over a slice in which every channel is seen."""
    seen = np.where(stream.valid[span][..., None], stream.values[span], np.nan)
    return np.nanmean(seen, axis=0)
