"""Full fits when they are asked for, and what of a cause is gone then."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.estimation.fit import options_for
from arm_brachy.diagnosis.estimation.laplace import Gain
from arm_brachy.diagnosis.estimation.parameters import HALF
from arm_brachy.diagnosis.results.cause import Estimate
from arm_brachy.diagnosis.selection import full_fits
from arm_brachy.diagnosis.selection.full_fits import AS_GOOD, FullFits

PLACE = (None, None, Estimate(8.0, 5.0, 11.0))


def numbers_of(causes, correlation):
    """A refit of these causes' numbers, each a coordinate; correlation of the first two."""
    charts, z, sd = [], [], []
    for number, cause in enumerate(causes):
        for i, (_, component, estimate) in enumerate(cause):
            charts.append(SimpleNamespace(number=number, field=f'number_{i}',
                                          step=np.array([0.02]), value=lambda z: z[0]))
            value, low, high = (v if component is None else v[component] for v in
                                (estimate.value, estimate.low, estimate.high))
            z.append(value)
            sd.append((high - low) / (2.0 * HALF))
    covariance = np.diag(np.square(sd))
    if correlation:
        covariance[0, 1] = covariance[1, 0] = correlation * sd[0] * sd[1]
    space = SimpleNamespace(charts=charts, slices=[slice(i, i + 1) for i in range(len(z))],
                            owner=np.array([chart.number for chart in charts]))
    return SimpleNamespace(space=space, z=np.array(z), covariance=covariance)


def gone(*causes, refit=True, correlation=0.0):
    """FullFits.gone where a fit found causes, a list of (neutral, component, Estimate) each.

    A number without a neutral value is a place.
    """
    found = SimpleNamespace(hypotheses=[], estimates=[],
                            refit=numbers_of(causes, correlation) if refit else None)
    for cause in causes:
        names = [f'number_{i}' for i in range(len(cause))]
        found.hypotheses.append(SimpleNamespace(strengths=[
            SimpleNamespace(name=name, neutral=neutral, component=component)
            for name, (neutral, component, _) in zip(names, cause, strict=True)
            if neutral is not None]))
        found.estimates.append({name: estimate for name, (*_, estimate) in
                                zip(names, cause, strict=True)})
    fits = FullFits(None, None)
    fits.of = lambda candidate: found
    return fits.gone(None)


@pytest.mark.parametrize(('low', 'high', 'expected'), [
    (-0.01, 0.05, True), (0.01, 0.05, False), (-0.05, -0.01, False), (-1e9, 1e9, True)])
def test_a_gain_whose_interval_holds_zero_is_gone(low, high, expected):
    assert gone([(0.0, None, Estimate(0.5 * (low + high), low, high))]) is expected


def test_a_modulus_ratio_is_nothing_at_one_and_a_gap_at_infinity():
    assert gone([(1.0, None, Estimate(1.1, 0.9, 1.3))])
    assert not gone([(1.0, None, Estimate(1.3, 1.1, 1.5))])
    assert gone([(np.inf, None, Estimate(0.05, 0.01, np.inf))])
    assert not gone([(np.inf, None, Estimate(0.05, 0.01, 0.2))])


def test_of_a_vector_the_component_counts():
    vector = Estimate((0.0, 2.0, 0.0), (-1.0, 1.0, -1.0), (1.0, 3.0, 1.0))
    assert gone([(0.0, 0, vector)]) and not gone([(0.0, 1, vector)])


def test_one_number_that_is_something_keeps_a_cause_and_any_cause_gone_undoes_all():
    nothing, something = ((0.0, None, Estimate(0.0, -1.0, 1.0)),
                          (0.0, None, Estimate(2.0, 1.0, 3.0)))
    assert not gone([nothing, something])
    assert gone([something], [nothing])


def test_numbers_of_which_each_may_be_nothing_are_something_where_their_sum_is():
    """Nine numbers of a field's distortion, each 0 +- 2 by itself, were worth 175 nats."""
    each = (0.0, None, Estimate(1.0, -0.5, 2.5))
    assert gone([each, each]) and gone([each, each], correlation=0.9)
    assert not gone([each, each], correlation=-0.95)


