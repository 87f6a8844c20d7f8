"""Five simple ways to answer, on the same cases and the same whitened residual as the diagnosis.

All get what the detector has after its model: the residual r, what may be in it anyway U, and the
response of every term at every place (`judge.Problem`). Three name causes; recalibration alone
and a Gaussian process name nothing.
- recalibrate only: nothing is missing, whatever is left.
- Gaussian process: as above; what is left is learnt as a function of pad travel (Rasmussen &
  Williams 2006, ch. 2) and only predicts.
- LASSO on sensitivities: min |r - X b|^2 / 2 + w |b|_1, w = sqrt(2 log p) for columns of length 1
  (Donoho & Johnstone 1994, Biometrika 81:425); names the cause that carries most.
- nearest cosine: the response at the smallest angle to r, if r is longer than noise is.
- always blame the modulus.
Test: prove/test_baselines.py
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.stats import chi2

from arm_brachy.experiments.diagnosis_score import RECALIBRATED

ALARM = 0.01                    # chance of a null to be found longer than noise
SWEEPS, SETTLED = 400, 1e-6     # of coordinate descent; largest change at the end, in noise
LENGTHS = np.geomspace(0.1, 4.0, 12)    # of the kernel, in the travels' standard deviations
RATIOS = np.geomspace(0.1, 100.0, 10)   # signal over noise of the kernel


def answers(problem):
    """Name of the baseline -> cause that it names, '' for none."""
    r, columns, causes = projected(problem)
    noisy = r @ r > chi2.ppf(1.0 - ALARM, len(r))
    return {'recalibrate only': '', 'Gaussian process': '',
            'LASSO': lasso_cause(r, columns, causes),
            'nearest cosine': nearest(r, problem, columns, causes) if noisy else '',
            'always the modulus': RECALIBRATED}


def projected(problem):
    """Residual (n,) and columns (n, p) whitened by C = I + U U^T, and the cause of each column.

    By C^(-1/2) = I - V (1 - 1 / sqrt(1 + s^2)) V^T, U = V s W^T.
    """
    left, size, _ = np.linalg.svd(problem.U, full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + size**2)
    columns = np.hstack([e.columns for e in problem.explanations])
    causes = [(i, e.cause) for i, e in enumerate(problem.explanations)
              for _ in range(e.columns.shape[1])]

    def white(a):
        return a - left @ (shrink * (left.T @ a).T).T

    return white(problem.r), white(columns), causes


def lasso_cause(r, columns, causes):
    """The cause whose columns carry most of a LASSO fit; '' if the fit is empty."""
    length = np.linalg.norm(columns, axis=0)
    seen = length > 1e-9
    if not seen.any():
        return ''
    found = np.zeros(len(length))
    found[seen] = lasso(columns[:, seen] / length[seen], r, np.sqrt(2.0 * np.log(seen.sum() + 1)))
    carried = {}
    for (_, cause), size in zip(causes, np.abs(found), strict=True):
        carried[cause] = carried.get(cause, 0.0) + size
    best = max(carried, key=carried.get)
    return best if carried[best] > 0.0 else ''


def lasso(X, r, weight):
    """Coefficients (p,) that minimise |r - X b|^2 / 2 + weight |b|_1, columns of length 1.

    Coordinate descent on the Gram matrix (Friedman et al. 2010, J Stat Softw 33(1)), to SETTLED or
    SWEEPS: a fit that has not settled is a baseline still, its largest coefficients have.
    """
    gram, b = X.T @ X, np.zeros(X.shape[1])
    gradient = X.T @ r
    for _ in range(SWEEPS):
        largest = 0.0
        for j in range(len(b)):
            pull = gradient[j] + b[j]
            new = np.sign(pull) * max(abs(pull) - weight, 0.0)
            if new != b[j]:
                gradient -= (new - b[j]) * gram[j]
                largest, b[j] = max(largest, abs(new - b[j])), new
        if largest < SETTLED:
            break
    return b


def nearest(r, problem, columns, causes):
    """The cause of the explanation whose span is nearest to r in angle."""
    number = np.array([i for i, _ in causes])
    best, cause = -1.0, ''
    for i, explanation in enumerate(problem.explanations):
        basis, sizes, _ = np.linalg.svd(columns[:, number == i], full_matrices=False)
        basis = basis[:, sizes > 1e-9 * max(sizes.max(initial=0.0), 1e-300)]
        cosine = np.linalg.norm(basis.T @ r)
        if cosine > best:
            best, cause = cosine, explanation.cause
    return cause


def gaussian_process(q, values, new):
    """Predict values at new travels (m, p) from travels q (n, p) and values (n, c); (m, c).

    One squared-exponential kernel for all channels, each of variance 1; length and ratio to the
    noise by the largest marginal likelihood on a grid.
    """
    spread = np.maximum(q.std(axis=0), 1e-9)
    size = np.maximum(values.std(axis=0), 1e-300)
    distance = _squares(q / spread, q / spread)
    best, chosen = -np.inf, None
    for length in LENGTHS:
        for ratio in RATIOS:
            kernel = np.exp(-0.5 * distance / length**2) + np.eye(len(q)) / ratio
            factor = cholesky(kernel, lower=True)
            seen = solve_triangular(factor, values / size, lower=True)
            power = np.mean(seen**2)    # the kernel's variance, at its likeliest
            likely = -np.log(np.diag(factor)).sum() - 0.5 * len(q) * np.log(max(power, 1e-300))
            if likely > best:
                best, chosen = likely, (length, kernel)
    length, kernel = chosen
    weights = cho_solve(cho_factor(kernel, lower=True), values / size)
    return size * (np.exp(-0.5 * _squares(new / spread, q / spread) / length**2) @ weights)


def _squares(a, b):
    return ((a[:, None] - b[None])**2).sum(axis=2)
