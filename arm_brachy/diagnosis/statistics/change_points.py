"""When: a step in the mean of a series at an unknown time, beside any nuisance, in coloured noise.

For every candidate k the series is regressed on the nuisance columns and a step from sample k on.
Twice the gain in log likelihood, T_k, is chi-square with c degrees of freedom (c series stepping
together) where there is no step. What the largest of them may reach by chance is bounded by
counting upcrossings; see `chance`.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import correlate
from scipy.stats import chi2

from arm_brachy.diagnosis.statistics.gls import bridged, regress, whitened

LEAST = 5         # samples on either side of a step
DROP = 5.94       # in T: (1 - exp(-DROP / 2))^2 = 0.90, see Step
MOST_STEPS = 6
PARTS = 0.05      # s from one part of a step to the next
DEPENDENT = 1e-11  # of the largest eigenvalue: below, rounding makes up the direction


@dataclass(frozen=True)
class Step:
    """A step of c series.

    t : [s] of the first sample after it;  low, high : [s] 90 % interval of when it was, from the
        last sample before to the first one after
    size : (c,);  sd : (c,) of the size;  statistic : T, the fall of chi^2 by the step
    chance : probability that noise alone reaches it anywhere in the series
    The interval holds the candidates within 5.94 of the best T: log likelihoods on either side
    fall off as random walks with negative drift, each of which exceeds the value at the true time
    by more than x / 2 with probability at most exp(-x / 2) (Siegmund 1988, Int Stat Rev 56:31).
    """

    t: float
    low: float
    high: float
    size: np.ndarray
    sd: np.ndarray
    statistic: float
    chance: float


def step_scan(t, y, valid, colour, sd, nuisance=None, *, least=LEAST):
    """The best step of y (n, c) at an unknown time.

    t : (n,) [s], even;  valid : (n,);  colour : noise_process.Colour;  sd : (c,) of the noise
    nuisance : (n, p) columns fitted beside it; a constant is always among them
    least : valid samples that must lie on either side
    Returns Step, whatever its `chance`, or None if the series is too short.
    Test: diagnosis/structural/test_changes.py
    """
    t, y, valid = np.asarray(t), np.asarray(y, dtype=float), np.asarray(valid)
    if valid.sum() <= 2 * least:
        return None
    columns = np.ones((len(t), 1)) if nuisance is None else np.column_stack(
        [np.ones(len(t)), nuisance])
    Q = _basis(whitened(t, columns, colour, valid))
    W = whitened(t, bridged(t, y, valid, columns, colour), colour, valid) / sd
    left = W - Q @ (Q.T @ W)
    period = float(np.median(np.diff(t)))
    response = colour.whiten(period, np.ones(len(t)))
    power = _later(valid, response ** 2)
    tilt = np.stack([_matched(colour, period, q) for q in Q.T], axis=1)
    free = power - np.sum(tilt ** 2, axis=1)
    index = _candidates(valid, least)
    index = index[free[index] > 1e-6 * power[index].max()]
    if not len(index):
        return None
    match = np.stack([_matched(colour, period, series) for series in left.T], axis=1)
    excess = _excess(left, match[index] ** 2 / free[index, None], valid.sum() - Q.shape[1] - 1)
    match, sd = match / excess, sd * excess
    statistic = np.sum(match[index] ** 2, axis=1) / free[index]
    best = int(np.argmax(statistic))
    near = index[statistic >= statistic[best] - DROP]
    k = index[best]
    neighbours = _neighbours(valid, response, tilt, free, index)
    before = np.flatnonzero(valid[:near[0]])[-1]
    return Step(float(t[k]), float(t[before]), float(t[near[-1]]),
                match[k] / free[k] * sd, sd / np.sqrt(free[k]), float(statistic[best]),
                chance(float(statistic[best]), y.shape[1], neighbours))


def _excess(left, fall, dof):
    """(c,) by how much what remains beside the best step is louder than the noise, at least 1.

    left : (n, c) whitened;  fall : (m, c) of chi^2 by each candidate
    """
    best = fall[int(np.argmax(fall.sum(axis=1)))]
    return np.sqrt(np.maximum((np.sum(left ** 2, axis=0) - best) / max(dof, 1), 1.0))


def steps(t, y, valid, colour, sd, nuisance=None, *, alarm, most=MOST_STEPS):
    """All sudden steps less likely than `alarm` by chance, one by one; a tuple of Step by time.

    Each that is found becomes a nuisance of the next search (binary segmentation, Vostrikova 1981,
    Dokl Akad Nauk SSSR 259:270); the sizes are those of all steps fitted together. A gradual
    change that the nuisance misses also looks like a step from afar: the search ends at the first
    one that is not there from near.
    """
    found, columns = [], nuisance
    while len(found) < most:
        step = step_scan(t, y, valid, colour, sd, columns)
        if step is None or step.chance > alarm or not sudden(step, t, y, valid, sd, columns):
            break
        found.append(step)
        column = (np.asarray(t) >= step.t).astype(float)
        columns = column[:, None] if columns is None else np.column_stack([columns, column])
    if len(found) > 1:
        found = _together(found, t, y, valid, colour, sd, columns)
    return tuple(sorted(found, key=lambda step: step.t))


def _together(found, t, y, valid, colour, sd, columns):
    """The steps, whose columns are the last ones, with sizes fitted all at once."""
    names = {'1': np.ones(len(t))} | {str(-i): c for i, c in enumerate(columns.T[::-1], start=1)}
    fit = regress(t, y, names, valid, colour, sd)
    out = []
    for i, step in enumerate(reversed(found), start=1):
        size, _ = fit.of(str(-i))
        out.append(replace(step, size=np.atleast_1d(size)))
    return out


def joined(found):
    """Steps by time, with those that follow within PARTS as one: what took a few samples.

    found : Step each, by time. The largest of them says when, its size is that of all.
    """
    groups = []
    for step in found:
        if groups and step.t - groups[-1][-1].t <= PARTS:
            groups[-1].append(step)
        else:
            groups.append([step])
    return tuple(replace(max(group, key=lambda step: np.linalg.norm(step.size)),
                         size=np.sum([step.size for step in group], axis=0)) for group in groups)


def sudden(step, t, y, valid, sd, nuisance=None):
    """True if at least half of a step stands against a slope in its neighbourhood.

    The neighbourhood is as long as noise of `sd` (c,) needs for a step of this size to stand out
    by four standard deviations, and at least 10 samples on either side. What the nuisance columns
    explain of all of y is taken out first.
    """
    columns = np.ones((len(t), 1)) if nuisance is None else np.column_stack(
        [np.ones(len(t)), nuisance])
    jump = (np.asarray(t) >= step.t).astype(float)
    W = np.column_stack([columns / np.maximum(np.abs(columns).max(axis=0), 1e-300), jump])
    beta = np.linalg.lstsq(W[valid], y[valid], rcond=1e-8)[0]
    left = y - W[:, :-1] @ beta[:-1]
    rows = np.flatnonzero(valid)
    middle = int(np.searchsorted(rows, np.searchsorted(t, step.t)))
    size = float(np.linalg.norm(step.size))
    reach = int(np.clip((16.0 * float(np.mean(sd)) / max(size, 1e-300)) ** 2, 10, len(rows) / 4))
    near = rows[max(middle - reach, 0):middle + reach]
    local = np.column_stack([np.ones(len(near)), t[near] - step.t, jump[near]])
    local[:, 1] /= max(np.abs(local[:, 1]).max(), 1e-300)
    there = np.linalg.lstsq(local, left[near], rcond=1e-8)[0][2]
    return bool(there @ step.size > 0.5 * size ** 2)


def chance(statistic, c, neighbours):
    """Bound on P(max T_k >= statistic) without a step.

    c : degrees of freedom of each T_k;  neighbours : (m,) correlation of successive candidates
    P(T_1 >= b^2) plus the expected number of upcrossings of b by chi = sqrt(T). From candidate to
    candidate chi changes by a normal step of variance 2 (1 - r), so an upcrossing has probability
    f(b) sqrt((1 - r) / pi), f the density of chi, and at most P(T >= b^2): Worsley 1982,
    Biometrika 69:297, with the crossing probability of a smooth path (Rice's formula).
    """
    b = np.sqrt(max(statistic, 1e-12))
    single = chi2.sf(statistic, c)
    density = 2.0 * b * chi2.pdf(statistic, c)
    crossing = np.minimum(density * np.sqrt(np.maximum(1.0 - neighbours, 0.0) / np.pi), single)
    return float(min(single + crossing.sum(), 1.0))


def threshold(alarm, c, neighbours):
    """The value of T that noise exceeds with probability `alarm`, by `chance`; bisection."""
    low, high = 0.0, 1e3
    for _ in range(60):
        middle = 0.5 * (low + high)
        if chance(middle, c, neighbours) > alarm:
            low = middle
        else:
            high = middle
    return high


def _basis(columns):
    """Orthonormal basis of the span of whitened nuisance columns; nearly dependent ones merge."""
    size = np.sqrt(np.sum(columns ** 2, axis=0))
    W = columns / np.where(size > 0.0, size, 1.0)
    power, V = np.linalg.eigh(W.T @ W)
    kept = power > DEPENDENT * power[-1]
    return W @ (V[:, kept] / np.sqrt(power[kept]))


def _candidates(valid, least):
    before = np.cumsum(valid) - valid
    return np.flatnonzero(valid & (before >= least) & (valid.sum() - before >= least))


def _matched(colour, period, series):
    """(n,) inner products of the whitened series with the whitened step from every sample on."""
    return np.cumsum(colour.whiten(period, series[::-1]))[::-1]


def _later(valid, weight):
    """(n,) sums of weight[i - k] over the valid i >= k, for every k."""
    n = len(valid)
    return correlate(valid.astype(float), weight, mode='full', method='fft')[n - 1:]


def _neighbours(valid, response, tilt, free, index):
    """Correlation of T's root between successive candidates."""
    shifted = np.concatenate([[0.0], response[:-1]])
    inner = _later(valid, response * shifted) - _shift_inner(tilt)
    pair = index[:-1]
    follows = index[1:] == pair + 1
    out = np.zeros(len(pair))
    norm = np.sqrt(free[pair[follows]] * free[pair[follows] + 1])
    out[follows] = np.clip(inner[pair[follows]] / norm, 0.0, 1.0)
    return out


def _shift_inner(tilt):
    """(n,) inner products of row k with row k + 1; the last row with itself."""
    return np.sum(tilt * np.vstack([tilt[1:], tilt[-1:]]), axis=1)
