"""Sampling figures of streams made by hand."""

import numpy as np
import pytest

from arm_brachy.recording.sampling import sampling


def test_lost_rows_and_gaps():
    t = np.array([0, 10, 20, 50, 60, 70]) * 10**6  # two samples lost between 20 and 50 ms
    missing = np.array([[0, 1, 1, 0, 0, 0], [0, 0, 0, 0, 1, 1]], dtype=bool).T
    out = sampling(t, missing)
    assert (out['rows'], out['rate_Hz'], out['lost_rows']) == (6, 100.0, 2)
    assert out['missing_values'] == 4
    assert out['longest_step_ms'] == pytest.approx(30.0)
    assert out['longest_gap_s'] == pytest.approx(0.05)  # from 0 to 50 ms


def test_jitter_is_that_put_in():
    rng = np.random.default_rng(0)
    steps = 10e6 + rng.uniform(-1e6, 1e6, 5000)
    out = sampling(np.cumsum(steps).astype(np.int64), np.zeros((5000, 1), dtype=bool))
    assert out['jitter_ms'] == pytest.approx(1.0 / np.sqrt(3.0), rel=0.03)


def test_a_single_row_has_no_rate():
    assert sampling(np.array([5]), np.array([[False]]))['rate_Hz'] == 0.0
