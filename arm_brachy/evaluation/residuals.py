"""What a model leaves unexplained of a recording, per marker and regime, against noise."""

from dataclasses import dataclass

import numpy as np

# Gaussian: standard deviation = 1.4826 times the median absolute deviation
MAD_TO_SD = 1.4826


@dataclass(frozen=True)
class MarkerResidual:
    """Residual r = measured - predicted of one marker over one interval.

    rms : [m] sqrt(mean of |r|^2);  largest : [m] max of |r|
    bias : (3,) [m] mean of r;  seen : share of the frames in which the marker was seen
    """

    marker: str
    regime: str
    rms: float
    largest: float
    bias: np.ndarray
    seen: float


def residual(measured, predicted):
    """r = measured - predicted, (n, k, 3) [m]; NaN where the marker was not seen."""
    return np.asarray(measured, dtype=float) - np.asarray(predicted, dtype=float)


def marker_residual(r, marker, regime='all'):
    """Statistics of one marker's residual r (n, 3) [m]; frames with NaN are skipped."""
    seen = np.isfinite(r).all(axis=1)
    if not seen.any():
        return MarkerResidual(marker, regime, np.nan, np.nan, np.full(3, np.nan), 0.0)
    size = np.linalg.norm(r[seen], axis=1)
    return MarkerResidual(marker, regime, float(np.sqrt(np.mean(size ** 2))), float(size.max()),
                          r[seen].mean(axis=0), float(seen.mean()))


def marker_residuals(data):
    """MarkerResidual of every marker, over everything and over each regime of `data`.

    data : timeseries.ResidualData;  Returns a tuple, markers within regimes, 'all' first.
    """
    r = residual(data.measured, data.predicted)
    whole = [('all', np.ones(len(data.t), dtype=bool))]
    parts = [(g.name, (data.t >= g.t_start) & (data.t <= g.t_end)) for g in data.regimes]
    return tuple(marker_residual(r[keep, k], marker, name)
                 for name, keep in whole + parts for k, marker in enumerate(data.names))


def pooled_rms(r):
    """Rms of |r| over all frames and markers of r (n, k, 3) [m]; NaN if nothing was seen."""
    squared = np.sum(np.asarray(r) ** 2, axis=2)
    seen = np.isfinite(squared)
    return float(np.sqrt(squared[seen].mean())) if seen.any() else np.nan


def noise_floor(measured):
    """Measurement noise per marker from the recording itself: rms norm (k,) [m].

    measured : (n, k, 3) [m], evenly sampled
    White noise of standard deviation s gives second differences of standard deviation sqrt(6) s;
    smooth motion gives almost none. The median makes it robust against the moments when it does.
    Valid where acceleration * dt^2 << s; correlated noise (drift, bias) is not in it.
    """
    second = np.diff(np.asarray(measured, dtype=float), n=2, axis=0)
    floor = np.full(second.shape[1], np.nan)
    for k in range(second.shape[1]):
        clean = second[np.isfinite(second[:, k]).all(axis=1), k]
        if len(clean):
            sd = MAD_TO_SD * np.median(np.abs(clean), axis=0) / np.sqrt(6.0)
            floor[k] = np.linalg.norm(sd)
    return floor
