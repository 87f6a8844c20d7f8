"""Speckle has the statistics that optics predict, and moves with the material."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from arm_brachy.devices.ultrasound import ImageFormer, UltrasoundParams, scatterers

PARAMS = UltrasoundParams()
FORMER = ImageFormer(PARAMS)
SY = PARAMS.sigma[1]
RAYLEIGH = np.sqrt(np.pi / (4.0 - np.pi))      # mean over sd of a Rayleigh variable
BOX = np.array([[-0.022, -4.0 * SY, -0.003], [0.022, 4.0 * SY, 0.041]])
RIM = 20                                        # pixels that see scatterers on one side only


def everywhere(points):
    return np.ones(len(points), dtype=bool)


def tissue(seed):
    return scatterers(everywhere, *BOX, PARAMS.density, np.random.default_rng(seed))


def half_width(profile, pixel):
    """Full width at half maximum [m] by linear interpolation."""
    above = np.flatnonzero(profile >= 0.5 * profile.max())
    i, j = above[0], above[-1]
    half = 0.5 * profile.max()
    left = i - (profile[i] - half) / (profile[i] - profile[i - 1])
    right = j + (profile[j] - half) / (profile[j] - profile[j + 1])
    return (right - left) * pixel


@pytest.mark.parametrize('place', [(0.0, 0.020), (0.0071, 0.0312), (-0.01234, 0.00991)])
def test_a_point_is_as_wide_as_the_point_spread_function(place):
    image = FORMER.envelope(np.array([[place[0], 0.0, place[1]]]), np.ones(1))
    v, u = np.unravel_index(image.argmax(), image.shape)
    assert np.isclose(half_width(image[v], PARAMS.pixel[0]), PARAMS.lateral, rtol=0.05)
    assert np.isclose(half_width(image[:, u], PARAMS.pixel[1]), PARAMS.axial, rtol=0.05)
    assert np.allclose([(u - 319.5) * PARAMS.pixel[0], v * PARAMS.pixel[1]], place,
                       atol=PARAMS.pixel.max())


def test_off_the_plane_an_echo_falls_to_half_at_half_the_elevation_width():
    peaks = [FORMER.envelope(np.array([[0.0, y, 0.02]]), np.ones(1)).max()
             for y in (0.0, 0.5 * PARAMS.elevation)]
    assert np.isclose(peaks[1] / peaks[0], 0.5, rtol=0.01)


def test_speckle_is_rayleigh_distributed():
    """Signal-to-noise ratio 1.913 and the distribution itself, on samples that do not overlap."""
    ratios, samples = [], []
    apart = (3.0 * PARAMS.sigma[[2, 0]] / PARAMS.pixel[::-1]).astype(int)
    for seed in range(6):
        image = FORMER.envelope(*tissue(seed))[RIM:-RIM, RIM:-RIM]
        ratios.append(image.mean() / image.std())
        samples.append(image[::apart[0], ::apart[1]].ravel())
        assert np.isclose(np.mean(image**2), 1.0, rtol=0.08)
    assert 1.87 < np.mean(ratios) < 1.95
    first = samples[0] / np.sqrt(np.mean(samples[0]**2) / 2.0)
    assert stats.kstest(first, stats.rayleigh.cdf).pvalue > 0.05


def correlation(a, b):
    """Correlation coefficient of two images' complex signals."""
    a, b = (s[RIM:-RIM, RIM:-RIM, 0] + 1j * s[RIM:-RIM, RIM:-RIM, 1] for s in (a, b))
    return np.abs(np.vdot(a, b)) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)


@pytest.mark.parametrize('shift', [0.5, 1.0, 2.0])
def test_speckle_decorrelates_with_motion_across_the_plane(shift):
    """exp(-d^2 / 4 sy^2): the overlap of two Gaussian slices."""
    points, amplitude = tissue(1)
    moved = points + [0.0, shift * SY, 0.0]
    found = correlation(FORMER.signal(points, amplitude), FORMER.signal(moved, amplitude))
    assert np.isclose(found, np.exp(-shift**2 / 4.0), atol=0.03)


@pytest.mark.parametrize('strain', [0.02, 0.05, 0.08])
def test_speckle_decorrelates_with_axial_strain(strain):
    """exp(-(2 k e sz)^2 / 4) where the displacement is zero: phases within the pulse fan out."""
    params = replace(PARAMS, width=512, height=128, aperture=0.65, depth=4e-3)
    former, middle = ImageFormer(params), 2e-3
    sums = np.zeros(3, dtype=complex)
    for seed in range(3):
        points, amplitude = scatterers(
            everywhere, [-0.31, -4 * SY, -1e-3], [0.31, 4 * SY, 5e-3], 0.1 * PARAMS.density,
            np.random.default_rng(seed))
        strained = points.copy()
        strained[:, 2] = middle + (1.0 + strain) * (points[:, 2] - middle)
        a, b = (former.signal(p, amplitude)[64, 10:-10] for p in (points, strained))
        a, b = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
        sums += [np.vdot(a, b), np.vdot(a, a), np.vdot(b, b)]
    k = 2.0 * np.pi * params.frequency / params.sound
    expected = np.exp(-(2.0 * k * strain * params.sigma[2])**2 / 4.0)
    found = np.abs(sums[0]) / np.sqrt(sums[1].real * sums[2].real)
    assert np.isclose(found, expected, atol=0.08)


def test_an_empty_cyst_is_dark_and_a_lump_of_twice_the_amplitude_6_dB_brighter():
    points, amplitude = tissue(2)
    middle = np.array([[-0.009, 0.0, 0.02], [0.009, 0.0, 0.02]])
    off = np.linalg.norm(points[:, None, [0, 2]] - middle[:, [0, 2]], axis=2) < 0.006
    changed = np.where(off[:, 0], 0.0, np.where(off[:, 1], 2.0, 1.0)) * amplitude
    v = round(0.02 / PARAMS.pixel[1])
    (_, before), (cyst, lump) = ([image[v - 25:v + 25, c - 40:c + 40] for c in (
        round(319.5 + m / PARAMS.pixel[0]) for m in middle[:, 0])] for image in (
            FORMER.envelope(points, a) for a in (amplitude, changed)))
    assert cyst.max() < 0.05
    assert np.isclose(10 * np.log10(np.mean(lump**2) / np.mean(before**2)), 6.02, atol=0.1)


def test_compression_spans_the_dynamic_range():
    levels = np.array([[1e-6, 1.0, 10.0**((PARAMS.dynamic_range / 2 - PARAMS.dynamic_range
                                            - PARAMS.brightness) / 20.0), 1e4]], dtype=np.float32)
    picture = FORMER.compress(levels)
    plain = 255.0 * (1.0 + PARAMS.brightness / PARAMS.dynamic_range)
    assert picture.dtype == np.uint8
    assert np.allclose(picture[0], [0, plain, 127.5, 255], atol=1.0)


def test_the_same_scatterers_give_the_same_picture():
    a, b = (FORMER.compress(FORMER.envelope(*tissue(3))) for _ in range(2))
    assert np.array_equal(a, b)
