"""Regressors that a stream may follow from the encoders alone, without any model of the tissue.

Smooth quasi-static answers are polynomials of the pushes; what relaxes is a sum of exponential
memories of them (a Prony series). A stream regressed on these loses whatever an honest tissue of
any stiffness does, and keeps steps, delays, reversals and drifts.
"""

import numpy as np
from numba import njit
from scipy.signal import lfilter

MEMORIES = (0.1, 0.4, 1.6, 6.4)   # s; a factor of four apart: any in between is nearly a mixture
POWERS = (1, 2, 3)
GRID = 0.01                        # s, on which memories are integrated


def moving(q, touch):
    """Indices of the pads that push more than `touch` [m] at any time; q (n, p)."""
    return np.flatnonzero(np.nanmax(np.abs(q), axis=0) > touch)


def history_columns(t, travel, touch, *, memory=True, like=None):
    """Columns name -> (n,) at times t (n,) [s], from the pads' travel.

    travel : (tt (m,) [s], q (m, p) [m]), straight between samples
    touch : [m] pads that never push further are left out
    like : (m, p) [m] travel that says which columns there are and scales them; None = q
    Powers of each push, products of pads that push at the same time, and memories of each push.
    Every column is of order one: lengths are scaled by the largest travel.
    """
    tt, q = travel
    like = q if like is None else like
    pads = moving(like, touch)
    size = max(float(np.abs(like).max()), 1e-12)
    u = np.stack([np.interp(t, tt, q[:, i]) for i in pads], axis=1) / size
    columns = {f'q{i}^{k}': u[:, j] ** k for j, i in enumerate(pads) for k in POWERS}
    together = np.abs(like[:, pads]) > touch
    for a in range(len(pads)):
        for b in range(a + 1, len(pads)):
            if np.any(together[:, a] & together[:, b]):
                columns[f'q{pads[a]}q{pads[b]}'] = u[:, a] * u[:, b]
    if memory:
        for time in MEMORIES:
            past = memories(t, tt, q[:, pads] / size, time)
            columns |= {f'm{i}_{time}': past[:, j] for j, i in enumerate(pads)}
    return columns


def memories(t, tt, u, time):
    """Exponential memory of u (m, p), time m' + m = u, at t (n,); (n, p).

    Exact on a grid of 10 ms for u straight between grid points; begins in equilibrium.
    """
    steps = max(int(np.ceil((tt[-1] - tt[0]) / GRID)), 1)
    grid = np.linspace(tt[0], tt[-1], steps + 1)
    x = (grid[1] - grid[0]) / time
    decay = np.exp(-x)
    ahead = 1.0 + np.expm1(-x) / x
    behind = -decay - np.expm1(-x) / x
    out = np.empty((len(t), u.shape[1]))
    for j in range(u.shape[1]):
        even = np.interp(grid, tt, u[:, j])
        start = np.array([even[0] * (1.0 - ahead)])
        remembered = lfilter([ahead, behind], [1.0, -decay], even, zi=start)[0]
        out[:, j] = np.interp(t, grid, remembered)
    return out


def play(q, width, start=0.0):
    """What lost motion `width` [m] makes of q (n,) [m]: y = min(max(y-, q - (1 - a) w), q + a w).

    start : a, share of the width that is taken up where q begins, y = q: 0 after a retraction, 1
        after a push. The play operator: Visintin 1994, Differential Models of Hysteresis.
    """
    width = float(width)
    return _play(np.ascontiguousarray(q, dtype=float), (1.0 - start) * width, start * width)


@njit(cache=True)
def _play(q, behind, ahead):
    out, y = np.empty_like(q), q[0]
    for i in range(len(q)):
        y = min(max(y, q[i] - behind), q[i] + ahead)
        out[i] = y
    return out


def slope(t, tt, q, reach):
    """Velocity (n,) [m/s] of q (m,) at t (n,), a central difference over +-`reach` [s]."""
    return (np.interp(t + reach, tt, q) - np.interp(t - reach, tt, q)) / (2.0 * reach)


def drift_columns(t):
    """Columns name -> (n,): a parabola in time, for what warms up, creeps or dries."""
    u = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
    return {'time': u, 'time^2': u ** 2}
