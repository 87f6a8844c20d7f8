"""Slipping pads: Coulomb's cone at every point, sliding force, sticking as a bond, no pull."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue.body import Pad, PadFace, PadFootprint, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.contact_pads import PadContact, touches
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh, with_midside
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.pad_slip import PadSlip

RADIUS = 0.0101
PUSH = np.array([[0.0, 0.0, -1e-3]])


def block():
    """Block of 48 x 48 x 24 mm, 6 kPa, held below; discs bonded to its flat top and one side."""
    mesh = box_mesh((0.048, 0.048, 0.024), (8, 8, 4))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.4)
    top, side = mesh.node_sets['z1'], mesh.node_sets['x0']
    under = top[np.linalg.norm(mesh.nodes[top, :2] - 0.024, axis=1) < RADIUS]
    beside = side[np.linalg.norm(mesh.nodes[side, 1:] - [0.024, 0.012], axis=1) < 0.0061]
    pads = (Pad('top', under, np.array([0.0, 0.0, -1.0]), np.array([0.024, 0.024, 0.024]), 0.02,
                radius=RADIUS),
            Pad('side', beside, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.024, 0.012]), 0.02))
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], pads)


def cap():
    """The block with its top domed by 3 mm, quadratic; a pad known by its nodes in the middle."""
    mesh = box_mesh((0.048, 0.048, 0.024), (8, 8, 4))
    nodes = mesh.nodes - [0.024, 0.024, 0.0]
    bulge = 1.0 - np.sum(nodes[:, :2] ** 2, axis=1) / (0.024**2)
    nodes[:, 2] *= 1.0 + bulge / 4.0
    mesh = quadratic_mesh(dataclasses.replace(mesh, nodes=nodes))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.4)
    top = mesh.node_sets['z1']
    corners = np.intersect1d(top, mesh.tets)
    under = corners[np.linalg.norm(mesh.nodes[corners, :2], axis=1) < 1.5 * RADIUS]
    pad = Pad('top', with_midside(mesh, under), np.array([0.0, 0.0, -1.0]),
              np.array([0.0, 0.0, 0.03]), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def pressed(body, friction, push=PUSH):
    """ContactState of a body whose pads come loose, pushed in one step."""
    contact = PadContact(PadSlip(friction).prepare(body))
    return contact.step(contact.start(body.mesh.nodes, 0.0 * push), push)


def slipping(friction):
    """The term on the pad on top."""
    return PadSlip(friction, pads=('top',))


def dragged(plant, ways):
    """States of a plant at rest whose pad on top goes through `ways`."""
    plant.reset(), plant.settle()
    return [plant.step(0.1 * (k + 1), [way, [0.0, 0.0, 0.0]]) for k, way in enumerate(ways)]


def test_every_point_keeps_within_the_cone():
    """Pressed and dragged: |t| <= mu p, no tension; some points stick and some slip."""
    body, friction = slipping(0.3).prepare(block()), 0.3
    contact = PadContact(body)
    state = contact.start(body.mesh.nodes, np.zeros((2, 3)))
    for way in ([0.0, 0.0, -2e-3], [1e-3, 0.0, -2e-3]):
        state = contact.step(state, [way, [0.0, 0.0, 0.0]])
        assert state.outcome.ok
    points = state.points[0]
    shear = contact.solver.assembler.law.constants(body)[2] * np.linalg.norm(points.slip, axis=-1)
    assert (points.pressure >= 0.0).all()
    bearing = points.pressure > 0.0
    assert (shear[bearing] <= friction * points.pressure[bearing] * (1.0 + 1e-6) + 1e-9).all()
    full = shear[bearing] >= (1.0 - 1e-6) * friction * points.pressure[bearing]
    assert 0.05 < full.mean() < 0.95


@pytest.mark.parametrize('friction', [0.0, 0.2, 0.5])
def test_a_pad_that_slides_is_dragged_by_mu_times_its_load(friction):
    ways = [[0.0, 0.0, -2e-3], *([3e-3 * k, 0.0, -2e-3] for k in (1, 2, 3))]
    last = dragged(TissueSimulator(block(), (slipping(friction),)), ways)[-1]
    assert last.outcome.ok
    force = last.pad_force[0]
    # the face is flat; tissue bulges up before its edge, which turns a little of the load
    assert -force[0] == pytest.approx(friction * force[2], abs=0.04 * force[2])
    assert force[2] > 0.1


def test_dragging_back_leaves_a_loop_and_a_bond_none():
    ways = [[s, 0.0, -2e-3] for s in (0.0, 2e-3, 0.0)]
    for terms, least, most in (((slipping(0.2),), 0.03, 1.0), ((), 0.0, 1e-6)):
        states = dragged(TissueSimulator(block(), terms), ways)
        loop = np.abs(states[2].pad_force[0] - states[0].pad_force[0]).max()
        assert least <= loop < most


def test_with_much_friction_a_plate_pushes_as_a_bonded_one_does_but_never_pulls():
    """A plate over the whole flat top, so that face and patch are the same."""
    mesh = quadratic_mesh(box_mesh((0.03, 0.03, 0.015), (3, 3, 2)))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.4)
    lid = Pad('top', mesh.node_sets['z1'], np.array([0.0, 0.0, -1.0]),
              np.array([0.015, 0.015, 0.015]), 0.01, radius=0.025)
    plain = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                     mesh.node_sets['z0'], (lid,))
    stuck, bonded = (TissueSimulator(plain, terms) for terms in ((slipping(5.0),), ()))
    for t, way in ((1.0, [0.0, 0.0, -1e-3]), (2.0, [3e-4, 0.0, -1e-3])):
        a, b = (plant.step(t, [way]) for plant in (stuck, bonded))
        assert a.outcome.ok and b.outcome.ok
        np.testing.assert_allclose(a.pad_force, b.pad_force, rtol=0.03, atol=5e-3)
    a, b = (plant.step(3.0, [[0.0, 0.0, 5e-4]]) for plant in (stuck, bonded))
    assert not a.pad_force.any() and b.pad_force[0, 2] < -0.15


def test_friction_is_invisible_until_something_slips():
    """Once all points stick, twice the coefficient changes nothing; a small one does."""
    ways = [[0.0, 0.0, -2e-3], [5e-4, 0.0, -2e-3]]
    low, high, twice = (dragged(TissueSimulator(block(), (slipping(mu),)), ways)[-1].pad_force[0]
                        for mu in (0.1, 2.5, 5.0))
    np.testing.assert_allclose(high, twice, rtol=0.0, atol=1e-3 * np.abs(high).max())
    assert np.abs(low - high).max() > 1e-2 * np.abs(high).max()


def test_only_the_chosen_pads_come_loose_and_the_others_hold():
    body = slipping(0.3).prepare(block())
    np.testing.assert_array_equal(touches(body), [True, False])
    assert body.pads[0].face == PadFootprint(0.3)
    plant = TissueSimulator(block(), (slipping(0.3),))
    plant.settle()
    state = plant.step(0.1, [[0.0, 0.0, -1e-3], [-1e-3, 0.0, 0.0]])
    assert state.outcome.ok and state.pad_force[0, 2] > 0.0 and state.pad_force[1, 0] > 0.0
    np.testing.assert_allclose((state.x - body.mesh.nodes)[body.pads[1].nodes, 0], -1e-3,
                               atol=1e-15)


def test_a_pad_that_touches_keeps_its_face():
    given = block()
    flat = dataclasses.replace(given.pads[0], face=PadFace(RADIUS, 1e-3, 0.3))
    given = dataclasses.replace(given, pads=(flat, given.pads[1]))
    assert slipping(0.1).prepare(given).pads[0].face == PadFace(RADIUS, 1e-3, 0.1)


def test_a_face_off_a_curved_patch_fits_it():
    """Nothing is pressed at rest; pressed without slip, it pushes as the bond did."""
    body = cap()
    assert np.abs(pressed(body, 5.0, 0.0 * PUSH).force).max() < 1e-9
    state, bonded = pressed(body, 5.0), StaticSolver(body).solve(body.mesh.nodes, PUSH)
    assert state.outcome.ok and np.ptp(body.mesh.nodes[body.pads[0].nodes, 2]) > 1e-3
    np.testing.assert_allclose(state.force[0], bonded.pad_force[0], rtol=0.0,
                               atol=0.01 * np.abs(bonded.pad_force).max())


def test_without_friction_a_face_lets_the_patch_spread():
    """It bears along its direction alone; the tissue beneath goes outward."""
    body = cap()
    state = pressed(body, 0.0)
    assert np.abs(state.force[0, :2]).max() < 1e-9 < 0.1 < state.force[0, 2]
    patch = body.pads[0].nodes
    out = np.sum((state.x - body.mesh.nodes)[patch, :2] * body.mesh.nodes[patch, :2], axis=1)
    assert out.sum() > 0.5 * np.abs(out).sum()


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigError, match='pads = .*left.* must be among top, side'):
        PadSlip(pads=('left',)).prepare(block())
    with pytest.raises(ConfigError, match="'implicit' with touching pads"):
        TissueSimulator(block(), (slipping(0.3),), dynamics='implicit')


def test_a_model_bonds_the_pad_all_the_same():
    plain, loose = block(), slipping(0.0).prepare(block())
    push = [[0.0, 0.0, -1e-3], [0.0, 0.0, 0.0]]
    np.testing.assert_array_equal(*(StaticSolver(b).solve(b.mesh.nodes, push).x
                                    for b in (plain, loose)))
