"""What is said, word for word where it matters, and the numbers in it."""

import math
import re
from dataclasses import replace

import pytest

from arm_brachy.control.moves import Move, PadTarget
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.results import formatting
from arm_brachy.diagnosis.results.cause import Cause
from arm_brachy.diagnosis.results.finding import Finding
from arm_brachy.diagnosis.results.parts import (
    Alternative,
    Interval,
    NextExperiment,
    Place,
    Recording,
)

PROMISES = re.compile(r'\b(powerful|advanced|robust|novel|accurate|smart|perhaps|maybe|possibly|'
                      r'likely|seems?|appears?|might|could be|clearly shows)\b', re.IGNORECASE)


@pytest.mark.parametrize('name, said', [
    ('named', 'Missing from the model: inclusion (spherical lump or soft pocket) at x = 18.2, '
              'y = 8.1, z = 28.4 mm (90 % region: 3.1 mm around it).'),
    ('structural', 'Missing from the model: backlash (the pad lags the motor by a fixed width '
                   'after every reversal) at the actuator of pad_1.'),
    ('equivalent', 'Missing from the model: either actuator gain (pad travel is scaled and '
                   'shifted against the encoder) or actuator compliance (the pad yields to what '
                   'pushes back on it) at the actuator of pad_1; these recordings cannot tell '
                   'which.'),
    ('nothing_missing', 'Nothing is missing: held out, the error of the optical markers is 0.15 '
                        'mm (noise alone: 0.15 mm) and the error of the EM tracker is 0.30 mm '
                        '(noise alone: 0.30 mm).'),
    ('unexplained', 'Something is missing that no term of the catalogue explains, most clearly '
                    'at x = -31.0, y = 24.0, z = 41.0 mm (within 8.6 mm of it), from '
                    '23.40 to 27.20 s of rich, while unloading, beginning suddenly between 23.31 '
                    'and 23.47 s (90 %).'),
])
def test_a_verdict_is_one_sentence(answers, name, said):
    assert sentences.verdict(answers[name]) == said


def test_numbers_are_told_with_their_intervals(answers):
    found, = sentences.numbers(answers['structural'])
    assert found.startswith('backlash: width ') and ' mm, 90 % interval ' in found
    assert sentences.numbers(answers['nothing_missing']) == []


def test_what_no_term_says_is_told_with_the_verdict_and_silence_is_not(answers):
    d = answers['unexplained']
    turning = Finding('optical', 'pad_1', None, '', 0.34, '1', 0.0, 24.6, 0.0, 62.0,
                      'The marker on pad_1 turns.')
    silent = replace(turning, unit='s', statement='The marker on pad_1 is silent.')
    said = sentences.verdict(replace(d, findings=(turning, silent, turning)))
    assert said == f'{sentences.verdict(d)} The marker on pad_1 turns.'


def test_what_comes_nearest_is_told_and_not_claimed(answers):
    d = answers['unexplained']
    assert sentences.nearest(d) == (
        'What comes nearest is base debond (part of the glued base has come off) on the base, at '
        'x = 31.0, y = -4.0, z = 0.0 mm: held out, the error of the optical markers goes from '
        '0.39 to 0.21 mm (noise alone: 0.15 mm) and the error of the pad forces goes from 0.041 '
        'to 0.033 N (noise alone: 0.030 N). It is not claimed: what it leaves is more than noise.')
    unsettled = replace(d, nearest=replace(d.nearest, fit=()))
    assert ('z = 0.0 mm, by its linear answer: its full fit did not settle. It'
            in sentences.nearest(unsettled))
    assert [sentences.why_not(one, d) for one in d.alternatives] == [
        'comes nearest, but leaves more than noise', 'explains a part at most',
        'gains too little on what was held out']
    assert 'base debond' not in sentences.verdict(d)


def test_nothing_is_promised_and_nothing_hedged(answers):
    for d in answers.values():
        said = [sentences.verdict(d), sentences.certainty(d), *map(sentences.improvement, d.fit),
                *(sentences.why_not(one, d) for one in d.alternatives)]
        if d.nearest is not None:
            said.append(sentences.nearest(d))
        if d.next_experiment is not None:
            said.append(sentences.request(d.next_experiment))
        assert not PROMISES.search(' '.join(said))


