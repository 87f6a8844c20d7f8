"""From a scene to a body: held nodes, pads, hanging masses."""

import dataclasses

import numpy as np
import pytest
from ruamel.yaml import YAML

from arm_brachy.core.errors import ConfigError, MeshError
from arm_brachy.core.scene import (
    Marker,
    Material,
    MeshFile,
    PadPatch,
    PointLoad,
    Region,
    Scene,
    Target,
)
from arm_brachy.tissue.body import PadFace
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import (
    build_body,
    build_pad,
    marker_points,
    target_points,
    with_moduli,
)
from arm_brachy.tissue.mesh import load_mesh

TOP = PadPatch('top', (0.02, 0.02, 0.03), (0.0, 0.0, -2.0), radius=0.011)
SIDE = PadPatch('side', (0.0, 0.02, 0.02), (1.0, 0.0, 0.0), radius=0.006)


@pytest.fixture
def mesh():
    return box_mesh((0.04, 0.04, 0.03), (8, 8, 6))


@pytest.fixture
def scene():
    return Scene('box', MeshFile('none'), Region('set', set='z0'), pads=(TOP, SIDE),
                 markers=(Marker('m0', (0.04, 0.01, 0.02)), Marker('p', (0.0, 0, 0), 'top')),
                 targets=(Target('t0', (0.02, 0.02, 0.01)),))


def test_moduli_are_lames(scene, mesh):
    body = build_body(scene, mesh)
    E, nu = scene.material.E, scene.material.nu
    np.testing.assert_allclose(body.mu, E / (2 * (1 + nu)))
    lam = E * nu / ((1 + nu) * (1 - 2 * nu))
    np.testing.assert_allclose(body.kappa, lam + 2.0 / 3.0 * body.mu)
    np.testing.assert_allclose(with_moduli(body, 2 * E, nu).mu, 2 * body.mu)


def test_pads_cover_the_disc_on_the_facing_side_only(scene, mesh):
    top, side = build_body(scene, mesh).pads
    x, y, z = mesh.nodes.T
    disc = np.hypot(x - 0.02, y - 0.02) <= 0.011
    assert np.array_equal(top.nodes, np.flatnonzero(disc & np.isclose(z, 0.03)))
    assert np.allclose(mesh.nodes[side.nodes, 0], 0.0)
    assert np.allclose(top.direction, [0, 0, -1])


def test_a_disc_wider_than_the_body_takes_no_flanks(mesh, scene):
    wide = dataclasses.replace(TOP, radius=0.1)
    body = build_body(dataclasses.replace(scene, pads=(wide,)), mesh)
    assert np.array_equal(body.pads[0].nodes, mesh.node_sets['z1'])


def test_a_pad_off_the_surface_is_refused(mesh):
    build_pad(mesh, PadPatch('near', (0.02, 0.02, 0.034), (0.0, 0.0, -1.0), radius=0.011))
    with pytest.raises(MeshError, match='pad far: its centre is 20.0 mm from the surface'):
        build_pad(mesh, PadPatch('far', (0.02, 0.02, 0.05), (0.0, 0.0, -1.0), radius=0.011))


def test_pad_from_a_named_set(mesh, scene):
    named = dataclasses.replace(TOP, set='z1')
    body = build_body(dataclasses.replace(scene, pads=(named,)), mesh)
    assert np.array_equal(body.pads[0].nodes, mesh.node_sets['z1'])


REGIONS = {
    'half space': Region('half_space', point=(0, 0, 0.0), normal=(0, 0, -1)),
    'box': Region('box', low=(-1, -1, 0), high=(1, 1, 0)),
    'set': Region('set', set='z0'),
}


@pytest.mark.parametrize('kind', REGIONS)
def test_every_kind_of_region_finds_the_base(mesh, scene, kind):
    body = build_body(dataclasses.replace(scene, fixed=REGIONS[kind]), mesh)
    assert np.array_equal(body.fixed, mesh.node_sets['z0'])


BAD = {
    'no node set': {'fixed': Region('set', set='floor')},
    'holds no node': {'fixed': Region('half_space', point=(0, 0, -1.0), normal=(0, 0, -1))},
    'direction .* no length': {'pads': (dataclasses.replace(TOP, direction=(0, 0, 0)),)},
    'must be at least 3': {'pads': (dataclasses.replace(TOP, radius=0.001),)},
    'pad second shares node': {'pads': (TOP, dataclasses.replace(TOP, name='second'))},
    'with the fixed region': {'fixed': Region('set', set='z1')},
    'load brick at': {'loads': (PointLoad('brick', (0.02, 0.02, 0.2), 0.1),)},
}


@pytest.mark.parametrize('message', BAD)
def test_refuses_in_one_line(mesh, scene, message):
    with pytest.raises(MeshError, match=message) as caught:
        build_body(dataclasses.replace(scene, **BAD[message]), mesh)
    assert '\n' not in str(caught.value)


def test_hanging_mass_keeps_its_weight_and_its_place(mesh, scene):
    at = (0.013, 0.017, 0.031)  # a millimetre above the surface: it hangs from the surface
    body = build_body(dataclasses.replace(scene, loads=(PointLoad('w', at, 0.05),)), mesh)
    np.testing.assert_allclose(body.nodal_mass.sum(), 0.05)
    assert body.nodal_mass.min() >= 0.0
    np.testing.assert_allclose(body.nodal_mass @ mesh.nodes / 0.05, (0.013, 0.017, 0.03),
                               atol=1e-12)


def test_markers_by_what_carries_them(scene):
    assert marker_points(scene)[0] == ('m0',)
    assert marker_points(scene, 'top')[0] == ('p',)
    names, positions = target_points(scene)
    assert names == ('t0',)
    assert positions.shape == (1, 3)
    assert marker_points(scene, 'base')[1].shape == (0, 3)


def test_material_comes_from_the_scene(scene, mesh):
    stiff = dataclasses.replace(scene, material=Material(E=1e5, nu=0.3, density=1200.0),
                                gravity=(0.0, 0.0, -9.81))
    body = build_body(stiff, mesh)
    assert np.all(body.density == 1200.0)
    assert np.array_equal(body.gravity, [0, 0, -9.81])


def test_a_laboratorys_own_pads_are_found_by_geometry(recordings):
    """The dome rig names the nodes under each disc: the disc rule must find the same ones."""
    folder = recordings / 'dome_rig'
    given = YAML(typ='safe').load((folder / 'scene.yaml').read_text(encoding='utf-8'))
    for pad in given['pads']:
        patch = PadPatch(pad['name'], pad['centre'], pad['direction'], pad['radius'])
        named = dataclasses.replace(patch, set=pad['node_set'])
        mesh = load_mesh(folder / 'phantom.npz')
        assert np.array_equal(build_pad(mesh, patch).nodes, build_pad(mesh, named).nodes)


def test_a_touching_pad_gets_a_face(mesh):
    patch = dataclasses.replace(TOP, contact='touching', friction=0.4, edge_radius=0.003)
    pad = build_pad(mesh, patch)
    assert pad.face == PadFace(radius=0.011, edge_radius=0.003, friction=0.4)
    np.testing.assert_array_equal(pad.nodes, build_pad(mesh, TOP).nodes)
    assert build_pad(mesh, TOP).face is None
    with pytest.raises(ConfigError, match='pad top: edge_radius_mm = 12; must be at most its'):
        build_pad(mesh, dataclasses.replace(patch, edge_radius=0.012))
