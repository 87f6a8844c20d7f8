"""A clock that is off: truth of another time, through every device that stamps."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy import registry
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.actuator import ActuatorParams, SimulatedBank
from arm_brachy.devices.em_tracker import EmTracker, EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams, OpticalTracker
from arm_brachy.devices.terms.actuator_lag import ActuatorLag
from arm_brachy.devices.terms.clock_offset import ClockOffset
from arm_brachy.devices.terms.marker_slip import MarkerSlip

EM = replace(EmTrackerParams(), position_noise=0.0, dropout_probability=0.0)
OPTICAL = replace(OpticalParams(), noise=0.0, calibration_error=0.0, occlusion_probability=0.0,
                  dropout_probability=0.0)
FORCE = replace(ForceSensorParams(), noise=0.0, moment_noise=0.0, resolution=0.0,
                moment_resolution=0.0)
NO_PADS, TURNS, REST = np.zeros((0, 3)), np.eye(3)[None], np.zeros((1, 3))
TICK, SIZE, OMEGA = 0.01, 0.01, 3.0
# Chords of the sine between ticks are off by this at most.
CHORD = SIZE * (OMEGA * TICK)**2 / 8.0


def sine(t):
    """Position [m], or force [N], of the one thing there is to see, (1, 3)."""
    return SIZE * np.sin(OMEGA * t) * np.array([[1.0, 0.0, -0.5]])


def em(terms, path):
    """(stamp, position (3,)) of every sample over two seconds of `path`."""
    tracker = EmTracker(EM, ('tool',), terms, np.random.default_rng(1))
    return [(s.t, s.position) for a, b in _ticks()
            for s in tracker.advance(a, path(a), TURNS, b, path(b), TURNS, NO_PADS, NO_PADS)]


def optical(terms, path):
    """See `em`."""
    tracker = OpticalTracker(OPTICAL, ('marker',), terms, np.random.default_rng(1))
    return [(s.t, s.points[0]) for a, b in _ticks()
            for s in tracker.advance(a, path(a), b, path(b), NO_PADS, NO_PADS)]


def force(terms, path):
    """See `em`; the path is one of forces."""
    sensor = ForceSensor(FORCE, ('pad',), terms, np.random.default_rng(1))
    return [(s.t, s.force) for a, b in _ticks()
            for s in sensor.advance(a, path(a), REST, b, path(b), REST, REST, REST)]


def _ticks():
    return [(TICK * k, TICK * (k + 1)) for k in range(200)]


STREAMS = {'em': em, 'optical': optical, 'force': force}


@pytest.mark.parametrize('stream', STREAMS)
@pytest.mark.parametrize('delay', [0.02, 0.0137, 0.2, -0.02, -0.2])
def test_a_sample_shows_the_truth_of_its_stamp_less_the_delay(stream, delay):
    samples = STREAMS[stream]((ClockOffset(stream=stream, delay=delay),), sine)
    assert len(samples) > 60
    for t, seen in samples:
        np.testing.assert_allclose(seen, sine(t - delay)[0], atol=CHORD)


def test_offsets_add_up():
    terms = (ClockOffset(delay=0.03), ClockOffset(delay=-0.01))
    for (t, seen), (t1, seen1) in zip(optical(terms, sine),
                                      optical((ClockOffset(delay=0.02),), sine), strict=True):
        assert t == pytest.approx(t1, abs=1e-12)
        np.testing.assert_array_equal(seen, seen1)


def test_events_happen_in_true_time():
    """A marker that slips at 1 s is seen to slip at 1 s plus the delay."""
    terms = (MarkerSlip(marker=0, onset=1.0, offset=(1e-3, 0.0, 0.0)), ClockOffset(delay=0.25))
    shift = [(t, seen[0]) for t, seen in optical(terms, lambda t: np.zeros((1, 3)))]
    assert min(t for t, x in shift if x > 0.0) == pytest.approx(1.25, abs=1e-9)


@pytest.mark.parametrize('delay', [0.02, 0.06])
def test_for_markers_alone_it_is_a_dead_time_of_the_actuators(delay):
    """A pad marker under either: equal stamps, equal places; no marker can tell them apart."""
    still, late = _pad_path(), _pad_path(ActuatorLag(time_constant=0.0, delay=delay))
    by_clock = dict(_to_ns(optical((ClockOffset(delay=delay),), still)))
    by_motor = dict(_to_ns(optical((), late)))
    common = sorted(by_clock.keys() & by_motor.keys())
    assert len(common) > 180
    np.testing.assert_allclose([by_clock[ns] for ns in common], [by_motor[ns] for ns in common],
                               atol=1e-12)
    moving = [ns for ns in common if 0.2e9 < ns < 0.8e9]
    ahead = dict(_to_ns(optical((), still)))
    assert min(abs(ahead[ns][0] - by_motor[ns][0]) for ns in moving) > 1e-4


def _pad_path(*terms):
    """True place of a pad sent off at t = 0, as a function of time on the ticks."""
    params = replace(ActuatorParams(), encoder_resolution=0.0, effort_noise=0.0)
    bank = SimulatedBank(('pad',), [0.03], params, terms, homed=True)
    bank.connect()
    bank.move([0.02])
    where = {0: 0.0, **{k: float(bank.read(TICK * k).pad[0]) for k in range(1, 201)}}
    return lambda t: np.array([[where[round(t / TICK)], 0.0, 0.0]])


def _to_ns(samples):
    return [(round(t * 1e9), seen) for t, seen in samples]


@pytest.mark.parametrize('stream', STREAMS)
def test_it_goes_to_the_device_of_its_stream(stream):
    terms = registry.parse_terms([{'name': 'clock_offset', 'stream': stream, 'delay_ms': -15}],
                                 'test')
    parts = registry.split(terms)
    assert {stage for stage, found in parts.items() if found} == {Stage(stream)}
    assert parts[Stage(stream)][0].lateness == pytest.approx(-0.015)


def test_a_stream_that_does_not_exist_is_refused():
    with pytest.raises(ConfigError, match="stream = 'encoder'; must be"):
        registry.parse_terms([{'name': 'clock_offset', 'stream': 'encoder'}], 'test')
