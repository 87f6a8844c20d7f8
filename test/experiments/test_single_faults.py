"""Recordings with one fault: the fault is in them, and rows count what was told."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.experiments.single_faults import (
    BEHIND,
    DRIFT,
    FAULTS,
    LAG,
    LOST,
    PAD,
    PLAY,
    YIELD,
    counted,
    drawn,
    kind,
    looked_at,
    structure,
    told,
)

BY = {fault.goes.__name__: i for i, fault in enumerate(FAULTS)}


def numbered(word):
    """Number of the fault that a word is in the name of."""
    return next(i for i, fault in enumerate(FAULTS) if word in fault.name)


def counted_and_gone(name):
    """(t (m,) of the path, what pad PAD's encoder counts (m,), where the pad is (m,))."""
    case = drawn(FAULTS[BY[name]], 0)
    t, q = case.path
    count = np.interp(t, case.run.encoder.t, case.run.encoder.values[:, PAD])
    return t, count, q[:, PAD]


@pytest.mark.parametrize(('name', 'least', 'most'), [
    ('play', -PLAY / 2, PLAY / 2), ('rounded_play', 0.0, PLAY), ('closed_play', 0.0, PLAY),
    ('lost_steps', 0.0, LOST)])
def test_a_pad_is_off_its_encoder_by_the_fault(name, least, most):
    t, count, gone = counted_and_gone(name)
    speed = np.abs(np.gradient(gone, t))
    off = (count - gone)[speed < 1e-3]      # the encoder samples at 50 Hz
    assert off.max() == pytest.approx(most, abs=6e-5)
    assert off.min() == pytest.approx(least, abs=6e-5)


def test_a_pad_that_lags_is_late_by_its_time_constant_on_a_ramp():
    t, count, gone = counted_and_gone('lag')
    speed = np.gradient(gone, t)
    ramp = (np.abs(np.gradient(speed, t)) < 1e-3) & (np.abs(speed) > 4e-3)
    assert np.median((count - gone)[ramp] / speed[ramp]) == pytest.approx(LAG, abs=2e-3)


def test_a_pad_that_yields_gives_way_by_the_force_on_it():
    case = drawn(FAULTS[BY['yielding']], 0)
    t, q = case.path
    at, force = case.run.force.t, np.linalg.norm(case.run.force.values[:, PAD], axis=1)
    off = (np.interp(at, case.run.encoder.t, case.run.encoder.values[:, PAD])
           - np.interp(at, t, q[:, PAD]))
    loaded = force > 1.0        # N: far above the noise, which adds to a length
    assert np.median(off[loaded] / force[loaded]) == pytest.approx(YIELD, rel=0.05)


def test_a_force_that_drifts_is_off_by_its_rate():
    fault = FAULTS[numbered('drifts')]
    case, sound = drawn(fault, 0), drawn(replace(fault, spoil=lambda rng, run, scene: run), 0)
    error = case.run.force.values - sound.run.force.values
    np.testing.assert_allclose(np.linalg.norm(error[:, PAD], axis=1), DRIFT * case.run.force.t)
    assert not np.delete(error, PAD, axis=1).any()


def test_play_from_the_middle_of_its_gap_is_told_as_play_alone():
    """It was told as play, an offset of half its width and a lost step."""
    assert looked_at((BY['play'], 0)) == ['play']


def test_what_is_pressed_is_no_slip():
    assert looked_at((numbered('presses'), 0)) == []


def test_a_lag_of_all_pads_may_be_their_clocks():
    """Also where one stream shows it and the others are too faint to say whether they are late."""
    findings = [one for one in structure(drawn(FAULTS[BY['lag']], 1)).findings if told(one)]
    assert findings and all(kind(one) == BEHIND for one in findings)


def test_rows_count_answers():
    row = counted(FAULTS[0], [['play'], ['play', 'slip'], [], ['slip'], ['play']])
    assert (row['fault_alone'], row['nothing'], row['something_else']) == (2, 1, 2)
    assert row['what_else'] == 'slip 2'
