"""Colour of the noise in a series whose slow part is shared by regressors and noise.

Regressors that go slowly take slow noise with them: what a fit leaves shows less of it than there
is, and the less the shorter the series. The restricted likelihood is that of what no value of the
coefficients can change, so that it counts what they take (Patterson & Thompson 1971, Biometrika
58:545, Eq. 3 in terms of whitened columns).
"""

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize
from scipy.special import expit, logit

from arm_brachy.diagnosis.statistics.gls import ALMOST, bridged, whitened
from arm_brachy.diagnosis.statistics.noise_process import Colour

SHARES = 0.01, 0.1, 0.6     # of the variance that is slow: first guesses
TIMES = 6                   # memories that are guessed at
LEAST_SHARE, MOST_SHARE = 0.003, 0.98
SHORTEST, LONGEST = 4.0, 0.25   # memory: sampling periods; of the series
TRIES = 40                  # evaluations after the guesses
LOOSE = 0.1                 # of logarithms and of the log likelihood: errors are far larger


def restricted_colour(t, y, valid, columns, least):
    """(Colour, standard deviations (c,)) of the noise in y beside the columns.

    t : (n,) [s], even;  y : (n, c), series of one colour;  valid : (n,);  columns : (n, p)
    least : (c,) standard deviations that none is below, for series that never change
    White noise plus a first-order Markov part: a slow part of two times is told by one that lies
    between. What columns miss of y counts as noise. Memories beyond a quarter of the series are
    not told from a drift.
    Test: diagnosis/structural/test_restricted.py
    """
    X = _independent(columns, valid)
    period = float(np.median(np.diff(t)))
    span = np.log([SHORTEST * period, max(LONGEST * (t[-1] - t[0]), 2.0 * SHORTEST * period)])

    def cost(point):
        return _cost(t, y, valid, X, least,
                     Colour(float(expit(point[0])), float(np.exp(point[1]))))[0]

    guesses = [(logit(share), time) for share in SHARES for time in np.linspace(*span, TIMES)]
    best = minimize(cost, min(guesses, key=cost), method='Nelder-Mead',
                    bounds=[(logit(LEAST_SHARE), logit(MOST_SHARE)), span],
                    options={'maxfev': TRIES, 'xatol': LOOSE, 'fatol': LOOSE}).x
    colour = Colour(float(expit(best[0])), float(np.exp(best[1])))
    return colour, _cost(t, y, valid, X, least, colour)[1]


def _independent(columns, valid):
    """(n, q) columns of the same span that are orthonormal where valid."""
    X = columns / np.maximum(np.abs(columns).max(axis=0), 1e-300)
    _, s, Vt = np.linalg.svd(X[valid], full_matrices=False)
    kept = s > np.sqrt(ALMOST) * s[0]
    return X @ (Vt[kept].T / s[kept])


def _cost(t, y, valid, X, least, colour):
    """-log restricted likelihood, less a constant, at the likeliest standard deviations (c,)."""
    both = whitened(t, np.column_stack([X, bridged(t, y, valid, X, colour)]), colour, valid)
    W, Y = both[:, :X.shape[1]], both[:, X.shape[1]:]
    R = cholesky(W.T @ W)                # columns of X are orthonormal: no loss by squaring
    dof = max(int(valid.sum()) - X.shape[1], 1)
    taken = solve_triangular(R, W.T @ Y, trans='T')
    variance = (np.sum(Y ** 2, axis=0) - np.sum(taken ** 2, axis=0)) / dof
    tells = variance > least ** 2
    volume = (0.5 * colour.log_determinant(int(valid.sum()), float(np.median(np.diff(t))))
              + np.log(np.diag(R)).sum())
    cost = 0.5 * dof * np.log(variance[tells]).sum() + tells.sum() * volume
    return cost, np.sqrt(np.where(tells, variance, least ** 2))
