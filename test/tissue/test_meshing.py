"""Meshing of closed surfaces: what comes out is sound and reads back."""

from types import SimpleNamespace

import meshio
import numpy as np
import pytest
import trimesh

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue import meshing
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.mesh import boundary_faces, load_mesh
from arm_brachy.tissue.mesh_command import mesh_command

BOX_MM = (30.0, 40.0, 50.0)


def box(extents=BOX_MM):
    return trimesh.creation.box(extents)


@pytest.fixture(scope='module')
def sphere():
    """A ball of 40 mm radius, its mesh and report."""
    surface = trimesh.creation.icosphere(subdivisions=3, radius=40.0)
    return surface, *meshing.mesh_surface(surface, edge_length=0.014)


def test_volume_and_boundary_are_the_surfaces(sphere):
    surface, mesh, report = sphere
    faces = boundary_faces(mesh)
    a, b, c = (mesh.nodes[faces[:, i]] for i in range(3))
    enclosed = np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0  # divergence theorem
    assert enclosed == pytest.approx(report.volume, rel=1e-12)
    assert report.volume == pytest.approx(surface.volume * 1e-9, rel=0.02)
    radii = np.linalg.norm(mesh.nodes[np.unique(faces)], axis=1)
    # outermost corners of the icosphere lie on the ball, its faces up to 0.6 % inside
    assert 0.039 < radii.min() and radii.max() < 0.0405
    assert report.surface_distance < 0.1 * 0.014


def test_elements_are_positive_and_well_shaped(sphere):
    _, mesh, report = sphere
    corners = mesh.nodes[mesh.tets]
    assert np.linalg.det(corners[:, 1:] - corners[:, :1]).min() > 0.0
    assert report.min_quality > 0.1
    assert np.radians(5.0) < report.min_dihedral < report.max_dihedral < np.radians(175.0)


def test_quality_of_known_tetrahedra():
    regular = TetMesh(np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float),
                      np.array([[0, 2, 1, 3]]))
    assert abs(meshing.mean_ratio(regular)[0]) == pytest.approx(1.0, rel=1e-12)
    assert meshing.dihedral_angles(regular) == pytest.approx(np.full((1, 6), np.arccos(1 / 3)))
    corner = TetMesh(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]))
    angles = meshing.dihedral_angles(corner)[0]
    assert sorted(angles) == pytest.approx([np.arctan(np.sqrt(2))] * 3 + [np.pi / 2] * 3)
    # 12 (3/6)^(2/3) / (3 * 1 + 3 * 2)
    assert meshing.mean_ratio(corner)[0] == pytest.approx(12 * 0.5 ** (2 / 3) / 9)


def test_nothing_is_left_in_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    meshing.mesh_surface(box(), edge_length=0.02)
    assert list(tmp_path.iterdir()) == []


def test_sharp_box_is_kept():
    mesh, report = meshing.mesh_surface(box(), edge_length=0.012)
    assert np.ptp(mesh.nodes, axis=0) * 1e3 == pytest.approx(BOX_MM, abs=0.2)
    assert report.volume == pytest.approx(60e-6, rel=5e-3)


def test_count_is_reached():
    mesh, report = meshing.mesh_with_count(box(), tets=2000, tolerance=0.05)
    assert abs(len(mesh.tets) - 2000) <= 100
    assert report.n_tets == len(mesh.tets)


@pytest.mark.parametrize('wanted', [300, 400, 700, 1100])
def test_count_is_reached_where_it_does_not_fall_with_length(monkeypatch, wanted):
    """Counts of the silicone beam, 30 mm thick, over edge lengths in mm: they jump and recover."""
    lengths = [8, 10, 11, 13, 14, 17, 18, 20, 21, 22, 24, 25, 27, 28, 29, 30]
    counts = [1931, 1145, 1583, 1297, 753, 667, 1363, 1145, 404, 694, 761, 329, 347, 361, 745, 749]

    def made(_surface, edge_length, _envelope, _repairs):
        n = round(np.interp(edge_length * 1e3, lengths, counts))
        return n, SimpleNamespace(n_tets=n, n_nodes=n // 4)

    monkeypatch.setattr(meshing, '_mesh', made)
    beam = trimesh.creation.box(extents=(30.0, 30.0, 100.0))
    mesh, _ = meshing.mesh_with_count(beam, tets=wanted, tolerance=0.2)
    assert abs(mesh - wanted) <= 0.2 * wanted


@pytest.mark.parametrize('name', ['out.msh', 'out.vtu'])
def test_written_file_reads_back(tmp_path, name):
    surface = tmp_path / 'box.stl'
    box().export(surface)
    rows = mesh_command(surface, tmp_path / name, edge_length_mm=20.0, unit='mm')
    mesh = load_mesh(tmp_path / name)
    assert (len(mesh.nodes), len(mesh.tets)) == (rows['nodes'], rows['tetrahedra'])
    assert meshio.read(tmp_path / name).cells_dict['tetra'].shape == (rows['tetrahedra'], 4)
    assert rows['volume_ml'] == pytest.approx(60.0, rel=1e-3)


@pytest.mark.parametrize('edge_length', [0.0, -0.01, 1e-4, 1.0, np.nan])
def test_edge_length_out_of_range_is_refused(edge_length):
    with pytest.raises(MeshError, match='edge_length'):
        meshing.mesh_surface(box(), edge_length=edge_length)


def test_unknown_output_format_is_refused_before_meshing(tmp_path):
    with pytest.raises(MeshError, match=r'cannot write \.doc'):
        mesh_command(tmp_path / 'absent.stl', tmp_path / 'out.doc', edge_length_mm=5.0)
