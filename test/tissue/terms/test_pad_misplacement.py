"""A misplaced pad against a scene whose pad is there; what it carries, what it leaves alone."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError, MeshError
from arm_brachy.core.scene import PadPatch
from arm_brachy.tissue.body import Pad, PadFace, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_pad, placement_mesh
from arm_brachy.tissue.contact_pads import PadContact
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.pad_misplacement import PadMisplacement
from arm_brachy.tissue.terms.reference_shape import ReferenceShape

SIDE, HEIGHT, CELL = 0.048, 0.024, 4e-3
MARKERS = np.array([[0.011, 0.02, 0.024], [0.041, 0.026, 0.021], [0.024, 0.024, 0.012],
                    [0.033, 0.012, 0.018], [0.008, 0.03, 0.009]])


def block(x=SIDE / 2, quadratic=False):
    """Block in cells of 4 mm, a disc of 12 mm bonded to its top, in the middle or at x [m]."""
    mesh = box_mesh((SIDE, SIDE, HEIGHT), (12, 12, 6))
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    pad = build_pad(mesh, PadPatch('pad', (x, SIDE / 2, HEIGHT), (0.0, 0.0, -1.0), 0.0121, 0.02))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.45)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def misplaced(up=CELL, side=0.0, **tilts):
    """The term; a pad that pushes along z has its `up` along x."""
    return PadMisplacement(up=up, side=side, **tilts)


def answers(body, push):
    """Displacement of the markers (5, 3) [m] and force on the pad (3,) [N] for a push (3,) [m]."""
    found = StaticSolver(body).solve(body.mesh.nodes, [push])
    assert found.outcome.ok
    points = embed(placement_mesh(body.mesh, body), MARKERS)
    return interpolate(points, found.x) - MARKERS, found.pad_force[0]


def test_it_answers_as_a_scene_whose_pad_is_there():
    """One cell along, the nodes under the disc form the same pattern, so only the mesh differs.

    What is left is the meshes' own error, here in cells of a third of the radius: with cells of
    6, 4 and 3 mm 17, 8 and 5 % of the effect on markers, 3.6, 1.7 and 1.1 % of the force.
    """
    there, here = block(SIDE / 2 + CELL, True), misplaced().prepare(block(quadratic=True))
    assert len(there.pads[0].nodes) == len(here.pads[0].nodes)
    np.testing.assert_allclose(here.pads[0].centre, there.pads[0].centre, atol=1e-12)
    (u0, f0), (u1, f1), (u, f) = (answers(body, [2e-3, 0.0, -1e-3]) for body in (
        block(quadratic=True), there, here))
    effect = np.abs(u1 - u0).max()
    assert effect > 0.2e-3 and np.abs(f1 - f0).max() > 0.05 * np.linalg.norm(f1)
    assert np.abs(u - u1).max() < 0.1 * effect
    np.testing.assert_allclose(f, f1, rtol=0.0, atol=0.02 * np.linalg.norm(f1))


def test_the_answer_is_smooth_in_the_offset_where_choosing_nodes_jumps():
    offsets = np.arange(0.0, CELL * 1.01, CELL / 4.0)
    slid = [answers(misplaced(o).prepare(block()), [0, 0, -2e-3])[1][2]
            for o in offsets]
    chosen = [answers(block(SIDE / 2 + o), [0, 0, -2e-3])[1][2] for o in offsets]
    seconds, jumps = (np.abs(np.diff(f, 2)).max() for f in (slid, chosen))
    assert seconds < 0.1 * jumps
    ahead, back = (answers(misplaced(s).prepare(block()), [0, 0, -2e-3])[0]
                   for s in (1e-7, -1e-7))
    at_rest = answers(block(), [0, 0, -2e-3])[0]
    # a marker on the boundary of two elements changes over, which is a kink but not a jump
    np.testing.assert_allclose(0.5 * (ahead + back), at_rest, rtol=0.0, atol=2e-8)


def test_tissue_stays_where_it_is_and_so_do_its_markers():
    body = misplaced(2e-3, 1e-3).prepare(block())
    assert np.abs(body.mesh.nodes - block().mesh.nodes).max() > 1e-3
    points = embed(placement_mesh(block().mesh, body), MARKERS)
    np.testing.assert_allclose(interpolate(points, body.mesh.nodes), MARKERS, atol=1e-12)
    np.testing.assert_array_equal(body.mesh.nodes[body.fixed], block().mesh.nodes[body.fixed])
    plain = block()
    assert placement_mesh(plain.mesh, plain) is plain.mesh


def test_the_pad_may_slide_on_a_shape_that_differs_too():
    """In the true shape, 10 % taller, the pad is at the same share of it."""
    terms = (misplaced(2e-3), ReferenceShape(height=0.1))
    body = TissueSimulator(block(), terms).body
    expected = [SIDE / 2 + 2e-3, SIDE / 2, 1.1 * HEIGHT]
    np.testing.assert_allclose(body.pads[0].centre, expected, atol=1e-12)
    points = embed(placement_mesh(block().mesh, body), MARKERS)
    np.testing.assert_allclose(interpolate(points, body.mesh.nodes), MARKERS * [1.0, 1.0, 1.1],
                               atol=1e-12)


def test_loads_keep_their_place_and_size():
    """What hangs on nodes that slide is handed on: same mass, same centre of mass."""
    rng, plain = np.random.default_rng(1), block()
    near = np.linalg.norm(plain.mesh.nodes - plain.pads[0].centre, axis=1) < 0.008
    mass = np.where(near, rng.uniform(0.0, 1e-3, len(near)), 0.0)
    loaded = dataclasses.replace(plain, nodal_mass=mass,
                                 nodal_force=np.outer(mass, [1.0, 2.0, -3.0]))
    body = misplaced().prepare(loaded)
    assert (body.nodal_mass >= -1e-18).all()
    assert body.nodal_mass.sum() == pytest.approx(mass.sum(), rel=1e-12)
    np.testing.assert_allclose(body.nodal_mass @ body.mesh.nodes, mass @ plain.mesh.nodes,
                               rtol=1e-9)
    np.testing.assert_allclose(body.nodal_force, np.outer(body.nodal_mass, [1, 2, -3]),
                               atol=1e-15)


@pytest.mark.parametrize(('direction', 'up', 'side'), [
    ([-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
    ([0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0])])
def test_tilt_turns_the_push_towards_up_and_side_by_the_angles(direction, up, side):
    body = block()
    body = dataclasses.replace(body, pads=(dataclasses.replace(
        body.pads[0], direction=np.array(direction)),))
    tilted = misplaced(0.0, tilt_up=0.1, tilt_side=-0.2).prepare(body)
    d = tilted.pads[0].direction
    assert np.linalg.norm(d) == pytest.approx(1.0)
    assert np.arctan2(d @ up, d @ direction) == pytest.approx(0.1)
    assert np.arctan2(d @ side, d @ direction) == pytest.approx(-0.2)
    assert tilted.mesh is body.mesh and tilted.scene_nodes is None


def test_side_is_across_the_push_and_up():
    moved = misplaced(0.0, 2e-3).prepare(block()).pads[0].centre - block().pads[0].centre
    np.testing.assert_allclose(moved, [0.0, -2e-3, 0.0], atol=1e-12)


def two_pads(face=None):
    """The block with a small disc on one side besides."""
    body = block()
    wall = body.mesh.node_sets['x0']
    beside = wall[np.linalg.norm(body.mesh.nodes[wall, 1:] - [0.024, 0.008], axis=1) < 0.0041]
    other = Pad('side', beside, np.array([1.0, 0, 0]), np.array([0.0, 0.024, 0.008]), 0.02)
    return dataclasses.replace(body, pads=(dataclasses.replace(body.pads[0], face=face), other))


def test_only_the_chosen_pad_moves():
    plain = two_pads()
    body = PadMisplacement(up=2e-3, pads=('pad',)).prepare(plain)
    beside = plain.pads[1].nodes
    np.testing.assert_array_equal(body.mesh.nodes[beside], plain.mesh.nodes[beside])
    np.testing.assert_array_equal(body.pads[1].centre, plain.pads[1].centre)
    assert body.pads[0].centre[0] == pytest.approx(SIDE / 2 + 2e-3)


def test_a_touching_pad_sits_there_too():
    """Its face is there, and the tissue bears it around the place where it is."""
    given = two_pads(PadFace(0.0121, 0.002, 0.3))
    body = PadMisplacement(up=4e-3, pads=('pad',)).prepare(given)
    contact, there = PadContact(body), np.array([SIDE / 2 + 4e-3, SIDE / 2, HEIGHT])
    np.testing.assert_allclose(contact.X_WP[0, :3, 3], there, atol=1e-9)
    state = contact.step(contact.start(body.mesh.nodes, np.zeros((2, 3))),
                         [[0.0, 0.0, -1e-3], [0.0, 0.0, 0.0]])
    assert state.outcome.ok and state.force[0, 2] > 0.1
    arm = np.array([state.moment[0, 1], state.moment[0, 0]]) / state.force[0, 2]
    np.testing.assert_allclose(arm, 0.0, atol=1e-3)  # of the load, off the middle of the face


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigError, match='pad_misplacement: pads = .* must be among pad, side'):
        PadMisplacement(up=1e-3, pads=('left',)).prepare(two_pads())
    with pytest.raises(MeshError, match='pad_misplacement: pad pad: .* turned inside out'):
        misplaced(0.02).prepare(block())
