"""Test of prove/report.py: what a finished trial leaves behind, from a made-up one."""

import json

import pytest
from made_up_answers import answer, cause, effect, record, truth

from arm_brachy.prove.curves import curves_plate
from arm_brachy.prove.folder import TrialFolder
from arm_brachy.prove.report import as_asked, confusion, markdown, report
from arm_brachy.prove.score import score

GAP = effect('backlash', {'width_mm': 0.2})
TRUTHS = {'case_000': truth(GAP), 'case_001': truth(kind='null'), 'case_002': truth(GAP),
          'case_003': truth(GAP, effect('gravity', {'added_m_s2': [1, 0, 0]}), kind='pair')}
ANSWERS = (answer('named', cause('backlash')), answer('nothing_missing'), None,
           answer('named', cause('backlash'), cause('gravity')))
RECORDS = {('absolute', case): record(given, case=case)
           for case, given in zip(TRUTHS, ANSWERS, strict=True)}
BEGUN = {'commit': 'abc', 'machine': 'one', 'modes': ['absolute'],
         'cases': 4, 'beacon': 'drawn on Friday'}


def test_a_finished_trial_leaves_result_table_pictures_and_an_index(tmp_path):
    folder = TrialFolder(tmp_path)
    folder.page('absolute', 'case_000').parent.mkdir(parents=True)
    folder.page('absolute', 'case_000').write_text('page')
    extras = {('absolute', 'case_000'): {'detectability_sd': 20.0, 'recovery': 0.7}}
    result = report(folder, BEGUN, TRUTHS, RECORDS, extras, frozen=True)
    held = json.loads((tmp_path / 'result.json').read_text())
    assert len([row for row in held['rows'] if 'case' in row]) == 4
    assert held['rows'][0]['recovery'] == 0.7
    for name in ('confusion', 'curves'):
        assert (tmp_path / f'{name}-absolute.png').read_bytes()[1:4] == b'PNG'
    index = (tmp_path / 'index.html').read_text()
    assert 'href="cases/absolute/case_000.html"' in index
    assert index.count('<tr>') > 4 + 10
    assert 'no blind trial' not in index
    assert '3 of 7 goals met' in index
    for case in TRUTHS:
        assert (tmp_path / 'cases' / 'absolute' / f'{case}.html').is_file()
    met = {goal.name: goal.met for goal in result.targets}
    assert met['absolute: pairs, at least one'] is True
    assert met['absolute: held-out recovery, median'] is False


def test_the_curves_show_shares_over_size_and_wrong_claims_over_all():
    rows = [{'kind': 'single', 'size': size, 'outcome': outcome, 'top_1': outcome == 'right',
             'wrong': outcome == 'wrong', 'confidence': sure}
            for size, outcome, sure in ((0.3, 'silent', 0.5), (0.7, 'wrong', 0.9),
                                        (0.8, 'right', 0.99), (2.0, 'right', 0.95))]
    left, right = curves_plate(rows, 'absolute').figure.axes
    named = left.containers[1].lines[0].get_ydata()
    assert named.tolist() == [0.0, 50.0, 100.0]
    line, = right.get_lines()
    assert line.get_xdata().tolist() == [0.0, 25.0, 50.0, 75.0]
    assert line.get_ydata().tolist() == [0.0, 0.0, 0.0, pytest.approx(100.0 / 3.0)]


def test_a_program_that_changed_is_said(tmp_path):
    report(TrialFolder(tmp_path), BEGUN, TRUTHS, RECORDS, {}, frozen=False)
    assert 'no blind trial' in (tmp_path / 'index.html').read_text()


def test_the_confusion_matrix_counts_nothing_and_one_effect():
    cells = confusion(TRUTHS, RECORDS, 'absolute')
    assert cells == {('backlash', 'backlash'): 1, ('nothing', 'silent'): 1,
                     ('backlash', 'failed'): 1}


def test_what_is_decided_with_another_recording_is_counted_by_itself():
    """Named with it: right, though the class that is right without it would not be."""
    gap = truth(GAP, kind='confounded', alike=('backlash', 'lost_steps'))
    either = answer('equivalent', cause('backlash', 1, 0.5), cause('lost_steps', 2, 0.5),
                    next_experiment={'instruction': 'again'})
    rows = [score(record(given, mode), as_asked(gap, mode)) for mode, given in (
        ('absolute', either), ('supplied', answer('named', cause('backlash'))),
        ('supplied', either))]
    lines = [line.split(' | ') for line in markdown(rows, ['absolute']).splitlines()]
    shares = {line[0].removeprefix('| '): line[-1].removesuffix(' |') for line in lines}
    assert shares['confounded, class holds it and names a recording'] == (
        '1 of 1: 100 % (21 to 100)')
    assert shares['confounded, told apart with the recording that decides'] == (
        '1 of 2: 50 % (9 to 91)')


def test_the_table_gives_counts_and_intervals():
    rows = [score(one, TRUTHS[case]) for (_, case), one in RECORDS.items()]
    lines = markdown(rows, ['absolute']).splitlines()
    # 1 of 2, Wilson: 9.5 to 90.5 %
    assert '| top-1, all singles | 1 of 2: 50 % (9 to 91) |' in lines
    assert '| false alarms, nulls | 0 of 1: 0 % (0 to 79) |' in lines
    assert '| confounded, class holds it and names a recording | - |' in lines
