"""What every sampled device promises, run over all of them."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import arm_brachy.devices
from arm_brachy.core.config import from_mapping, to_mapping
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantities
from arm_brachy.core.random import stream
from arm_brachy.core.term import SensingTerm
from arm_brachy.devices.actuator import ActuatorParams, SimulatedBank
from arm_brachy.devices.cavity_detector import CavityDetectorParams
from arm_brachy.devices.em_tracker import EmTracker, EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.insertion import InsertionProfile
from arm_brachy.devices.needle import NeedleParams
from arm_brachy.devices.needle_driver import NeedleDriverParams
from arm_brachy.devices.needle_echo import NeedleEchoParams
from arm_brachy.devices.optical_tracker import OpticalParams, OpticalTracker
from arm_brachy.devices.surface_scanner import ScannerParams
from arm_brachy.devices.terms.actuator_compliance import ActuatorCompliance
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.actuator_lag import ActuatorLag
from arm_brachy.devices.terms.axis_crosstalk import AxisCrosstalk
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.devices.terms.clock_offset import ClockOffset
from arm_brachy.devices.terms.em_distortion import EmDistortion
from arm_brachy.devices.terms.em_offset import EmOffset
from arm_brachy.devices.terms.force_drift import ForceDrift
from arm_brachy.devices.terms.force_gain import ForceGain
from arm_brachy.devices.terms.lost_steps import LostSteps
from arm_brachy.devices.terms.marker_slip import MarkerSlip
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.devices.tip_detector import TipDetectorParams
from arm_brachy.devices.ultrasound import UltrasoundParams
from arm_brachy.devices.ultrasound_imager import ImagerParams

NAMES = ('a', 'b', 'c')
PARAMS = (ActuatorParams, EmTrackerParams, OpticalParams, ForceSensorParams)
PROBING = (NeedleParams, InsertionProfile, NeedleDriverParams, UltrasoundParams,
           NeedleEchoParams, TipDetectorParams, CavityDetectorParams, ImagerParams, ScannerParams)
TERMS = (ActuatorLag, ActuatorGain, Backlash, LostSteps, ActuatorCompliance, MarkerSlip,
         OpticalScale, EmDistortion, EmOffset, AxisCrosstalk, ForceGain, ForceDrift,
         ClockOffset)

# Straight motion, so that the truth between two ticks does not depend on how time is cut.
_SPEED = np.array([[0.01, 0.0, 0.02], [0.0, -0.01, 0.0], [0.003, 0.004, 0.005]])
_TURN = Rotation.from_rotvec([[0.0, 0.0, 0.1], [0.2, 0.0, 0.0], [0.05, 0.05, 0.05]])


DISTORTED, SLIPPED = (EmDistortion(),), (MarkerSlip(onset=0.3),)


def _positions(t):
    return _SPEED * t


def _rotations(t):
    return Rotation.from_rotvec(t * _TURN.as_rotvec()).as_matrix()


class Em:
    """The EM tracker in motion."""

    per_instant = 3
    rate = 40.0

    def __init__(self, seed, terms=DISTORTED, **changes):
        params = replace(EmTrackerParams(), **changes)
        self.device = EmTracker(params, NAMES, terms, stream(seed, 'em'))

    def advance(self, t0, t1):
        return self.device.advance(t0, _positions(t0), _rotations(t0), t1, _positions(t1),
                                   _rotations(t1), _positions(t0), _positions(t1))


class Optical:
    """The optical tracker in motion."""

    per_instant = 1
    rate = 100.0

    def __init__(self, seed, terms=SLIPPED, **changes):
        params = replace(OpticalParams(), **changes)
        self.device = OpticalTracker(params, NAMES, terms, stream(seed, 'optical'))

    def advance(self, t0, t1):
        return self.device.advance(t0, _positions(t0), t1, _positions(t1), _positions(t0),
                                   _positions(t1))


class Force:
    """The force sensor under a growing load."""

    per_instant = 3
    rate = 100.0

    def __init__(self, seed, terms=(), **changes):
        # no counts: at the edge of a count, rounding in the truth would become a whole count
        params = replace(ForceSensorParams(), resolution=0.0, moment_resolution=0.0, **changes)
        self.device = ForceSensor(params, NAMES, terms, stream(seed, 'force'))

    def advance(self, t0, t1):
        return self.device.advance(t0, 9 * _positions(t0), _positions(t0), t1, 9 * _positions(t1),
                                   _positions(t1), _positions(t0), _positions(t1))


DEVICES = (Em, Optical, Force)


def _run(rig, tick, seconds):
    n = round(seconds / tick)
    return [s for k in range(n) for s in rig.advance(k * tick, (k + 1) * tick)]


def _numbers(sample):
    """All numeric content of a sample as one vector."""
    values = [getattr(sample, f.name) for f in fields(sample)]
    return np.concatenate([np.ravel(v).astype(float) for v in values
                           if not isinstance(v, (str, tuple))])


def _arrays(sample):
    return [v for f in fields(sample) if isinstance(v := getattr(sample, f.name), np.ndarray)]


@pytest.mark.parametrize('make', DEVICES)
def test_same_seed_same_bits_other_seed_other_noise(make):
    a, b, c = (_run(make(seed), 0.02, 1.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal([_numbers(s) for s in a], [_numbers(s) for s in b])
    assert not np.array_equal([_numbers(s) for s in a], [_numbers(s) for s in c], equal_nan=True)


@pytest.mark.parametrize('make', DEVICES)
@pytest.mark.parametrize('latency', [0.0, 0.017])
def test_one_tick_or_two_give_the_same_samples(make, latency):
    coarse = _run(make(1, latency=latency), 0.02, 2.0)
    fine = _run(make(1, latency=latency), 0.01, 2.0)
    np.testing.assert_allclose([_numbers(s) for s in coarse], [_numbers(s) for s in fine],
                               rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('make', DEVICES)
def test_rate_is_exact_over_a_minute(make):
    samples = _run(make(1, latency=0.0), 0.02, 60.0)
    assert len(samples) == make.per_instant * round(60.0 * make.rate)
    t = np.array([s.t for s in samples[::make.per_instant]])
    np.testing.assert_allclose(t, np.arange(1, len(t) + 1) / make.rate, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize('make', DEVICES)
def test_latency_delays_delivery_not_the_stamp(make):
    at_once = _run(make(1, latency=0.0), 0.02, 1.0)
    late = _run(make(1, latency=0.1), 0.02, 1.0)
    assert len(at_once) - len(late) == make.per_instant * round(0.1 * make.rate)
    np.testing.assert_array_equal([_numbers(s) for s in late],
                                  [_numbers(s) for s in at_once[:len(late)]])


@pytest.mark.parametrize('make', DEVICES)
@pytest.mark.parametrize('delay', [0.02, 0.13, -0.02, -0.13])
def test_a_clock_that_is_off_shifts_stamps_and_nothing_else(make, delay):
    """Value for value the run without the offset, but for what is lost before time zero."""
    plain = _run(make(1, terms=()), 0.02, 1.0)
    off = _run(make(1, terms=(ClockOffset(delay=delay),)), 0.02, 1.0)
    lost = make.per_instant * np.sum(np.array([s.t for s in plain[::make.per_instant]])
                                     < -delay - 1e-9)
    matching = plain[lost:lost + len(off)]
    assert len(off) > 0.8 * len(plain)
    np.testing.assert_allclose([s.t for s in off], [s.t + delay for s in matching], atol=1e-9)
    moved = [replace(s, t=0.0) for s in off], [replace(s, t=0.0) for s in matching]
    np.testing.assert_array_equal(*[[_numbers(s) for s in run] for run in moved])


@pytest.mark.parametrize('make', DEVICES)
@pytest.mark.parametrize('delay', [0.13, -0.13])
def test_no_stamp_lies_ahead_of_its_delivery_or_before_zero(make, delay):
    rig, last = make(1, terms=(ClockOffset(delay=delay),)), 0.0
    for k in range(50):
        for sample in rig.advance(0.02 * k, 0.02 * (k + 1)):
            assert 0.0 <= sample.t <= 0.02 * (k + 1) + 1e-12
            assert sample.t >= last
            last = sample.t
    assert last > 0.8


@pytest.mark.parametrize('make', DEVICES)
def test_returned_arrays_share_no_memory(make):
    spoiled, clean = make(1), make(1)
    for k in range(20):
        a = spoiled.advance(0.05 * k, 0.05 * (k + 1))
        b = clean.advance(0.05 * k, 0.05 * (k + 1))
        np.testing.assert_array_equal([_numbers(s) for s in a], [_numbers(s) for s in b])
        arrays = [array for s in a for array in _arrays(s)]
        assert not any(np.shares_memory(x, y) for i, x in enumerate(arrays) for y in arrays[:i])
        for array in arrays:
            array[...] = 1


@pytest.mark.parametrize('make', DEVICES)
def test_a_term_leaves_the_noise_as_it_was(make):
    """The difference that a term makes is the term's, not another draw of the dice."""
    class Shift(SensingTerm):
        def distort(self, t, names, values, pads):
            return values + 1e-3
    with_term = _run(make(1, terms=(Shift(),)), 0.02, 1.0)
    without = _run(make(1, terms=()), 0.02, 1.0)
    kept = {'Em': 'position', 'Optical': 'points', 'Force': 'force'}[make.__name__]
    for a, b in zip(with_term, without, strict=True):
        difference = getattr(a, kept) - getattr(b, kept)
        np.testing.assert_allclose(difference[np.isfinite(difference)], 1e-3, atol=1e-12)


