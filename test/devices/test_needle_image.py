"""A needle in the image: where it is drawn, how it fades, and whether the detector finds it."""

import numpy as np
import pytest

from arm_brachy.devices.needle_echo import NeedleEcho, NeedleEchoParams
from arm_brachy.devices.tip_detector import TipDetector, TipDetectorParams
from arm_brachy.devices.ultrasound import ImageFormer, UltrasoundParams, scatterers

IMAGE, NEEDLE = UltrasoundParams(), NeedleEchoParams()
ECHO, FORMER = NeedleEcho(NEEDLE, IMAGE), ImageFormer(IMAGE)
ACROSS = np.array([0.0, 1.0, 0.0])
BACKGROUNDS = 4


def pixel_of(x, z):
    return 319.5 + x / IMAGE.pixel[0], z / IMAGE.pixel[1]


def speckle(seed):
    sy = IMAGE.sigma[1]
    points, amplitude = scatterers(
        lambda p: np.ones(len(p), dtype=bool), [-0.022, -3.1 * sy, -0.003],
        [0.022, 3.1 * sy, 0.041], IMAGE.density, np.random.default_rng(seed))
    return FORMER.envelope(points, amplitude)


@pytest.fixture(scope='module')
def backgrounds():
    return [speckle(seed) for seed in range(BACKGROUNDS)]


def test_the_head_stands_where_the_axis_pierces_the_plane():
    axis = np.array([0.1, 0.95, 0.2]) / np.linalg.norm([0.1, 0.95, 0.2])
    tip = np.array([0.004, 0.0, 0.02]) + 0.006 * axis
    image = ECHO.envelope(tip, axis)
    v, u = np.unravel_index(image.argmax(), image.shape)
    assert np.allclose((u, v), pixel_of(0.004, 0.02), atol=1.0)


def test_the_tail_decays_geometrically():
    image = ECHO.envelope([0.0, 0.001, 0.02], ACROSS)
    u = 319
    heights = [image[round((0.02 + k * NEEDLE.spacing) / IMAGE.pixel[1]), u] for k in range(5)]
    ratios = np.array(heights[1:]) / heights[:-1]
    overlap = np.exp(-0.5 * (NEEDLE.spacing / IMAGE.sigma[2])**2)
    assert np.allclose(ratios, 10**(NEEDLE.decay / 20), rtol=0.1 + 2 * overlap)


def test_short_of_the_plane_the_head_fades_as_the_beam_does_and_beyond_it_stays():
    sy = IMAGE.sigma[1]
    bright = [ECHO.envelope([0.0, y, 0.02], ACROSS).max() for y in (-2 * sy, -sy, 0.0, 0.01)]
    assert np.allclose(np.array(bright) / bright[2], [np.exp(-2.0), np.exp(-0.5), 1.0, 1.0],
                       rtol=0.01)


def places(n):
    rng = np.random.default_rng(8)
    return np.column_stack([rng.uniform(-0.014, 0.014, n), rng.uniform(0.006, 0.032, n)])


def test_the_detector_finds_it_within_half_a_millimetre_in_95_of_100_images(backgrounds):
    detector = TipDetector(TipDetectorParams(), IMAGE, NEEDLE)
    errors, missed = [], 0
    for k, (x, z) in enumerate(places(120)):
        envelope = backgrounds[k % BACKGROUNDS].copy()
        ECHO.add_to(envelope, [x, 0.0, z], ACROSS)
        picture = FORMER.compress(envelope)
        offset = 0.004 * np.array([np.cos(k), np.sin(k)])
        seen = detector.find(picture, np.array([x, z]) + offset)
        missed += not seen.found
        if seen.found:
            errors.append([seen.x - x, seen.z - z])
    assert missed <= 6
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=1))) < 0.5e-3


def test_speckle_alone_is_no_needle(backgrounds):
    detector = TipDetector(TipDetectorParams(), IMAGE, NEEDLE)
    pictures = [FORMER.compress(b) for b in backgrounds]
    alarms = sum(detector.find(pictures[k % BACKGROUNDS], place).found
                 for k, place in enumerate(places(60)))
    assert alarms <= 3


def test_a_search_beyond_the_image_says_that_nothing_was_found(backgrounds):
    detector = TipDetector(TipDetectorParams(), IMAGE, NEEDLE)
    assert not detector.find(FORMER.compress(backgrounds[0]), np.array([0.5, 0.5])).found
