"""How evenly a stream was sampled and how much of it is missing."""

import numpy as np


def sampling(t_ns, missing):
    """Summarise a stream.

    t_ns : (n,) increasing times [ns];  missing : (n, k) true where item k has no value
    Returns a dict: rows, rate_Hz (of the median period), jitter_ms (standard deviation of the
    steps that are no gaps), longest_step_ms, lost_rows (by the median period), missing_values,
    longest_gap_s (of any item, from its last value to its next; runs that touch an end count from
    the end).
    """
    steps = np.diff(t_ns) * 1e-9
    if not len(steps):
        return {'rows': len(t_ns), 'rate_Hz': 0.0, 'jitter_ms': 0.0, 'longest_step_ms': 0.0,
                'lost_rows': 0, 'missing_values': int(missing.sum()), 'longest_gap_s': 0.0}
    period = float(np.median(steps))
    regular = steps[steps < 1.5 * period]
    return {
        'rows': len(t_ns),
        'rate_Hz': round(1.0 / period, 6),
        'jitter_ms': round(float(regular.std()) * 1e3, 6),
        'longest_step_ms': round(float(steps.max()) * 1e3, 6),
        'lost_rows': int(np.maximum(0, np.rint(steps / period) - 1).sum()),
        'missing_values': int(missing.sum()),
        'longest_gap_s': round(max((_longest_gap(t_ns * 1e-9, m) for m in missing.T),
                                   default=0.0), 6),
    }


def _longest_gap(t, missing):
    if not missing.any():
        return 0.0
    present = t[~missing]
    return float(np.diff(np.concatenate([t[:1], present, t[-1:]])).max())
