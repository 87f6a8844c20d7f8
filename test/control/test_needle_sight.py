"""Why a needle waits: the text names what it waits for, how it is, and what is allowed."""

import numpy as np
import pytest

from arm_brachy.control.needle_sight import probe_fault, target_fault
from arm_brachy.control.procedure_steps import ProbeSeen
from arm_brachy.core.outcome import Outcome


@pytest.mark.parametrize(('probe', 'said'), [
    (ProbeSeen(in_contact=False), 'probe/state: the probe has lost the skin; must be in contact'),
    (ProbeSeen(in_contact=True), 'probe/state: the tip is nan m from the image plane; must be a'),
    (ProbeSeen(in_contact=True, out_of_plane=3.4e-3),
     'probe/state: the tip is 3.4 mm ahead of the image plane; must be at most 2 mm')])
def test_faults_of_the_probe_are_told_apart_by_their_text(probe, said):
    outcome, text = probe_fault(probe, 2e-3)
    assert outcome is Outcome.STALE_INPUT and text.startswith(said)


def test_a_target_that_nothing_shows_is_told_with_the_age_of_either():
    outcome, text = target_fault(False, 1.24, np.inf, 0.5)
    assert outcome is Outcome.STALE_INPUT
    assert 'the last estimate is 1.2 s old, no image of it (ultrasound/target) came' in text
    assert 'must be at most 0.5 s old' in text
    assert target_fault(True, np.inf, 0.1, 0.5) is None
