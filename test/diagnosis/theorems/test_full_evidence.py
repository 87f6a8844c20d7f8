"""Evidence by full fits: what is linear gains none, and no start changes what it comes to."""

import numpy as np
import pytest

from arm_brachy.diagnosis.assembly import assemble
from arm_brachy.diagnosis.decide import Judge
from arm_brachy.diagnosis.full_fits import FullFits
from arm_brachy.diagnosis.hypotheses import Tried
from arm_brachy.diagnosis.model_error import Accuracy
from arm_brachy.diagnosis.responses import respond

LUMP = {'name': 'inclusion', 'centre_mm': (20.0, 10.0, 30.0), 'radius_mm': 12.0, 'ratio': 4.0}


def weighed(matched, hypothesis):
    """(evidence by its response, what a full fit gains over that) of a Hypothesis alone."""
    response = respond(matched.baseline, hypothesis)
    assembly = assemble([matched], Tried((hypothesis,), ((response,),)))
    one, = Judge(assembly.problem, np.random.default_rng(1)).singles()
    fits = FullFits(assembly, np.random.default_rng(2), Accuracy())
    return one.evidence, fits.gain(one).evidence


def test_a_gain_of_a_sensor_is_linear_and_gains_nothing(breast, once, cause):
    matched = breast.watch(once, {'name': 'force_gain', 'gain': 0.08, 'pads': ['pad_1']})
    linear, more = weighed(matched, cause('force_gain', pads=('pad_1',)))
    assert linear > 3.0
    assert more == pytest.approx(0.0, abs=0.5)


def test_a_lump_comes_to_the_same_evidence_from_any_place_near(breast, once, cause):
    """By their responses places differ by far more than what decides between causes."""
    matched = breast.watch(once, LUMP)
    found = [weighed(matched, cause('inclusion', centre=centre, radius=0.012)) for centre in
             ((0.02, 0.01, 0.03), (0.012, 0.018, 0.036), (0.026, 0.002, 0.026))]
    responses, whole = [a for a, _ in found], [a + b for a, b in found]
    assert np.ptp(responses) > 5.0
    assert np.ptp(whole) < 0.5
