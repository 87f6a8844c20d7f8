"""What jumped, together with what: the cause of a sudden step."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.isolation.events import _unless_undone, events_of
from arm_brachy.diagnosis.results.finding import Finding
from arm_brachy.registry import parse_terms

ONSET = 9.0
ABSENT = {f'tissue_{i}' for i in range(4, 12)}    # where four markers on the tissue will do


@pytest.fixture(scope='module')
def happened(laboratory, short_pushes, look):
    """(terms, disturb, which markers are seen) -> Finding each."""

    def record(*entries, disturb=None, seed=21, moves=None, seen=None):
        lab = laboratory(parse_terms(list(entries), 'test'), seed, disturb=disturb)
        run = lab.record(moves or short_pushes())
        return look(run if seen is None else only(run, seen))[1].findings

    return record


def only(run, seen):
    """The RunData with those of its optical markers that `seen` says yes to."""
    k = [i for i, name in enumerate(run.optical.ids) if seen(name)]
    return replace(run, optical=replace(
        run.optical, ids=tuple(run.optical.ids[i] for i in k),
        points=run.optical.points[:, k], visible=run.optical.visible[:, k]))


def test_a_tissue_marker_that_slips(happened):
    found, = happened({'name': 'marker_slip', 'marker': 'tissue_5', 'onset_s': ONSET,
                       'offset_mm': [0.0, 0.8, 0.0]})
    assert (found.term, found.channel) == ('marker_slip', 'tissue_5')
    assert found.onset[0] <= ONSET + 0.01 and found.onset[1] >= ONSET - 0.01
    assert found.t_start == pytest.approx(ONSET, abs=0.02)
    assert found.value == pytest.approx([0.0, 8e-4, 0.0], abs=8e-5)


def test_a_pad_that_jumps_by_less_than_the_tissue_did_not_move_it(happened):
    """Both at once: the larger one is told, and not hidden behind the pad."""
    def both(t, names, points):
        moved = np.zeros_like(points)
        moved[..., names.index('tissue_5'), :] = [0.0, 8e-4, 0.0]
        moved[..., names.index('pad_1'), :] = [1.5e-4, 0.0, 1e-4]
        return points + (t > ONSET) * moved

    found, = happened(disturb=both)
    assert (found.term, found.channel) == ('marker_slip', 'tissue_5')
    assert found.value == pytest.approx([0.0, 8e-4, 0.0], abs=8e-5)


def test_a_base_marker_that_slips_is_not_the_base_that_moves(happened):
    found, = happened({'name': 'marker_slip', 'marker': 'base_1', 'onset_s': ONSET,
                       'offset_mm': [0.8, 0.0, 0.0]})
    assert (found.term, found.channel) == ('marker_slip', 'base_1')


@pytest.mark.parametrize('back, slipped', [
    (1.0, 0), *(pytest.param(*case, marks=pytest.mark.validate) for case in ((0.0, 1), (0.5, 2)))])
def test_a_slip_is_permanent_a_press_is_undone(happened, back, slipped):
    """A press on one marker was told as two slips; one that goes half of the way back is two."""
    def press(t, names, points):
        moved = np.zeros_like(points)
        moved[..., names.index('tissue_5'), :] = [0.0, 8e-4, 0.0]
        return points + ((t > ONSET) - back * (t > ONSET + 4.0)) * moved

    found = happened(disturb=press)
    assert [f.term for f in found].count('marker_slip') == slipped
    assert all(f.term == 'marker_slip' or 'external_force' in f.rivals for f in found)
    assert all(f.channel == 'tissue_5' and f.onset is not None for f in found)
    assert len(found) == (1 if back == 0.0 else 2)


def slip(t, *offset_mm, sd_mm=0.02):
    return Finding('optical', 'tissue_5', 'marker_slip', 'offset', 1e-3 * np.array(offset_mm), 'm',
                   1e-3 * np.full(3, sd_mm), 20.0, t, t + 0.1, 'tissue_5 alone jumps')


@pytest.mark.parametrize(('steps', 'slipped'), [
    ([(10.0, 0.0, 1.0, 0.0), (14.0, 0.0, -0.5, 0.0), (14.1, 0.0, -0.46, 0.0)], 0),
    ([(10.0, 0.0, 0.6, 0.0), (10.2, 0.0, 0.4, 0.0), (14.0, 0.0, -1.0, 0.0)], 0),
    ([(10.0, 0.0, 1.0, 0.0), (14.0, 0.0, -1.0, 0.0), (30.0, 0.1, 1.0, 0.0),
      (34.0, 0.0, -0.5, 0.0)], 0),
    ([(10.0, 0.0, 1.0, 0.0), (14.0, 0.0, -1.0, 0.0), (30.0, 0.8, 0.0, 0.0)], 1),
    ([(10.0, 0.0, 1.0, 0.0), (14.0, 0.0, -1.0, 0.0), (30.0, 0.0, 5.0, 0.0)], 1),
    ([(10.0, 0.0, 1.0, 0.0), (14.0, 0.0, -0.5, 0.0)], 2)],
    ids=['released in two steps', 'pressed in two steps', 'pressed again, half seen to go',
         'pressed, and slipped aside', 'pressed, and slipped far along',
         'half of the way back'])
def test_a_press_may_come_and_go_in_several_steps(steps, slipped):
    found = _unless_undone([slip(*one) for one in steps])
    assert [one.term for one in found].count('marker_slip') == slipped
    assert all(one.term or one.rivals == ('external_force',) for one in found)


def test_lost_steps_move_the_pad_and_what_follows_it(happened):
    found, = happened({'name': 'lost_steps', 'shortfall_mm': 0.6, 'onset_s': ONSET,
                       'actuators': [2]})
    assert found.term == 'lost_steps' and found.rivals == ()
    assert found.value == pytest.approx(6e-4, rel=0.05)
    assert found.parameters['actuators'] == (2,)
    assert found.parameters['onset'] == pytest.approx(ONSET, abs=0.03)


def test_lost_steps_that_are_made_up_for_while_other_pads_push(happened, short_pushes):
    """From then on the encoder of pad_2 is never home, and single pushes look like pairs."""
    half = len(short_pushes()) // 2
    moves = [(q + 6e-4 * (k >= half) * np.eye(3)[2], speed, hold)
             for k, (q, speed, hold) in enumerate(short_pushes())]
    found, = happened({'name': 'lost_steps', 'shortfall_mm': 0.6, 'onset_s': ONSET,
                       'actuators': [2]}, moves=moves)
    assert found.term == 'lost_steps' and found.parameters['actuators'] == (2,)
    assert found.value == pytest.approx(6e-4, rel=0.05)


def test_a_pad_marker_that_slips_along_the_push_moves_nothing_else(happened, laboratory):
    along = -8e-4 * laboratory().directions[1]
    found, = happened({'name': 'marker_slip', 'marker': 'pad_1', 'onset_s': ONSET,
                       'offset_mm': (1e3 * along).tolist()})
    assert (found.term, found.channel, found.rivals) == ('marker_slip', 'pad_1', ())
    assert found.parameters['offset'] == pytest.approx(tuple(along), abs=3e-5)


def test_a_knock_moves_all_markers(happened):
    def knock(t, names, points):
        return points + (t > ONSET) * np.array([3e-4, 0.0, 1e-4])

    found, = happened(disturb=knock,
                      seen=lambda name: name not in ABSENT)
    assert found.term is None and found.channel == '' and 'knocked' in found.statement
    assert found.value == pytest.approx([3e-4, 0.0, 1e-4], abs=5e-5)


@pytest.mark.parametrize('pair', [
    ('tissue_0', 'tissue_1'), *(
        pytest.param(pair, marks=pytest.mark.validate) for pair in (
            ('pad_0', 'pad_1'), ('base_0', 'base_1'), ('pad_0', 'tissue_1'),
            ('pad_2', 'base_1')))])
def test_markers_that_exchange_their_names_were_not_touched(happened, pair):
    def exchange(t, names, points):
        order = np.arange(len(names))
        if t > ONSET:
            i, j = (names.index(name) for name in pair)
            order[[i, j]] = order[[j, i]]
        return points[order]

    found, = happened(disturb=exchange)
    assert found.term is None and found.rivals == () and 'exchanged names' in found.statement
    assert all(name in found.statement for name in pair)


def test_a_touch_moves_some_markers_and_lets_go(happened):
    def touch(t, names, points):
        pushed = np.array([name in ('tissue_3', 'tissue_4', 'tissue_5') for name in names])
        return points + ((ONSET < t < ONSET + 4.0) * pushed)[:, None] * [0.0, 5e-4, 0.0]

    found = happened(disturb=touch)
    assert sorted(round(f.t_start) for f in found) == [9, 13]
    assert all(f.term is None and 'external_force' in f.rivals for f in found)


@pytest.mark.parametrize(('onset', 'rate'), [
    pytest.param(9.0, 1e-5, marks=pytest.mark.validate), (12.0, 4e-5),
    pytest.param(15.0, 8e-5, marks=pytest.mark.validate)])
def test_what_sets_in_and_goes_on_is_no_step(happened, onset, rate):
    """Tissue swells from `onset` [s] on, by `rate` [m/s] at markers and targets."""
    def swell(t, names, points):
        soft = np.array([not name.startswith(('pad', 'base')) for name in names])
        outward = points / np.linalg.norm(points, axis=1, keepdims=True)
        return points + rate * max(t - onset, 0.0) * soft[:, None] * outward

    assert not any(found.term == 'marker_slip' or 'jump' in found.statement
                   for found in happened(disturb=swell))


def test_a_tenth_of_the_typical_size_is_named_rightly_or_not_at_all(happened):
    for entry in ({'name': 'lost_steps', 'shortfall_mm': 0.06, 'onset_s': ONSET,
                   'actuators': [2]},
                  {'name': 'marker_slip', 'marker': 'tissue_5', 'onset_s': ONSET,
                   'offset_mm': [0.0, 0.08, 0.0]}):
        for found in happened(entry):
            assert entry['name'] in (found.term, *found.rivals)


def test_nothing_jumps_no_event():
    assert events_of((), 20) == ()


@pytest.mark.parametrize('noise', [0.0, *(
    pytest.param(noise, marks=pytest.mark.validate) for noise in (1e-6, 1e-5))])
def test_what_no_laboratory_calls_a_step_is_none(laboratory, short_pushes, look, noise):
    """Without noise the curve between two ticks, some microns, stands out."""
    lab = laboratory((), 5, **_noisy(noise))
    assert look(lab.record(short_pushes()))[1].findings == ()


@pytest.mark.parametrize('noise', [pytest.param(0.0, marks=pytest.mark.validate), 1e-4])
@pytest.mark.parametrize('entry', [
    pytest.param({'name': 'marker_slip', 'marker': 'pad_1', 'offset_mm': [0.0, 0.08, 0.0]},
                 marks=pytest.mark.validate),
    {'name': 'lost_steps', 'shortfall_mm': 0.08, 'actuators': [2]}])
def test_small_steps_of_pads_and_their_markers_are_found(laboratory, short_pushes, look, noise,
                                                         entry):
    terms = parse_terms([{**entry, 'onset_s': ONSET}], 'test')
    found, = look(laboratory(terms, 21, **_noisy(noise)).record(short_pushes()))[1].findings
    assert found.term == entry['name']
    assert np.linalg.norm(found.value) == pytest.approx(8e-5, rel=0.2)


@pytest.mark.parametrize('axis', [0, *(
    pytest.param(axis, marks=pytest.mark.validate) for axis in (1, 2))])
def test_what_jumps_by_less_than_a_count_did_not_jump(recorded, look, axis):
    """An axis in counts of 0.5 mm: no marker slips, and no actuator is uneven."""
    run = recorded()
    points = run.optical.points.copy()
    points[..., axis] = np.round(points[..., axis] / 5e-4) * 5e-4
    assert look(replace(run, optical=replace(run.optical, points=points)))[1].findings == ()


def _noisy(noise):
    """Parameters of all devices for markers of this noise [m rms], the others in proportion."""
    share = noise / 1e-4
    return {'optical': OpticalParams(noise=noise),
            'em': EmTrackerParams(position_noise=share * EmTrackerParams().position_noise),
            'force': ForceSensorParams(noise=share * ForceSensorParams().noise)}
