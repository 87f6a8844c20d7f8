"""Sensing terms in the whole cell: each in its own stream, the rest to the bit as without."""

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.core import config
from arm_brachy.core.paths import config_dir
from arm_brachy.scenario import Scenario, resolve

PATH = config_dir() / 'scenarios' / 'in_process.yaml'  # no such file; scenes are found from there
TERMS = {
    'em': [{'name': 'em_offset', 'offset_mm': [0.0, 2.0, 0.0], 'tools': ['target_1']},
           {'name': 'clock_offset', 'stream': 'em', 'delay_ms': 60}],
    'optical': [{'name': 'optical_scale', 'scale': 0.01},
                {'name': 'clock_offset', 'stream': 'optical', 'delay_ms': -30}],
    'force': [{'name': 'axis_crosstalk', 'onward': [0.1, 0, 0], 'pads': ['pad_1']},
              {'name': 'force_gain', 'gain': 0.1, 'pads': ['pad_2']},
              {'name': 'force_drift', 'rate_N_min': [3.0, 0.0, 0.0]},
              {'name': 'clock_offset', 'stream': 'force', 'delay_ms': 20}],
}


def run(terms=()):
    """Three seconds of task 1 in open loop, so that no sensor moves a pad."""
    task = {'name': 'task_1', 'target': 'target_1', 'axes': ['x'], 'displacement_mm': [-5, 0, 0],
            'duration_s': 7.0}
    plant = {'mesh': {'file': '../scenes/breast/breast_600.msh'}, 'element': 'linear',
             'terms': list(terms)}
    given = {'name': 'in_process', 'seed': 3, 'scene': '../scenes/breast.yaml', 'settle_s': 0.5,
             'model': {'element': 'linear'}, 'plant': plant, 'control': {'loop': 'open'},
             'force': {'resolution_N': 0.0, 'noise_N': 0.0}, 'tasks': [task]}
    cell = resolve(config.from_mapping(Scenario, given, 'in_process'), PATH)
    loop = inprocess.InProcess(cell, inprocess.SENSORS)
    while loop.t < 3.0 - 1e-9:
        loop.tick()
    return loop.data()


@pytest.fixture(scope='module')
def plain():
    return run()


@pytest.fixture(scope='module', params=TERMS)
def distorted(request):
    return request.param, run(TERMS[request.param])


def values(data):
    """stream -> (stamps (k,), values (k, ...))."""
    em = data.em['target_1']
    return {'em': (em.t, em.position), 'optical': (data.optical.t, data.optical.points),
            'force': (data.force.t, data.force.values),
            'encoder': (data.encoder.t, data.encoder.values),
            'pads': (data.pad_displacement.t, data.pad_displacement.values)}


def test_other_streams_are_to_the_bit_as_without(plain, distorted):
    stream, data = distorted
    seen, expected = values(data), values(plain)
    for other in seen.keys() - {stream}:
        for a, b in zip(seen[other], expected[other], strict=True):
            assert a.tobytes() == b.tobytes(), other
    assert np.abs(np.diff(expected['pads'][1], axis=0)).max() > 1e-4


def test_the_stream_itself_differs_by_its_terms(plain, distorted):
    """Stamp by stamp: the equation of the terms on the plain run's values of that instant."""
    stream, data = distorted
    (t, seen), (t0, true) = values(data)[stream], values(plain)[stream]
    delay = {'em': 0.06, 'optical': -0.03, 'force': 0.02}[stream]
    n = min(len(t), len(t0))
    assert n > 0.9 * len(t0)
    np.testing.assert_allclose(t[:n], t0[:n] + delay, atol=1e-9)
    seen, true, when = seen[:n], true[:n], t0[:n]
    if stream == 'em':
        expected = true + [0.0, 2e-3, 0.0]
        np.testing.assert_allclose(seen, expected, atol=1e-12)
    elif stream == 'optical':   # noise and calibration error are not scaled
        np.testing.assert_allclose(seen - true, 0.01 * true, atol=1e-5)
    else:
        gain = np.array([1.0, 1.1, 1.0, 1.0])[:, None]
        mixed = true.copy()
        mixed[:, 0, 1] += 0.1 * true[:, 0, 0]
        expected = gain * mixed + when[:, None, None] * [0.05, 0.0, 0.0]
        np.testing.assert_allclose(seen, expected, atol=1e-12)


def test_no_sample_comes_before_its_stamp(distorted):
    stream, data = distorted
    stamps = values(data)[stream][0]
    assert np.all(np.diff(stamps) > 0.0)
    assert stamps[0] >= 0.0 and stamps[-1] <= 3.0 + 1e-9
