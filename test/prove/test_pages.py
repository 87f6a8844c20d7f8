"""Test of prove/pages.py: a case's page shows the truth beside the answer."""

import re

import pytest
from made_up_answers import answer, cause, effect, record, truth

from arm_brachy.prove.folder import TrialFolder
from arm_brachy.prove.pages import case_page, mood_of
from arm_brachy.prove.score import score

STEP = effect('lost_steps', {'actuators': ['pad_2'], 'shortfall_mm': 0.4}, size=0.8,
              onset=20.0)
FOUND = {'shortfall_mm': {'value': 0.31, 'interval_90': [0.25, 0.37]}}
TOLD = cause('lost_steps', parameters=FOUND)
BEGUN = {'commit': 'abc', 'machine': 'one', 'modes': ['absolute'], 'cases': 4,
         'beacon': 'Friday'}


def page_of(folder, given, true):
    one = record(given)
    return case_page(folder, score(one, true), BEGUN, true, one).read_text(encoding='utf-8')


def text_of(page):
    return ' '.join(re.sub('<[^>]*>', ' ', page.partition('<main>')[2]).split())


def test_what_was_planted_stands_beside_what_was_said(tmp_path):
    text = text_of(page_of(TrialFolder(tmp_path), answer('named', TOLD), truth(STEP)))
    assert 'case_000: lost_steps Right: what was planted is what was said' in text
    assert 'lost_steps 0.80 actuators pad_2 shortfall_mm 0.4 onset in the bag 20.500 s' in text
    assert 'lost_steps shortfall_mm 0.31 0.25 to 0.37' in text
    assert 'error of parameters 23 %' in text
    assert 'arm-brachy prove --cases 4 --mode absolute --beacon Friday' in text


def test_a_page_leads_to_that_of_the_detector(tmp_path):
    folder = TrialFolder(tmp_path)
    there = folder.page('absolute', 'case_000')
    assert '<a href' not in page_of(folder, answer('nothing_missing'), truth(kind='null'))
    there.parent.mkdir(parents=True)
    there.write_text('page')
    page = page_of(folder, answer('nothing_missing'), truth(kind='null'))
    link = re.search('<a href="([^"]*)">The page', page).group(1)
    assert (tmp_path / 'cases' / 'absolute' / link).resolve() == there


def test_an_answer_that_never_came_has_a_page(tmp_path):
    assert 'No answer' in text_of(page_of(TrialFolder(tmp_path), None, truth(STEP)))


@pytest.mark.parametrize(('kind', 'outcome', 'mood'), [
    ('null', 'silent', 'good'), ('single', 'silent', 'open'), ('strange', 'abstained', 'good'),
    ('single', 'abstained', 'open'), ('pair', 'right', 'good'), ('null', 'wrong', 'bad'),
    ('null', 'abstained', 'open'), ('single', 'failed', 'bad')])
def test_silence_is_good_where_nothing_is_missing(kind, outcome, mood):
    assert mood_of({'kind': kind, 'outcome': outcome}) == mood
