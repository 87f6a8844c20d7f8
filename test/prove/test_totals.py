"""Test of prove/totals.py: shares, intervals and goals against published and hand-made values."""

import pytest
from made_up_answers import answer, cause, effect, record, truth

from arm_brachy.prove import totals
from arm_brachy.prove.score import score


def rows(hits, of):
    return [{'hit': i < hits} for i in range(of)]


@pytest.mark.parametrize(('hits', 'of', 'low', 'high'), [
    # Newcombe 1998, Stat Med 17:857, table I, method 3 (Wilson without continuity correction)
    (81, 263, 25.53, 36.62), (15, 148, 6.24, 16.05), (0, 20, 0.0, 16.11), (1, 29, 0.61, 17.18)])
def test_intervals_are_wilsons(hits, of, low, high):
    one = totals.share('x', rows(hits, of), lambda row: row['hit'])
    assert one['low_percent'] == pytest.approx(low, abs=0.006)
    assert one['high_percent'] == pytest.approx(high, abs=0.006)


def test_nothing_to_count_has_no_share():
    one = totals.share('x', [], bool)
    assert (one['of'], one['share_percent'], one['low_percent']) == (0, None, None)


def _rows():
    gap = effect('backlash', {'width_mm': 0.2}, size=0.4)
    wide = effect('backlash', {'width_mm': 0.2}, size=1.5)
    right = answer('named', cause('backlash', probability=0.9))
    wrong = answer('named', cause('gravity', probability=0.6))
    silent = answer('nothing_missing')
    return [score(record(given, case=f'case_{i}'), true, seen) for i, (given, true, seen) in
            enumerate([
                (right, truth(wide), {'detectability_sd': 20.0, 'separation_sd': 9.0}),
                (right, truth(wide), {'detectability_sd': 20.0, 'separation_sd': 2.0}),
                (silent, truth(gap), {'detectability_sd': 3.0, 'separation_sd': None}),
                (wrong, truth(kind='null'), None), (silent, truth(kind='null'), None),
                (None, truth(kind='null'), None)])]


def test_shares_count_what_they_say():
    found = {one['what']: (one['count'], one['of']) for one in totals.shares(_rows())}
    assert found['top-1, identifiable singles'] == (1, 1)
    assert found['top-1, all singles'] == (2, 3)
    assert found['false alarms, nulls'] == (2, 3)       # a crash on a null is no clean bill
    assert found['wrong claims, or no answer'] == (2, 6)   # a crash claims nothing good
    assert found['no answer: crashed or timed out'] == (1, 6)
    assert found['pairs, both'] == (0, 0)


def test_laws_are_counted_apart():
    own = effect('backlash', {'width_mm': 0.2}, form='registry', same=['width_mm'])
    other = effect('backlash', {'width_mm': 0.2}, form='rounded', same=[])
    right = answer('named', cause('backlash', probability=0.9))
    wrong = answer('named', cause('gravity', probability=0.6))
    rows = [score(record(given, case=f'case_{i}'), true) for i, (given, true) in enumerate([
        (right, truth(own)), (wrong, truth(other)), (right, truth(other)),
        (wrong, truth(own, other, kind='pair')), (right, truth(kind='null'))])]
    found = {one['what']: (one['count'], one['of']) for one in totals.per_form(rows)}
    assert found["top-1, all singles: the registry's law"] == (1, 1)
    assert found['top-1, all singles: another law'] == (1, 2)
    assert found["wrong claims, or no answer: the registry's law"] == (0, 1)
    assert found['wrong claims, or no answer: another law'] == (2, 3)


def test_power_grows_with_size():
    found = {one['what']: (one['count'], one['of']) for one in totals.power(_rows())}
    assert found['named, 0.2 to 0.5 of the typical size'] == (0, 1)
    assert found['named, 1 to 2 of the typical size'] == (2, 2)


def test_risk_is_that_of_the_surest_claims():
    curve = totals.risk_coverage(_rows())
    assert [round(one['risk_percent']) for one in curve] == [0, 0, 33]
    assert curve[-1]['coverage_percent'] == pytest.approx(50.0)


def test_goals_are_met_missed_or_open():
    met = {one.name: one.met for one in totals.targets(_rows(), 'absolute')}
    assert met['absolute: top-1, identifiable singles'] is True
    assert met['absolute: false alarms, nulls'] is False
    assert met['absolute: pairs, at least one'] is None


def test_truths_of_two_solvers_are_counted_apart():
    rows = [{'kind': kind, 'solver': solver, 'top_1': right, 'outcome': outcome}
            for kind, solver, right, outcome in (
                ('single', 'a', True, 'right'), ('single', 'a', False, 'silent'),
                ('single', 'b', True, 'right'), ('null', 'b', False, 'wrong'))]
    found = {one['what']: (one['count'], one['of']) for one in totals.per_solver(rows)}
    assert found == {'top-1, all singles: truth by a': (1, 2),
                     'top-1, all singles: truth by b': (1, 1),
                     'false alarms, nulls: truth by a': (0, 0),
                     'false alarms, nulls: truth by b': (1, 1)}
