"""Sample times are exact, whatever the ticks; truth between ticks is on the straight line."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.sampling import DelayLine, SampleTimes, fraction, lerp, slerp


@pytest.mark.parametrize(('rate', 'tick'), [(40.0, 0.02), (100.0, 0.02), (40.0, 0.012),
                                            (1000.0 / 3.0, 0.02), (29.97, 0.01), (100.0, 0.007)])
def test_every_sample_once_and_exact(rate, tick):
    times = SampleTimes(rate)
    n_ticks = round(60.0 / tick)
    seen = [s for k in range(n_ticks) for s in times.between(k * tick, (k + 1) * tick)]
    exact = Fraction(rate).limit_denominator(1000)
    last = int(n_ticks * Fraction(str(tick)) * exact)
    assert [s.number for s in seen] == list(range(1, last + 1))  # frame 0 is at t = 0, excluded
    assert all(s.ns == s.number * 10**9 // exact for s in seen)


def test_frame_zero_comes_at_the_phase():
    times = SampleTimes(40.0, 0.0125)
    assert times.between(0.0, 0.0125)[0] == (0, 12_500_000)
    assert times.between(0.0125, 0.0376)[0].number == 1
    assert times.between(0.0, 0.012) == []


@pytest.mark.parametrize(('rate', 'phase'), [(0.0, 0.0), (-1.0, 0.0), (np.nan, 0.0), (40.0, -1.0)])
def test_bad_times_are_refused(rate, phase):
    with pytest.raises(ConfigError, match='must be'):
        SampleTimes(rate, phase)


def test_lerp_and_fraction():
    instant = SampleTimes(40.0).between(0.02, 0.04)[0]
    assert fraction(instant, 0.02, 0.04) == pytest.approx(0.25)
    a, b = np.array([[1.0, 2.0, 3.0]]), np.array([[2.0, 4.0, 6.0]])
    np.testing.assert_allclose(lerp(a, b, 0.25), [[1.25, 2.5, 3.75]])
    end = lerp(a, b, 1.0)
    np.testing.assert_array_equal(end, b)
    assert not np.shares_memory(end, b)


def test_slerp_turns_evenly_about_one_axis():
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    start = Rotation.from_rotvec([[0.3, 0.1, -0.2]])
    end = start * Rotation.from_rotvec([1.2 * axis])
    middle = slerp(start.as_matrix(), end.as_matrix(), 0.25)
    expected = (start * Rotation.from_rotvec([0.3 * axis])).as_matrix()
    np.testing.assert_allclose(middle, expected, atol=1e-14)


def test_delay_line_delivers_in_order_after_the_latency():
    times = SampleTimes(40.0)
    line = DelayLine(times, 0.03)
    out = {}
    for k in range(20):
        t0, t1 = 0.02 * k, 0.02 * (k + 1)
        new = [(s.number, s) for s in times.between(t0, t1)]
        for s in line.exchange(new, t0, t1):
            out[s.number] = (t0, s.t + 0.03, t1)
    assert list(out) == list(range(1, 15))
    assert all(t0 < due <= t1 + 1e-12 for t0, due, t1 in out.values())
