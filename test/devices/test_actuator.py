"""The simulated bank: motion, limits, homing, refusals, force limit, emergency stop, drivers."""

from dataclasses import replace
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from arm_brachy.core.errors import CommandRefused, ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.term import ActuationTerm, Stage
from arm_brachy.devices import actuator_driver
from arm_brachy.devices.actuator import (
    AbstractActuatorDriver,
    ActuatorParams,
    SimulatedBank,
    load_driver,
)
from arm_brachy.devices.terms.actuator_lag import ActuatorLag
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.devices.terms.marker_slip import MarkerSlip

NAMES = ('pad_1', 'pad_2', 'pad_3')
STROKES = np.array([0.03, 0.03, 0.02])
PARAMS = ActuatorParams()


def _bank(params=PARAMS, terms=(), **options):
    bank = SimulatedBank(NAMES, STROKES, params, terms, np.random.default_rng(1),
                         **{'homed': True, **options})
    bank.connect()
    return bank


def _run(bank, t0, t1, dt=0.02, effort=None):
    return [bank.read(t0 + dt * (k + 1), effort) for k in range(round((t1 - t0) / dt))]


def test_reaches_its_targets_and_says_so():
    bank = _bank()
    bank.read(0.0)
    bank.move([0.010, 0.005, 0.0])
    states = _run(bank, 0.0, 2.0)
    assert states[3].moving.tolist() == [True, True, False]
    assert not states[-1].moving.any()
    assert states[-1].outcome is Outcome.OK
    half_count = 0.5 * PARAMS.encoder_resolution
    np.testing.assert_allclose(states[-1].q, [0.010, 0.005, 0.0], atol=half_count)
    np.testing.assert_allclose(states[-1].pad, [0.010, 0.005, 0.0], atol=1e-9)


def test_speed_and_acceleration_limits_hold_at_the_pad():
    bank = _bank(replace(PARAMS, servo_time_constant=0.01))
    bank.move([0.02, 0.015, 0.01], [0.02, 0.01, 0.005])
    dt = 0.001
    pad = np.array([s.pad for s in _run(bank, 0.0, 3.0, dt)])
    velocity = np.diff(pad, axis=0) / dt
    assert (np.abs(velocity).max(axis=0) <= np.array([0.02, 0.01, 0.005]) * (1 + 1e-9)).all()
    assert np.abs(np.diff(velocity, axis=0)).max() <= PARAMS.max_acceleration * dt * (1 + 1e-6)
    assert (pad <= np.array([0.02, 0.015, 0.01])).all()


@pytest.mark.parametrize('params', [PARAMS, replace(PARAMS, servo_time_constant=0.0)])
def test_time_may_be_cut_anyhow(params):
    one, two = _bank(params), _bank(params)
    for bank in (one, two):
        bank.move([0.01, 0.02, 0.004])
    coarse = _run(one, 0.0, 1.6, 0.02)
    fine = _run(two, 0.0, 1.6, 0.01)[1::2]
    for a, b in zip(coarse, fine, strict=True):
        np.testing.assert_allclose(a.pad, b.pad, rtol=0.0, atol=1e-14)


def test_encoder_reads_whole_counts():
    bank = _bank()
    bank.move([0.0101, 0.0033, 0.0])
    for state in _run(bank, 0.0, 1.0):
        counts = state.q / PARAMS.encoder_resolution
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
        assert np.abs(state.q - state.pad).max() <= 0.5 * PARAMS.encoder_resolution + 1e-12


def test_velocity_is_that_of_the_encoder_not_of_the_motor():
    """Whole counts per read, also while homing moves the zero; the term shows in the encoder."""
    bank = _bank(homed=False, start=np.array([0.004, 0.0, 0.01]))
    bank.home()
    states = _run(bank, 0.0, 3.0)
    assert states[-1].homed.all()
    counts = np.array([s.velocity for s in states]) * 0.02 / PARAMS.encoder_resolution
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    travel = 0.02 * np.sum([s.velocity for s in states], axis=0)
    np.testing.assert_allclose(travel, [-0.004, 0.0, -0.01], atol=PARAMS.encoder_resolution)


def test_effort_is_noisy_whole_counts_about_the_push_and_moves_no_pad():
    """Mean and spread of 3 x 2000 readings within 4 standard errors."""
    push = np.array([3.0, 0.0, 12.0])
    read = np.array([s.effort for s in _run(_bank(), 0.0, 40.0, effort=push)])
    counts = read / PARAMS.effort_resolution
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    spread = PARAMS.effort_noise
    assert np.abs(read.mean(axis=0) - push).max() < 4.0 * spread / np.sqrt(2000)
    np.testing.assert_allclose(read.std(axis=0), spread, rtol=4.0 / np.sqrt(2 * 2000))


