"""A recording before any model: kinds of push, what is handed on, the pushes to make again."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.control.moves import check_moves
from arm_brachy.devices.actuator_driver import ActuatorParams
from arm_brachy.diagnosis.experiment_design.moves import moves_of
from arm_brachy.diagnosis.isolation.handover import given, occasions_of
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.report.occasions import intervals, regime_of
from arm_brachy.diagnosis.results.finding import Finding
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.motion import Motion, motion_of
from arm_brachy.evaluation.regimes import HOLD, REST

PLAY = {'name': 'backlash', 'width_mm': 0.5, 'actuators': [0]}
SLIP = {'name': 'marker_slip', 'marker': 'tissue_3', 'onset_s': 9.0, 'offset_mm': [1.0, 0.0, 0.5]}


@pytest.fixture(scope='module')
def looked(recorded, laboratory):
    """Entry -> Recorded of the short protocol: 8, 6, 4 mm alone, then two pairs."""
    scene = laboratory().scene
    return lambda entry=None: look(evidence_of(recorded(entry), scene))


@pytest.fixture(scope='module')
def sound(looked):
    return looked()


def test_kinds_are_what_a_person_calls_another_push(sound):
    assert set(sound.kinds) == {
        'pad_0 to 8 mm at 16 mm/s', 'pad_1 to 8 mm at 16 mm/s', 'pad_2 to 4 mm at 16 mm/s',
        'pad_0 and pad_1 to 4 mm at 16 mm/s', 'pad_1 and pad_2 to 8 mm at 16 mm/s'}


def test_play_is_handed_on_as_a_term_and_nothing_else_is(looked, sound):
    assert given((sound,)).terms == ()
    term, = given((looked(PLAY),)).terms
    assert term.spec.name == 'backlash' and term.actuators == (0,)
    assert term.width == pytest.approx(0.5e-3, rel=0.1)


def test_a_late_clock_is_told_and_put_right_in_the_states_not_in_the_model_again(looked, sound):
    late = looked({'name': 'clock_offset', 'stream': 'optical', 'delay_ms': 30.0})
    found = given((late,))
    assert [f.term for f, _ in found.certain] == ['clock_offset'] and found.terms == ()
    shown, plain = (one.states.streams['optical'] for one in (late, sound))
    # at 16 mm/s the pad markers would be 0.5 mm behind
    assert np.nanmedian(np.abs(shown.values - plain.values)) < 1e-4


def test_how_far_a_marker_slipped_is_left_to_the_model(looked):
    found = given((looked(SLIP),))
    assert not found.certain and [f.term for f, _ in found.open] == ['marker_slip']


@pytest.mark.parametrize(('rivals', 'certain'), [
    ((), True), (('actuator_compliance',), False), (('inclusion',), False),
    (('marker_slip',), False)])
def test_what_has_rivals_is_left_to_the_model(rivals, certain):
    gain = Finding('encoder', 'pad_1', 'actuator_gain', 'gain', 0.06, '', 1e-3, 60.0, 0.0, 9.0,
                   'The marker departs from the encoder.', rivals,
                   parameters={'gain': 0.06, 'actuators': (0,)})
    found = given((SimpleNamespace(name='one', structure=SimpleNamespace(findings=(gain,))),))
    kept, other = (found.certain, found.open) if certain else (found.open, found.certain)
    assert kept == ((gain, 'one'),) and other == ()


@pytest.mark.parametrize(('size', 'settled'), [(0.332e-3, True), (0.6e-3, False)])
def test_what_another_recording_settles_is_settled_here_if_as_large(size, settled):
    def short(value, rivals):
        return Finding('optical', 'on_pad_2', 'lost_steps', 'shortfall', value, 'm', 5e-6, 40.0,
                       28.0, 74.0, 'The marker stands short of the encoder.', rivals,
                       parameters={'shortfall': value, 'onset': 28.0, 'actuators': (1,)})
    one, other = (SimpleNamespace(name=name, structure=SimpleNamespace(findings=(found,)))
                  for name, found in (('one', short(0.33e-3, ('marker_slip',))),
                                      ('other', short(size, ()))))
    alone, together = given((one,)), given((one,), beside=(one, other))
    assert alone.terms == () and len(alone.open) == 1
    assert [t.shortfall for t in together.terms] == ([0.33e-3] if settled else [])
    assert [f.rivals for f, _ in together.certain] == ([()] if settled else [])


@pytest.mark.parametrize(('pad', 'told'), [('pad_1', True), ('pad_2', False)])
def test_what_one_recording_cannot_tell_from_its_rival_another_one_does(pad, told):
    """A yield that moderate pushes show as a gain, of the same actuator or of another one."""
    def finding(term, parameter, name, value, rivals, end):
        return Finding('encoder', name, term, parameter, value, '', 0.05 * abs(value), 20.0, 0.0,
                       end, 'The marker departs from the encoder.', rivals,
                       parameters={parameter: value, 'actuators': (int(name[-1]) - 1,)})
    gain = finding('actuator_gain', 'gain', 'pad_1', -0.09, ('actuator_compliance',), 9.0)
    yields = finding('actuator_compliance', 'compliance', pad, 3.3e-4, (), 20.0)
    one, other = (SimpleNamespace(name=name, structure=SimpleNamespace(findings=(found,)))
                  for name, found in (('one', gain), ('other', yields)))
    found = given((one,), beside=(one, other))
    if not told:
        assert found.open == ((gain, 'one'),) and found.certain == ()
        return
    (kept, name), = found.certain
    assert found.open == () and name == 'one'
    assert (kept.term, kept.value, kept.t_end) == ('actuator_compliance', 3.3e-4, 9.0)
    assert [term.compliance for term in found.terms] == [3.3e-4]


def test_what_a_sound_recording_shows_as_well_is_no_news(looked):
    one = looked(PLAY)
    assert given((one,), known=one.structure.findings).certain == ()


@pytest.mark.parametrize(('size', 'news'), [(0.016, False), (0.029, False), (0.12, True)])
def test_a_fault_of_the_kind_that_a_sound_recording_shows_is_news_if_larger(size, news):
    """1.5 % of gain is how the rig is; 12 % is a fault."""
    def gain(value):
        return Finding('encoder', 'pad_1', 'actuator_gain', 'gain', value, '', 1e-3, 60.0, 0.0,
                       9.0, 'The marker departs from the encoder.', (),
                       parameters={'gain': value, 'actuators': (0,)})
    one = SimpleNamespace(name='one', structure=SimpleNamespace(findings=(gain(size),)))
    assert bool(given((one,), known=(gain(0.015),)).certain) == news


def test_a_slip_says_when_something_happened(looked):
    occasions = occasions_of((looked(SLIP),))
    assert occasions.onsets and min(abs(t - 9.0) for t in occasions.onsets) < 0.2
    (start, end), = [w for w in occasions.windows if abs(w[0] - 9.0) < 0.2]
    assert end > start


def test_what_happened_in_one_of_two_recordings_is_of_that_one(looked, sound):
    assert set(occasions_of((sound, looked(SLIP))).owners.values()) == {(1,)}


def test_the_pushes_can_be_made_again(sound):
    """Following the moves arrives at the corners of the recorded path, not faster than allowed."""
    motion = motion_of(sound.prepared.evidence)
    moves = moves_of(motion, sound.prepared.evidence.scene.pads, ActuatorParams(max_speed=0.018),
                     0.05)
    ends = np.array([[pad.position for pad in move.pads] for move in moves])
    assert ends.max(axis=0) == pytest.approx([8e-3, 6e-3, 6e-3], abs=1e-4)
    assert np.all([0.0 < move.speed <= 0.018 for move in moves])
    assert sum(move.hold for move in moves) < motion.t[-1] - motion.t[0]


def test_pushes_without_a_stand_become_moves_that_stand_as_long_as_a_cell_must(sound):
    t, q = np.array([0.0, 1.0, 1.5, 2.5, 4.0]), np.array([0.0, 0.0, 5e-3, 2e-3, 2e-3])
    scene = sound.prepared.evidence.scene
    motion = Motion(t, np.stack([q, 0.0 * q, 0.0 * q], axis=1), 1e-5, 1e-4)
    actuators, tick = ActuatorParams(), 0.05
    moves = moves_of(motion, scene.pads, actuators, tick)
    assert len(moves) == 2
    check_moves(moves, scene, actuators, tick, lambda *keys: '.'.join(map(str, keys)))


def test_what_leads_nowhere_or_creeps_is_part_of_the_stand_before(sound):
    """A scenario was refused for a move of 9 um/s, which was noise."""
    t = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 8.0, 9.0])
    q = 1e-3 * np.array([0.0, 0.0, 5.0, 4.996, 4.99, 5.0, 0.0, 0.0])
    scene = sound.prepared.evidence.scene
    motion = Motion(t, np.stack([q, 0.0 * q, 0.0 * q], axis=1), 1e-6, 1e-4)
    moves = moves_of(motion, scene.pads, ActuatorParams(), 0.05)
    assert [move.pads[0].position for move in moves] == [5e-3, 0.0]
    assert [move.hold for move in moves] == pytest.approx([5.0, 1.0])


def test_an_effect_of_depth_shows_while_pads_are_in(sound):
    states = sound.states
    depth = states.q.max(axis=1)
    assert regime_of(states, depth) == 'amplitude'
    assert regime_of(states, (states.labels.regime == REST) * 1.0) == 'rest'
    assert regime_of(states, depth * (states.labels.regime == HOLD)) == 'hold'
    rng = np.random.default_rng(2)
    assert regime_of(states, rng.uniform(size=len(depth))) == ''


class Half:
    """A Matched as far as `intervals` looks at it."""

    def __init__(self, recorded):
        self.recorded = recorded


def test_when_is_where_the_effect_is_large(sound):
    t = sound.states.t
    inside = (t > 8.0) & (t < 12.0)
    one, = intervals(Half(sound), np.where(inside, 1.0, 0.1), term='obstacle')
    assert one.t_start == pytest.approx(t[inside][0], abs=0.5)
    assert one.t_end == pytest.approx(t[inside][-1], abs=0.5)
    assert intervals(Half(sound), np.zeros(len(t))) == ()


@pytest.mark.parametrize('entry, explained', [
    ({'name': 'lost_steps', 'shortfall_mm': 0.88, 'onset_s': 9.0, 'actuators': [1]}, {'pad_1'}),
    (SLIP, set())])
def test_a_pad_that_lost_steps_explains_the_step_of_its_marker(looked, entry, explained):
    """One event was told twice: as lost steps, and by the model as a slip of that marker."""
    occasions = occasions_of((looked(entry),))
    assert {marker for marker, _ in occasions.explained} == explained
    for marker, (low, high) in occasions.explained:
        onset, = occasions.onsets
        assert low < onset < high
        assert not occasions.is_news({'marker': marker, 'onset': onset})
        assert occasions.is_news({'marker': 'tissue_5', 'onset': onset})
