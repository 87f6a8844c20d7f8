"""After every verdict a person is told what to do, and that something is left where it is."""

from dataclasses import replace

import pytest

from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.report.next_steps import FINER, HELD_OUT, what_next
from arm_brachy.diagnosis.results.parts import Screened, StreamFit, Unfinished


@pytest.mark.parametrize('name', ['named', 'structural', 'equivalent', 'nothing_missing',
                                  'unexplained'])
def test_there_is_always_something_to_do(answers, name):
    lines = what_next(answers[name])
    assert lines and all(line.endswith(('.', '`.')) and len(line) > 20 for line in lines)


def test_a_recording_that_is_asked_for_comes_first(answers):
    d = answers['equivalent']
    assert what_next(d)[0] == sentences.request(d.next_experiment)


def test_what_was_not_held_out_is_to_be_confirmed(answers):
    assert HELD_OUT in what_next(answers['structural'])
    assert HELD_OUT not in what_next(answers['named'])      # pairs was held out


def test_a_device_is_to_be_calibrated_and_tissue_is_not(answers):
    assert any('Calibrate or repair what backlash' in line
               for line in what_next(answers['structural']))
    assert not any('Calibrate' in line for line in what_next(answers['named']))


def test_a_misfit_that_the_mesh_explains_asks_for_a_mesh(answers):
    fit = (StreamFit('optical', 0.6e-3, 0.5e-3, 0.1e-3, 0.3e-3, mesh=0.4e-3),)
    assert FINER in what_next(replace(answers['named'], fit=fit))
    left = what_next(replace(answers['named'], fit=(replace(fit[0], mesh=None),)))
    assert FINER not in left and any('Something is left in the optical markers' in line
                                     for line in left)


@pytest.mark.parametrize(('why', 'told'), [('quick', 'without --quick'),
                                           ('time_limit', 'longer --time-limit'),
                                           ('interrupted', 'to its end')])
def test_a_partial_answer_is_to_be_finished(answers, why, told):
    d = replace(answers['nothing_missing'], verdict='partial', unfinished=Unfinished(
        why, 12.0, ('signals',), ('fits',)), screen=(
            Screened('backlash', '', 40.0, 12.0), Screened('gravity', '', 3.0, 0.0)))
    first, second = what_next(d)
    assert told in first and 'Treat backlash as a candidate' in second
    assert d.sentence.startswith('No verdict: ')
    assert 'ranks backlash first (log evidence +40, ahead of gravity by 37)' in d.sentence


def test_a_candidate_that_does_not_stand_out_is_not_recommended(answers):
    d = replace(answers['nothing_missing'], verdict='partial', unfinished=Unfinished(
        'quick', 12.0, ('signals',), ('fits',)), screen=(Screened('obstacle', '', 1.0, 0.0),))
    assert len(what_next(d)) == 1


def test_the_headline_names_the_misfit_that_is_left(answers):
    """Markers at 0.031 mm over a noise of 0.008 mm were headed 99.9 %."""
    d = replace(answers['named'], fit=(StreamFit('optical', 0.4e-3, 0.3e-3, 8e-6, 31e-6),
                                       StreamFit('force', 0.3, 0.2, 0.03, 0.031)))
    assert sentences.remaining(d) == (
        'Not all of the misfit is explained: that of the optical markers is still 3.9 times the '
        'noise, 0.0310 over 0.0080 mm (pad forces 1.0 times).')
    assert sentences.remaining(answers['nothing_missing']) == (
        'The remaining misfit is 1.0 times the noise or less.')
    assert sentences.remaining(replace(d, fit=())) == ''


def test_structure_that_is_left_is_told_in_plain_words(answers):
    assert 'shows no structure beyond noise' in sentences.certainty(answers['named'])
    said = sentences.certainty(answers['unexplained'])
    assert 'The residual still has structure' in said and '1 in 1 000 000' in said
