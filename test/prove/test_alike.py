"""Effects of the generator and terms of the registry under one name: what is compared, and how."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.experiments.blind_trials import TRIALS, alike_lines
from arm_brachy.prove import alike
from arm_brachy.prove.generator.body import draw_body
from arm_brachy.prove.generator.solver import NotSolved
from arm_brachy.registry import by_name, parse_terms


@pytest.fixture(scope='module')
def body():
    return draw_body(np.random.default_rng(1), 'test')


@pytest.mark.parametrize('name', alike.PLAYED)
def test_the_registry_takes_the_numbers_of_the_generator(body, name):
    """As a scenario would have them: names, units and limits are those of the term."""
    effect = alike.typical(name, body)
    term, = parse_terms([alike.entry(effect)], 'test')
    assert isinstance(term, by_name(name))
    assert effect.values and alike.typical(name, body) == effect    # drawn from one seed


def test_what_is_no_such_effect_or_case_is_refused_in_a_line(body, monkeypatch, capsys, tmp_path):
    with pytest.raises(InputError, match='backlash: must be one of anisotropy'):
        alike.typical('backlash', body)
    monkeypatch.setattr(sys, 'argv', ['alike', TRIALS[-1], 'case_999', '--folder', str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        alike.main()
    assert end.value.code == 2
    assert 'case_999: must be one of the' in capsys.readouterr().err


def test_a_place_without_a_balance_is_drawn_anew(body):
    """And where none of them has one, that is said."""
    played, solved = [], alike.Both('gravity', 8.0, 0.4)

    def both(effect):
        played.append(effect.values['added_m_s2'])
        if len(played) < alike.ATTEMPTS - lucky:
            raise NotSolved('no equilibrium')
        return solved
    bench, lucky = SimpleNamespace(body=body, both=both), 1
    assert alike._played(bench, 'gravity') is solved
    assert len(set(played)) == len(played) == alike.ATTEMPTS - 1
    played, lucky = [], -1
    with pytest.raises(InputError, match='gravity: no equilibrium at 5 places'):
        alike._played(bench, 'gravity')


def test_the_table_has_a_line_an_effect_and_a_column_a_case():
    one = {'trial': 'abc', 'case': 'case_000',
           'rows': [{'effect': 'gravity', 'planted': 8.0, 'apart': 0.4}]}
    other = {'trial': 'abc', 'case': 'case_001',
             'rows': [{'effect': 'obstacle', 'planted': 1.0, 'apart': 1.5}]}
    assert alike_lines(one, other).splitlines() == [
        '| effect | abc case_000, sd | abc case_001, sd |', '|---|---|---|',
        '| `gravity` | 0.4 of 8.0 (5%) | - |', '| `obstacle` | - | 1.5 of 1.0 (150%) |']
