"""Estimates beside the truth: known errors give known numbers, and the page shows them."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.evaluation import assess, estimate_figures, estimates, report
from arm_brachy.evaluation.timeseries import TargetEstimates

SD = np.array([0.2e-3, 0.1e-3, 0.4e-3])
OFFSET = np.array([0.3e-3, 0.0, 0.0])


def said(run, rng, offset=0.0, claimed=1.0, skip=()):
    """Ten estimates a second of 'target 1' with Gaussian errors; `claimed` scales the sd."""
    truth = run.truth['target 1']
    t = np.arange(0.0, truth.t[-1], 0.1)
    t = t[[not any(a < x < b for a, b in skip) for x in t]]
    points = estimates.true_at(truth, t) + SD * rng.standard_normal((len(t), 3)) + offset
    return TargetEstimates(t, points, np.tile(np.diag((claimed * SD)**2), (len(t), 1, 1)))


@pytest.fixture
def rng():
    return stream(3, 'estimates')


def numbers_of(run, estimate):
    found, = estimates.estimate_metrics(dataclasses.replace(
        run, estimates={'pod': {'target 1': estimate}}))
    return found


def test_a_covariance_that_is_right_holds_the_truth_in_95_per_cent(run, rng):
    found = numbers_of(run, said(run, rng))
    assert found.coverage == pytest.approx(0.95, abs=0.03)     # 420 estimates: 1 % sd
    assert found.rms == pytest.approx(np.linalg.norm(SD), rel=0.08)
    assert found.sd == pytest.approx(np.linalg.norm(SD) / np.sqrt(3.0))
    assert found.share == 1.0


def test_too_small_a_covariance_does_not(run, rng):
    """Half the sd: the 95 % ellipsoid becomes one of chi-square 7.81 / 4, which holds 42 %."""
    assert numbers_of(run, said(run, rng, claimed=0.5)).coverage == pytest.approx(0.42, abs=0.07)


def test_an_offset_is_found(run, rng):
    np.testing.assert_allclose(numbers_of(run, said(run, rng, OFFSET)).offset, OFFSET, atol=6e-5)


def test_a_gap_counts_as_not_available(run, rng):
    assert numbers_of(run, said(run, rng, skip=[(10.0, 20.5)])).share == pytest.approx(
        1.0 - 10.4 / 42.0, abs=0.01)


def test_without_truth_nothing_is_said(run, rng):
    bare = dataclasses.replace(run, truth={}, estimates={'pod': {'target 1': said(run, rng)}})
    assert estimates.estimate_metrics(bare) == ()


def test_the_report_shows_estimate_ellipse_and_truth(run, rng, tmp_path):
    heard = dataclasses.replace(run, em={}, feedback='pod', tissue=None, force=None, topics=(),
                                estimates={'pod': {'target 1': said(run, rng, skip=[(9, 12)])}})
    numbers = assess.assess(heard)
    assert numbers.goals.steady_state_error == 0.5e-3
    names = [plate.name for plate in report.plates(heard, numbers)]
    assert 'estimate_pod_target 1' in names
    page = report.write_report(heard, numbers, tmp_path / 'report.html').read_text()
    assert '<h2>Estimates</h2>' in page and 'without a sensor in the tissue' in page
    assert 'Median ITAE (EM)' not in page and 'EM measurement' not in page
    rows = [row for row in assess.estimates_to_result(heard, numbers).rows]
    assert rows[0]['coverage_percent'] == pytest.approx(100 * numbers.estimates[0].coverage)


def test_the_ellipses_are_those_of_the_covariance(run, rng):
    plate = estimate_figures.estimate(dataclasses.replace(
        run, estimates={'pod': {'target 1': said(run, rng)}}), 'pod', 'target 1')
    drawn = plate.figure.axes[-1].patches
    assert len(drawn) == estimate_figures.SHOWN
    # 95 % of a plane Gaussian lie within 2.448 sd
    assert sorted((drawn[0].width, drawn[0].height)) == pytest.approx(
        sorted(2 * 2.448 * SD[:2] * 1e3), rel=1e-3)
