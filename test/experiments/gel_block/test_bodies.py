"""States along rays: the cubic between them, the effect as a difference, the block's layout."""

import numpy as np
import pytest

from arm_brachy.core.errors import NotConverged
from arm_brachy.experiments.gel_block import bodies
from arm_brachy.experiments.gel_block.bodies import Body, Ray, solve_ray
from arm_brachy.experiments.gel_block.equilibrium import Solver
from arm_brachy.experiments.gel_block.layout import DIRECTIONS, MM, PADS, SIDE

ROUGH = tuple(MM * np.array(one, dtype=float)
              for one in ((-60, -24, 4, 60), (-45, -8, 20, 45), (0, 16, 44, 60)))


@pytest.fixture(scope='module')
def ray():
    return solve_ray(Body(ROUGH), (2 * MM, 0.0))


def test_every_grid_has_the_pads_between_its_planes():
    """The nodes that a pad carries are all those of a square of its size."""
    for body in (bodies.BODIES[bodies.FINE], bodies.BODIES[bodies.PLAIN]):
        nodes = body.block().nodes
        for pad in PADS:
            carried = nodes[pad.carries(nodes)]
            extent = np.ptp(carried, axis=0)
            across = np.abs(pad.direction) < 0.5
            np.testing.assert_allclose(extent, np.where(across, SIDE, 0.0), atol=1e-12)
            np.testing.assert_allclose(carried.mean(axis=0)[~across],
                                       np.array(pad.centre)[~across], atol=1e-12)


def test_the_block_resists_and_gives_way_along_the_push(ray):
    assert ray.share == pytest.approx(np.arange(7) / 6)
    assert not ray.u[0].any() and not ray.force[0].any()
    back = -ray.force @ DIRECTIONS[0]
    assert np.all(np.diff(back[:, 0]) > 0.0)        # against the push, more so the deeper
    # at 2 mm, 3 % of the block: in proportion to depth within 3 %
    assert back[1:, 0] / ray.share[1:] == pytest.approx(back[-1, 0], rel=0.03)
    inside = ray.u[-1, -3:] @ DIRECTIONS[0]
    assert np.all(inside > 0.0) and np.all(inside < 2 * MM)


def test_between_states_runs_the_cubic_through_them():
    share = np.array([0.0, 1 / 3, 2 / 3, 1.0])
    def cubic(s):
        return (s - 0.4 * s ** 2 + 0.2 * s ** 3)[:, None, None] * np.ones((5, 3))
    ray = Ray(np.array([1.0, 0.0]), share, cubic(share), cubic(share)[:, :2])
    s = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(ray.at(s, 'u'), cubic(s), atol=1e-12)


def test_effects_add_their_difference_to_the_fine_body(tmp_path, ray, monkeypatch):
    """And what is there is not solved again."""
    solved = []

    def solve(body, full):
        solved.append(body)
        factor = {0.0: 1.0}.get(body.stiffening, 3.0)
        return Ray(np.array(full), ray.share, factor * ray.u, factor * ray.force)

    monkeypatch.setattr(bodies, 'solve_ray', solve)
    for name in (bodies.FINE, bodies.PLAIN, 'stiffening'):
        for to in bodies.RAYS:
            bodies._solve(tmp_path, name, to)
    count = len(solved)
    bodies.solve_all(tmp_path, {bodies.PLAIN, 'stiffening'})
    assert len(solved) == count
    rays = bodies.load_rays(tmp_path, 'stiffening')
    assert set(rays) == {'A', 'B', 'AB'}
    np.testing.assert_allclose(rays['A'].u, (1.0 + 3.0 - 1.0) * ray.u)
    assert set(bodies.load_rays(tmp_path)) == set(bodies.RAYS)


def test_a_way_too_far_is_said_so():
    block = Body(ROUGH).block()
    top = 3 * np.flatnonzero(block.nodes[:, 2] > 60 * MM - 1e-9) + 2
    held = np.concatenate([(3 * block.glued[:, None] + np.arange(3)).ravel(), top])
    to = np.concatenate([np.zeros(3 * len(block.glued)), np.full(len(top), -61 * MM)])
    with pytest.raises(NotConverged, match='shorter steps'):
        Solver(block, held).along(np.zeros(len(held)), to, np.zeros(block.size), halvings=0)
