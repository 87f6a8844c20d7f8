"""A cavity in the images: its outline in a picture, its centre over a sweep, or none."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.devices.cavity_detector import (
    CavityDetector,
    CavityDetectorParams,
    CavityLocaliser,
)
from arm_brachy.devices.ultrasound_imager import Imager, ImagerParams

PARAMS, RADIUS = ImagerParams(target_radius=0.005), 0.005
IMAGE, TOP = PARAMS.image, 0.05
CENTRE = np.array([0.001, 0.002, 0.028])
# The probe looks down; the needle runs along world y, across its plane.
R_WP = np.column_stack([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
R_NEEDLE = np.column_stack([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def block():
    """Nodes and tetrahedra of a block of 44 x 44 x 50 mm, 11 mm apart across."""
    axes = [np.linspace(-0.022, 0.022, 5), np.linspace(-0.022, 0.022, 5), np.linspace(0, TOP, 6)]
    nodes = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(5, 5, 6)
    kuhn = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7],
                     [0, 5, 1, 7]])
    corners = np.array([number[i:i + 2, j:j + 2, k:k + 2].ravel()
                        for i, j, k in np.ndindex(4, 4, 5)])
    return nodes, corners[:, kuhn].reshape(-1, 4)


NODES, TETS = block()


def sweep(seed, last, params=PARAMS, target=CENTRE, inclusions=()):
    """Frames of a plane that goes with the tip, from 8 mm before the middle to `last` [m]."""
    made = Imager(params, NODES, TETS, inclusions, np.random.default_rng(seed), target=target)
    frames = []
    for k, y in enumerate(np.arange(-0.008, last + 1e-9, 0.25e-3)):     # 5 mm/s at 20 Hz
        probe = R_WP, np.array([0.0, CENTRE[1] + y, TOP])
        tip = np.array([0.0, CENTRE[1] + y, 0.0295])
        shaft = np.linspace(tip - [0.0, 0.05, 0.0], tip, 30)
        frames.append(made.see(0.05 * k, NODES, probe, None, shaft, probe, (R_NEEDLE, tip)))
    return frames


@pytest.mark.parametrize('seed', [0, 1])
def test_a_cavity_is_located_before_the_needle_is_in_its_middle(seed):
    """Plane and tip stop 1.5 mm before it; needle and comet tail cross the cavity all the way."""
    frames = sweep(seed, last=-1.5e-3)
    assert frames[0].cavity is None
    cavity = frames[-1].cavity
    assert np.linalg.norm(cavity.centre - CENTRE) < 0.5e-3
    assert cavity.radius == pytest.approx(RADIUS, abs=0.5e-3)
    sd = np.sqrt(np.linalg.eigvalsh(cavity.covariance)[-1])
    assert np.linalg.norm(cavity.centre - CENTRE) < 3.0 * sd < 3.0 * PARAMS.cavity.sd_most


def test_speckle_and_a_solid_mass_are_no_cavity():
    """A mass is darker by 10 dB, fluid by 40."""
    elsewhere = CENTRE + [0.0, 0.1, 0.0]        # outside of the block
    for inclusions in ((), ((CENTRE, RADIUS, 5.0),)):
        assert all(f.cavity is None for f in sweep(2, 0.0, target=elsewhere,
                                                   inclusions=inclusions))


def test_a_target_without_echo_is_not_searched_for():
    assert all(f.cavity is None for f in sweep(0, -6e-3, replace(PARAMS, target_radius=0.0)))


def test_the_outline_is_where_the_plane_cuts_the_sphere():
    """Also under a needle: within 0.3 mm of the circle, on average over its edge."""
    detector = CavityDetector(PARAMS.cavity, IMAGE)
    for frame, y in zip(sweep(3, 0.0)[20::4], np.arange(-0.008, 1e-9, 0.25e-3)[20::4],
                        strict=True):
        head = np.array([0.0, TOP - 0.0295])
        points = detector.outline(frame.picture, head, head)
        middle = np.array([-CENTRE[0], TOP - CENTRE[2]])
        true = np.sqrt(RADIUS**2 - y**2)
        assert np.linalg.norm(points - middle, axis=1).mean() == pytest.approx(true, abs=0.3e-3)


def circles(heights, centre, radius):
    """Outlines of a sphere in planes at `heights` [m] along y, as from a probe at the origin."""
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    for h in heights:
        r = np.sqrt(radius**2 - (h - centre[1])**2)
        yield h, np.column_stack([centre[0] + r * np.cos(turn), centre[2] + r * np.sin(turn)])


def test_a_sphere_is_found_exactly_and_surer_with_a_wider_sweep():
    centre, sd = np.array([2e-3, 5e-3, 0.02]), []
    for first in (1.5e-3, 2.5e-3):
        localiser = CavityLocaliser(CavityDetectorParams())
        for k, (h, edge) in enumerate(circles(np.arange(first, 4.6e-3, 0.5e-3), centre, RADIUS)):
            localiser.see(0.1 * k, np.eye(3), np.array([0.0, h, 0.0]), edge)
        found = localiser.cavity
        assert np.allclose(found.centre, centre, atol=1e-9)
        assert found.radius == pytest.approx(RADIUS)
        sd.append(np.sqrt(found.covariance[1, 1]))
    assert sd[0] < 0.7 * sd[1]


def test_a_plane_that_stands_still_says_nothing_of_the_third_direction():
    localiser = CavityLocaliser(CavityDetectorParams())
    for k in range(50):
        (h, edge), = circles([3e-3], np.array([0.0, 5e-3, 0.02]), RADIUS)
        localiser.see(0.05 * k, np.eye(3), np.array([0.0, h, 0.0]), edge)
    assert localiser.cavity is None


def test_planes_expire_while_nothing_is_seen():
    """Known within the memory of the last plane, not after it."""
    params, centre = CavityDetectorParams(memory=2.0), np.array([2e-3, 5e-3, 0.02])
    localiser = CavityLocaliser(params)
    for k, (h, edge) in enumerate(circles(np.arange(1.5e-3, 4.6e-3, 0.5e-3), centre, RADIUS)):
        localiser.see(0.1 * k, np.eye(3), np.array([0.0, h, 0.0]), edge)
    for t, known in ((1.0, True), (0.6 + 2.1, False)):
        localiser.see(t, np.eye(3), np.zeros(3), None)
        assert (localiser.cavity is not None) == known


def test_a_picture_without_the_cavity_tells_no_target():
    """The plane sweeps into the cavity, then jumps off it by 12 mm and comes back later."""
    made = Imager(PARAMS, NODES, TETS, (), np.random.default_rng(0), target=CENTRE)

    def see(t, y):
        probe = R_WP, np.array([0.0, CENTRE[1] + y, TOP])
        tip = np.array([0.0, CENTRE[1] + y, 0.0295])
        shaft = np.linspace(tip - [0.0, 0.05, 0.0], tip, 30)
        return made.see(t, NODES, probe, None, shaft, probe, (R_NEEDLE, tip)).cavity

    sweep_in = [see(0.05 * k, y) for k, y in enumerate(np.arange(-5e-3, -1.2e-3, 0.25e-3))]
    assert sweep_in[-1] is not None
    assert [see(t, -0.012) for t in (1.0, 1.05, 2.0)] == [None] * 3
    assert see(3.0, -1.5e-3) is not None
    assert see(3.0 + PARAMS.cavity.memory + 0.5, -1.5e-3) is None      # one plane is no centre
