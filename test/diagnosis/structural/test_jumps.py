"""Steps of single channels."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.random import stream as draws
from arm_brachy.diagnosis.isolation.steps import jumps
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.noise import Noise
from arm_brachy.diagnosis.signals.stream import OPTICAL, TISSUE, Stream
from arm_brachy.diagnosis.statistics.noise_process import Colour

PERIOD, DEPTH = 0.02, np.array([0.25, -0.80, 0.55])
SD, LOUD = 3e-5, 2e-4       # m: across the camera's view, and in depth
CHANNELS, STEPPING, SAMPLES = 40, 8, 1000
STEP = 6e-5


def test_a_step_across_the_view_of_a_camera_that_is_loud_in_depth():
    """It looks along none of the world's axes: in each of these the step is below the noise."""
    rng, depth = draws(0, 'jumps'), DEPTH / np.linalg.norm(DEPTH)
    values = (SD * rng.standard_normal((SAMPLES, CHANNELS, 3))
              + LOUD * rng.standard_normal((SAMPLES, CHANNELS, 1)) * depth)
    across = np.cross(depth, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    values[SAMPLES // 2:, :STEPPING] += STEP * across
    covariance = SD**2 * np.eye(3) + LOUD**2 * np.outer(depth, depth)
    sd = np.sqrt(np.diag(covariance))
    t, names = PERIOD * np.arange(SAMPLES), tuple(f'm{i}' for i in range(CHANNELS))
    stream = Stream(OPTICAL, t, names, values, np.ones(values.shape[:2], dtype=bool),
                    (TISSUE,) * CHANNELS, np.zeros((CHANNELS, 3)))
    noise = Noise(np.tile(sd, (CHANNELS, 1)), Colour(), PERIOD, covariance / np.outer(sd, sd),
                  'idle')
    travel = t, 1e-3 * np.sin(t)[:, None]
    prepared = SimpleNamespace(
        on=lambda kind, *bodies: (stream, noise) if kind == OPTICAL else (None, None),
        evidence=SimpleNamespace(pads=()), calibration=Calibration(),
        motion=SimpleNamespace(touch=np.zeros(1)))
    found = jumps(prepared, travel, {}, alarm=1e-3)
    assert [one.channel for one in found] == list(names[:STEPPING])
    for one in found:
        assert one.step.size @ across == pytest.approx(STEP, abs=2e-5)
