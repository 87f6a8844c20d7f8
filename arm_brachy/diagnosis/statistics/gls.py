"""Linear regression on time series with coloured noise, with errors that survive a wrong model."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solve_triangular, toeplitz
from scipy.signal import lfilter

BLOCK = 1.0         # s: errors further apart than this count as independent
FEWEST_BLOCKS = 3   # per parameter, for standard errors from blocks
FORGOTTEN = 7.0     # time constants of the whitening filter
ALMOST = 1e-10      # of the largest singular value: below, columns are linearly dependent


@dataclass(frozen=True)
class Fit:
    """Least-squares estimate of the coefficients of p columns.

    names : p;  value, sd : (p, c), c series fitted on the same columns
    covariance : (p, p) for series of unit noise;  chi2 : (c,);  dof : int, of one series
    residual : (n, c) y - X value, NaN where not valid
    """

    names: tuple
    value: np.ndarray
    sd: np.ndarray
    covariance: np.ndarray
    chi2: np.ndarray
    dof: int
    residual: np.ndarray

    def of(self, name):
        """(value, sd) of one column, floats if there is one series."""
        i = self.names.index(name)
        if self.value.shape[1] == 1:
            return float(self.value[i, 0]), float(self.sd[i, 0])
        return self.value[i], self.sd[i]

    def correlation(self, first, second):
        """Correlation of two estimates, from the columns alone."""
        i, j = self.names.index(first), self.names.index(second)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i]
                                                     * self.covariance[j, j]))


def bridged(t, y, valid, columns, colour):
    """y (n, c) with rows that are not valid filled in, for filters that need a value everywhere.

    Filled with what ordinary least squares on the columns (n, p) explains, plus a straight line
    between what it leaves on either side: a gap during a motion then leaves no step behind. Each
    side is a mean as long as the whitening filter of `noise_process` remembers: one sample alone
    would lend its noise to the whole gap, and what comes after would stand out from it. What
    drifts without a column for it is met as late as that. Some row has to be valid.
    """
    if np.all(valid):
        return np.array(y, dtype=float)
    size = np.abs(columns).max(axis=0)
    X = columns / np.where(size > 0.0, size, 1.0)
    beta = np.linalg.lstsq(X[valid], y[valid], rcond=1e-8)[0]
    gap, rows = np.flatnonzero(~valid), np.flatnonzero(valid)
    after = np.searchsorted(rows, gap)
    before, after = rows[np.maximum(after - 1, 0)], rows[np.minimum(after, len(rows) - 1)]
    _, m = colour.innovation(float(np.median(np.diff(t))))
    left = np.where(valid[:, None], y - X @ beta, 0.0)
    past, ahead = _recent(left, valid, m)[before], _recent(left[::-1], valid[::-1], m)[::-1][after]
    apart = t[after] - t[before]
    share = np.clip((t[gap] - t[before]) / np.where(apart > 0.0, apart, 1.0), 0.0, 1.0)[:, None]
    first, last = (gap < rows[0])[:, None], (gap > rows[-1])[:, None]
    share = np.where(first, 1.0, np.where(last, 0.0, share))
    out = np.array(y, dtype=float)
    out[gap] = (1.0 - share) * past + share * ahead + X[gap] @ beta
    return out


def _recent(left, valid, m):
    """(n, c) means of the valid rows up to each, every older one a factor m less in weight."""
    weight = lfilter([1.0], [1.0, -m], valid.astype(float))
    return lfilter([1.0], [1.0, -m], left, axis=0) / np.maximum(weight, 1e-300)[:, None]


def whitened(t, columns, colour, valid):
    """Columns (n, k) through the whitening filter of `noise_process`; rows not valid are zero.

    The filter takes what was before the first row as known; the first rows are therefore whitened
    with their covariance matrix, until the filter has forgotten its start.
    """
    period = float(np.median(np.diff(t)))
    out = colour.whiten(period, columns)
    _, m = colour.innovation(period)
    if colour.share > 0.0:
        n = min(len(t), 1 + int(np.ceil(FORGOTTEN / max(-np.log(max(m, 1e-300)), 1e-2))))
        out[:n] = solve_triangular(_root(colour, period, n), columns[:n], lower=True)
    return np.where(valid[:, None], out, 0.0)


@lru_cache(maxsize=24)      # the guesses of `reml`, of 4 MB at most; a series is whitened again
def _root(colour, period, n):
    """Cholesky factor (n, n) of the correlation of n samples; read only."""
    lag = period * np.arange(n)
    root = np.linalg.cholesky(toeplitz(np.concatenate([[1.0], colour.correlation(lag[1:])])))
    root.flags.writeable = False
    return root


def regress(t, y, columns, valid, colour, sd):
    """Generalised least squares of y on named columns.

    t : (n,) [s];  y : (n, c);  columns : name -> (n,);  valid : (n,) rows that count
    colour : noise_process.Colour of the noise;  sd : (c,) its standard deviation
    Standard errors are the larger of what the noise alone gives, scaled up where chi^2 exceeds its
    expectation, and of the block estimate over pieces of 1 s, which also sees errors of the model
    that last (Newey & West 1987, Econometrica 55:703, with disjoint blocks).
    Linearly dependent columns share their effect with least norm and get infinite errors.
    Returns Fit.
    """
    names = tuple(columns)
    X = np.stack([columns[name] for name in names], axis=1)
    size = np.abs(X).max(axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    W = whitened(t, X / scale, colour, valid)
    Y = whitened(t, bridged(t, y, valid, X, colour), colour, valid) / sd
    U, s, Vt = np.linalg.svd(W, full_matrices=False)
    kept = s > ALMOST * s[0]
    inverse = Vt[kept].T / s[kept]
    beta = inverse @ (U[:, kept].T @ Y)
    left = Y - W @ beta
    dof = max(int(valid.sum()) - int(kept.sum()), 1)
    chi2 = np.sum(left ** 2, axis=0)
    covariance = inverse @ inverse.T
    error = np.sqrt(np.maximum(chi2 / dof, 1.0)) * np.sqrt(np.diag(covariance))[:, None]
    error = np.maximum(error, _block_errors(t, W, left, covariance))
    loose = np.abs(Vt[~kept]).max(axis=0, initial=0.0) > 1e-6
    error[loose] = np.inf
    residual = np.where(valid[:, None], y - X @ (beta / scale[:, None] * sd), np.nan)
    return Fit(names, beta / scale[:, None] * sd, error / scale[:, None] * sd,
               covariance / np.outer(scale, scale), chi2, dof, residual)


def _block_errors(t, W, left, covariance):
    """(p, c) standard errors from sums of scores over blocks; 0 where there are too few."""
    block = ((t - t[0]) / BLOCK).astype(int)
    first = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1])
    if len(first) < FEWEST_BLOCKS * W.shape[1]:
        return np.zeros((W.shape[1], left.shape[1]))
    out = np.empty((W.shape[1], left.shape[1]))
    for c in range(left.shape[1]):
        scores = np.add.reduceat(W * left[:, c:c + 1], first, axis=0) @ covariance
        out[:, c] = np.sqrt(np.sum(scores ** 2, axis=0))
    return out
