"""What a finding without a model becomes in the answer: one cause, or a class with its rivals."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.isolation.handover import Given, given
from arm_brachy.diagnosis.report.finding_causes import said_of_faint, with_findings
from arm_brachy.diagnosis.report.finding_estimates import merged
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.finding import Finding


@pytest.fixture(scope='module')
def scene():
    return load_scene(config_dir() / 'scenes' / 'breast.yaml')


def gain(rivals=('actuator_compliance',)):
    return Finding('encoder', 'pad_2', 'actuator_gain', 'gain', 0.06, '1', 1e-3, 60.0, 0.0, 9.0,
                   'The marker departs from the encoder.', rivals,
                   parameters={'gain': 0.06, 'actuators': (1,)})


def answered(scene, finding, verdict='nothing_missing', causes=(), more=()):
    """(causes, where, when) of a decision with findings, those with rivals left to the model."""
    each = [(one, 'one') for one in (finding, *more)]
    found = Given(tuple(x for x in each if not x[0].rivals),
                  tuple(x for x in each if x[0].rivals), ())
    return with_findings(found, scene, causes, (), (), SimpleNamespace(verdict=verdict, ranked=()))


def test_a_finding_without_rivals_is_a_cause(scene):
    (cause,), (place,), (when,) = answered(scene, gain(()))
    assert (cause.term, cause.option, cause.applies_to) == ('actuator_gain', 0,
                                                            {'actuators': (1,)})
    assert cause.parameters['gain'].value == pytest.approx(0.06)
    assert place.actuator == scene.pads[1].name and when.recording == 'one'


def test_numbers_that_were_estimated_together_have_an_interval_each(scene):
    tilt = Finding('optical', 'pad_2', 'pad_misplacement', 'tilt_up', -0.02, 'rad', 0.003, 40.0,
                   0.0, 9.0, 'The marker moves aside.', parameters={
                       'tilt_up': -0.02, 'tilt_side': 0.19, 'pads': ('pad_2',)},
                   slack=0.004, errors={'tilt_side': 0.0})
    (cause,), _, _ = answered(scene, tilt)
    up, side = cause.parameters['tilt_up'], cause.parameters['tilt_side']
    assert up.high - up.value == pytest.approx(1.645 * 0.005, rel=1e-3)
    assert side.value - side.low == pytest.approx(1.645 * 0.004, rel=1e-3)


def test_what_the_model_found_beside_a_finding_adds_to_it(scene):
    more = Cause('actuator_gain', {'gain': Estimate(0.01, -0.02, 0.04)}, {'actuators': (1,)}, 0.9)
    elsewhere = replace(more, applies_to={'actuators': (0,)})
    (first, other), _, _ = answered(scene, gain(()), 'named', (more, elsewhere))
    assert first.parameters['gain'].value == pytest.approx(0.07)
    assert first.parameters['gain'].high - 0.07 == pytest.approx(0.03, rel=0.01)
    assert first.probability > 0.999 and other == elsewhere


def test_more_play_begins_where_the_finding_has_it():
    marker = Cause('backlash', {'width': Estimate(3e-4, 2e-4, 4e-4), 'start': Estimate(0.5, 0.4,
                   0.6)}, {'actuators': (1,)}, 0.99)
    model = replace(marker, parameters={'width': Estimate(1e-4, 0.0, 2e-4),
                                        'start': Estimate(0.2, 0.0, 0.9)})
    both = merged(marker, model)
    assert both.parameters['width'].value == pytest.approx(4e-4)
    assert both.parameters['start'] == marker.parameters['start']


def test_a_finding_that_no_model_told_from_its_rivals_is_a_class(scene):
    causes, where, _ = answered(scene, gain())
    assert [(c.term, c.option) for c in causes] == [('actuator_gain', 1),
                                                    ('actuator_compliance', 2)]
    assert sum(c.probability for c in causes) == pytest.approx(1.0, abs=2e-3)
    assert causes[1].applies_to == {'actuators': (1,)} and not causes[1].parameters
    assert [p.actuator for p in where] == [scene.pads[1].name] * 2
    assert causes[1].build().actuators == (1,)


def test_a_finding_that_may_be_chance_is_a_note_and_no_cause(scene):
    """Of 3.9 sd, past the threshold of a finding: one in ten thousand, of a hundred channels."""
    faint = replace(gain(()), z=3.9)
    found = given([SimpleNamespace(name='one', structure=SimpleNamespace(findings=(faint,)))])
    assert with_findings(found, scene, (), (), (), None) == ([], [], [])
    assert found.terms == ()
    note, = said_of_faint(found)
    assert faint.statement in note and f'{faint.probability:.2f}' in note


def test_findings_alike_on_two_pads_are_one_class(scene):
    other = replace(gain(), channel='pad_1', parameters={'gain': 0.05, 'actuators': (0,)})
    causes, _, _ = answered(scene, gain(), more=(other,))
    assert [(c.term, c.option, c.applies_to['actuators']) for c in causes] == [
        ('actuator_gain', 1, (1,)), ('actuator_compliance', 2, (1,)),
        ('actuator_gain', 1, (0,)), ('actuator_compliance', 2, (0,))]


def test_an_option_may_be_several_causes_each_of_its_own_stream(scene):
    """Pads lag, or the clocks of all streams are off: it was one clock, of no stream."""
    lag = Finding('encoder', '', 'actuator_lag', 'time_constant', 0.013, 's', 1e-4, 60.0, 0.0, 9.0,
                  'All others are late.', ('clock_offset',), parameters={'time_constant': 0.013},
                  ways={'clock_offset': ({'stream': 'optical', 'delay': 0.013},
                                         {'stream': 'force', 'delay': 0.012})})
    causes, where, _ = answered(scene, lag)
    assert [(c.term, c.option, c.applies_to) for c in causes] == [
        ('actuator_lag', 1, {}), ('clock_offset', 2, {'stream': 'optical'}),
        ('clock_offset', 2, {'stream': 'force'})]
    assert [p.stream for p in where] == ['encoder', 'optical', 'force']
    assert causes[2].parameters['delay'].value == 0.012
    assert causes[2].parameters['delay'].high < 0.013


def test_tissue_that_the_model_did_not_find_is_no_option(scene):
    causes, _, _ = answered(scene, gain(('inclusion',)))
    assert [(c.term, c.option) for c in causes] == [('actuator_gain', 0)]


def test_a_rival_that_the_model_named_takes_the_finding(scene):
    named, _, _ = answered(scene, gain())
    rival = next(c for c in named if c.term == 'actuator_compliance')
    causes, where, when = answered(scene, gain(), 'named', (rival,))
    assert causes == [rival] and where == [] and when == []


def test_where_something_is_left_that_nothing_explains_there_are_no_options(scene):
    causes, _, _ = answered(scene, gain(), 'unexplained')
    assert [(c.term, c.option) for c in causes] == [('actuator_gain', 0)]