def test_options_at_different_places_each_have_theirs(answers):
    d = answers['equivalent']
    apart = replace(d, where=(d.where[0], Place(actuator='pad_2', term='actuator_compliance',
                                                option=2)))
    said = sentences.verdict(apart)
    assert re.search(r'gain \(.*?\) at the actuator of pad_1 or actuator compliance \(.*?\) at '
                     'the actuator of pad_2;', said)


def test_one_cause_in_two_channels_is_explained_once(answers):
    d = answers['equivalent']
    gain = d.causes[0]
    said = sentences.verdict(replace(d, causes=(gain, replace(gain, option=2)), where=tuple(
        Place(actuator=pad, term=gain.term, option=i) for i, pad in ((1, 'pad_1'), (2, 'pad_2')))))
    assert re.search(r'either actuator gain \(.*?\) at the actuator of pad_1 or actuator gain at '
                     'the actuator of pad_2; these recordings cannot tell which', said)


def test_what_holds_in_any_case_is_said(answers):
    d = answers['equivalent']
    said = sentences.verdict(replace(d, causes=(*d.causes, Cause('gravity'))))
    assert said.endswith('In any case gravity (gravity missing from the model, or tilted).')


def test_two_causes_are_both_named(answers):
    d = answers['named']
    said = sentences.verdict(replace(d, causes=(*d.causes, Cause('pad_slip'))))
    assert 'inclusion (' in said and '; pad slip (' in said


def test_a_mesh_at_fault_is_not_called_physics(answers):
    mesh = replace(answers['named'], causes=(Cause('discretisation'),), where=())
    said = sentences.verdict(mesh)
    assert said.startswith('The mesh is at fault, not the physics: discretisation')
    assert 'Missing from the model' not in said


def test_beside_a_found_cause_the_place_of_the_rest_is_said(answers):
    d = answers['unexplained']
    known = Place(actuator='pad_3', term='backlash')
    said = sentences.verdict(replace(d, where=(known, *d.where), causes=(Cause('backlash'),)))
    assert 'most clearly at x = -31.0' in said
    assert said.endswith('besides backlash (the pad lags the motor by a fixed width after every '
                         'reversal) at the actuator of pad_3.')


@pytest.mark.parametrize('place, said', [
    (Place(stream='em'), 'in the EM tracker'),
    (Place(stream='force', channel='pad_2'), 'in the pad forces (pad pad_2)'),
    (Place(boundary='base', position=(0.01, 0.0, 0.0), radius=0.004, term='base_debond'),
     'on the base, at x = 10.0, y = 0.0, z = 0.0 mm (90 % region: 4.0 mm around it)'),
    (Place(boundary='base'), 'on the base'),
    (Place(position=(-1e-9, 0.0, 0.0), radius=0.004),
     'at x = 0.0, y = 0.0, z = 0.0 mm (within 4.0 mm of it)'),
])
def test_places(place, said):
    assert sentences.place(place) == said


def test_intervals():
    whole = Recording('run', 'fitted', 1.0, 60.0)
    held = Interval('run', 2.0, 9.5, 'hold')
    assert sentences.interval(held) == 'from 2.00 to 9.50 s of run, in holds'
    assert sentences.interval(Interval('run', 0.5, 60.0), (whole,)) == 'throughout run'
    assert (sentences.interval(Interval('run', 2.0, 60.0), (whole,))
            == 'from 2.00 to 60.00 s of run')
    assert sentences.interval(Interval('other', 0.5, 60.0), (whole,)).startswith('from 0.50')


@pytest.mark.parametrize('args, said', [
    (('width', 'mm', 0.3104, 0.2897, 0.3302), 'width 0.310 mm, 90 % interval 0.290 to 0.330 mm'),
    (('ratio', '1', 5.61, 2.9, 12.43), 'ratio 5.6, 90 % interval 2.9 to 12.4'),
    (('E', 'kPa', 260.0, 200.0, 330.0), 'E 260 kPa, 90 % interval 200 to 330 kPa'),
    (('tilt_side', 'deg', 1.5, -math.inf, math.inf),
     'tilt side 1.50 deg, 90 % interval not known'),
    (('offset', 'mm', [1.0, -2.0, 0.0], [0.5, -2.5, -0.5], [1.5, -1.5, 0.5]),
     'offset (1.0, -2.0, 0.0) mm, 90 % interval (0.5 to 1.5, -2.5 to -1.5, -0.5 to 0.5) mm'),
])
def test_a_parameter_shows_the_digits_its_interval_deserves(args, said):
    assert formatting.parameter(*args) == said


