"""What the study counts over all answers, and when it judges its goals."""

import json

import numpy as np
import pytest

from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.parts import StreamFit
from arm_brachy.experiments import diagnosis_cases as cases
from arm_brachy.experiments import diagnosis_totals as totals
from arm_brachy.experiments.diagnosis_plan import plan
from arm_brachy.experiments.diagnosis_score import INERT
from arm_brachy.experiments.readme import rendered
from arm_brachy.registry import TERMS

MM = 1e-3
SEEN = len(TERMS) - len(INERT)


def test_an_oracle_leaves_what_is_left_of_nothing(label, answer):
    """Mesh errors leave 1.5 floors in the nulls: 1.7 floors are 13 % more, 2 are 33 %."""
    index = [label(None) | {'name': f'null_{i}'} for i in range(3)]
    index += [label('backlash') | {'name': 'good'}, label('backlash') | {'name': 'poor'}]
    lines = {}
    for one, left in zip(index, (1.4, 1.5, 1.9, 1.7, 2.0), strict=True):
        verdict = ['nothing_missing'] if one['term'] is None else ['named', Cause('backlash')]
        lines[one['name']] = {'cpu_s': 1.0, 'answer': answer(
            *verdict, fit=(StreamFit('optical', left * MM, left * MM, MM),))}
    *_, good, poor = totals.rows_of(index, lines)
    assert good['error_over_oracle'] == pytest.approx(1.7 / 1.5)
    assert poor['error_over_oracle'] == pytest.approx(2.0 / 1.5)
    total = totals.totals((good, poor))[-1]
    assert (total['count'], total['of']) == (1, 2)


@pytest.fixture(scope='module')
def outcome_of_a_perfect_tool(answer):
    index = [cases.labels(case, f'{case.name}.npz') for case in plan()]
    lines = {}
    for one in index:
        silent = one['term'] in (None, *INERT) or one['size'] < 1.0
        said = answer('nothing_missing') if silent else answer('named', Cause(
            one['term'], {name: Estimate(value, value, value) for name, value in
                          one['parameters'].items()}))
        lines[one['name']] = {'name': one['name'], 'cpu_s': 2.0, 'answer': said}
    return index, lines


def test_totals_count_terms_and_nulls_apart(outcome_of_a_perfect_tool):
    index, lines = outcome_of_a_perfect_tool
    found, wrong, _, tenth, alarms, *_ = totals.totals(totals.rows_of(index, lines))
    assert (found['count'], found['of'], wrong['count']) == (SEEN, SEEN, 0)
    assert (tenth['count'], tenth['of']) == (0, SEEN)
    assert (alarms['count'], alarms['of']) == (0, 66)   # 60; damping, mass, lag at both sizes


def test_intervals_are_wilsons():
    """1 of 60: 0.29 to 8.86 % (Newcombe 1998, Stat. Med. 17:857, method 3, by its formula)."""
    n, k, z = 60, 1, 1.959964
    middle = (k / n + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(k / n * (1 - k / n) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    share = totals._share('x', [0] * k, [0] * n)
    assert share['low_percent'] == pytest.approx(100 * (middle - half), abs=1e-3)
    assert share['high_percent'] == pytest.approx(100 * (middle + half), abs=1e-3)


def test_goals_wait_for_the_last_answer(outcome_of_a_perfect_tool):
    index, lines = outcome_of_a_perfect_tool
    whole = totals.result(index, lines)
    assert [t.goal for t in whole.targets[:4]] == [f'>= {SEEN}', '<= 0', '<= 0', '<= 1']
    assert all(t.met for t in whole.targets[:4])
    part = totals.result(index, dict(list(lines.items())[:20]))
    assert all(t.met is None for t in part.targets)


def test_the_table_has_a_line_per_term(outcome_of_a_perfect_tool):
    text = totals.markdown(json.loads(totals.result(*outcome_of_a_perfect_tool).to_json()))
    for cls in TERMS:
        line, = (one for one in text.splitlines() if one.startswith(f'| `{cls.spec.name}` |'))
        assert line.count('|') == 9
    assert '| `backlash` | right | no |' in text


def test_a_part_says_how_many_were_judged(outcome_of_a_perfect_tool):
    index, lines = outcome_of_a_perfect_tool
    for many in (20, len(index)):
        part = json.loads(totals.result(index, dict(list(lines.items())[:many])).to_json())
        judged, = (row for row in part['rows'] if row.get('what', '').startswith('cases judged'))
        assert (judged['count'], judged['of']) == (many, len(index))
        said = f'cases judged, of those planned | {many} | {len(index)} |'
        assert totals.markdown(part).count(said) == 1
    text = totals.markdown(part)
    assert text.index('cases judged') < text.index('named or provable class')


def test_the_readme_has_the_table_of_the_result(outcome_of_a_perfect_tool, tmp_path):
    text = '<!-- diagnosis: made -->\n\nold\n\n<!-- end -->'
    totals.result(*outcome_of_a_perfect_tool).to_json(tmp_path / 'diagnosis-terms.json')
    after = rendered(text, tmp_path)
    assert 'old' not in after and '| `backlash` | right |' in after
    assert rendered(after, tmp_path) == after
