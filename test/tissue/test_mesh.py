"""Reading, refusing and measuring meshes; points that ride on them."""

import dataclasses

import meshio
import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import (
    boundary_faces,
    embed,
    interpolate,
    load_mesh,
    quality,
    rotations,
    volumes,
)

SIZE = (0.06, 0.04, 0.02)
ROTATION = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def mesh():
    return box_mesh(SIZE, (4, 3, 2), perturbation=0.2, rng=np.random.default_rng(0))


def save(path, mesh, **changes):
    arrays = {'nodes': mesh.nodes, 'tets': mesh.tets, 'base_nodes': mesh.node_sets['z0'],
              'tags': np.zeros(7, dtype=int)} | changes
    np.savez(path, **arrays)
    return path


def test_npz_round_trip_keeps_order_and_sets(tmp_path, mesh):
    loaded = load_mesh(save(tmp_path / 'm.npz', mesh))
    assert np.array_equal(loaded.nodes, mesh.nodes)
    assert np.array_equal(loaded.tets, mesh.tets)
    assert list(loaded.node_sets) == ['base_nodes']
    assert np.array_equal(loaded.node_sets['base_nodes'], mesh.node_sets['z0'])


def test_gmsh_and_vtk_in_millimetres_equal_npz(tmp_path, mesh):
    faces = boundary_faces(mesh)
    base = np.isin(faces, mesh.node_sets['z0']).all(axis=1)
    tags = [np.ones(len(mesh.tets), dtype=int), np.where(base, 1, 2)]
    raw = meshio.Mesh(1e3 * mesh.nodes, [('tetra', mesh.tets), ('triangle', faces)],
                      cell_data={'gmsh:physical': tags, 'gmsh:geometrical': tags},
                      field_data={'base': np.array([1, 2])})
    raw.write(tmp_path / 'm.msh', file_format='gmsh22')
    loaded = load_mesh(tmp_path / 'm.msh', 'mm')
    np.testing.assert_allclose(loaded.nodes, mesh.nodes, atol=1e-12)
    assert np.array_equal(loaded.tets, mesh.tets)
    assert np.array_equal(loaded.node_sets['base'], np.sort(mesh.node_sets['z0']))
    assert {'volume_1', 'surface_2'} <= set(loaded.node_sets)
    raw.write(tmp_path / 'm.vtu')
    assert np.array_equal(load_mesh(tmp_path / 'm.vtu', 'mm').tets, mesh.tets)


def with_tet(mesh, row):
    tets = mesh.tets.copy()
    tets[3] = row(tets[3])
    return {'tets': tets}


BAD = {
    'element 3 is inverted': lambda m: with_tet(m, lambda t: t[[0, 2, 1, 3]]),
    'element 3 repeats a node': lambda m: with_tet(m, lambda t: t[[0, 1, 2, 2]]),
    'element 3 names nodes': lambda m: with_tet(m, lambda t: t + 1000),
    'swap two columns': lambda m: {'tets': m.tets[:, [0, 2, 1, 3]]},
    'no tetrahedra': lambda m: {'tets': np.zeros((0, 4), dtype=int)},
    'node 5 is': lambda m: {'nodes': np.where(np.arange(len(m.nodes))[:, None] == 5, np.nan,
                                              m.nodes)},
    'belongs to no element': lambda m: {'nodes': np.vstack([m.nodes, [0.0, 0.0, 0.0]])},
    'separate pieces': lambda m: {'nodes': np.vstack([m.nodes, m.nodes + 0.1]),
                                  'tets': np.vstack([m.tets, m.tets + len(m.nodes)])},
    'belongs to 4 elements': lambda m: {'tets': np.vstack([m.tets, m.tets])},
    'mesh unit: mm': lambda m: {'nodes': 1e3 * m.nodes},
    'mesh unit: m': lambda m: {'nodes': 1e-3 * m.nodes},
    "node set 'base_nodes'": lambda m: {'base_nodes': np.array([0, 99999])},
    'nodes have shape': lambda m: {'nodes': m.nodes[:, :2]},
}


@pytest.mark.parametrize('message', BAD)
def test_refuses_in_one_line_with_file_and_place(tmp_path, mesh, message):
    path = save(tmp_path / 'm.npz', mesh, **BAD[message](mesh))
    with pytest.raises(MeshError, match=message) as caught:
        load_mesh(path)
    assert 'm.npz' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_refuses_flat_element(tmp_path):
    nodes = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0.003, 0.003, 1e-12]])
    np.savez(tmp_path / 'm.npz', nodes=nodes, tets=np.array([[0, 1, 2, 3]]))
    with pytest.raises(MeshError, match='element 0 is flat'):
        load_mesh(tmp_path / 'm.npz')