def test_a_lump_whose_size_makes_up_for_its_contrast_is_something_where_their_product_is():
    """1.97 (0.78 to 4.96) times as stiff and 5 to 14 mm wide: 7 standard deviations together."""
    ratio = (1.0, None, Estimate(2.0, 0.8, 3.2))
    assert gone([ratio]) and gone([ratio, PLACE], correlation=-0.5)
    assert not gone([ratio, PLACE], correlation=-0.95)


def test_what_could_not_be_fitted_in_full_is_not_gone():
    assert not gone([(0.0, None, Estimate(0.0, -1.0, 1.0))], refit=False)


@pytest.mark.parametrize(('gain', 'expected'), [
    (Gain(0.0, 0.5 * AS_GOOD), 'every state'), (Gain(0.0, 2.0 * AS_GOOD), 'states of the fit'),
    (None, 'every state')])
def test_what_a_response_says_as_well_is_asked_what_it_leaves_in_every_state(
        gain, expected):
    """A gap of 1.5 mm was passed off as a drift by the third of the states of its full fit."""
    fits = FullFits(None, None)
    fits.of, fits.gain = (lambda candidate: None), (lambda candidate: gain)
    fits._linear = lambda candidate: 'every state'
    fits._fitted = lambda candidate: 'states of the fit'
    assert fits.check(None) == expected


def test_a_fit_begins_where_that_in_other_noise_ended(monkeypatch):
    """Settled or not; what did not begin begins at its response again."""
    starts, ends = [], {}
    hypotheses = {'lump': object(), 'gap': object()}

    def fit_in_full(assembly, candidate, law, start):
        starts.append(start)
        return SimpleNamespace(refit=None, end=assembly.end if 'gap' not in (
            candidate.explanations) else None)

    monkeypatch.setattr('arm_brachy.diagnosis.selection.full_fits.fit_in_full', fit_in_full)
    for end in ('in quiet', 'in loud'):
        assembly = SimpleNamespace(end=end, hypothesis_of=lambda e: (hypotheses[e], None))
        fits = FullFits(assembly, None, ends=ends)
        for causes in (('lump',), ('lump', 'gap'), ('lump',)):
            fits.of(SimpleNamespace(explanations=causes, causes=causes))
    assert starts == [None, None, 'in quiet', None]


@pytest.mark.parametrize(('evidence', 'runs'), [(5.9, 30), (6.1, 60)])
def test_what_its_response_does_not_claim_is_soon_given_up(evidence, runs):
    assert options_for(SimpleNamespace(evidence=evidence)).runs == runs


@pytest.mark.parametrize(('gain', 'again'), [(-8.2, False), (-1.0, True)])
def test_what_was_worth_nothing_in_quieter_noise_is_not_fitted_again(monkeypatch, gain, again):
    """5.9 nats by its response, -2.3 by its fit; 3.6 in noise twice as loud, which is no more."""
    asked, hypothesis = [], object()
    assembly = SimpleNamespace(hypothesis_of=lambda explanation: (hypothesis, None))

    def fitted(assembly, candidate, found):
        asked.append(candidate.evidence)
        return Gain(gain, gain)

    monkeypatch.setattr(full_fits, 'gain_over_response', fitted)
    one = SimpleNamespace(explanations=(object(),), evidence=5.9, fit=11.8)
    loud = SimpleNamespace(explanations=(object(),), evidence=3.6, fit=9.0)
    quiet = FullFits(assembly, None)
    other = FullFits(assembly, None, quiet=quiet)
    quiet.of = other.of = lambda candidate: None
    worth = 5.9 + quiet.gain(one).evidence
    found = other.gain(loud)
    assert asked == [5.9, 3.6] if again else asked == [5.9]
    if not again:
        assert 3.6 + found.evidence == pytest.approx(worth)
        assert 9.0 + found.fit == pytest.approx(11.8 + gain)
