"""Bisection keeps volume, neighbours and sets; grading keeps rims and surface; discs are met."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from arm_brachy.core.errors import MeshError
from arm_brachy.core.scene import PadPatch
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_pad
from arm_brachy.tissue.disc_meshing import mesh_with_discs
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.mesh import boundary_faces, quadratic_mesh, volumes
from arm_brachy.tissue.mesh_check import check_mesh
from arm_brachy.tissue.meshing import dihedral_angles, mean_ratio
from arm_brachy.tissue.outlines import crossing, follow_rims
from arm_brachy.tissue.refinement import grade, near_rims, refine
from arm_brachy.tissue.rims import fit_rim, outline, rim

L = 0.04
TOP = PadPatch('top', centre=(L / 2, L / 2, L), direction=(0.0, 0.0, -1.0), radius=0.012)


@pytest.fixture(scope='module')
def box():
    return box_mesh((L, L, L), (3, 3, 3), perturbation=0.2, rng=np.random.default_rng(3))


@pytest.fixture(scope='module')
def ball():
    """A meshed ball of 30 mm with a disc of 10 mm on top, and its surface."""
    surface = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    patch = PadPatch('top', centre=(0.0, 0.0, 0.03), direction=(0.0, 0.0, -1.0), radius=0.010)
    mesh = mesh_with_discs(surface, (patch,), edge_length=0.012, envelope=6e-4, depth=4e-3,
                           unit='m')
    return surface, patch, mesh


def longest_edges(mesh):
    ends = mesh.nodes[mesh.tets[:, EDGES]]
    return np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2).max(axis=1)


def test_bisection_keeps_body_and_neighbours(box):
    """Same volume and surface area, faces shared by two at most (check_mesh), old nodes first."""
    finer, parents = refine(box, np.arange(0, len(box.tets), 7))
    check_mesh(finer, 'refined')
    assert len(finer.tets) > len(box.tets)
    assert volumes(finer).sum() == pytest.approx(L ** 3, rel=1e-13)
    np.testing.assert_array_equal(finer.nodes[:len(box.nodes)], box.nodes)
    np.testing.assert_allclose(finer.nodes[len(box.nodes):], finer.nodes[parents].mean(axis=1),
                               atol=1e-17)
    corners = finer.nodes[boundary_faces(finer)]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(area, axis=1).sum() / 2 == pytest.approx(6.0 * L ** 2, rel=1e-12)


def test_nothing_marked_changes_nothing(box):
    same, parents = refine(box, np.zeros(len(box.tets), dtype=bool))
    np.testing.assert_array_equal(same.tets, box.tets)
    assert len(parents) == 0


def test_surface_sets_grow_with_the_surface_and_stay_on_it(box):
    """A face of the box is its set, whatever is refined; opposite corners never meet inside."""
    finer, _ = refine(box, np.ones(len(box.tets), dtype=bool))
    for name, axis, at in (('x0', 0, 0.0), ('z1', 2, L)):
        on_face = np.flatnonzero(np.abs(finer.nodes[:, axis] - at) < 1e-12)
        np.testing.assert_array_equal(finer.node_sets[name], on_face)


def test_set_of_a_volume_takes_inner_nodes_too(box):
    whole = TetMesh(box.nodes, box.tets, {'all': np.arange(len(box.nodes))})
    finer, _ = refine(whole, np.ones(len(box.tets), dtype=bool))
    np.testing.assert_array_equal(finer.node_sets['all'], np.arange(len(finer.nodes)))


def test_quality_settles(box):
    """Towards an inner point, until elements are 50 times smaller: none twice as flat as ever."""
    mesh, centre, before = box, np.full(3, L / 2), mean_ratio(box).min()
    for _ in range(15):
        away = np.linalg.norm(mesh.nodes[mesh.tets].mean(axis=1) - centre, axis=1)
        mesh, _ = refine(mesh, away < longest_edges(mesh))
        assert mean_ratio(mesh).min() > 0.5 * before
    assert longest_edges(mesh).min() < 0.02 * longest_edges(box).min()
    assert dihedral_angles(mesh).min() > 0.5 * dihedral_angles(box).min()


def test_equal_meshes_give_equal_meshes(box):
    first, second = (grade(box, lambda p: 0.008 + 0.5 * p[:, 2]) for _ in range(2))
    np.testing.assert_array_equal(first.tets, second.tets)
    np.testing.assert_array_equal(first.nodes, second.nodes)


def test_grading_reaches_the_wished_size_and_no_more(box):
    mesh = grade(box, near_rims(box, (TOP,), 7e-3, growth=1.0))
    centres = mesh.nodes[mesh.tets].mean(axis=1)
    away = np.linalg.norm(centres[:, None] - rim(box, TOP), axis=2).min(axis=1)
    wished = 7e-3 + np.maximum(away - 7e-3, 0.0)
    assert np.all(longest_edges(mesh) <= wished * (1.0 + 1e-12))
    uniform = grade(box, lambda p: np.full(len(p), 7e-3))
    assert len(mesh.tets) < len(uniform.tets) / 2


def test_quadratic_meshes_and_hopeless_sizes_are_refused(box):
    with pytest.raises(MeshError, match='midside'):
        refine(quadratic_mesh(box), [0])
    with pytest.raises(MeshError, match='midside'):
        fit_rim(quadratic_mesh(box), TOP, reach=1e-3)
    beside = PadPatch('edge', centre=(0.0, 0.0, L), direction=(0.0, 0.0, -1.0), radius=0.012)
    with pytest.raises(MeshError, match='beside the body'):
        rim(box, beside)


def test_rim_lies_on_circle_and_surface(box):
    points = rim(box, TOP)
    np.testing.assert_allclose(points[:, 2], L, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points - TOP.centre, axis=1), TOP.radius, rtol=1e-12)


def test_mesh_with_discs_has_the_rim_among_its_edges(ball):
    """A closed polygon of edges on the cylinder, and the pad covers all that is inside it."""
    surface, patch, mesh = ball
    check_mesh(mesh, 'ball')
    edges = outline(mesh, patch)
    assert len(edges) >= 8
    assert np.all(np.unique(edges, return_counts=True)[1] == 2)
    radii = np.linalg.norm(mesh.nodes[np.unique(edges)][:, :2], axis=1)
    np.testing.assert_allclose(radii, patch.radius, rtol=1e-6)
    assert pad_area(mesh, patch) == pytest.approx(polygon_area(mesh, edges), rel=1e-6)
    assert mean_ratio(mesh).min() > 0.1
    assert volumes(mesh).sum() == pytest.approx(surface.volume, rel=0.06)


def pad_area(mesh, patch):
    """What the faces under a pad cover, seen along its axis."""
    faces = boundary_faces(mesh)
    corners = mesh.nodes[faces[np.isin(faces, build_pad(mesh, patch).nodes).all(axis=1)]]
    return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].sum()


def polygon_area(mesh, edges):
    """Area of the star-shaped polygon of `edges` around the z axis, by its triangles."""
    a, b = mesh.nodes[edges[:, 0]], mesh.nodes[edges[:, 1]]
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()


def test_a_mesh_without_rims_gets_them(box):
    """Closed, on the circle, under all of the disc; the box stays the box."""
    surface = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [L, L, L]])
    assert len(crossing(box, TOP))
    mesh = follow_rims(box, (TOP,), surface)
    check_mesh(mesh, 'followed')
    assert not len(crossing(mesh, TOP))
    edges = outline(mesh, TOP)
    assert np.all(np.unique(edges, return_counts=True)[1] == 2)
    centred = TetMesh(mesh.nodes - TOP.centre, mesh.tets)
    assert pad_area(mesh, TOP) == pytest.approx(polygon_area(centred, edges), rel=1e-9)
    assert volumes(mesh).sum() == pytest.approx(L ** 3, rel=1e-12)
    assert mean_ratio(mesh).min() > 0.5 * mean_ratio(box).min()


def test_rim_nodes_that_a_mesher_left_off_the_surface_go_onto_it(box):
    surface = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [L, L, L]])
    mesh = follow_rims(box, (TOP,), surface)
    on_rim = np.unique(outline(mesh, TOP))
    nodes = mesh.nodes.copy()
    nodes[on_rim, 2] += 0.01 * L * np.resize([1.0, -1.0], len(on_rim))
    mesh = follow_rims(replace(mesh, nodes=nodes), (TOP,), surface)
    np.testing.assert_allclose(mesh.nodes[on_rim, 2], L, atol=1e-12)
    assert np.array_equal(np.unique(outline(mesh, TOP)), on_rim)


def test_grading_brings_rim_and_surface_nearer(ball):
    """Halved edges go onto the circle: the disc's missing area falls about fourfold (to 1/2)."""
    surface, patch, mesh = ball
    finer = grade(mesh, near_rims(mesh, (patch,), 2.5e-3, largest=9e-3), patches=(patch,),
                  surface=surface)
    check_mesh(finer, 'graded ball')
    assert len(outline(finer, patch)) >= 2 * len(outline(mesh, patch)) - 4
    circle = np.pi * patch.radius ** 2
    assert circle - pad_area(finer, patch) < 0.5 * (circle - pad_area(mesh, patch))
    short = surface.volume - volumes(mesh).sum()
    assert 0.0 < surface.volume - volumes(finer).sum() < short