@pytest.mark.parametrize(('name', 'text'), [('m.txt', 'x'), ('m.msh', 'nonsense'),
                                            ('m.npz', 'nonsense'), ('m.vtk', '')])
def test_refuses_unreadable_files(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshError, match=name):
        load_mesh(tmp_path / name)
    with pytest.raises(MeshError, match='no such file'):
        load_mesh(tmp_path / 'absent.msh')


def test_boundary_is_closed_outward_and_bounds_the_volume(mesh):
    corners = mesh.nodes[boundary_faces(mesh)]
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-16)
    flux = np.sum(areas * corners.mean(axis=1)) / 3.0  # divergence theorem with field x / 3
    np.testing.assert_allclose(flux, np.prod(SIZE))
    np.testing.assert_allclose(volumes(mesh).sum(), np.prod(SIZE))


def test_quality_of_a_regular_tetrahedron():
    nodes = 0.01 * np.array([[1.0, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
    figures = quality(TetMesh(nodes, np.array([[0, 1, 2, 3]])))
    np.testing.assert_allclose(figures.min_radius_ratio, 1.0)
    np.testing.assert_allclose(figures.min_dihedral, np.arccos(1.0 / 3.0))
    np.testing.assert_allclose([figures.min_edge, figures.max_edge], 0.01 * np.sqrt(8.0))
    np.testing.assert_allclose(figures.volume, 0.01 ** 3 * 8.0 / 3.0)


def test_quality_of_a_sliver_is_near_zero():
    nodes = 0.01 * np.array([[1.0, 0, 0], [0, 1, 0.01], [-1, 0, 0], [0, -1, 0.01]])
    tets = np.array([[0, 1, 2, 3]])
    sliver = TetMesh(nodes, tets if volumes(TetMesh(nodes, tets)) > 0 else tets[:, [0, 2, 1, 3]])
    figures = quality(sliver)
    assert figures.min_radius_ratio < 0.03
    assert figures.min_dihedral < 0.03


def test_embedding_reproduces_affine_motion_inside_and_standing_off(mesh):
    rng = np.random.default_rng(1)
    inside = rng.uniform(0.0, 1.0, (40, 3)) * SIZE
    off = np.array([[0.03, 0.02, 0.024], [-0.003, 0.01, 0.01], [0.062, 0.043, 0.022]])
    points = np.vstack([inside, off, mesh.nodes[7]])
    riders = embed(mesh, points)
    affine = ROTATION + rng.uniform(-0.2, 0.2, (3, 3))
    moved = interpolate(riders, mesh.nodes @ affine.T + 0.01)
    np.testing.assert_allclose(moved, points @ affine.T + 0.01, atol=1e-14)
    assert riders.weights[:40].min() >= -1e-9
    np.testing.assert_allclose(riders.matrix(len(mesh.nodes)) @ mesh.nodes, points, atol=1e-15)


def test_embedded_rotation_is_the_polar_rotation(mesh):
    riders = embed(mesh, [[0.03, 0.02, 0.01], [0.03, 0.02, 0.022]])
    stretch = np.diag([1.3, 0.8, 1.1])
    R = rotations(riders, mesh.nodes @ (ROTATION @ stretch).T)
    np.testing.assert_allclose(R, np.broadcast_to(ROTATION, (2, 3, 3)), atol=1e-13)


def test_far_point_is_refused_by_name(mesh):
    with pytest.raises(MeshError, match=r'marker_3 at .* 10\.0 mm outside'):
        embed(mesh, [[0.03, 0.02, 0.01], [0.03, 0.02, 0.03]], names=['marker_2', 'marker_3'])


def test_surface_attachment_has_no_negative_weight(mesh):
    riders = embed(mesh, [[0.03, 0.02, 0.024]], onto_surface=True)
    assert riders.weights.min() >= 0.0
    np.testing.assert_allclose(interpolate(riders, mesh.nodes), [[0.03, 0.02, 0.02]], atol=1e-15)


def test_box_mesh_is_sound(tmp_path, mesh):
    assert volumes(mesh).min() > 0.0
    assert dataclasses.is_dataclass(load_mesh(save(tmp_path / 'm.npz', mesh)))


def test_a_laboratorys_two_exports_are_the_same_mesh(recordings):
    folder = recordings / 'dome_rig'
    gmsh, npz = load_mesh(folder / 'phantom.msh'), load_mesh(folder / 'phantom.npz')
    assert np.array_equal(gmsh.tets, npz.tets)
    np.testing.assert_allclose(gmsh.nodes, npz.nodes, atol=1e-8)  # printed with 7 digits
    assert np.array_equal(gmsh.node_sets['surface_1'], npz.node_sets['base_nodes'])
    assert np.array_equal(gmsh.node_sets['surface_11'], npz.node_sets['pad_nodes_0'])
    assert quality(npz).min_radius_ratio > 0.1
