"""Pad forces where they should be none: zero of the sensors, and its drift."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import logsumexp

from arm_brachy.diagnosis.results.finding import (
    ALARM,
    Finding,
    log_tail,
    sigma_of_tail,
    threshold,
)
from arm_brachy.diagnosis.signals.regressors import MEMORIES, memories
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE

SETTLED = 0.2    # s after a motion before a sample counts as unloaded
FEWEST = 4       # rests: two make a line, the others tell how well it fits
SHORTEST = 10    # samples of a rest
TESTS = 2        # zero and drift
BESIDES = 2.3    # nats that all sensors but the loudest have to say for a lean: odds of 10
ALIKE = 1e-6     # of columns: how little one may add to the others
ENDS = 30        # rests at which somebody may have begun to lean on the body, or stopped
WANDERING = 0.5  # prior probability that what rests scatter by is remembered from rest to rest
SHARES = 0.7, 0.97              # of its variance, then,
SPANS = 0.03, 0.1, 0.3, 1.0, 10.0   # and for so many times the length of the recording


def force_findings(prepared, jumps=()):
    """Findings about the zero of every pad's force sensor, from the rests between pushes.

    jumps : times [s] of sudden events, after which the force at rest may be another
    The mean force of every rest is fitted by a zero, a drift and, if that is asked for, by what
    the tissue under this pad remembers of its pushes, so that recovery is no drift, or by what its
    first push has left for good (a guide that rubs, a bond that has bedded in), or both. The
    scatter of the rests about the fit, pooled over the pads, counts as noise: sensors wander from
    rest to rest by more than they do within one. It is no less than the noise of the mean of a
    rest, and known from as many rests as there are more than terms of the fit (`log_tail`).
    For how long a sensor remembers where it had wandered to, few rests hardly tell: chances are
    averaged over memories, by their restricted likelihoods (`_wanderings`).
    Where all sensors together ask for it, a force that acted in some successive rests alone is
    fitted beside: somebody who leaned on the body is no drift, however well a line and a memory
    bend to it.
    Test: diagnosis/structural/test_force.py
    """
    force = prepared.evidence.get(FORCE)
    if force is None or prepared.motion is None or (
            prepared.motion.q[0] > prepared.motion.touch).any():
        return ()   # what was pushed before the recording is still remembered
    rests = _rests(prepared, force)
    if len(rests) < FEWEST:
        return ()
    t = np.array([force.t[rows].mean() for rows in rests])
    fits = _unless_leant([_fits(prepared, force, k, rests, t, jumps)
                          for k in range(len(force.names))])
    stiffness = _stiffness(prepared, force, rests)
    ways = _wanderings(fits, _means(prepared, rests), stiffness * _known(prepared, force, rests))
    slack = np.hypot(prepared.calibration.force_zero, prepared.calibration.touch * stiffness)
    return tuple(found for pad in dict.fromkeys(force.names)
                 if (index := [k for k in force.on(pad) if fits[k] is not None])
                 for found in _findings(prepared, force, index, ways, slack))


def _known(prepared, force, rests):
    """[m] to which noisy encoders say where the pads are in the shortest of the rests."""
    shortest = min(np.ptp(force.t[rows]) for rows in rests)
    return float(prepared.evidence.get(ENCODER).path_error(shortest).max())


def _stiffness(prepared, force, rests):
    """Force per travel [N/m] of the pad that the tissue pushes back most, by its deepest push.

    A pad whose zero is off by a touch presses, or pulls, at rest already.
    """
    (tt, q), names = prepared.travel, prepared.evidence.get(ENCODER).names
    found = [0.0]
    for k, pad in enumerate(force.names):
        if pad not in names or not force.valid[:, k].any():
            continue
        depth = np.where(force.valid[:, k], np.interp(force.t, tt, q[:, names.index(pad)]), 0.0)
        deep = depth > 0.5 * depth.max()
        if depth.max() > prepared.motion.touch:
            push = force.values[:, k] - np.nanmean(force.values[rests[0], k], axis=0)
            found.append(np.median(np.linalg.norm(push[deep], axis=1) / depth[deep]))
    return max(found)


def unloaded(prepared, t):
    """(n,) True where no pad pushes and none has moved for a while."""
    rows = np.zeros(len(t), dtype=bool)
    for first, last in _spans(prepared):
        rows |= (t >= first) & (t <= last)
    return rows


def _spans(prepared):
    begin = prepared.motion.t[0]
    return [(start if start == begin else start + SETTLED, end)
            for start, end, pushed in prepared.motion.stills() if not pushed]


def _rests(prepared, force):
    """Row numbers of the samples of every rest that is long enough."""
    found = [np.flatnonzero((force.t >= first) & (force.t <= last))
             for first, last in _spans(prepared)]
    return [rows for rows in found if len(rows) >= SHORTEST]


def _unless_leant(fits):
    """The fit of each pad, None with too few rests: without a lean, unless one is likelier.

    fits : [pad][lean] of `_fits`, of no lean first. What leans on the body shows in others than
    the loudest sensor too; it pays for the search, and for the chance that nobody did.
    """
    known = [its for its in fits if its is not None]
    if not known:
        return [None] * len(fits)
    more = np.array([[worth for _, worth in its] for its in known])
    more -= more[:, :1]
    total = more.sum(axis=0)
    total[(total - more.max(axis=0) < BESIDES) & (len(known) > 1)] = 0.0
    lean = int(np.argmax(total))
    lean = lean if total[lean] > np.log(len(total) / ALARM) else 0
    return [None if its is None else its[lean][0] for its in fits]


def _fits(prepared, force, k, rests, t, jumps):
    """Of one pad for each of `_leans`: (fit, log evidence over a zero and a drift alone).

    A fit is a _Fit, zero and drift first among its columns. None with too few rests.
    """
    seen = [i for i, rows in enumerate(rests) if force.valid[rows, k].sum() >= SHORTEST]
    if len(seen) < FEWEST:
        return None
    y = np.array([np.nanmean(force.values[rests[i], k], axis=0) for i in seen])
    fixed = [np.ones(len(seen)), t[seen] - force.t[0]]
    fixed += [(t[seen] >= time).astype(float) for time in jumps]
    pasts = [(*recovery, *begun) for recovery, begun in product(
        [(), *((one,) for one in _recovery(prepared, force, k, rests, seen))],
        [(), _begun(prepared, force, k, t[seen])])]
    plain = [fit for past in pasts if (fit := _fit([*fixed, *past], y, t[seen])) is not None]
    if not plain:
        return None
    straight = plain[0]         # the past of none comes first
    without = min(plain, key=_cost), max(_worth(fit, straight) for fit in plain)
    out = [without]
    for lean in _leans(len(rests))[1:]:
        column = np.isin(seen, lean).astype(float)
        some = [fit for past in pasts if np.ptp(column)
                and (fit := _fit([*fixed, column, *past], y, t[seen])) is not None]
        worth = [_worth(fit, straight) for fit in some]
        out.append((some[int(np.argmax(worth))], max(worth)) if some else without)
    return out


@dataclass(frozen=True)
class _Fit:
    """Least squares. beta : (m, c);  covariance : (m, m) per unit scatter;  left : (r, c) misfit

    dof : rests more than columns;  columns : (r, m);  y : (r, c);  t : (r,) [s]
    """

    beta: np.ndarray
    covariance: np.ndarray
    left: np.ndarray
    dof: int
    columns: np.ndarray
    y: np.ndarray
    t: np.ndarray


def _fit(columns, y, t):
    """The _Fit by columns, each (r,), of what was measured y (r, c) at rests t (r,).

    None if they are too many, or two say the same: a memory that is over by the next rest is a
    lean at one rest.
    """
    X = np.stack(columns, axis=1)
    dof, size = len(y) - X.shape[1], np.linalg.norm(X, axis=0)
    if dof <= 1 or not size.all():
        return None
    u, s, vt = np.linalg.svd(X / size, full_matrices=False)
    if s[-1] < ALIKE:
        return None
    half = vt.T / s / size[:, None]
    beta, covariance = half @ (u.T @ y), half @ half.T
    return _Fit(beta, covariance, y - X @ beta, dof, X, y, t)


def _squares(fit):
    return max(float(np.sum(fit.left ** 2)), 1e-30)


def _cost(fit):
    """Schwarz's criterion of a fit, by which the past of a pad is chosen."""
    r, c = fit.left.shape
    return c * (r * np.log(_squares(fit)) + (r - fit.dof) * np.log(r))


