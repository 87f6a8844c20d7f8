"""Test of prove/rivals.py: how the baselines are counted, and what a process learns."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_up_answers import effect, truth

from arm_brachy.experiments.blind_trials import baseline_lines
from arm_brachy.prove import rivals

TRUTHS = {'case_0': truth(effect('backlash', {})), 'case_1': truth(kind='null')}
SAID = {'case_0': {'said': {'LASSO': 'backlash', 'always': 'stiffness_scale'},
                   'error_process': 0.7},
        'case_1': {'said': {'LASSO': '', 'always': 'stiffness_scale'}, 'error_process': None}}


def test_baselines_are_counted_as_the_diagnosis_is():
    found = {(row['baseline'], row['what']): (row['count'], row['of'])
             for row in rivals.rows(TRUTHS, SAID)}
    assert found['LASSO', 'top-1, all singles'] == (1, 1)
    assert found['LASSO', 'false alarms, nulls'] == (0, 1)
    assert found['always', 'false alarms, nulls'] == (1, 1)
    assert found['always', 'wrong claims, all cases'] == (2, 2)
    assert '| LASSO | 1 of 1: 100 %' in baseline_lines(rivals.rows(TRUTHS, SAID))


def test_a_case_that_could_not_be_compared_is_a_false_alarm_and_no_hit():
    none = {'said': {}, 'error_process': None}
    found = {(row['baseline'], row['what']): row['count'] for row in rivals.rows(
        {**TRUTHS, 'case_2': TRUTHS['case_1']}, {**SAID, 'case_2': none})}
    assert found['LASSO', 'false alarms, nulls'] == 1


def test_what_a_process_recovers():
    gained = {'absolute/case_0': {'error_base': 1.0, 'error_oracle': 0.5, 'recovery': 0.9}}
    row = rivals.gain_row(SAID, gained)
    assert row['median'] == pytest.approx(0.6)
    assert row['of'] == 1


def test_a_process_adds_what_was_left_and_nothing_at_rest(monkeypatch):
    monkeypatch.setattr(rivals, 'channels_of', lambda specimen: {'force': ('a', 'b')})
    rng = np.random.default_rng(1)
    q = np.vstack([rng.uniform(0.0, 5e-3, (60, 2)), np.zeros((5, 2))])
    left = 0.03 + 40.0 * q[:, :1] * np.ones(3)       # a zero that is off, and a soft spring
    values = np.stack([left + 1e-4 * rng.normal(size=left.shape), np.full_like(left, np.nan)], 1)
    values[7, 0] = np.nan
    stream = SimpleNamespace(names=('a',), values=values[:, :1])
    matched = SimpleNamespace(
        recorded=SimpleNamespace(states=SimpleNamespace(q=q, streams={'force': stream})),
        baseline=SimpleNamespace(shown={'force': np.zeros((65, 2, 3))},
                                 model=SimpleNamespace(specimen=None)))
    new = np.array([[2e-3, 1e-3], [4e-3, 2e-3], [0.0, 0.0]])
    found = rivals.learn(matched, 'force', new)
    np.testing.assert_allclose(found[:, 0, 0], [0.08, 0.16, 0.0], atol=5e-3)
    np.testing.assert_array_equal(found[:, 1], 0.0)
