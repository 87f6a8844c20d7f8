"""Evidence by full fits: what is linear gains none, and no start changes what it comes to."""

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.discrepancy import Accuracy
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.selection.full_fits import FullFits
from arm_brachy.diagnosis.selection.judge import Judge
from arm_brachy.diagnosis.selection.problem import assemble
from arm_brachy.diagnosis.selection.screening import Tried

LUMP = {'name': 'inclusion', 'centre_mm': (20.0, 10.0, 30.0), 'radius_mm': 12.0, 'ratio': 4.0}


def weighed(matched, hypothesis):
    """(evidence by its response, what a full fit gains over that) of a Hypothesis alone."""
    response = respond(matched.baseline, hypothesis)
    assembly = assemble([matched], Tried((hypothesis,), ((response,),)))
    one, = Judge(assembly.problem, np.random.default_rng(1)).singles()
    fits = FullFits(assembly, np.random.default_rng(2), Accuracy())
    return one.evidence, fits.gain(one).evidence


def beyond(matched, hypotheses, law):
    """(gain of the pair over the first alone, of the second in what the first leaves)."""
    tried = Tried(tuple(hypotheses), tuple((respond(matched.baseline, one),)
                                           for one in hypotheses))
    assembly = assemble([matched], tried)
    judge = Judge(assembly.problem, np.random.default_rng(1))
    first, = (one for one in judge.singles() if one.causes == (hypotheses[0].name,))
    pair, _ = judge._best_pair((first,))
    fits = FullFits(assembly, np.random.default_rng(2), Accuracy(law=law))
    return pair.evidence - first.evidence, fits.beyond(first, assembly.problem.explanations[1:])


def test_beside_a_law_without_errors_a_second_cause_is_worth_what_the_pair_gains(breast, once,
                                                                                 cause):
    """Both answer in proportion, so that nothing but the order of the sums differs."""
    matched = breast.watch(once, {'name': 'force_gain', 'gain': 0.08, 'pads': ['pad_1']}, {
        'name': 'optical_scale', 'scale': 0.01})
    gained, seen = beyond(matched, (cause('force_gain', pads=('pad_1',)),
                                    cause('optical_scale')), law=0.0)
    assert gained > 3.0
    assert seen == pytest.approx(gained, rel=1e-6)


def test_what_a_law_may_have_wrong_is_worth_nothing(breast, once, cause):
    """Tissue three times less compressible doubles the forces: 4 % of one are 4 % of its effect,
    which the law does not hold to; 25 % are another cause."""
    causes = cause('compressibility'), cause('force_gain', pads=('pad_2',))

    def seen(gain, law):
        return beyond(breast.watch(once, {'name': 'compressibility', 'factor': 3.0}, {
            'name': 'force_gain', 'gain': gain, 'pads': ['pad_2']}), causes, law)[1]
    assert seen(0.04, law=0.0) > 6.0 > 1.0 > seen(0.04, law=0.05)
    assert seen(0.25, law=0.05) > 6.0


def test_a_gain_of_a_sensor_is_linear_and_gains_nothing(breast, once, cause):
    matched = breast.watch(once, {'name': 'force_gain', 'gain': 0.08, 'pads': ['pad_1']})
    linear, more = weighed(matched, cause('force_gain', pads=('pad_1',)))
    assert linear > 3.0
    assert more == pytest.approx(0.0, abs=0.5)


def test_a_lump_comes_to_the_same_evidence_from_any_place_near(breast, once, cause):
    """By their responses places differ by far more than what decides between causes."""
    matched = breast.watch(once, LUMP)
    found = [weighed(matched, cause('inclusion', centre=centre, radius=0.012))
             for centre in ((0.02, 0.01, 0.03), (0.012, 0.018, 0.036))]
    responses, whole = [a for a, _ in found], [a + b for a, b in found]
    assert np.ptp(responses) > 5.0
    assert np.ptp(whole) < 0.5
