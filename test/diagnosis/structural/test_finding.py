"""How sure a finding is: of few degrees of freedom, of its own size, beside prior odds."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from arm_brachy.diagnosis.results.finding import (
    ALARM,
    CERTAIN,
    log_tail,
    probability,
    sigma,
    sigma_of_tail,
    threshold,
)
from arm_brachy.diagnosis.settings import FindingRules


def sigma_of_few(value, sd, dof, slack=0.0):
    return sigma_of_tail(log_tail(value, sd, dof, slack), np.size(value))


@pytest.mark.parametrize('dof', [3, 8])
def test_estimates_whose_error_is_estimated_alarm_as_often_as_is_said(dof):
    """2000 drifts of nothing, by their scatter: as a chi^2 they alarm far more often."""
    rng = np.random.default_rng(dof)
    drift = rng.standard_normal((2000, 3))
    sd = np.sqrt(rng.chisquare(dof, (2000, 1)) / dof) * np.ones(3)
    limit = np.sqrt(chi2.isf(0.05, 3))
    few = np.mean([sigma_of_few(*one, dof) > limit for one in zip(drift, sd, strict=True)])
    plain = np.mean([sigma(*one) > limit for one in zip(drift, sd, strict=True)])
    assert few == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / 2000))
    assert plain > 0.1


def test_what_is_known_well_is_taken_as_known():
    assert sigma_of_few([3.0, 1.0], [1.0, 1.0], 10**6) == pytest.approx(np.sqrt(10.0), rel=1e-4)
    # the slack of a calibration, a hundred times the error, is known
    assert sigma_of_few(5.0, 0.01, 3, slack=1.0) == pytest.approx(sigma(5.0, 0.01, 1.0), rel=1e-4)
    assert sigma_of_few(1e9, 1.0, 1000) == CERTAIN


def test_probability_is_that_of_the_bound():
    """p = 0.001 says at most 20 to 1 in favour of a fault, before any prior odds."""
    even = FindingRules(prior=1.0)
    for p in (0.05, 0.01, 0.001):
        odds = 1.0 / (-np.e * p * np.log(p))
        z = norm.isf(p / 2.0)
        assert probability(z, rules=even) == pytest.approx(odds / (1.0 + odds), rel=1e-6)
    assert probability(norm.isf(0.0005), rules=even) == pytest.approx(0.982, abs=1e-3)
    assert probability(0.1) == 0.0
    assert probability(60.0) == pytest.approx(1.0)


def test_more_components_say_less():
    assert probability(5.0, 3) < probability(5.0, 1)
    z = np.linspace(2.0, 12.0, 30)
    assert (np.diff([probability(one) for one in z]) >= 0.0).all()


def test_a_threshold_alone_is_no_claim():
    """One of three clocks may be told from 3.6 sd; a cause it is from where chance is out."""
    faint = probability(threshold(3))
    assert faint < FindingRules().told < probability(6.0)
    assert ALARM / 3 == pytest.approx(2.0 * norm.sf(threshold(3)))
