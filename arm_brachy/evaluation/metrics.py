"""Every number quoted about a time response, an actuator, a force or a stream, defined once.

Pure functions of arrays, SI in and SI out. A number that the data cannot give is NaN (no sample in
the window, band never entered), never a stand-in.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError


@dataclass(frozen=True)
class SteadyState:
    """Where a response ended.

    mean_abs : [m] mean of |e|, noise included;  offset : [m] |mean of e|, noise averaged out
    spread : [m] rms distance from the mean position (noise, ripple, limit cycle)
    """

    mean_abs: float
    offset: float
    spread: float


@dataclass(frozen=True)
class Overshoot:
    """How far past the goal: `distance` [m] signed, `fraction` of the commanded step."""

    distance: float
    fraction: float


@dataclass(frozen=True)
class StreamQuality:
    """Rate, regularity and completeness of one stream.

    count : recorded;  lost : published but not recorded, None = publisher keeps no count
    rate : [1/s];  jitter : [s] standard deviation of the interval;  longest_gap : [s]
    """

    count: int
    lost: int | None
    rate: float
    jitter: float
    longest_gap: float


def deviation(positions, goal, axes):
    """Signed error on the controlled axes, zero on those left free.

    positions : (n, 3) [m];  goal : (3,) [m];  axes : (3,) bool;  Returns (n, 3) [m], p - goal.
    """
    return (np.asarray(positions) - np.asarray(goal)) * np.asarray(axes, dtype=bool)


def itae(t, error, *, t_start=None):
    """Integral of time-weighted absolute error, (3.30): integral of (t - t_start) |e| dt [m s^2].

    t : (n,) [s];  t_start : [s] start of the task, the first sample if not given
    error : (n,) [m] or (n, 3) [m], of which the Euclidean norm is taken
    Trapezoidal rule on the samples as they are. Times 1000 it is in mm s^2, the unit in which
    (3.30) gives the size of the published table (the thesis prints none).
    It grows with the square of the duration: compare only tasks of equal length. Noise of rms s
    adds up to s T^2 / 2, so a floor is quoted beside it by evaluating truth as well.
    """
    t, size = np.asarray(t, dtype=float), magnitude(error)
    if len(t) < 2:
        return np.nan
    t_start = t[0] if t_start is None else t_start
    return float(np.trapezoid((t - t_start) * size, t))


def magnitude(error):
    """|e| of an (n,) or (n, 3) error, same unit."""
    error = np.asarray(error, dtype=float)
    return np.abs(error) if error.ndim == 1 else np.linalg.norm(error, axis=1)


def steady_state(t, error, window):
    """Mean, offset and spread of the error over the last `window` seconds.

    t : (n,) [s];  error : (n, 3) [m];  window : [s] > 0, long against the sampling interval and
    short against the task; meaningless if the response has not settled by t[-1] - window.
    Returns SteadyState; all NaN if there is no sample.
    """
    if window <= 0:
        raise InputError(f'steady_state: window = {window} s; must be > 0')
    if len(t) == 0:
        return SteadyState(np.nan, np.nan, np.nan)
    last = np.asarray(error)[np.asarray(t) >= t[-1] - window]
    mean = last.mean(axis=0)
    spread = np.sqrt(np.mean(np.sum((last - mean) ** 2, axis=1)))
    return SteadyState(float(magnitude(last).mean()), float(np.linalg.norm(mean)), float(spread))


def progress(positions, start, goal, axes):
    """Distance covered along start -> goal, on the controlled axes.

    positions : (n, 3) [m];  start, goal : (3,) [m];  axes : (3,) bool
    Returns (s (n,) [m], step [m]): s = 0 at the start, s = step at the goal; step >= 0.
    """
    axes = np.asarray(axes, dtype=bool)
    way = (np.asarray(goal) - np.asarray(start)) * axes
    step = float(np.linalg.norm(way))
    if step == 0.0:
        return np.zeros(len(positions)), 0.0
    return (np.asarray(positions) - np.asarray(start)) @ (way / step), step


def overshoot(positions, start, goal, axes):
    """Largest distance past the goal along start -> goal; negative = the goal was never reached.

    Arguments as for `progress`. Returns Overshoot; the fraction is NaN for a step of zero.
    On noisy samples it includes the noise's own maximum: quote it from truth where there is one.
    """
    s, step = progress(positions, start, goal, axes)
    if len(s) == 0:
        return Overshoot(np.nan, np.nan)
    past = float(s.max()) - step
    return Overshoot(past, past / step if step else np.nan)


def rise_time(t, positions, start, goal, axes, *, low=0.1, high=0.9):
    """Time [s] from the first crossing of `low` to that of `high`, as fractions of the step.

    Crossings are interpolated linearly. NaN if `high` is never reached.
    """
    s, step = progress(positions, start, goal, axes)
    return _first_crossing(t, s, high * step) - _first_crossing(t, s, low * step)


def _first_crossing(t, s, level):
    above = np.flatnonzero(s >= level)
    if len(above) == 0:
        return np.nan
    i = above[0]
    if i == 0:
        return float(t[0])
    return float(np.interp(level, s[i - 1:i + 1], t[i - 1:i + 1]))


def settling_time(t, error, band):
    """Time [s] from t[0] after which |e| stays within `band` [m] to the end; NaN if it does not.

    The last crossing is interpolated linearly. It says nothing beyond t[-1].
    """
    if band <= 0:
        raise InputError(f'settling_time: band = {band} m; must be > 0')
    t, size = np.asarray(t, dtype=float), magnitude(error)
    outside = np.flatnonzero(size > band)
    if len(t) == 0 or (len(outside) and outside[-1] == len(t) - 1):
        return np.nan
    if len(outside) == 0:
        return 0.0
    i = outside[-1]
    share = (size[i] - band) / (size[i] - size[i + 1])
    return float(t[i] + share * (t[i + 1] - t[i]) - t[0])


def pad_travel(q):
    """Path length of every pad: sum of |q[k + 1] - q[k]| over (n, p) [m]; Returns (p,) [m].

    Encoder noise adds to it, so it is taken from encoders (quantised), not from trackers.
    """
    q = np.asarray(q, dtype=float)
    return np.abs(np.diff(q, axis=0)).sum(axis=0)


def peak_force(force):
    """Largest |f| of every pad over (n, p, 3) [N]; samples with NaN are skipped; (p,) [N]."""
    size = np.linalg.norm(np.asarray(force, dtype=float), axis=2)
    return np.fmax.reduce(size, axis=0, initial=np.nan)


def stream_quality(stamps, published=None):
    """Rate, jitter, longest gap and losses of a stream.

    stamps : (n,) [s];  published : count from the publishers' sequence counters or None
    rate = (n - 1) / (t[-1] - t[0]). Jitter supposes a periodic stream. NaN where n is too small.
    """
    gaps = np.diff(np.sort(np.asarray(stamps, dtype=float)))
    duration = gaps.sum()
    lost = None if published is None else int(published) - len(stamps)
    rate = len(gaps) / duration if duration > 0 else np.nan
    jitter = float(gaps.std()) if len(gaps) > 1 else np.nan
    longest = float(gaps.max()) if len(gaps) else np.nan
    return StreamQuality(len(stamps), lost, float(rate), jitter, longest)


def real_time_factor(simulated, wall):
    """Simulated seconds per second on the wall; NaN if either is unknown or zero."""
    if wall is None or not wall > 0 or not np.isfinite(simulated):
        return np.nan
    return float(simulated / wall)
