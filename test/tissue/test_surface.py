"""Closed surfaces: what has an inside is read and turned outward, all else is refused."""

import numpy as np
import pytest
import trimesh

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.surface import read_surface

BOX_MM = (30.0, 40.0, 50.0)


def box(extents=BOX_MM):
    return trimesh.creation.box(extents)


def test_inward_surface_is_turned():
    inward = box()
    inward.invert()
    surface, repairs = read_surface(inward)
    assert surface.volume > 0.0
    assert repairs == ('12 of 12 faces turned outward',)


def test_one_flipped_face_is_turned():
    faces = box().faces.copy()
    faces[3] = faces[3][::-1]
    surface, repairs = read_surface(trimesh.Trimesh(box().vertices, faces, process=False))
    assert surface.volume == pytest.approx(60e-6)
    assert repairs == ('1 of 12 faces turned outward',)


def opened():
    return trimesh.Trimesh(box().vertices, box().faces[1:], process=False)


def with_fin():
    """A box with one more triangle standing on an edge."""
    solid = box()
    edge = solid.faces[0][:2]
    vertices = np.vstack([solid.vertices, solid.vertices[edge].mean(axis=0) * 2.0])
    return trimesh.Trimesh(vertices, np.vstack([solid.faces, [*edge, len(solid.vertices)]]),
                           process=False)


def two_boxes():
    other = box()
    other.apply_translation([100.0, 0.0, 0.0])
    return trimesh.util.concatenate([box(), other])


def pinched():
    """Two boxes that share one corner."""
    other = box()
    other.apply_translation(BOX_MM)
    return trimesh.util.concatenate([box(), other])


def crossing():
    """A box whose one corner is pushed through the opposite wall."""
    solid = box().subdivide()
    vertices = solid.vertices.copy()
    vertices[0] *= -3.0
    return trimesh.Trimesh(vertices, solid.faces, process=False)


def flat():
    triangle = np.array([[0, 0, 0], [30, 0, 0], [0, 30, 0]], float)
    return trimesh.Trimesh(np.vstack([triangle, [[10, 10, 0]]]),
                           [[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]], process=False)


def not_finite():
    vertices = box().vertices.copy()
    vertices[2, 1] = np.nan
    return trimesh.Trimesh(vertices, box().faces, process=False)


@pytest.mark.parametrize(('surface', 'complaint'), [
    (opened(), r'open: 3 boundary edges, first near \(.*\) mm'),
    (with_fin(), 'open: 2 boundary edges|non-manifold: 1 edges'),
    (two_boxes(), '2 separate pieces'),
    (pinched(), 'non-manifold: 1 corners'),
    (crossing(), 'self-intersecting: .* first near'),
    (flat(), 'encloses .* must enclose a volume'),
    (not_finite(), 'not finite'),
])
def test_bad_surface_is_refused_in_one_line(surface, complaint):
    with pytest.raises(MeshError, match=complaint) as caught:
        read_surface(surface)
    assert '\n' not in str(caught.value)


def test_wrong_unit_is_refused():
    with pytest.raises(MeshError, match='50 m read in m.*check the unit'):
        read_surface(box(), unit='m')
    with pytest.raises(MeshError, match='unit'):
        read_surface(box((0.03, 0.03, 0.1)), unit='mm')


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(MeshError, match='no such file'):
        read_surface(tmp_path / 'absent.stl')
    for name in ('text.stl', 'text.ply', 'text.obj', 'text.xyz'):
        (tmp_path / name).write_text('this is no surface\n')
        with pytest.raises(MeshError, match=name):
            read_surface(tmp_path / name)
