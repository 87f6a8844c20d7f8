"""Free vibration of a marker: frequency, damping ratio, amplitude, where it settles."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

PADDING = 16        # zero padding of the spectrum that starts the fit
LOWEST_PERIODS = 2  # fewer in the record and a frequency cannot be told from a drift


@dataclass(frozen=True)
class Ringing:
    """x(t) = offset + direction A exp(-zeta w t) cos(w t + phase), w = 2 pi f, t from the start.

    frequency : f [Hz];  damping : zeta;  amplitude : A [m];  offset : (3,) [m]
    explained : share of the variance along `direction` that this one mode explains
    """

    frequency: float
    damping: float
    amplitude: float
    offset: np.ndarray
    explained: float


UNKNOWN = Ringing(np.nan, np.nan, np.nan, np.full(3, np.nan), np.nan)


def ringing(t, x):
    """Fit one decaying mode to a marker's motion along its direction of largest variance.

    t : (n,) [s], evenly sampled;  x : (n, 3) [m]; NaN rows are skipped
    Returns Ringing; UNKNOWN with fewer than 16 samples or no motion. Amplitude and phase are
    linear in the model, so that only frequency and damping are searched for, from the peak of the
    spectrum. Valid for one dominant mode: see `explained`.
    Test: evaluation/test_ringing.py
    """
    seen = np.isfinite(x).all(axis=1)
    t, x = np.asarray(t)[seen], np.asarray(x)[seen]
    centre = x.mean(axis=0) if len(x) else np.zeros(3)
    if len(t) < 16 or not np.ptp(x, axis=0).any():
        return UNKNOWN
    direction = np.linalg.svd(x - centre, full_matrices=False)[2][0]
    s, t = (x - centre) @ direction, t - t[0]
    start = _spectral_peak(t, s)
    fit = least_squares(lambda p: _misfit(t, s, *p)[0], [start, 0.02],
                        bounds=([0.3 * start, -0.5], [3.0 * start, 0.9]), x_scale=[start, 0.02])
    left, (a, b, c) = _misfit(t, s, *fit.x)
    explained = 1.0 - np.sum(left ** 2) / np.sum((s - s.mean()) ** 2)
    return Ringing(float(fit.x[0]), float(fit.x[1]), float(np.hypot(a, b)),
                   centre + c * direction, float(explained))


def _spectral_peak(t, s):
    step = (t[-1] - t[0]) / (len(t) - 1)
    size = PADDING * len(s)
    power = np.abs(np.fft.rfft((s - s.mean()) * np.hanning(len(s)), size))
    frequency = np.fft.rfftfreq(size, step)
    power[frequency < LOWEST_PERIODS / (t[-1] - t[0])] = 0.0
    return float(frequency[power.argmax()])


def _misfit(t, s, frequency, damping):
    """What is left of s, and the linear coefficients (cosine, sine, constant)."""
    w = 2.0 * np.pi * frequency
    decay = np.exp(-damping * w * t)
    basis = np.stack([decay * np.cos(w * t), decay * np.sin(w * t), np.ones_like(t)], axis=1)
    coefficients = np.linalg.lstsq(basis, s, rcond=None)[0]
    return basis @ coefficients - s, coefficients
