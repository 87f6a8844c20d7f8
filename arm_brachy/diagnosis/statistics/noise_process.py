"""Colour of a sensor's noise: white, plus a slow part that forgets exponentially.

The variogram g(h) = E[(x(t + h) - x(t))^2] / 2 needs no mean, bears gaps and does not shrink on
short stretches as an autocorrelation does. For white noise of variance w plus a first-order
Markov part of variance s and correlation time T it is g(h) = w + s (1 - exp(-h / T)). Stretches
in which something may still settle are freed of a parabola first; what that leaves of either kind
of noise is computed, so that the fit is not biased.
Source: Cressie 1993, Statistics for Spatial Data, sec. 2.4 (estimators) and 2.6 (weighted fit).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.optimize import minimize_scalar, nnls
from scipy.signal import lfilter

MEDIAN_CHI2 = 0.4549   # median of the square of a standard normal
LONGEST_LAG = 0.6      # of a stretch: beyond, too few independent pairs
SIGNIFICANT = 3.0      # standard deviations of a lag correlation under white noise
TIMES = 12             # correlation times tried before the best is refined
LAGS = 16
LONGEST_MISFIT = 3.0   # s
LONGEST_PARABOLA, SHORTEST_PARABOLA = 200, 20   # samples


@dataclass(frozen=True)
class Colour:
    """Noise of unit variance. share : of the variance that is slow;  time : its memory [s]."""

    share: float = 0.0
    time: float = 0.0

    def correlation(self, lag):
        """Correlation of two samples `lag` [s] apart, lag > 0."""
        if self.share == 0.0:
            return np.zeros_like(np.asarray(lag, dtype=float))
        return self.share * np.exp(-np.abs(lag) / self.time)

    def mean_variance(self, count, period):
        """Variance of the mean over `count` samples, `period` [s] apart; arrays allowed.

        Its inverse is the effective number of samples. Exact for the slow part as well:
        (1 / n^2) (n + 2 sum_k (n - k) a^k), a = exp(-period / time).
        """
        n = np.maximum(np.asarray(count, dtype=float), 1.0)
        if self.share == 0.0:
            return 1.0 / n
        a = np.exp(-period / self.time)
        if a > 1.0 - 1e-9:
            return (1.0 - self.share) / n + self.share
        power = np.exp(n * np.log(a)) if a > 0.0 else np.zeros_like(n)
        slow = (n * (1.0 - a ** 2) - 2.0 * a * (1.0 - power)) / (n * (1.0 - a)) ** 2
        return (1.0 - self.share) / n + self.share * slow

    def innovation(self, period):
        """(sd, m): of the innovations e, and the moving-average root, of x_k - a x_{k-1} =
        e_k - m e_{k-1}, the ARMA(1, 1) process that white plus first-order Markov noise is.
        """
        if self.share == 0.0:
            return 1.0, 0.0
        a = np.exp(-period / self.time)
        white = 1.0 - self.share
        power = self.share * (1.0 - a ** 2) + white * (1.0 + a ** 2)
        if white < 1e-12 or a < 1e-9:
            return float(np.sqrt(power)), 0.0
        half = power / (2.0 * a * white)
        m = half - np.sqrt(half ** 2 - 1.0)
        return float(np.sqrt(power / (1.0 + m ** 2))), float(m)

    def log_determinant(self, count, period):
        """Logarithm of the determinant of the correlation matrix of `count` samples.

        The sum of the log variances of the errors of one-step prediction, by the Kalman filter
        (Schweppe 1965, IEEE Trans Inf Theory 11:61), which is steady sooner or later.
        """
        a2, white = np.exp(-2.0 * period / self.time) if self.share else 0.0, 1.0 - self.share
        steady = 2.0 * np.log(self.innovation(period)[0])
        total, slow = 0.0, self.share
        for k in range(count):
            one = np.log(slow + white)
            if abs(one - steady) < 1e-9:
                return float(total + (count - k) * steady)
            total += one
            slow = a2 * slow * white / (slow + white) + self.share * (1.0 - a2)
        return float(total)

    def whiten(self, period, columns):
        """Innovations of unit variance of the columns (n, ...), `period` [s] apart.

        A linear filter, for regressors and data alike. It takes the past as zero and known, which
        makes too much of the first samples of slow noise: see gls.whitened.
        """
        columns = np.asarray(columns, dtype=float)
        if self.share == 0.0:
            return columns
        sd, m = self.innovation(period)
        return lfilter([1.0 / sd, -np.exp(-period / self.time) / sd], [1.0, -m], columns, axis=0)


@dataclass(frozen=True)
class Stretch:
    """Samples start <= i < stop. settled : True if nothing but noise can be in them."""

    start: int
    stop: int
    settled: bool = True


def pieces(start, stop, settled):
    """A run of samples as Stretches; one that may still settle is cut so that a parabola fits."""
    if settled:
        return [Stretch(start, stop)] if stop - start > 2 else []
    number = -(-(stop - start) // LONGEST_PARABOLA)
    edges = np.linspace(start, stop, number + 1).round().astype(int)
    return [Stretch(int(a), int(b), False) for a, b in zip(edges[:-1], edges[1:], strict=True)
            if b - a >= SHORTEST_PARABOLA]


def variogram(values, valid, lags, stretches, *, robust=False):
    """Half the mean squared difference at each lag, over pairs that lie in one stretch.

    values : (n, k) evenly sampled;  valid : (n, k);  lags : (m,) in samples
    robust : from the median instead of the mean, for data with steps and outliers
    Returns (m, k) and the number of pairs (m, k); NaN where there are none.
    """
    parts = []
    for s in stretches:
        seen = np.where(valid[s.start:s.stop], values[s.start:s.stop], np.nan)
        parts.append(seen if s.settled else _flattened(seen))
    found = np.full((len(lags), values.shape[1]), np.nan)
    pairs = np.zeros(found.shape, dtype=int)
    for j, lag in enumerate(lags):
        steps = [part[lag:] - part[:-lag] for part in parts if len(part) > lag]
        if not steps:
            continue
        squared = np.concatenate(steps) ** 2
        pairs[j] = np.isfinite(squared).sum(axis=0)
        known = pairs[j] > 0
        if robust:
            found[j, known] = np.nanmedian(squared[:, known], axis=0) / (2.0 * MEDIAN_CHI2)
        else:
            found[j, known] = 0.5 * np.nansum(squared[:, known], axis=0) / pairs[j, known]
    return found, pairs


def _flattened(part):
    """Columns of part (n, k), NaN where not seen, less a parabola each."""
    out = np.full(part.shape, np.nan)
    u = np.linspace(-1.0, 1.0, len(part))
    basis = np.stack([np.ones_like(u), u, u ** 2], axis=1)
    for c in range(part.shape[1]):
        seen = np.isfinite(part[:, c])
        if seen.sum() > 2 * basis.shape[1]:
            fit = np.linalg.lstsq(basis[seen], part[seen, c], rcond=None)[0]
            out[seen, c] = part[seen, c] - basis[seen] @ fit
    return out


def expected_variogram(lags, period, stretches, time):
    """Variogram (m,) of unit noise of correlation time `time` [s] (0 = white), as `variogram` sees
    it over these stretches: 1 - exp(-h / time), less what the parabolas take.
    """
    h = lags * period
    plain = np.ones_like(h) if time == 0.0 else 1.0 - np.exp(-h / time)
    total, weight = np.zeros(len(lags)), np.zeros(len(lags))
    known = {}
    for s in stretches:
        n = s.stop - s.start
        pairs = np.maximum(n - lags, 0).astype(float)
        if not s.settled and n not in known:
            known[n] = _flattened_variogram(lags, period, n, time)
        total += pairs * (plain if s.settled else known[n])
        weight += pairs
    return np.where(weight > 0.0, total / np.maximum(weight, 1.0), plain)


def _flattened_variogram(lags, period, n, time):
    u = np.linspace(-1.0, 1.0, n)
    Q = np.linalg.qr(np.stack([np.ones_like(u), u, u ** 2], axis=1))[0]
    K = np.eye(n) if time == 0.0 else toeplitz(np.exp(-np.arange(n) * period / time))
    K = K - Q @ (Q.T @ K)
    K = K - (K @ Q) @ Q.T
    own = np.diag(K)
    return np.array([np.mean(0.5 * (own[lag:] + own[:-lag]) - np.diag(K, lag)) if lag < n else 0.0
                     for lag in lags])


def lags_for(longest):
    """Lags (m,) in samples, about geometric, up to `longest`."""
    grid = np.unique(np.round(np.geomspace(1.0, max(longest, 1), LAGS)).astype(int))
    return grid[grid <= max(longest, 1)]


def fit_colour(gamma, pairs, lags, period, stretches=()):
    """Colour and total variance from a variogram.

    gamma, pairs : (m,) pooled over channels of like variance;  lags : (m,) in samples
    stretches : that it was taken over; needed if any of them may still settle
    Returns (Colour, variance). Weighted least squares with weights pairs / gamma^2, coefficients
    not negative, the correlation time searched for. The slow part is dropped if it is not
    significant at the number of independent pairs.
    """
    keep = np.isfinite(gamma) & (pairs > 0) & (gamma > 0.0)
    gamma, pairs, lags = gamma[keep], pairs[keep], lags[keep]
    if not len(lags):
        return Colour(), 0.0
    root = np.sqrt(np.maximum(pairs / lags, 1.0)) / gamma
    ones = expected_variogram(lags, period, stretches, 0.0)

    def fitted(log_time):
        slow = expected_variogram(lags, period, stretches, float(np.exp(log_time)))
        return nnls(np.stack([ones, slow], axis=1) * root[:, None], gamma * root)

    grid = np.log(np.geomspace(1.5 * period, max(lags[-1], 3) * period, TIMES))
    best = int(np.argmin([fitted(x)[1] for x in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, TIMES - 1)]
    x = minimize_scalar(lambda x: fitted(x)[1], bounds=bounds, method='bounded').x
    (white, slow), time = fitted(x)[0], float(np.exp(x))
    total = white + slow
    if total == 0.0 or slow / total * np.sqrt(pairs[0]) < SIGNIFICANT:
        return Colour(), float(max(total, gamma[0]))
    return Colour(float(slow / total), float(time)), float(total)


def residual_colour(t, residual, valid, sensor, sensor_sd):
    """Colour, and standard deviations (c,), of what a fit leaves; at least those of the sensor.

    t : (n,) [s];  residual : (n, c);  valid : (n,);  sensor : Colour;  sensor_sd : float or (c,)
    From the median variogram, so that steps and spikes do not count as noise: a misfit of the fit
    that lasts becomes slow noise, and what is found beside it has to stand out from it.
    """
    period = float(np.median(np.diff(t)))
    lags = lags_for(int(min(LONGEST_LAG * len(t), LONGEST_MISFIT / period)))
    mask = np.repeat(valid[:, None], residual.shape[1], axis=1)
    gamma, pairs = variogram(residual, mask, lags, [Stretch(0, len(t))], robust=True)
    relative = gamma / sensor_sd ** 2
    colour, variance = fit_colour(np.nanmean(relative, axis=1), pairs.sum(axis=1), lags, period)
    if variance <= 1.0:
        return sensor, np.broadcast_to(sensor_sd, residual.shape[1]).copy()
    far = relative[np.flatnonzero(np.nan_to_num(relative).any(axis=1))[-1]]   # the longest known
    loudness = np.nan_to_num(far) / np.nanmean(far)
    return colour, sensor_sd * np.sqrt(np.maximum(variance * loudness, 1.0))
