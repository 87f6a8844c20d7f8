"""Noise, quantisation, clocks and dropouts are as large as they are said to be."""
import numpy as np

from arm_brachy.prove.generator.sensors import (
    RATES,
    coloured,
    draw_sensors,
    lost,
    quantise,
    sample_times,
)


def test_noise_has_its_deviation_and_its_share_of_memory():
    x = coloured(np.random.default_rng(0), (200_000,), 0.01, 50.0, 0.25)
    # The AR(1) part has a memory of 15 samples: some 7000 independent ones, 1 % of deviation.
    assert abs(x.std() / 0.01 - 1) < 0.03
    next_one = np.corrcoef(x[:-1], x[1:])[0, 1]
    assert abs(next_one - 0.25 * np.exp(-1 / 15)) < 0.03


def test_quantised_values_are_whole_steps():
    x = quantise(np.linspace(0, 1, 999), 0.002)
    np.testing.assert_allclose(np.round(x / 0.002), x / 0.002, atol=1e-9)


def test_clocks_are_late_by_what_was_drawn():
    sensors = draw_sensors(np.random.default_rng(3))
    for stream, rate in RATES.items():
        true, stamps = sample_times(np.random.default_rng(4), sensors, stream, 60.0)
        assert abs(np.mean(stamps - true) - sensors.clock[stream]) < 2e-5
        assert abs(sensors.clock[stream]) <= 2e-3
        assert abs(np.median(np.diff(true)) * rate - 1) < 1e-9
        assert (np.diff(stamps) > 0).all()


def test_dropouts_come_in_bursts():
    t = np.arange(0, 6000, 1 / 60)
    gone = lost(np.random.default_rng(5), t, 1 / 40)
    # One burst of 0.275 s on average every 40 s, and two single samples in a thousand.
    assert abs(gone.mean() - (0.275 / 40 + 0.002)) < 0.003
    assert (gone[1:] & gone[:-1]).mean() > 0.5 * gone.mean()
