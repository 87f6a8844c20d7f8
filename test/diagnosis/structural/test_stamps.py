"""Stamps: sensors that are read one by one, recordings stamped with dates."""

import numpy as np
import pytest

from arm_brachy.diagnosis.signals import noise
from arm_brachy.diagnosis.signals.stream import FORCE, Stream, thinned
from arm_brachy.diagnosis.signals.timestamps import from_zero, session_zero, together

NAMES, SD = ('a', 'b', 'c'), 0.05


def stream(times, value=lambda t, k: 0.0 * t, lost=()):
    """Forces of sensors with stamps (n,) [s] each; lost : (sensor, number of sample) each."""
    t = np.unique(np.concatenate(times))
    values = np.full((len(t), len(times), 3), np.nan)
    for k, own in enumerate(times):
        values[np.searchsorted(t, own), k] = np.broadcast_to(value(own, k), (3, len(own))).T
        for i in (i for which, i in lost if which == k):
            values[np.searchsorted(t, own[i]), k] = np.nan
    names = NAMES[:len(times)]
    return Stream(FORCE, t, names, values, np.isfinite(values).all(axis=2), names,
                  np.zeros((len(times), 3)))


def apart(rate, count=3, seconds=20.0):
    """Stamps of sensors that are read one after the other."""
    return [np.arange(0.0, seconds, 1.0 / rate) + k / (count * rate) for k in range(count)]


@pytest.mark.parametrize('rate', [40.0, 100.0, 1000.0])
def test_the_noise_of_sensors_that_are_read_one_by_one_is_theirs(rate):
    """Between two samples a straight line has 1 to 0.71 times their deviation, and shares a sample
    with the next one: that colour, 1.25 in deviation, is taken as common to all channels.
    """
    rng, notes = np.random.default_rng(0), []
    one = together(stream(apart(rate), lambda t, k: SD * rng.standard_normal((3, len(t)))), notes)
    one = thinned(one, 0.01) if rate > 150.0 else one
    found = noise._noise(one, ((0.0, 20.0, True),), (), {}, None)
    expected = SD / np.sqrt(max(rate / 100.0, 1.0))
    assert found.source == 'idle'
    assert np.all(found.sd > 0.7 * expected) and np.all(found.sd < 1.3 * expected)
    assert one.valid.mean() > 0.95
    assert any('stamps of their own' in note for note in notes)


def test_values_are_those_at_the_common_stamps():
    slow = [np.arange(0.0, 5.0, 0.1) + 0.03, np.arange(0.0, 5.0, 0.02) + 0.001]
    one = together(stream(slow, lambda t, k: (k + 1.0) * t), [])
    assert np.allclose(one.t, slow[0]) and one.valid[:-1].all()
    assert np.allclose(one.values[:-1, 1, 0], 2.0 * one.t[:-1])


def test_a_gap_is_not_bridged():
    lost = [(1, i) for i in range(100, 110)]
    one = together(stream(apart(40.0, 2), lost=lost), [])
    gone = np.flatnonzero(~one.valid[:, 1])
    assert one.valid[:, 0].all()
    assert set(range(100, 110)) < set(gone.tolist()) <= set(range(99, 111)) | {0}


def test_sensors_with_common_stamps_are_left_as_they_are():
    t = np.arange(0.0, 5.0, 0.01)
    notes = []
    whole = stream([t, t[::2]])
    assert together(whole, notes) is whole
    holes = stream([t, t], lost=[(0, i) for i in range(0, 400)])
    assert together(holes, notes) is holes and not notes


def test_a_sensor_that_says_nothing_takes_the_others_not_with_it():
    times = apart(40.0)
    one = together(stream(times, lost=[(2, i) for i in range(len(times[2]))]), [])
    assert one.valid[1:, :2].all() and not one.valid[:, 2].any()


def test_dates_become_seconds_and_all_streams_move_alike():
    t, date, notes = np.arange(0.0, 30.0, 0.1), 1.7e9, []
    first, none, later = from_zero((stream([t + date]), None, stream([t + date + 0.02])), notes)
    assert none is None and first.t[0] == 0.0
    assert later.t[0] == pytest.approx(0.02, abs=1e-6)      # double precision at such dates
    assert 'counted from the first stamp' in notes[0]


def test_seconds_of_the_run_stay_what_they_are():
    one = stream([np.arange(0.5, 30.0, 0.1)])
    assert from_zero((one,), []) == (one,)


@pytest.mark.parametrize(('spans', 'zero'), [
    ([(0.0, 39.0)], None),                                  # one: its own
    ([(0.0, 39.0), (50.0, 77.0)], 0.0),
    ([(50.0, 77.0), (0.5, 39.0)], 0.0),                     # in any order
    ([(1.7e9, 1.7e9 + 40.0), (1.7e9 + 60.0, 1.7e9 + 90.0)], 1.7e9),
    ([(0.0, 39.0), (0.0, 27.0)], None),                     # clocks of their own
    ([(1.7e9, 1.7e9 + 40.0), (1.7e9 + 1e5, 1.7e9 + 1e5 + 40.0)], None)])    # days apart
def test_recordings_that_follow_each_other_count_together(spans, zero):
    assert session_zero(spans) == zero


def test_times_of_a_session_count_from_its_beginning():
    t, date = np.arange(0.0, 30.0, 0.1), 1.7e9
    notes = []
    one, = from_zero((stream([t + date + 60.0]),), notes, date)
    assert one.t[0] == pytest.approx(60.0, abs=1e-6) and 'first stamp of all' in notes[0]
    later = stream([t + 50.0])
    assert from_zero((later,), [], 0.0)[0].t[0] == 50.0
    assert from_zero((later,), [], date)[0].t[0] == 0.0     # not of that session
