"""Claims that what was held out gainsays are taken back; those that it bears out are not."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis import standing as door
from arm_brachy.diagnosis.adequacy import Scan
from arm_brachy.diagnosis.decide import Candidate, Decision
from arm_brachy.diagnosis.judgement import Judgement
from arm_brachy.diagnosis.statements import StreamFit

ROWS = 4000


def judged(held_out):
    one = Candidate((SimpleNamespace(cause='inclusion'),), held_out, held_out, np.ones(1),
                    np.ones(1), (0.0,))
    before = Scan(np.zeros(1), 0, 1e-9)
    decision = Decision('named', one, (), (one,), Scan(np.zeros(1), 0, 0.5), before)
    fits = SimpleNamespace(of=lambda candidate: SimpleNamespace(refit='settled'))
    assembly = SimpleNamespace(problem=SimpleNamespace(r=np.zeros(ROWS)))
    return Judgement(assembly, fits, decision, (), None, ('before',))


@pytest.fixture
def errors(monkeypatch):
    """Function that sets (optical, force) errors with what was found; without 0.02 mm, 0.03 N."""
    def given(optical, force):
        monkeypatch.setattr(door, 'errors_of', lambda *_, **__: (
            StreamFit('optical', 8e-5, 2e-5, 1.8e-5, optical),
            StreamFit('force', 0.05, 0.03, 0.008, force)))
    return given


@pytest.mark.parametrize(('optical', 'force'), [(2.1e-5, 0.05), (2.0e-5, 0.026)])
def test_what_predicts_no_stream_far_better_is_not_claimed(errors, optical, force):
    errors(optical, force)
    found = door.standing(judged(300.0), 1.0)
    assert found.decision.verdict == 'unexplained' and found.decision.accepted is None
    assert found.decision.nearest.causes == ('inclusion',)
    assert found.notes[0] == 'before' and 'Inclusion' in found.notes[1]


@pytest.mark.parametrize(('held_out', 'optical', 'force'), [
    (300.0, 1.85e-5, 0.05), (300.0, 2.1e-5, 0.02), (30.0, 2.1e-5, 0.05)])
def test_what_predicts_one_better_or_gains_too_little_to_see_stands(errors, held_out, optical,
                                                                    force):
    errors(optical, force)
    one = judged(held_out)
    assert door.standing(one, 1.0) is one