def test_figures_have_two_digits_of_the_interval():
    assert formatting.figures((10.04, 9.0, 11.0), 2.0) == ('10.0', '9.0', '11.0')
    assert formatting.figures((0.0, 0.0)) == ('0.0', '0.0')


def test_what_is_zero_but_for_rounding_is_zero():
    bias = (8.3e-17, 0.0, -0.078)
    assert formatting.amount('N', bias, bias, bias) == '(0.0, 0.0, -0.078) N'


@pytest.mark.parametrize('chance, said', [(1.0, 'above 99.9 %'), (0.9993, 'above 99.9 %'),
                                          (0.994, '99.4 %'), (0.57, '57 %'), (0.004, '0.4 %'),
                                          (0.0, 'below 0.1 %')])
def test_certainty_is_never_rounded_up_to_one(chance, said):
    assert formatting.percent(chance) == said


def test_rare_chances_are_counted():
    assert formatting.share(2e-7) == 'less than 1 in 1 000 000'
    assert formatting.share(0.42) == '42 %'


def test_improvement_shows_all_four_errors(answers):
    optical = answers['named'].fit[0]
    assert sentences.improvement(optical) == (
        'Error of the optical markers (held out: pairs): 0.62 mm as given, 0.41 mm recalibrated, '
        '0.16 mm with what was found; noise alone leaves 0.15 mm.')
    assert 'what was found' not in sentences.improvement(answers['nothing_missing'].fit[0])


def test_certainty_of_options_is_their_distance(answers):
    said = sentences.certainty(answers['equivalent'])
    assert 'actuator gain: 57 %' in said and '0.4 standard deviations apart' in said
    assert 'nearest rival is 14.2 standard deviations' in sentences.certainty(answers['named'])


def test_why_an_alternative_lost(answers):
    d = answers['named']
    worse = sentences.why_not(Alternative(('obstacle',), -1.0), d)
    assert 'no better than no new physics' in worse
    assert 'less well than what is named' in sentences.why_not(Alternative(('obstacle',), 5.0), d)
    assert 'all data together' in sentences.why_not(Alternative(('obstacle',), 300.0), d)
    assert 'not ruled out' in sentences.why_not(Alternative(('obstacle',), 5.0, visible=False), d)
    assert sentences.why_not(Alternative(('obstacle',), 5.0, why='it is far away'), d) == (
        'it is far away')
    assert 'too little' in sentences.why_not(Alternative(('obstacle',), 1.0),
                                         answers['nothing_missing'])


def test_a_request_says_what_to_do_and_what_it_decides(answers):
    assert sentences.request(answers['equivalent'].next_experiment) == (
        'Record the pad forces as well. Push pad_1 to 8 mm at 20 mm/s, hold 2 s, back, hold 2 s; '
        'twice. Push pad_1 to 8 mm and pad_3 to 8 mm at 20 mm/s, hold 2 s, back, hold 2 s; once. '
        'This is expected to tell actuator gain from actuator compliance, by at least 9.6 '
        'standard deviations.')
    assert sentences.request(NextExperiment(instruction='Turn the phantom over.')) == (
        'Turn the phantom over.')


@pytest.mark.parametrize('move, said', [
    (Move('m', 5e-3, (PadTarget('a', 1e-3),), hold=1.0, cycles=3),
     'Push a to 1 mm at 5 mm/s, hold 1 s, back, hold 1 s; 3 times.'),
    (Move('m', 5e-3, (PadTarget('a', 1e-3),), 'home', 1.0),
     'Push a to 1 mm at 5 mm/s, hold 1 s; the others go home.'),
    (Move('m', 5e-3, (), 'home', 4.0), 'All pads go home, for 4 s.'),
    (Move('m', 5e-3, (), 'stay', 4.0), 'All pads stand, for 4 s.'),
])
def test_moves(move, said):
    assert sentences.move(move) == said