def _worth(fit, straight):
    """Log evidence of a fit over that of fewer columns, exact for however few rests.

    Zellner 1986, On assessing prior distributions and Bayesian regression analysis with g-prior
    distributions, g the number of rests; Liang et al. 2008, JASA 103, eq. 6.
    """
    r, c = fit.left.shape
    n, k = c * straight.dof, c * (straight.dof - fit.dof)
    return 0.5 * ((n - k) * np.log1p(r) - n * np.log1p(r * _squares(fit) / _squares(straight)))


def _leans(r):
    """() and numbers of successive rests of r, neither the first nor the last among them.

    What sets in before can be a zero that is off, and what stays until the end a drift that was
    seen too rarely. Of many rests it begins and ends at some.
    """
    ends = np.unique(np.linspace(1, r - 2, min(r - 2, ENDS)).round().astype(int))
    return [(), *(range(first, last + 1) for first in ends for last in ends[ends >= first])]


def _recovery(prepared, force, k, rests, seen):
    """Mean over every rest of what is remembered of this pad's push, one column per memory."""
    t, push = _push(prepared, force.names[k])
    if np.ptp(push) <= prepared.motion.touch:
        return []
    past = [memories(force.t, t, push[:, None] / np.ptp(push), time)[:, 0]
            for time in MEMORIES[1:]]
    return [np.array([column[rests[i]].mean() for i in seen]) for column in past]