def test_reading_more_often_leaves_where_moves_end():
    params = replace(PARAMS, position_repeatability=5e-5)
    ends = []
    for reads in (1, 40):
        bank = _bank(params)
        for k, q in enumerate((0.01, 0.012)):
            bank.move([q] * 3)
            pads = [bank.read(10.0 * (k + (j + 1) / reads)).pad for j in range(reads)]
        ends.append(pads[-1])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


@pytest.mark.parametrize(('q', 'speed', 'says'), [
    ([0.01, 0.031, 0.0], None, 'pad_2: position = 31 mm; must be 0 to 30'),
    ([0.01, 0.0, 0.021], None, 'pad_3: position = 21 mm; must be 0 to 20'),
    ([0.01, np.nan, 0.0], None, 'pad_2: position = nan mm'),
    ([-0.001, 0.0, 0.0], None, 'pad_1: position = -1 mm'),
    ([0.01, np.inf, 0.0], None, 'pad_2: position = inf mm'),
    ([0.01, 0.0], None, r'shape \(2,\)'),
    (['a', 0.0, 0.0], None, 'must be 3 numbers'),
    ([0.01, 0.0, 0.0], [0.01, 0.03, 0.01], 'pad_2: speed = 30 mm/s; must be 0 to 20'),
    ([0.01, 0.0, 0.0], [0.01, 0.0, 0.01], 'pad_2: speed = 0 mm/s'),
])
def test_bad_commands_are_refused_whole(q, speed, says):
    bank = _bank()
    bank.move([0.002, 0.002, 0.002])
    with pytest.raises(CommandRefused, match=says) as refusal:
        bank.move(q, speed)
    assert '\n' not in str(refusal.value)
    assert refusal.value.exit_status == 2
    states = _run(bank, 0.0, 1.0)
    assert states[0].outcome is Outcome.REJECTED
    assert states[0].message == str(refusal.value)
    assert states[1].outcome is Outcome.OK
    np.testing.assert_allclose(states[-1].pad, 0.002, atol=1e-9)


def test_must_be_homed_first_and_homing_finds_zero():
    start = np.array([0.004, 0.0, 0.01])
    bank = _bank(homed=False, start=start)
    state = bank.read(0.0)
    assert not state.homed.any()
    np.testing.assert_array_equal(state.q, 0.0)  # the sensor counts from where it was switched on
    with pytest.raises(CommandRefused, match='pad_1: not homed'):
        bank.move([0.001, 0.001, 0.001])
    bank.home()
    states = _run(bank, 0.0, 3.0)
    speeds = np.abs(np.array([s.velocity for s in states]))
    assert speeds.max() <= PARAMS.home_speed + PARAMS.encoder_resolution / 0.02   # one count
    assert states[-1].homed.all()
    assert 0.01 / PARAMS.home_speed <= next(s.t for s in states if s.homed.all()) <= 2.3
    np.testing.assert_allclose(states[-1].q, 0.0, atol=1e-9)
    bank.move([0.001, 0.001, 0.001])


def test_force_limit_ends_the_push_but_lets_it_retract():
    bank = _bank()
    bank.move([0.02, 0.02, 0.0])
    _run(bank, 0.0, 0.4)
    effort = np.array([60.0, 1.0, 0.0])
    states = _run(bank, 0.4, 2.0, effort=effort)
    assert states[0].outcome is Outcome.HELD
    assert 'pad_1' in states[0].message
    assert 'pad_2' not in states[0].message
    assert np.ptp([s.pad[0] for s in states]) == 0.0
    assert states[-1].pad[1] == pytest.approx(0.02, abs=1e-9)
    bank.move([0.0, 0.02, 0.0])
    back = _run(bank, 2.0, 4.0, effort=effort)
    assert back[0].outcome is Outcome.OK
    assert back[-1].pad[0] == pytest.approx(0.0, abs=1e-9)


def test_emergency_stop_stands_still_until_released():
    bank = _bank()
    bank.move([0.02, 0.02, 0.02])
    before = _run(bank, 0.0, 0.5)[-1]
    bank.stop()
    after = _run(bank, 0.5, 1.0)
    np.testing.assert_array_equal(after[-1].pad, before.pad)
    assert after[-1].outcome is Outcome.HELD
    bank.hold()
    assert _run(bank, 1.0, 1.1)[-1].message.startswith('emergency stop')
    with pytest.raises(CommandRefused, match='call release first'):
        bank.move([0.0, 0.0, 0.0])
    with pytest.raises(CommandRefused, match='call release first'):
        bank.home()
    bank.release()
    bank.move([0.0, 0.0, 0.0])
    np.testing.assert_allclose(_run(bank, 1.1, 3.0)[-1].pad, 0.0, atol=1e-9)


