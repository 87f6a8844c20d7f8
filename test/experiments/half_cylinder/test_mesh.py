"""The laboratory's mesh: round where the half-cylinder is, the pads' rims and the lump in it."""

import numpy as np
import pytest

from arm_brachy.experiments.half_cylinder import shapes
from arm_brachy.experiments.half_cylinder.bodies import ASIDE, BODIES, under_the_edge
from arm_brachy.experiments.half_cylinder.elements import Body
from arm_brachy.experiments.half_cylinder.law import Law
from arm_brachy.experiments.half_cylinder.layout import LENGTH, MM, PADS, RADIUS
from arm_brachy.experiments.half_cylinder.mesh import LUMP, RIM, aside, load_mesh


@pytest.fixture(scope='module')
def mesh():
    return load_mesh()


def body(mesh):
    one, alike = Law.of(9e3, 0.48), np.ones((len(mesh.tets), 1))
    return Body(mesh, Law(one.shear * alike, one.bulk * alike))


def area(mesh, name):
    return shapes.face_areas(mesh.nodes[mesh.faces[name]]).sum()


def test_it_is_a_half_cylinder_with_a_ball_in_it(mesh):
    """Parabolas in place of arcs of 14 degrees: wrong by less than a thousandth."""
    weights = body(mesh).weights
    assert weights.sum() == pytest.approx(np.pi / 2 * RADIUS ** 2 * LENGTH, rel=1e-4)
    assert weights[mesh.lump].sum() == pytest.approx(4 / 3 * np.pi * LUMP[1] ** 3, rel=1e-3)
    assert area(mesh, 'base') == pytest.approx(2 * RADIUS * LENGTH, rel=1e-9)
    round_side = area(mesh, 'side') + sum(area(mesh, pad.name) for pad in PADS)
    assert round_side == pytest.approx(np.pi * RADIUS * LENGTH, rel=1e-3)


@pytest.mark.parametrize('shift', [0.0, ASIDE[1]])
def test_pads_are_discs_on_the_round_side(mesh, shift):
    moved = aside(mesh, ASIDE[0], shift)
    for pad in PADS:
        nodes = moved.nodes[moved.patch(pad.name)]
        assert np.hypot(nodes[:, 1], nodes[:, 2]) == pytest.approx(RADIUS, abs=1e-6 * MM)
        off = nodes - pad.centre - ([shift, 0, 0] if pad.name == ASIDE[0] else np.zeros(3))
        away = np.linalg.norm(off - np.outer(off @ pad.direction, pad.direction), axis=1)
        assert away.max() == pytest.approx(RIM, abs=1e-6 * MM)
        assert (away > RIM - 1e-6 * MM).sum() > 40       # the rim is in the mesh


def test_a_pad_aside_leaves_the_body_as_it_is(mesh):
    moved = aside(mesh, *ASIDE)
    change = body(moved).weights.sum() / body(mesh).weights.sum() - 1.0
    assert abs(change) < 1e-5
    for name in ('base', 'left', 'top', 'skin'):
        np.testing.assert_array_equal(moved.nodes[np.unique(mesh.faces[name])],
                                      mesh.nodes[np.unique(mesh.faces[name])])


def test_the_loose_strip_is_one(mesh):
    """48 x 18 mm, by whole faces of some 7 mm."""
    base = mesh.faces['base']
    off = under_the_edge(mesh.nodes[base[:, :3]].mean(axis=1))
    loose = shapes.face_areas(mesh.nodes[base[off]]).sum()
    assert loose == pytest.approx(48 * MM * 18 * MM, rel=0.1)
    assert BODIES['loose'].loose is under_the_edge