def _begun(prepared, force, k, t):
    """(r,) 1 at rests t (r,) after this pad's first push, in a tuple; () where that is no step."""
    times, push = _push(prepared, force.names[k])
    pushed = np.abs(push - push[0]) > prepared.motion.touch
    if not pushed.any():
        return ()
    after = (t > times[pushed.argmax()]).astype(float)
    return (after,) if np.ptp(after) else ()


def _push(prepared, pad):
    """(t (n,) [s], travel (n,) [m]) of a pad; none where it has no encoder."""
    (t, q), names = prepared.travel, prepared.evidence.get(ENCODER).names
    return t, q[:, names.index(pad)] if pad in names else np.zeros(len(t))


def _means(prepared, rests):
    """(c,) standard deviation of the mean over the shortest of the rests, the noisiest pad's."""
    noise = prepared.noise[FORCE]
    return np.sqrt(noise.mean_variance(min(map(len, rests))).max(axis=0))


@dataclass(frozen=True)
class _Wandering:
    """One memory of what rests scatter by.

    weight : its probability;  fits : _Fit of each channel with it, None with too few rests
    scatter : (c,) standard deviation of a rest;  dof : degrees of freedom from which it is known
    """

    weight: float
    fits: list
    scatter: np.ndarray
    dof: int


def _wanderings(fits, least, more):
    """_Wandering each: white, and of some shares and memories, weighed by restricted likelihood.

    fits : _Fit of each channel or None;  least : (c,) standard deviations of the mean of a rest;
    more : [N] beside it that encoders leave open
    A drift takes much of slow noise with it, and the rest looks as if it were white. Patterson &
    Thompson 1971, Biometrika 58:545; what is common to all channels is their colour, each axis
    has its own size. Averages of chances over what is not known: Kass & Raftery 1995, JASA 90:773.
    """
    known = [fit for fit in fits if fit is not None]
    dof = max(sum(fit.dof for fit in known), 1)
    span = max((np.ptp(fit.t) for fit in known), default=1.0)
    colours = [(0.0, span), *product(SHARES, [some * span for some in SPANS])]
    out, logs = [], []
    for share, memory in colours:
        white = [None if fit is None else _whitened(fit, share, memory) for fit in fits]
        squares = sum(np.sum(one.left ** 2, axis=0) for one, _ in filter(None, white))
        scatter = np.maximum(np.sqrt(squares / dof), least)
        volume = sum(len(scatter) * half for _, half in filter(None, white))
        prior = 1.0 - WANDERING if share == 0.0 else WANDERING / (len(colours) - 1)
        logs.append(np.log(prior) - volume - np.sum(
            dof * np.log(scatter) + 0.5 * squares / scatter ** 2))
        out.append(_Wandering(0.0, [one and one[0] for one in white],
                              np.hypot(scatter, more), dof))
    weights = np.exp(np.array(logs) - logsumexp(logs))
    return [replace(one, weight=float(weight)) for one, weight in zip(out, weights, strict=True)]