def test_hold_brakes_within_the_acceleration_limit():
    bank = _bank(replace(PARAMS, servo_time_constant=0.0))
    bank.move([0.02, 0.02, 0.02])
    before = _run(bank, 0.0, 0.5)[-1]
    bank.hold()
    after = _run(bank, 0.5, 1.5)[-1]
    braking = PARAMS.max_speed**2 / (2.0 * PARAMS.max_acceleration)
    np.testing.assert_allclose(after.pad - before.pad, braking, rtol=1e-9)
    assert after.outcome is Outcome.HELD


def test_terms_act_between_set_point_encoder_and_pad():
    bank = _bank(replace(PARAMS, encoder_resolution=0.0), (ActuatorLag(), Backlash(width=0.001)))
    bank.move([0.01, 0.01, 0.01])
    out = _run(bank, 0.0, 2.0)[-1]
    np.testing.assert_allclose(out.q, 0.01, atol=1e-9)
    np.testing.assert_allclose(out.pad, 0.009, atol=1e-9)
    bank.move([0.005, 0.005, 0.005])
    back = _run(bank, 2.0, 4.0)[-1]
    np.testing.assert_allclose(back.pad, 0.005, atol=1e-9)


def test_an_encoder_term_changes_the_reading_alone():
    class Offset(ActuationTerm):
        spec = replace(Backlash.spec, name='offset', stage=Stage.ENCODER)

        def memory(self, q0):
            return None

        def step(self, memory, u, effort, t, dt):
            return u + 1e-3, None

    bank = _bank(replace(PARAMS, encoder_resolution=0.0), (Offset(),))
    bank.move([0.01, 0.01, 0.01])
    end = _run(bank, 0.0, 2.0)[-1]
    np.testing.assert_allclose(end.pad, 0.01, atol=1e-9)
    np.testing.assert_allclose(end.q, 0.011, atol=1e-9)


def test_repeatability_is_the_spread_of_where_moves_end():
    """Chi-square on 3 x 200 settling errors; the 99.98 % interval."""
    spread = 5e-5
    bank = _bank(replace(PARAMS, position_repeatability=spread, encoder_resolution=0.0,
                         servo_time_constant=0.0))
    errors = []
    for k in range(200):
        target = np.array([0.01, 0.012, 0.014]) + 1e-4 * (k % 2)
        bank.move(target)
        bank.move(target)  # repeating a command does not throw the dice again
        errors.append(bank.read(10.0 * (k + 1)).pad - target)
    ratio = np.mean(np.square(errors)) / spread**2
    assert abs(ratio - 1.0) < 3.7 * np.sqrt(2.0 / 600.0)


@pytest.mark.parametrize(('change', 'says'), [
    ({'strokes': [0.03, 0.06, 0.02]}, 'pad_2: stroke_mm = 60'),
    ({'strokes': [0.03, -0.01, 0.02]}, 'pad_2: stroke_mm = -10'),
    ({'strokes': [0.03, 0.02]}, '3 names'),
    ({'terms': (MarkerSlip(),)}, 'marker_slip acts at optical'),
    ({'terms': (Backlash(actuators=(3,)),)}, 'backlash: actuators'),
    ({'start': [0.0, 0.04, 0.0]}, 'pad_2: start_mm = 40'),
    ({'rng': None}, 'effort_noise_N > 0 needs a random stream'),
])
def test_bad_set_up_is_refused_by_name(change, says):
    settings = {'names': NAMES, 'strokes': STROKES, 'params': PARAMS,
                'rng': np.random.default_rng(1), **change}
    with pytest.raises(ConfigError, match=says):
        SimulatedBank(**settings)


def test_calls_out_of_order_are_refused():
    bank = SimulatedBank(NAMES, STROKES, PARAMS, rng=np.random.default_rng(1), homed=True)
    with pytest.raises(CommandRefused, match='connect first'):
        bank.read(0.0)
    bank.connect()
    bank.read(1.0)
    with pytest.raises(CommandRefused, match='backwards'):
        bank.read(0.5)
    bank.close()
    bank.close()


def test_drivers_come_from_entry_points(monkeypatch):
    point = EntryPoint('simulated', 'arm_brachy.devices.actuator:SimulatedBank',
                       actuator_driver.DRIVER_GROUP)
    monkeypatch.setattr(actuator_driver, 'entry_points', lambda group: [point])
    assert load_driver('simulated') is SimulatedBank
    assert issubclass(load_driver('simulated'), AbstractActuatorDriver)
    with pytest.raises(ConfigError, match="'zaber' not found; available .*: simulated"):
        load_driver('zaber')
