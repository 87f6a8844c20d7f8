"""Surface files of other programs: right, or refused in one line."""

import struct

import numpy as np
import pytest
import trimesh

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.formats.writing import FORMATS, format_of, write_mesh
from arm_brachy.tissue.mesh import load_mesh
from arm_brachy.tissue.mesh_command import mesh_command
from arm_brachy.tissue.surface import read_surface

EXTENTS = (30.0, 40.0, 50.0)
VOLUME = pytest.approx(60e-6, rel=1e-6)


@pytest.fixture(scope='module')
def box():
    return trimesh.creation.box(EXTENTS)


def binary(box, header=b'', count=None):
    rows = b''.join(struct.pack('<12fH', 0, 0, 0, *corners.ravel(), 0)
                    for corners in box.triangles)
    count = len(box.faces) if count is None else count
    return header.ljust(80, b'\0') + struct.pack('<I', count) + rows


def text(box, name=b'body'):
    rows = [b'facet normal 0 0 0\n outer loop\n' + b''.join(
        b'  VERTEX %r %r %r\n' % tuple(p) for p in corners.tolist()) + b' endloop\nendfacet\n'
        for corners in box.triangles]
    return b'solid ' + name + b'\r\n' + b''.join(rows) + b'endsolid ' + name + b'\n'


@pytest.mark.parametrize(('make', 'repairs'), [
    (lambda b: binary(b), ()), (lambda b: binary(b, b'solid of a CAD program'), ()),
    (lambda b: binary(b) + b'\0' * 7, ('7 bytes behind the last triangle left out',)),
    (lambda b: binary(b, 'Körper'.encode('latin-1')), ()),
    (lambda b: text(b), ()), (lambda b: text(b, 'Körper'.encode('latin-1')), ()),
    (lambda b: text(b, 'Körper'.encode()), ()), (lambda b: text(b).replace(b'\n', b'\r\n'), ()),
])
def test_stl_as_programs_write_it(tmp_path, box, make, repairs):
    (tmp_path / 'x.stl').write_bytes(make(box))
    surface, done = read_surface(tmp_path / 'x.stl')
    assert surface.volume == VOLUME and done == repairs


@pytest.mark.parametrize('kind', ['obj', 'off', 'ply', 'stl'])
def test_a_second_reader_agrees(tmp_path, box, kind):
    box.export(tmp_path / f'x.{kind}')
    ours, _ = read_surface(tmp_path / f'x.{kind}')
    theirs, _ = read_surface(trimesh.load(tmp_path / f'x.{kind}', process=False, force='mesh'))
    assert np.array_equal(ours.vertices, theirs.vertices)
    assert np.array_equal(ours.faces, theirs.faces)


def test_comments_in_another_encoding(tmp_path, box):
    body = box.export(file_type='obj').encode()
    (tmp_path / 'x.obj').write_bytes('# Würfel\no Würfel\n'.encode('latin-1') + body)
    assert read_surface(tmp_path / 'x.obj')[0].volume == VOLUME


@pytest.mark.parametrize(('name', 'make', 'words'), [
    ('x.stl', lambda b: binary(b)[:400], 'says 12 triangles and holds 6; the file is cut short'),
    ('x.stl', lambda b: binary(b, count=2**32 - 1), 'says 4294967295 triangles and holds 12'),
    ('x.stl', lambda b: text(b)[:700], 'facets begin, .* the file is cut short'),
    ('x.stl', lambda b: text(b).replace(b'20.0', b'20,0'),
     'a corner has .*20,0.* must be a number'),
    ('x.stl', lambda b: b'', '0 bytes; must be an STL file'),
    ('x.step', lambda b: b'ISO-10303-21;', 'must be an STL, OBJ, PLY or OFF file; export'),
    ('x.3mf', lambda b: b'', 'must be an STL, OBJ, PLY or OFF file; export the body as STL'),
    ('x.glb', lambda b: b'glTF', 'must be an STL, OBJ, PLY or OFF file; convert'),
    ('x.ply', lambda b: b'ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n'
     b'property float x\nend_header\n', 'says 99999999999 of element vertex; the file of'),
    ('x.obj', lambda b: b'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n', 'x.obj: '),
    ('x.off', lambda b: b'OFF\n3 1 0\n0 0 0\n', 'x.off: '),
])
def test_what_is_no_surface_is_one_line(tmp_path, box, name, make, words):
    (tmp_path / name).write_bytes(make(box))
    with pytest.raises(MeshError, match=words) as caught:
        read_surface(tmp_path / name)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('suffix', FORMATS)
def test_every_format_that_is_offered_comes_back_alike(tmp_path, suffix):
    mesh = box_mesh((0.06, 0.04, 0.02), (3, 2, 2))
    write_mesh(tmp_path / f'm{suffix}', mesh)
    assert [p.name for p in tmp_path.iterdir()] == [f'm{suffix}']
    back = load_mesh(tmp_path / f'm{suffix}')
    assert np.array_equal(back.tets, mesh.tets)
    np.testing.assert_allclose(back.nodes, mesh.nodes, rtol=1e-14, atol=1e-17)


@pytest.mark.parametrize('name', ['m.stl', 'm.ply', 'm.off', 'm.wkt', 'm.bdf', 'm.med', 'm'])
def test_what_cannot_hold_tetrahedra_is_refused_before_meshing(tmp_path, name):
    """The surface is not there: nothing is read before the output has been looked at."""
    with pytest.raises(MeshError, match='must hold tetrahedra.*must end on .msh, .vtu'):
        mesh_command(tmp_path / 'none.stl', tmp_path / name, edge_length_mm=10.0)
    assert format_of('a/b.MSH') == '.msh'
