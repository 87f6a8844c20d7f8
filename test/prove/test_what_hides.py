"""Opened cases are drawn again as they were, and effects are looked at where they are."""

import sys

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.experiments.blind_trials import TRIALS, hidden_lines
from arm_brachy.prove import what_hides
from arm_brachy.prove.source import case_of

PATTERN = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])


def test_what_a_trial_opened_is_drawn_again_from_its_commit_and_beacon():
    """Without solving anything: bodies, kinds and numbers of the effects."""
    jobs, truths, rows = what_hides.opened(TRIALS[-1])
    assert set(jobs) == set(truths) == set(rows)
    for name, job in jobs.items():
        assert (job.kind, job.body) == (truths[name]['kind'], truths[name]['body'])
    some = [name for name in sorted(jobs) if truths[name]['effects']][:3]
    for name in some:
        drawn = case_of(jobs[name]).effects
        assert [one.name for one in drawn] == truths[name]['labels']
        assert [one.size for one in drawn] == pytest.approx(
            [one['size'] for one in truths[name]['effects']])


def test_an_effect_is_read_off_by_the_names_of_channels():
    t, states = np.arange(5.0), np.array([1.5, 3.0])
    values = t[:, None, None] * PATTERN
    found = what_hides.at_states(t, ('b', 'a'), values, ['a', 'b', 'c'], states)
    np.testing.assert_allclose(found[:, 1, :, 0], states[:, None] * PATTERN[0])
    assert not found[:, [0, 2]].any()


def test_cases_that_a_trial_does_not_have_are_refused_in_a_line(monkeypatch, capsys, tmp_path):
    with pytest.raises(InputError, match='no opened.json'):
        what_hides.opened('0000000')
    monkeypatch.setattr(sys, 'argv', ['what_hides', TRIALS[-1], 'case_999',
                                      '--folder', str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        what_hides.main()
    assert end.value.code == 2
    assert 'case_999: must be cases of' in capsys.readouterr().err


def test_the_table_has_a_line_a_case():
    row = {'case': 'case_001', 'planted': 'gravity', 'size': 0.5, 'oracle': 6.0, 'at_states': 9.0,
           'calibrated': 5.5, 'seen': 3.0, 'tested': 1.0, 'outcome': 'silent'}
    line = hidden_lines({'rows': [row]}).splitlines()[2]
    assert line == '| case_001 | `gravity` | 0.50 | 6.0 | 9.0 | 5.5 | 3.0 | 1.0 | silent |'
