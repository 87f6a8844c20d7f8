"""What was being done while a recording was made: intervals of load, rest, ringing."""

import numpy as np

from arm_brachy.evaluation.timeseries import Regime

REST, LOAD, HOLD, UNLOAD, EXCHANGE = 'rest', 'load', 'hold', 'unload', 'exchange'
HELD, RINGING, SETTLED = 'held', 'ringing', 'settled'
IDLE = (REST, HOLD, HELD, SETTLED)

# An encoder of 0.01 mm resolution differenced over 0.2 s is good to 0.1 mm/s; pads push at mm/s.
WINDOW = 0.2        # s
STILL = 0.5e-3      # m/s
TOUCH = 0.1e-3      # m, pushed less than this counts as not pushed
NOISE_PEAK = 3.0    # times the rms norm of Gaussian noise: exceeded once in 10^5 samples
BAND = 0.02         # of the largest departure: the usual 2 % band of a settling time


def pad_regimes(encoder):
    """Split a recording by what its pads do.

    encoder : Series of (n, p) [m], pushes from rest
    Returns Regime tuple without gaps: rest (no pad pushes), hold (pads push and stand), load (pads
    move in), unload (they move out), exchange (some in, some out).
    Valid for pads that move faster than 0.5 mm/s; slower motion counts as standing.
    """
    t, q = encoder.t, encoder.values
    ahead = np.searchsorted(t, t + 0.5 * WINDOW, side='right') - 1
    behind = np.searchsorted(t, t - 0.5 * WINDOW)
    span = np.maximum(t[ahead] - t[behind], 1e-9)[:, None]
    speed = (q[ahead] - q[behind]) / span
    inward, outward = (speed > STILL).any(axis=1), (speed < -STILL).any(axis=1)
    pushed = (q > TOUCH).any(axis=1)
    label = np.select([inward & outward, inward, outward, pushed], [EXCHANGE, LOAD, UNLOAD, HOLD],
                      REST)
    return _runs(t, label)


def release_regimes(t, measured, release, floor):
    """Split a recording of a body that is let go: held, ringing, settled.

    t : (n,) [s];  measured : (n, k, 3) [m];  release : [s];  floor : (k,) [m] rms noise norm
    Settled: from then on no marker departs from its final mean (over the last tenth) by more than
    2 % of the largest departure of all, or than what noise does.
    """
    final = np.nanmean(measured[-max(1, len(t) // 10):], axis=0)
    departure = np.linalg.norm(measured - final, axis=2)
    allowed = np.maximum(BAND * np.nanmax(departure), NOISE_PEAK * np.nan_to_num(floor))
    outside = (np.nan_to_num(departure) > allowed).any(axis=1)
    settled = t[min(np.flatnonzero(outside).max(initial=0) + 1, len(t) - 1)]
    label = np.select([t <= release, t < settled], [HELD, RINGING], SETTLED)
    return _runs(t, label)


def inside(t, regimes, names):
    """True (n,) where t [s] lies in a Regime with one of `names`; its end belongs to the next."""
    hit = np.zeros(len(t), dtype=bool)
    for regime in regimes:
        if regime.name in names:
            hit |= (t >= regime.t_start) & ((t < regime.t_end) | (regime.t_end >= t[-1]))
    return hit


def _runs(t, label):
    """Maximal stretches of one label, each ending where the next begins."""
    start = np.concatenate([[0], np.flatnonzero(label[1:] != label[:-1]) + 1])
    end = np.append(start[1:], len(t) - 1)
    return tuple(Regime(str(label[a]), float(t[a]), float(t[b]))
                 for a, b in zip(start, end, strict=True))
