"""Did the pad itself move, or only its marker? What tissue and forces would then have done."""

import numpy as np

from arm_brachy.diagnosis.signals.regressors import history_columns
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.gls import regress

LOUD = 3.0       # standard errors that the expected answer of a channel must have to be asked
FEWEST = 100


def share_followed(prepared, travel, late, pad, t_step, shortfall):
    """Share of the answer to a pad that falls short that tissue markers and forces show.

    travel : (t, q (m, p));  late : kind -> [s];  pad : name;  t_step : [s];  shortfall : [m]
    Every channel is regressed on the history of the pads; the coefficients tell how it would
    change if the pad stood short from t_step on, and that change is fitted beside the history:
    1 = the pad moved, 0 = nothing but its marker did.
    Returns (share, standard error); (nan, inf) if no channel would show it.
    """
    t, q = travel
    moved = q.copy()
    moved[t >= t_step, prepared.evidence.get('encoder').names.index(pad)] -= shortfall
    shares, weights = [], []
    for kind, bodies in ((OPTICAL, (TISSUE,)), (FORCE, prepared.evidence.pads)):
        stream, noise = prepared.on(kind, *bodies)
        if stream is None:
            continue
        then = stream.t - late.get(kind, 0.0)
        plain = _columns(then, (t, q), prepared, kind)
        short = _columns(then, (t, moved), prepared, kind, like=q)
        step = {'step': (stream.t >= t_step).astype(float)}
        for k in range(len(stream.names)):
            found = _one(stream, noise, k, plain, short, step)
            shares += [value for value, _ in found]
            weights += [error ** -2 for _, error in found]
    if not weights:
        return np.nan, np.inf
    weights = np.array(weights)
    return float(np.sum(weights * shares) / weights.sum()), float(weights.sum() ** -0.5)


def _columns(then, travel, prepared, kind, like=None):
    return {'1': np.ones(len(then))} | history_columns(
        then, travel, prepared.motion.touch, memory=kind == FORCE, like=like)


def _one(stream, noise, k, plain, short, step):
    """[(share, error)] of each component of one channel that would show the change."""
    valid, y = stream.valid[:, k], stream.values[:, k]
    if valid.sum() < FEWEST:
        return []
    beta = regress(stream.t, y, plain | step, valid, noise.colour, noise.sd[k]).value[:-1]
    change = np.stack([short[name] - plain[name] for name in plain], axis=1) @ beta
    out = []
    for c in range(y.shape[1]):
        fit = regress(stream.t, y[:, c:c + 1], plain | {'share': change[:, c]}, valid,
                      noise.colour, noise.sd[k, c:c + 1])
        value, error = fit.of('share')
        if error < 1.0 / LOUD:
            out.append((value, error))
    return out
