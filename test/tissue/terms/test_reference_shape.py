"""Reference shape: bars of another size, the volume of a bump, a plane base, what rides along."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import least_squares

from arm_brachy.core.errors import MeshError
from arm_brachy.diagnosis.likelihood.constitutive_error import OWN
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh, volumes
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.reference_shape import ReferenceShape

E, SIZE = 6e3, np.array([0.04, 0.04, 0.06])
TOP = (0.02, 0.02, 0.06)


def block(cells=(4, 4, 6), quadratic=True, nu=0.0):
    """Block held below, its whole top a pad."""
    mesh = box_mesh(SIZE, cells)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    lid = Pad('lid', mesh.node_sets['z1'], np.array([0.0, 0.0, 1.0]), np.array(TOP), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (lid,))


def bump(height, radius, centre=TOP):
    """A ReferenceShape with a bump alone."""
    return ReferenceShape(bump_height=height, bump_radius=radius, bump_centre=tuple(centre))


def test_a_taller_and_wider_bar_is_a_bar_of_that_size():
    """F = E A (1 + l)^2 d / (L (1 + h)), nu = 0; no stress at rest."""
    simulator = TissueSimulator(block(), (ReferenceShape(height=0.03, width=-0.02),))
    np.testing.assert_allclose(simulator.state.pad_force, 0.0, atol=1e-12)
    pulled = simulator.step(1.0, [[0.0, 0.0, 1e-6]])
    expected = E * 0.04**2 * 0.98**2 * 1e-6 / (0.06 * 1.03)
    assert -pulled.pad_force[0, 2] == pytest.approx(expected, rel=1e-4)
    corners = simulator.body.mesh.nodes
    np.testing.assert_allclose(np.ptp(corners, axis=0), SIZE * [0.98, 0.98, 1.03])
    np.testing.assert_allclose(corners.mean(axis=0)[:2], 0.02)  # about the middle of the base


def test_volume_of_a_bump():
    """On a plane face: int h (1 - s^2)^2 dA = pi R^2 h / 3."""
    height, radius, plain = 2e-3, 0.018, block((8, 8, 8))
    grown = bump(height, radius).prepare(plain)
    gain = volumes(grown.mesh).sum() - volumes(plain.mesh).sum()
    assert gain == pytest.approx(np.pi * radius**2 * height / 3.0, rel=1e-3)


@pytest.mark.parametrize(('centre', 'out'), [
    (TOP, [0.0, 0.0, 1.0]), ((0.04, 0.02, 0.03), [1.0, 0.0, 0.0]),
    ((0.02, 0.0, 0.03), [0.0, -1.0, 0.0])])
def test_a_bump_grows_outward_and_a_dent_inward(centre, out):
    plain = block((8, 8, 12))
    for height in (1.5e-3, -1.5e-3):
        moved = bump(height, 0.012, centre).prepare(plain).mesh.nodes - plain.mesh.nodes
        at = np.linalg.norm(plain.mesh.nodes - centre, axis=1)
        np.testing.assert_allclose(moved[at.argmin()], height * np.array(out), atol=1e-12)
        assert not moved[at > 0.012 + 0.005].any()


def test_a_bump_beside_the_base_leaves_it_where_it_is():
    plain = block((8, 8, 12))
    grown = bump(2e-3, 0.015, (0.04, 0.02, 0.008)).prepare(plain)
    np.testing.assert_array_equal(grown.mesh.nodes[plain.fixed], plain.mesh.nodes[plain.fixed])
    assert np.abs(grown.mesh.nodes - plain.mesh.nodes).max() > 5e-4


def test_edges_stay_straight():
    grown = bump(3e-3, 0.02).prepare(block())
    ends = grown.mesh.nodes[grown.mesh.tets[:, EDGES]]
    np.testing.assert_allclose(grown.mesh.nodes[grown.mesh.midside], ends.mean(axis=2))


def test_base_normal_and_not_an_axis_is_what_is_up():
    """The same block lying on its side."""
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    shape, upright = ReferenceShape(height=0.1, width=0.05), block()
    lying = dataclasses.replace(upright, mesh=dataclasses.replace(
        upright.mesh, nodes=upright.mesh.nodes @ turn.T))
    np.testing.assert_allclose(shape.prepare(lying).mesh.nodes,
                               shape.prepare(upright).mesh.nodes @ turn.T, atol=1e-15)


def pushed_along(direction, shape, centre=TOP):
    """How far [m] a pad of `block` that is pushed along `direction` goes in a `shape`."""
    pad = dataclasses.replace(block().pads[0], direction=np.array(direction),
                              centre=np.array(centre))
    return shape.prepare(dataclasses.replace(block(), pads=(pad,))).pads[0].centre - pad.centre


def test_a_pad_comes_to_the_surface_along_its_push():
    """Its actuator stays where it is mounted: an oblique pad is up at the top, and aside."""
    direction, rise = [0.6, 0.0, -0.8], 0.05 * 0.06
    went = pushed_along(direction, ReferenceShape(height=0.05))
    np.testing.assert_allclose(np.cross(went, direction), 0.0, atol=1e-15)
    assert went[2] == pytest.approx(rise)


def test_a_surface_that_slides_brings_no_pad_anywhere():
    went = pushed_along([0.6, 0.0, -0.8], ReferenceShape(width=0.05), (0.03, 0.02, 0.06))
    np.testing.assert_allclose(went, 0.0, atol=1e-12)


def test_a_pad_that_shears_stays():
    """A surface that rises meets no push along it."""
    assert not pushed_along([1.0, 0.0, 0.0], ReferenceShape(height=0.05)).any()


def test_a_pad_is_glued_to_its_patch_where_that_is_now():
    plain = block()
    grown = ReferenceShape(height=0.05).prepare(plain)
    np.testing.assert_allclose(grown.mesh.nodes[plain.pads[0].nodes, 2], 0.063, rtol=1e-12)


def test_pads_come_along():
    shape = ReferenceShape(height=0.05, bump_height=1e-3, bump_centre=TOP)
    plain = block()
    grown = shape.prepare(plain)
    pad = grown.pads[0]
    np.testing.assert_allclose(pad.centre, [0.02, 0.02, 0.064], rtol=1e-12)
    middle = np.linalg.norm(plain.mesh.nodes - TOP, axis=1).argmin()
    np.testing.assert_allclose(grown.mesh.nodes[middle], pad.centre)
    np.testing.assert_array_equal(pad.nodes, plain.pads[0].nodes)
    np.testing.assert_array_equal(pad.direction, plain.pads[0].direction)


@pytest.mark.parametrize(('form', 'share'), [
    (lambda r: np.exp(-0.5 * r**2), 0.11), (lambda r: np.maximum(1.0 - (r / 2.0)**2, 0.0), 0.08)])
def test_bumps_of_other_forms_are_met_to_a_tenth(form, share):
    """Of a Gaussian and of a cap, rms over the area: what the full fit of a bump leaves."""
    r = np.linspace(0.0, 4.0, 2000)
    points = np.column_stack([r, 0.0 * r, 0.0 * r])

    def off(numbers):
        height, radius = numbers
        ours = ReferenceShape(bump_centre=(0.0, 0.0, 0.0), bump_radius=radius)
        return np.sqrt(r) * (height * ours._profile(points) - form(r))

    best = least_squares(off, [1.0, 2.5])
    left = np.linalg.norm(best.fun) / np.linalg.norm(np.sqrt(r) * form(r))
    assert left == pytest.approx(share, abs=0.005)
    assert share <= 1.1 * OWN['reference_shape']


def test_a_marker_keeps_its_material_point():
    """Embedded in the scene's mesh, it moves with the nodes: to 3 % more height at rest."""
    plain = block()
    markers = np.array([[0.0, 0.013, 0.041], [0.02, 0.02, 0.03]])
    riders = embed(plain.mesh, markers)
    state = TissueSimulator(plain, (ReferenceShape(height=0.03),)).settle()
    np.testing.assert_allclose(interpolate(riders, state.x), markers * [1.0, 1.0, 1.03],
                               atol=1e-9)


def test_what_cannot_be_is_refused():
    with pytest.raises(MeshError, match=r'elements turned inside out, .* -25 mm is too steep'):
        bump(-25e-3, 0.012).prepare(block())
    with pytest.raises(MeshError, match='onto the surface or make it wider'):
        bump(1e-3, 0.01, (0.02, 0.02, 0.09)).prepare(block())
    loose = dataclasses.replace(block(), fixed=np.array([0, 1]))
    point = dataclasses.replace(block().pads[0], nodes=block().pads[0].nodes[:1])
    with pytest.raises(MeshError, match='pad lid span no boundary face'):
        ReferenceShape(height=0.1).prepare(dataclasses.replace(block(), pads=(point,)))
    with pytest.raises(MeshError, match='none of the 2 fixed nodes'):
        ReferenceShape(height=0.1).prepare(loose)