def test_bank_states_share_no_memory():
    banks = [SimulatedBank(NAMES, [0.03] * 3, ActuatorParams(), (ActuatorLag(), Backlash()),
                           np.random.default_rng(1), homed=True) for _ in range(2)]
    for bank in banks:
        bank.connect()
        bank.move([0.01, 0.02, 0.005])
    for k in range(1, 60):
        spoiled, clean = (bank.read(0.02 * k) for bank in banks)
        for x, y in zip(_arrays(spoiled), _arrays(clean), strict=True):
            np.testing.assert_array_equal(x, y)
            x[...] = 1


@pytest.mark.parametrize('cls', PARAMS + TERMS)
def test_parameters_survive_yaml_and_refuse_what_is_out_of_range(cls):
    default = cls()
    assert from_mapping(cls, to_mapping(default), 'x.yaml') == default
    for name, info in quantities(cls).items():
        if info.low is None:
            continue
        below = info.low - 1.0
        bad = {info.key(name): [below] * 3 if info.shape else below}
        with pytest.raises(ConfigError, match=info.key(name)):
            from_mapping(cls, bad, 'x.yaml')


@pytest.mark.parametrize('cls', PARAMS + PROBING + TERMS)
def test_every_number_says_where_it_comes_from(cls):
    for name, info in quantities(cls).items():
        assert info.text
        conventional = name in ('phase', 'roll') or name.startswith(('generator_', 'seroma_c'))
        assert info.source or conventional, f'{cls.__name__}.{name} has no source'


@pytest.mark.parametrize('cls', TERMS)
def test_terms_are_documented_and_fittable(cls):
    spec = cls.spec
    assert spec.equation
    assert spec.source
    assert spec.invisible_when
    assert all(info.prior is not None for info in quantities(cls).values())


def test_readme_table_is_the_declarations():
    """Every parameter, with its default in edge units, stands in the README of the package."""
    text = (Path(arm_brachy.devices.__file__).parent / 'README.md').read_text(encoding='utf-8')
    for cls in PARAMS + PROBING + TERMS:
        for key, value in to_mapping(cls()).items():
            if key == 'cameras' or isinstance(value, dict):
                continue
            assert f'| {cls.__name__} | `{key}` | {value} |' in text
