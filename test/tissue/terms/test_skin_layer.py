"""Skin layer: its volume, a clad bar, a clad sphere against Lame, and where there is none."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import Pad, SoftBody, Springs, TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import signed_volumes
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, face_middles, quadratic_mesh, volumes
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.inclusion import cells
from arm_brachy.tissue.terms.skin_layer import SkinLayer, layer_fraction, share_below

E, RADIUS = 6e3, 0.03


def body_on(mesh, nu, fixed=(), pads=()):
    """Homogeneous SoftBody."""
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.asarray(fixed, dtype=np.int64), pads)


def test_share_of_a_tetrahedron_below_a_level():
    """Against random points; at a corner, an edge and a face that all have one value."""
    values = np.random.default_rng(1).normal(size=(6, 4))
    L = np.random.default_rng(2).dirichlet(np.ones(4), 100000)
    for level in (-1.0, -0.3, 0.2, 0.8):
        counted = (L @ values.T < level).mean(axis=0)
        np.testing.assert_allclose(share_below(values, level), counted, atol=5e-3)
    for values, share in (([0, 1, 1, 1], 1 / 8), ([0, 0, 1, 1], 1 / 2), ([0, 0, 0, 1], 7 / 8),
                          ([0, 0, 0, 0], 1.0), ([1, 1, 1, 1], 0.0)):
        assert share_below(np.array(values, dtype=float), 0.5) == pytest.approx(share)


@pytest.mark.parametrize('thickness', [0.0005, 0.002, 0.006])
@pytest.mark.parametrize('divisions', [4, 8])
def test_volume_of_the_layer_does_not_depend_on_the_mesh(divisions, thickness):
    """Thinner or thicker than an element; top and sides, not the base."""
    a, b, c = size = (0.06, 0.05, 0.04)
    mesh = box_mesh(size, (divisions,) * 3)
    got = layer_fraction(mesh, mesh.node_sets['z0'], thickness) @ volumes(mesh)
    core = (a - 2.0 * thickness) * (b - 2.0 * thickness) * (c - thickness)
    assert got == pytest.approx(a * b * c - core, rel=0.02)


def test_fraction_moves_smoothly_with_thickness():
    mesh = box_mesh((0.06, 0.05, 0.04), (5, 5, 5))
    thickness = np.linspace(5e-4, 6e-3, 56)
    phi = np.array([layer_fraction(mesh, mesh.node_sets['z0'], t) for t in thickness])
    assert phi.min() >= 0.0 and phi.max() <= 1.0
    assert np.diff(phi, axis=0).min() >= 0.0
    assert np.diff(phi @ volumes(mesh), 2).max() < 0.05 * np.diff(phi @ volumes(mesh)).mean()


def test_clad_bar():
    """In parallel: F = strain (E A_core + ratio E A_layer), nu = 0; elements twice the layer."""
    width, length, thickness, ratio = 0.02, 0.08, 0.002, 5.0
    mesh = box_mesh((width, width, length), (5, 5, 16))
    ends = np.union1d(mesh.node_sets['z0'], mesh.node_sets['z1'])  # nothing but the sides is free
    clad = SkinLayer(ratio, thickness).prepare(body_on(mesh, 0.0, ends))
    pad = Pad('end', mesh.node_sets['z1'], np.array([0.0, 0.0, 1.0]),
              np.array([width / 2, width / 2, length]), 1.0)
    body = dataclasses.replace(clad, fixed=mesh.node_sets['z0'], pads=(pad,))
    pulled = TissueSimulator(body).step(1.0, [[0.0, 0.0, 1e-5 * length]])
    core = (width - 2.0 * thickness) ** 2
    expected = 1e-5 * E * (core + ratio * (width**2 - core))
    assert -pulled.pad_force[0, 2] == pytest.approx(expected, rel=0.02)


def ball():
    """Ball of 30 mm: an octahedron of 8 x 512 tetrahedra blown up, elements of about 4 mm."""
    corners = []
    for signs in np.ndindex(2, 2, 2):
        octant = np.vstack([np.zeros(3), np.diag(1.0 - 2.0 * np.array(signs))])
        corners.append(cells(3) @ octant)
    corners = np.concatenate(corners)
    nodes, tets = np.unique(np.rint(corners.reshape(-1, 3) * 8).astype(int), axis=0,
                            return_inverse=True)
    tets, nodes = tets.reshape(-1, 4), nodes / 8.0
    length = np.linalg.norm(nodes, axis=1)
    nodes *= RADIUS * (np.abs(nodes).sum(axis=1) / np.where(length, length, 1.0))[:, None]
    flip = signed_volumes(nodes, tets) < 0.0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    return quadratic_mesh(TetMesh(nodes, tets))


def swelling(body, pull=1e-3):
    """Mean radial displacement [m] of the surface of a ball under the tension `pull` [Pa]."""
    mesh = body.mesh
    faces = boundary_faces(mesh)
    a, b, c = (mesh.nodes[faces[:, i]] for i in range(3))
    force = np.zeros_like(mesh.nodes)
    np.add.at(force, face_middles(mesh, faces),  # a constant traction, work-equivalent
              np.repeat(pull * np.cross(b - a, c - a)[:, None] / 6.0, 3, axis=1))
    tips = np.flatnonzero((np.abs(mesh.nodes) > 0.999 * RADIUS).any(axis=1))
    weak = Springs(tips, np.tile(1e-4 * np.eye(3), (len(tips), 1, 1)))  # against turning
    held = dataclasses.replace(body, springs=weak, nodal_force=force,
                               fixed=np.flatnonzero(np.linalg.norm(mesh.nodes, axis=1) == 0.0))
    u = StaticSolver(held).solve(mesh.nodes, np.zeros((0, 3))).x - mesh.nodes
    skin = np.unique(faces)
    return np.einsum('ni,ni->n', u[skin], mesh.nodes[skin]).mean() / RADIUS


def lame(thickness, ratio, nu):
    """Displacement of a clad ball over that of a plain one: u = A r inside, B r + C / r^2."""
    (G1, K1), a, b = moduli(E, nu), RADIUS - thickness, RADIUS
    G2, K2 = ratio * G1, ratio * K1
    A, B, C = np.linalg.solve([[a, -a, -a**-2], [3 * K1, -3 * K2, 4 * G2 * a**-3],
                               [0.0, 3 * K2, -4 * G2 * b**-3]], [0.0, 0.0, 1.0])
    return (B * b + C / b**2) / (b / (3.0 * K1))


def test_clad_sphere():
    """Lame's clad ball, layer half an element: arithmetic mean close, harmonic mean far off."""
    thickness, ratio, nu = 0.002, 5.0, 0.0
    plain = body_on(ball(), nu)
    exact = lame(thickness, ratio, nu)
    clad = SkinLayer(ratio, thickness).prepare(plain)
    phi = layer_fraction(plain.mesh, [], thickness)
    series = 1.0 / (1.0 - phi + phi / ratio)
    harmonic = dataclasses.replace(plain, mu=series * plain.mu, kappa=series * plain.kappa)
    bare = swelling(plain)
    error, other = (abs(swelling(b) / bare / exact - 1.0) for b in (clad, harmonic))
    assert exact < 0.8  # the layer matters
    assert error < 0.025
    assert error < 0.2 * other


def test_a_pads_area_has_the_skin_and_the_base_has_not():
    mesh = box_mesh((0.04, 0.04, 0.04), (8, 8, 8))
    pad = Pad('pad', mesh.node_sets['z1'], np.array([0, 0, -1.0]), np.array([0.02, 0.02, 0.04]), 1)
    plain = body_on(mesh, 0.45, mesh.node_sets['z0'], (pad,))
    scale = SkinLayer(2.5, 0.002).prepare(plain).mu / plain.mu
    middle = mesh.nodes[mesh.tets].mean(axis=1)
    inner = np.abs(middle[:, :2] - 0.02).max(axis=1) < 0.01
    assert scale[inner & (middle[:, 2] > 0.035)].min() > 1.0
    np.testing.assert_array_equal(scale[inner & (middle[:, 2] < 0.035)], 1.0)


def test_a_body_without_a_free_surface_is_refused():
    mesh = box_mesh((0.04, 0.04, 0.04), (2, 2, 2))
    with pytest.raises(MeshError, match='all 48 boundary faces are fixed'):
        SkinLayer(2.5).prepare(body_on(mesh, 0.45, np.arange(len(mesh.nodes))))
