"""The live comparison on made-up streams: silent when sound, quick and exact when not."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.diagnosis.monitoring import Limits, Watched, threshold, watched
from arm_brachy.diagnosis.residual_monitor import WAITING, Monitor
from arm_brachy.diagnosis.statistics.noise_process import Colour

PERIOD, SD = 0.02, 0.15e-3      # s, m
NAMES = ('a', 'b', 'c', 'd')
HOME = 0.05 * np.arange(12.0).reshape(4, 3)
COLOURS = {'white': Colour(), 'mixed': Colour(0.5, 0.5), 'slow': Colour(1.0, 0.3)}
# s to find 5 sd; noise without a white part departs as far by itself, for as long as it remembers
WITHIN = {'white': 1.0, 'mixed': 1.0, 'slow': 3.0}
AT = 20.0           # s of a fault
STRAIGHT = np.array([1.0, 0.0, 0.0])


def noise(colour, seconds, seed):
    """(n, 4, 3) [m], white plus slow."""
    rng, n = np.random.default_rng(seed), round(seconds / PERIOD)
    white = np.sqrt(1.0 - colour.share) * rng.normal(size=(n, 4, 3))
    if not colour.share:
        return SD * white
    slow = ColouredNoise((4, 3), colour.time, PERIOD, rng)
    return SD * (white + np.sqrt(colour.share) * np.array([slow.draw() for _ in range(n)]))


def times(n):
    return PERIOD * np.arange(n)


def push(n):
    """(n, 1, 1) [m] there and back every 10 s at 8 mm/s, with holds; at rest for 3 s."""
    return np.interp((times(n) - 3.0) % 10.0 * (times(n) > 3.0), [0.0, 1.0, 4.0, 5.0],
                     [0.0, 8e-3, 8e-3, 0.0])[:, None, None]


def alarms(colour, measured, predicted=None, limits=None):
    """All Alarms over a run; the Monitor."""
    monitor = Monitor({'optical': Watched(NAMES, np.full((4, 3), SD), PERIOD, colour)}, limits)
    out = []
    for k, values in enumerate(measured):
        expected = HOME if predicted is None else HOME + predicted[k]
        out += monitor.predict(k * PERIOD, {'optical': expected})
        out += monitor.measure('optical', k * PERIOD, values)
    return out, monitor


@pytest.mark.parametrize('name', [
    'white', 'slow', pytest.param('mixed', marks=pytest.mark.validate)])
def test_ten_minutes_of_noise_raise_no_alarm(name):
    found, _ = alarms(COLOURS[name], HOME + noise(COLOURS[name], 600.0, 1))
    assert not found


@pytest.mark.parametrize('name', COLOURS)
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_step_of_five_sd_is_found_soon_and_named(name, sign):
    measured = HOME + noise(COLOURS[name], 40.0, 2)
    t = times(len(measured))
    measured[t >= AT, 2, 1] += sign * 5.0 * SD
    found, monitor = alarms(COLOURS[name], measured)
    first = found[0]
    assert (first.stream, first.channel, first.axis) == ('optical', 'c', 1)
    assert AT <= first.t <= AT + WITHIN[name] and abs(first.onset - AT) < 0.3
    assert {(alarm.channel, alarm.axis) for alarm in found} == {('c', 1)}
    assert first.size * sign == pytest.approx(5.0 * SD, abs=3.0 * SD)
    assert 'optical c is off its prediction' in str(first) and 'along y' in str(first)


def test_false_alarms_are_no_more_than_is_stated():
    """White noise, one per 5 s asked for, offsets known from 50 s."""
    limits = Limits(per_hour=720.0, lasts=0.0, zero=50.0)
    found, _ = alarms(Colour(), HOME + noise(Colour(), 400.0, 3), limits=limits)
    # 70 are asked for; what is forgiven of the offsets, 0.04 sd, takes exp(-0.08 h) of them, 40 %
    assert 42 - 4 * 7 < len(found) < 70 + 3 * 8


@pytest.mark.parametrize(('h', 'samples'), [(4.0, 336.0), (5.0, 930.0)])
def test_the_threshold_is_that_of_tables(h, samples):
    """Two-sided 168 and 465 at k = 0.5: Montgomery, Introduction to SPC, table of CUSUM runs."""
    assert threshold(1.0 / samples) == pytest.approx(h, abs=0.02)


def moving(error, seconds=60.0, late=0.0):
    """Alarms where the body moves `error` more than predicted, and stamps are late [s]."""
    n = round(seconds / PERIOD)
    predicted = push(n) * STRAIGHT
    true = (1.0 + error) * np.interp(times(n) - late, times(n), push(n)[:, 0, 0])
    found, _ = alarms(COLOURS['mixed'], HOME + true[:, None, None] * STRAIGHT
                      + noise(COLOURS['mixed'], seconds, 4), predicted)
    return found


def test_what_a_good_model_may_have_wrong_is_no_alarm():
    assert not moving(0.04) and not moving(-0.04) and not moving(0.0, late=0.004)


def test_more_than_that_is():
    found = moving(0.25)
    assert {alarm.axis for alarm in found} == {0} and found[0].t < 3.0 + 5.0


def test_a_clock_that_is_late_shows_while_the_body_moves():
    found = moving(0.0, late=0.1)
    assert found and (found[0].onset - 2.5) % 10.0 < 5.5     # 0.5 s before it shows, at most


def test_glitches_and_gaps_are_no_alarm():
    measured = HOME + noise(Colour(), 60.0, 5)
    measured[100::70, 1] += 5e-3
    measured[500:900, 3] = np.nan
    measured[:80, 0] = np.nan       # not seen while offsets are taken: no alarm ever
    found, _ = alarms(Colour(), measured)
    assert not found


def test_an_alarm_ends_with_its_cause():
    measured = HOME + noise(Colour(), 60.0, 7)
    t = times(len(measured))
    measured[(t >= AT) & (t < AT + 5.0), 0] += 6.0 * SD
    found, monitor = alarms(Colour(), measured)
    assert {alarm.channel for alarm in found} == {'a'} and len(found) == 3
    assert not monitor.active


def test_samples_wait_for_the_model_and_are_not_kept_for_ever():
    monitor = Monitor({'optical': Watched(NAMES, np.full((4, 3), SD), PERIOD)})
    for k in range(2 * WAITING):
        assert monitor.measure('optical', k * PERIOD, HOME + k * 1e-3) == ()
    assert len(monitor._waiting['optical']) == WAITING
    monitor.predict(0.0, {'optical': HOME})
    with pytest.raises(InputError, match='must increase'):
        monitor.predict(0.0, {'optical': HOME})


def test_streams_by_topic_and_noise_by_data_sheet():
    """Ten times the noise of a force sensor, in one pad of two that come by themselves."""
    params = ForceSensorParams(noise_correlation=0.0)
    topics = {f'force/{pad}/wrench': watched('force', (pad,), params) for pad in ('p', 'q')}
    monitor, rng, found = Monitor(topics), np.random.default_rng(8), []
    for k in range(1000):
        t = k / params.rate
        found += monitor.predict(t, dict.fromkeys(topics, np.zeros((1, 3))))
        for topic in topics:
            off = 10.0 * params.noise * (topic == 'force/q/wrench' and t > 5.0)
            found += monitor.measure(topic, t, params.noise * rng.normal(size=(1, 3)) + off)
    assert {(alarm.stream, alarm.channel) for alarm in found} == {('force', 'q')}
    assert {alarm.axis for alarm in found} == {0, 1, 2} and ' N along ' in str(found[0])


def one_axis(values, sd=0.02):
    """Alarms of a load cell that reads along its push alone, as a vector, where the model has
    forces across it as well; values (n,) [N] along the push.
    """
    push = np.array([0.6, 0.8, 0.0])
    model = np.interp(times(len(values)), [0.0, 4.0, 6.0, 60.0], [0.0, 0.0, 3.0, 3.0])
    forces = np.outer(model, push) + np.outer(model, [-0.4, 0.3, 0.5])
    stream = Watched(('pad',), np.full((1, 3), sd), PERIOD, Colour(), push[None])
    monitor, found = Monitor({'force/pad/wrench': stream}), []
    for k, (read, force) in enumerate(zip(values + model, forces, strict=True)):
        found += monitor.predict(k * PERIOD, {'force/pad/wrench': force[None]})
        found += monitor.measure('force/pad/wrench', k * PERIOD, (read * push)[None])
    return found


def test_a_sensor_of_one_axis_is_compared_along_it_alone():
    """Across its push the model has 2 N that no sensor reads: no departure."""
    noise = 0.02 * np.random.default_rng(5).normal(size=1500)
    assert not one_axis(noise)
    off = noise + 0.5 * (times(1500) > AT)
    first = one_axis(off)[0]
    assert AT < first.t < AT + 1.0 and first.size == pytest.approx(0.5, abs=0.1)
    assert 'along its push since' in str(first)


def test_a_sensor_of_three_axes_is_compared_along_all_of_them():
    """The same stream whose readings across are noise: that the model has forces there is seen."""
    rng = np.random.default_rng(6)
    push = np.array([0.6, 0.8, 0.0])
    stream = Watched(('pad',), np.full((1, 3), 0.02), PERIOD, Colour(), push[None])
    monitor, found = Monitor({'force/pad/wrench': stream}), []
    model = np.interp(times(1500), [0.0, 4.0, 6.0, 60.0], [0.0, 0.0, 3.0, 3.0])
    for k, force in enumerate(model):
        found += monitor.predict(k * PERIOD, {'force/pad/wrench': (
            force * (push + [0.0, 0.0, 0.5]))[None]})
        found += monitor.measure('force/pad/wrench', k * PERIOD, (
            force * push + 0.02 * rng.normal(size=3))[None])
    assert {alarm.axis for alarm in found} == {2}
