"""The imager: needle and grid where geometry puts them, tip found in a deforming body."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.devices.needle import NeedleParams, NeedlePath
from arm_brachy.devices.ultrasound import UltrasoundParams
from arm_brachy.devices.ultrasound_imager import Imager, ImagerParams, aperture_share, echo_regions
from arm_brachy.robot.reference import rotation
from arm_brachy.robot.template import ImageGeometry, Template, TemplateParams

PARAMS = ImagerParams()
IMAGE = PARAMS.image
GEOMETRY = ImageGeometry(IMAGE.width, IMAGE.height, tuple(1.0 / IMAGE.pixel))
# The probe looks down on a slab, its plane across the needles, which run along world y.
R_WP = np.column_stack([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
TOP = 0.05
PROBE = (R_WP, np.array([0.0, 0.0, TOP]))
TEMPLATE = Template(TemplateParams(),
                    np.column_stack([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
                    np.array([0.0, -0.06, 0.03]))


def slab():
    """Nodes and tetrahedra of 44 x 44 x 50 mm, 11 mm apart across, linear."""
    axes = [np.linspace(-0.022, 0.022, 5), np.linspace(-0.022, 0.022, 5), np.linspace(0, TOP, 6)]
    nodes = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(5, 5, 6)
    kuhn = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7],
                     [0, 5, 1, 7]])
    corners = np.array([number[i:i + 2, j:j + 2, k:k + 2].ravel()
                        for i, j, k in np.ndindex(4, 4, 5)])
    return nodes, corners[:, kuhn].reshape(-1, 4)


NODES, TETS = slab()


def imager(params=PARAMS, seed=0, inclusions=()):
    return Imager(params, NODES, TETS, inclusions, np.random.default_rng(seed), TEMPLATE, GEOMETRY)


@pytest.fixture(scope='module')
def still():
    """One imager for the tests that ask for single frames, a second apart."""
    made, clock = imager(), iter(range(10**6))

    def see(**given):
        full = {'x': NODES, 'probe': PROBE, 'pressure': None, 'shaft': None, 'told_probe': PROBE,
                'told_tip': None, **given}
        return made.see(float(next(clock)), **full)
    return see


def needle(hole, depth, radius=np.inf):
    path = NeedlePath(replace(NeedleParams(), radius=radius), TEMPLATE.hole(*hole), TEMPLATE.axis,
                      TEMPLATE.R[:, 0])
    path.advance(depth)
    return path.shaft(41), (np.column_stack([path.n, np.cross(path.t, path.n), path.t]), path.p)


@pytest.mark.parametrize('hole', [(6, 6), (4, 8), (8, 5)])
def test_grid_and_needle_are_where_the_needle_truly_crosses_the_plane(still, hole):
    """Within 2 pixels, with the probe turned 10 degrees and 3 mm off."""
    turned = (R_WP @ rotation(np.array([0.1, 0.05, 0.13])), np.array([0.003, 0.0, TOP]))
    shaft, _ = needle(hole, 0.07)
    frame = still(probe=turned, told_probe=turned, shaft=shaft)
    local = (shaft - turned[1]) @ turned[0]
    x, z = (np.interp(0.0, local[:, 1], local[:, k]) for k in (0, 2))
    true = np.array([z / IMAGE.pixel[1], x / IMAGE.pixel[0] + 0.5 * (IMAGE.width - 1)])
    corner = np.rint(true).astype(int) - 8
    window = tuple(slice(c, c + 17) for c in corner)
    drawn = (np.ptp(frame.overlay[window].astype(int), axis=2) > 60).nonzero()
    bright = (frame.picture[window] >= 250).nonzero()
    for found in (drawn, bright):
        assert len(found[0]) > 6
        assert np.linalg.norm(np.mean(found, axis=1) + corner - true) < 2.0


def test_the_picture_marks_where_the_tip_will_be_and_where_it_is_to_be():
    """Both along the needle onto the plane, within a pixel; not once they are old."""
    made, forward = imager(), TEMPLATE.axis
    ends = np.array([[0.004, 0.02, 0.028], [-0.003, 0.02, 0.033]])     # 20 mm ahead of the plane
    made.hear_aim(0.0, ends)

    def marks(t):
        drawn = made.see(t, NODES, PROBE, None, None, PROBE, None).overlay.astype(int)
        magenta = (drawn[..., 0] > 200) & (drawn[..., 2] > 200) & (drawn[..., 1] < 120)
        cyan = (drawn[..., 1] > 200) & (drawn[..., 2] > 200) & (drawn[..., 0] < 60)
        return [np.argwhere(kind) for kind in (magenta, cyan)]

    assert np.allclose(forward, [0.0, 1.0, 0.0])
    for place, (x, _, z) in zip(marks(0.1), ends, strict=True):
        true = np.array([(TOP - z) / IMAGE.pixel[1],
                         -x / IMAGE.pixel[0] + 0.5 * (IMAGE.width - 1)])
        middle = 0.5 * (place.min(axis=0) + place.max(axis=0))
        assert len(place) > 10 and np.abs(middle - true).max() <= 1.0
    assert not any(len(place) for place in marks(2.0))


def test_what_is_foretold_of_a_tip_is_two_places_and_the_newest():
    made = imager()
    for places in (np.zeros((1, 3)), np.zeros((0, 3))):
        with pytest.raises(InputError, match='must be two'):
            made.hear_aim(0.0, places)
    new, old = np.array([[0.0, 0.02, 0.03]] * 2), np.array([[0.01, 0.02, 0.03]] * 2)
    drawn = []
    for heard in ([(0.1, new)], [(0.1, new), (0.0, old)]):
        made = imager()
        for t, places in heard:
            made.hear_aim(t, places)
        drawn.append(made.see(0.1, NODES, PROBE, None, None, PROBE, None).overlay)
    assert np.array_equal(*drawn)


def test_the_tip_is_told_in_the_world_by_the_told_pose(still):
    told = (R_WP @ rotation(np.array([0.0, 0.0, 0.02])), PROBE[1] + [4e-4, 0.0, -3e-4])
    shaft, tip = needle((6, 6), 0.06)
    frame = still(shaft=shaft, told_probe=told, told_tip=tip)
    seen = np.array([frame.detection.x, 0.0, frame.detection.z])
    assert frame.outcome is Outcome.OK
    assert np.allclose(frame.tip_W, told[1] + told[0] @ seen, atol=1e-12)
    assert np.linalg.norm(PROBE[1] + R_WP @ seen - tip[1]) < 5e-4


def test_the_tip_is_found_in_a_deforming_body_while_the_needle_advances():
    """RMSE at most 0.5 mm, found in 95 % of the frames; the true radius is not the told one.

    The probe stays 0.3 mm rms about the tip; the slab is pressed, sheared and bulges.
    """
    made, rng, errors, missed = imager(), np.random.default_rng(4), [], 0
    for k in range(60):
        depth, press = 0.045 + 5e-4 * k, 0.05 + 0.05 * np.sin(0.15 * k)
        x = NODES * [1.0 + 0.5 * press, 1.0 + 0.5 * press, 1.0 - press]
        x[:, 0] += 0.1 * press * x[:, 2] + 5.0 * press * x[:, 1]**2
        shaft, true = needle((6, 6), depth, 0.36)
        told = needle((6, 6), depth + 1e-4 * rng.standard_normal(), 0.4)[1]
        at = np.array([0.0, true[1][1] + 3e-4 * rng.standard_normal(), TOP * (1.0 - press)])
        frame = made.see(0.05 * k, x, (R_WP, at), None, shaft, (R_WP, at), told)
        missed += frame.tip_W is None
        if frame.tip_W is not None:
            errors.append((frame.tip_W - true[1])[[0, 2]])
    rmse = np.sqrt(np.mean(np.sum(np.square(errors), axis=1)))
    assert missed <= 3 and rmse < 0.5e-3, f'{missed} of 60 missed, RMSE {1e3 * rmse:.3f} mm'


def test_without_contact_the_strips_are_dark_and_deep_points_see_past_them(still):
    pressure = np.full(16, 5e3)
    pressure[:6] = 0.0
    plain, dark = still().picture.astype(float), still(pressure=pressure).picture.astype(float)
    lost = IMAGE.width * 6 // 16
    top = slice(20, 120)
    assert dark[top, :lost - 60].max() == 0.0
    assert np.array_equal(dark[top, lost + 60:], plain[top, lost + 60:])
    assert dark[500:, lost - 20:lost].mean() > 0.0
    assert still(pressure=np.zeros(16)).picture.max() == 0


def test_the_share_of_the_aperture_is_a_half_at_the_edge_of_contact():
    share = aperture_share(np.arange(16) >= 8, IMAGE, 4.0)
    assert np.allclose(share[100:, 319:321].mean(axis=1), 0.5, atol=1e-6)
    width = IMAGE.depth / 4.0 / IMAGE.pixel[0]      # pixels, at the lowest row
    assert np.isclose(share[-1, 320 + round(width / 4)], 0.75, atol=0.01)


def test_inclusions_and_seroma_are_darker_or_brighter_by_their_level():
    params = replace(PARAMS, seroma_radius=0.006, seroma_centre=(0.0, 0.0, 0.02))
    found = echo_regions(params, [((0.01 * k, 0.0, 0.02), 0.005, ratio)
                                  for k, ratio in enumerate((5.0, 0.3, 1.0))])
    assert [round(20 * np.log10(r.gain)) for r in found] == [-10, 5, -40]
    picture = imager(params).see(0.0, NODES, PROBE, None, None, None, None).picture
    v = round((TOP - 0.02) / IMAGE.pixel[1])
    assert picture[v - 40:v + 40, 280:360].mean() < 5.0 < picture[v - 40:v + 40, 40:120].mean()


@pytest.mark.parametrize(('move', 'outcome'), [
    ([0.0, 0.005, 0.0], Outcome.TIP_OUT_OF_IMAGE), ([0.03, 0.0, 0.0], Outcome.TIP_OUT_OF_IMAGE),
    ([0.0, 0.0, -0.1], Outcome.IMAGE_EMPTY), ([0.0, 0.1, 0.0], Outcome.IMAGE_EMPTY)])
def test_what_the_plane_does_not_hold_has_a_name(still, move, outcome):
    shaft, tip = needle((6, 6), 0.06)
    away = (R_WP, PROBE[1] + move)
    frame = still(probe=away, told_probe=away, shaft=shaft, told_tip=tip)
    assert frame.outcome is outcome and frame.tip_W is None and frame.message
    assert '\n' not in frame.message


def test_a_needle_that_is_not_there_is_not_seen(still):
    _, tip = needle((6, 6), 0.06)
    frame = still(told_tip=tip)
    assert frame.outcome is Outcome.TIP_NOT_SEEN and frame.tip_W is None


def test_needles_along_the_plane_leave_the_grid_out_and_say_so(still):
    along = (np.column_stack([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), PROBE[1])
    frame = still(probe=along, told_probe=along)
    assert frame.outcome is Outcome.REJECTED and 'along the image plane' in frame.message


def test_images_come_at_their_rate():
    made = imager(replace(PARAMS, image=replace(UltrasoundParams(), rate=10.0)))
    frames = [made.see(0.05 * k, NODES, PROBE, None, None, None, None) for k in range(10)]
    assert [f is not None for f in frames] == [True, False] * 5


def test_same_seed_same_bits_and_nothing_is_shared():
    shaft, tip = needle((6, 6), 0.06)
    first, second, other = (imager(seed=s).see(0.0, NODES, PROBE, None, shaft, PROBE, tip)
                            for s in (1, 1, 2))
    assert np.array_equal(first.picture, second.picture)
    assert np.array_equal(first.overlay, second.overlay)
    assert not np.array_equal(first.picture, other.picture)
    assert not np.shares_memory(first.picture, first.overlay)
