"""What a model leaves unexplained of a recording, per marker and regime, against noise."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.evaluation.regimes import inside

# Gaussian: standard deviation = 1.4826 times the median absolute deviation
MAD_TO_SD = 1.4826


@dataclass(frozen=True)
class MarkerResidual:
    """Residual r = measured - predicted of one marker over one interval.

    rms : [m] sqrt(mean of |r|^2);  largest : [m] max of |r|;  rms_axes : (3,) [m] per axis
    bias : (3,) [m] mean of r;  seen : share of the frames in which the marker was seen
    gain : measured over predicted motion, least squares over departures from either's mean; NaN
        where the prediction hardly moves. Below 1 the model moves too much.
    For the force on a pad read N for m.
    """

    marker: str
    regime: str
    rms: float
    largest: float
    bias: np.ndarray
    seen: float
    rms_axes: np.ndarray
    gain: float = np.nan


def residual(measured, predicted):
    """r = measured - predicted, (n, k, 3) [m]; NaN where the marker was not seen."""
    return np.asarray(measured, dtype=float) - np.asarray(predicted, dtype=float)


def marker_residual(r, marker, regime='all', gain=np.nan):
    """Statistics of one marker's residual r (n, 3) [m]; frames with NaN are skipped."""
    seen = np.isfinite(r).all(axis=1)
    if not seen.any():
        none = np.full(3, np.nan)
        return MarkerResidual(marker, regime, np.nan, np.nan, none, 0.0, none)
    squared = r[seen] ** 2
    size = np.sqrt(squared.sum(axis=1))
    return MarkerResidual(marker, regime, float(np.sqrt(np.mean(size ** 2))), float(size.max()),
                          r[seen].mean(axis=0), float(seen.mean()),
                          np.sqrt(squared.mean(axis=0)), gain)


def marker_residuals(data, floor=None):
    """MarkerResidual of every marker, over everything and over each regime of `data`.

    data : timeseries.ResidualData;  floor : (k,) noise; a gain is given only where the prediction
        moves by more than that (None = always)
    Returns a tuple, markers within regimes, 'all' first.
    """
    r = residual(data.measured, data.predicted)
    floor = np.zeros(len(data.names)) if floor is None else floor
    parts = {name: inside(data.t, data.regimes, (name,)) for name in
             dict.fromkeys(g.name for g in data.regimes)}
    whole = {'all': np.ones(len(data.t), dtype=bool)}
    return tuple(marker_residual(r[keep, k], marker, name, motion_gain(
        data.measured[keep, k], data.predicted[keep, k], floor[k]))
        for name, keep in (whole | parts).items() for k, marker in enumerate(data.names))


def motion_gain(measured, predicted, floor=0.0):
    """Least-squares factor from predicted to measured motion, each about its mean.

    measured, predicted : (n, 3);  Returns NaN if the prediction's rms motion is below `floor`.
    """
    seen = np.isfinite(measured).all(axis=1) & np.isfinite(predicted).all(axis=1)
    if not seen.any():
        return np.nan
    m = measured[seen] - measured[seen].mean(axis=0)
    p = predicted[seen] - predicted[seen].mean(axis=0)
    power = np.sum(p * p)
    if not power > len(p) * floor ** 2:
        return np.nan
    return float(np.sum(m * p) / power)


def pooled_rms(r):
    """Rms of |r| over all frames and markers of r (n, k, 3) [m]; NaN if nothing was seen."""
    squared = np.sum(np.asarray(r) ** 2, axis=2)
    seen = np.isfinite(squared)
    return float(np.sqrt(squared[seen].mean())) if seen.any() else np.nan


def noise_floor(measured, idle=None):
    """Measurement noise per marker from the recording itself: rms norm (k,) [m].

    measured : (n, k, 3) [m], evenly sampled;  idle : (n,) True where nothing moved, None = use all
    White noise of standard deviation s gives second differences of standard deviation sqrt(6) s;
    smooth motion gives almost none. The median makes it robust against the moments when it does.
    Valid where acceleration * dt^2 << s; correlated noise (drift, bias) is not in it.
    """
    measured = np.asarray(measured, dtype=float)
    if idle is not None:
        measured = np.where(idle[:, None, None], measured, np.nan)
    second = np.diff(measured, n=2, axis=0)
    floor = np.full(second.shape[1], np.nan)
    for k in range(second.shape[1]):
        clean = second[np.isfinite(second[:, k]).all(axis=1), k]
        if len(clean):
            sd = MAD_TO_SD * np.median(np.abs(clean), axis=0) / np.sqrt(6.0)
            floor[k] = np.linalg.norm(sd)
    return floor
