"""The screen of all candidate terms: shared out between forks it is that of one process."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.forked import cores
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.selection import screening
from arm_brachy.diagnosis.selection.screening import try_all
from arm_brachy.registry import by_name

NAMES = ('stiffness_gradient', 'base_debond', 'pad_slip', 'external_force', 'actuator_gain',
         'damping')
TERMS = tuple(map(by_name, NAMES))
pytestmark = pytest.mark.skipif(cores() == 1, reason='one core, nothing is shared out')


@pytest.fixture
def screen(linear, encoder):
    """Function from a number of jobs to (Tried, the baseline it was tried at, what was told)."""
    def tried(jobs, thin=lambda options: options[:3]):
        baseline = Baseline(ForwardModel(linear), encoder, np.array([0.5, 1.4, 3.4, 6.5, 8.0]))
        told = []
        found = try_all([SimpleNamespace(baseline=baseline)], thin=thin, terms=TERMS, jobs=jobs,
                        progress=lambda *so_far: told.append(so_far))
        return found, baseline, told
    return tried


def test_two_processes_try_the_same_with_the_same_bits(screen):
    """And leave the same at the baseline, which a full fit takes over."""
    (one, here, _), (two, there, _) = screen(1), screen(2)
    assert len(one.hypotheses) > 8 and one.hypotheses == two.hypotheses
    assert one.left_out == two.left_out and set(one.left_out) == {'external_force', 'damping'}
    for hypothesis, (a,), (b,) in zip(two.hypotheses, one.responses, two.responses, strict=True):
        assert b.hypothesis is hypothesis and (a.scale, a.exact) == (b.scale, b.exact)
        assert {kind: (v.tobytes(), v.strides) for kind, v in a.values.items()} == {
            kind: (v.tobytes(), v.strides) for kind, v in b.values.items()}
    assert here.restructures == there.restructures and len(here.restructures) > 1
    assert here.condensed is not None and there.condensed is not None


def test_what_is_done_is_told_by_one_process_and_by_two(screen):
    (_, _, one), (_, _, two) = screen(1), screen(2)
    total = len(one)
    assert [(done, of) for done, of, _ in one] == [(i, total) for i in range(total)]
    counts = [done for done, _, _ in two]
    assert counts[0] == 0 and counts[-1] == total and counts == sorted(counts)
    assert {of for _, of, _ in two} == {total} and len(set(counts)) > 3


@pytest.mark.parametrize('jobs', [1, 2])
def test_a_place_without_a_state_is_left_out_and_a_bug_arrives(screen, monkeypatch, jobs):
    def without_state(baseline, one):
        raise NotConverged(f'{one.name} has no state')

    monkeypatch.setattr(screening, 'respond', without_state)
    assert screen(jobs)[0].left_out['pad_slip'] == 'pad_slip has no state'

    def wrong(baseline, one):
        raise ZeroDivisionError(f'in {one.name}')

    monkeypatch.setattr(screening, 'respond', wrong)
    with pytest.raises(ZeroDivisionError, match='in stiffness_gradient'):
        screen(jobs)