def _whitened(fit, share, memory):
    """(the _Fit where a share of the variance has a memory [s], half the logarithms of its
    restricted likelihood's two determinants).
    """
    apart = np.abs(np.subtract.outer(fit.t, fit.t))
    root = cholesky(share * np.exp(-apart / memory) + (1.0 - share) * np.eye(len(fit.t)),
                    lower=True)
    X, y = (solve_triangular(root, x, lower=True) for x in (fit.columns, fit.y))
    size = np.linalg.norm(X, axis=0)
    q, r = np.linalg.qr(X / size)
    inverse = solve_triangular(r, np.eye(len(size))) / size[:, None]
    beta = inverse @ (q.T @ y)
    half = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r)) * size).sum()
    return replace(fit, beta=beta, covariance=inverse @ inverse.T, left=y - X @ beta), half


def _estimate(ways, index, number, slack):
    """(value (c,), error (c,), z) of a coefficient of the channels `index`, over _Wanderings."""
    values, errors, tails = [], [], []
    for one in ways:
        fits = [one.fits[k] for k in index]
        value = np.concatenate([fit.beta[number] for fit in fits])
        sd = np.concatenate([one.scatter * np.sqrt(fit.covariance[number, number])
                             for fit in fits])
        values.append(value)
        errors.append(sd)
        tails.append(log_tail(value, sd, one.dof, slack))
    weight = np.array([one.weight for one in ways])[:, None]
    mean = np.sum(weight * values, axis=0)
    sd = np.sqrt(np.sum(weight * (np.square(errors) + np.square(values - mean)), axis=0))
    return mean, sd, sigma_of_tail(logsumexp(tails, b=weight[:, 0]), len(mean))


def _findings(prepared, force, index, ways, slack):
    """Findings of one pad by the _Wanderings of its channels `index`."""
    calibration, tests = prepared.calibration, TESTS * len(prepared.evidence.pads)
    pad, span = force.names[index[0]], (float(force.t[0]), float(force.t[-1]))
    out = []
    rate, rate_sd, z = _estimate(ways, index, 1, calibration.force_drift)
    limit = threshold(tests, len(rate))
    if z > limit:
        rate, rate_sd = _in_frame(force, index, rate, rate_sd)
        out.append(Finding(
            FORCE, pad, 'force_drift', 'rate', rate, 'N/s', rate_sd, z, *span,
            f'The force on {pad} drifts by {60.0 * np.linalg.norm(rate):.2f} N a minute while '
            'nothing pushes.', rivals=('swelling_drift',),
            parameters={'rate': tuple(rate), 'pads': (pad,)}, slack=calibration.force_drift))
    zero, zero_sd, z = _estimate(ways, index, 0, slack)
    if z > limit and not any(prepared.evidence.scene.gravity):    # a weight presses at rest
        zero, zero_sd = _in_frame(force, index, zero, zero_sd)
        out.append(Finding(
            FORCE, pad, 'force_drift', 'bias', zero, 'N', zero_sd, z, *span,
            f'The force on {pad} reads {np.linalg.norm(zero):.2f} N at the start while nothing '
            'pushes.', rivals=('actuator_gain', 'gravity', 'reference_shape'),
            parameters={'rate': (0.0, 0.0, 0.0), 'bias': tuple(zero), 'pads': (pad,)},
            slack=float(slack)))
    return out


def _in_frame(force, index, value, sd):
    """(value (3,), its error (3,)) in the frame, of a pad's components (c,), channels `index`.

    Across what is measured along one direction the value is zero, known no better than along it.
    """
    if force.along is None:
        return value, sd
    ways = force.along[index]
    return value @ ways, np.repeat(sd, 3) if len(sd) == 1 else np.sqrt(sd**2 @ ways**2)
