"""Mesh files of other programs: right, or refused in one line that names what is in them."""

import resource

import meshio
import numpy as np
import pytest

from arm_brachy.core import guard
from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import load_mesh, volumes

SIZE_MM = np.array([60.0, 40.0, 20.0])
VOLUME = np.prod(SIZE_MM) * 1e-9


@pytest.fixture(scope='module')
def box():
    """A TetMesh in millimetres."""
    return box_mesh(SIZE_MM, (3, 2, 2))


def faces_at(box, axis, value):
    """Triangles of the boundary in a plane, from the elements that lie on it."""
    on = np.abs(box.nodes[:, axis] - value) < 1e-9
    return np.array([tet[on[tet]] for tet in box.tets if on[tet].sum() == 3])


def gmsh_41(box, order=1):
    """MSH 4.1 text: the volume in two groups, face x = 0 in two groups, face z = 0 in one."""
    nodes, tets = box.nodes, box.tets
    kind = 4
    if order == 2:
        nodes, tets, kind = *with_ten_nodes(box, [0, 1, 2, 3, 5, 4]), 11
    left, floor = faces_at(box, 0, 0.0), faces_at(box, 2, 0.0)
    lines = ['$MeshFormat', '4.1 0 8', '$EndMeshFormat', '$PhysicalNames', '3', '2 1 "wall"',
             '2 2 "glued"', '3 3 "gel"', '$EndPhysicalNames', '$Entities', '0 0 2 1',
             '5 0 0 0 0 1 1 2 1 2 0', '6 0 0 0 1 1 0 1 2 0', '7 0 0 0 1 1 1 2 3 9 2 5 6',
             '$EndEntities', '$Nodes', f'1 {len(nodes)} 10 {9 + len(nodes)}',
             f'3 7 0 {len(nodes)}', *(str(k + 10) for k in range(len(nodes))),
             *('{!r} {!r} {!r}'.format(*p) for p in nodes.tolist()), '$EndNodes', '$Elements',
             f'3 {len(left) + len(floor) + len(tets)} 1 {len(left) + len(floor) + len(tets)}']
    number = 0
    for dimension, entity, code, rows in ((2, 5, 2, left), (2, 6, 2, floor), (3, 7, kind, tets)):
        lines.append(f'{dimension} {entity} {code} {len(rows)}')
        for row in rows:
            number += 1
            lines.append(' '.join(map(str, [number, *(row + 10)])))
    return '\n'.join([*lines, '$EndElements', ''])


def with_ten_nodes(box, order=range(6), bend=0.0):
    """(nodes, (m, 10)) with a node on every edge; order : of the six; bend : off the middle."""
    pairs = np.sort(box.tets[:, [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]]], axis=2)
    edges, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middles = box.nodes[edges].mean(axis=1) + bend * np.array([0.0, 0.0, 1.0])
    which = len(box.nodes) + which.reshape(-1, 6)[:, list(order)]
    return np.vstack([box.nodes, middles]), np.hstack([box.tets, which])


def save(path, text):
    path.write_text(text)
    return path


def test_a_face_in_two_groups_is_in_both(tmp_path, box):
    mesh = load_mesh(save(tmp_path / 'm.msh', gmsh_41(box)), 'mm')
    left, floor = (np.flatnonzero(np.abs(box.nodes[:, axis]) < 1e-9) for axis in (0, 2))
    assert np.array_equal(mesh.node_sets['wall'], left)
    assert np.array_equal(mesh.node_sets['glued'], np.union1d(left, floor))
    assert np.array_equal(mesh.node_sets['gel'], np.arange(len(box.nodes)))
    assert np.array_equal(mesh.node_sets['volume_9'], mesh.node_sets['gel'])
    assert np.array_equal(mesh.tets, box.tets)
    np.testing.assert_allclose(mesh.nodes, 1e-3 * box.nodes, rtol=1e-15)


@pytest.mark.parametrize('kind', ['gmsh', 'gmsh22'])
@pytest.mark.parametrize('binary', [True, False])
def test_what_meshio_writes_as_gmsh_is_read_alike(tmp_path, box, kind, binary):
    tags = [np.full(len(box.tets), 4, dtype=np.int32)]
    raw = meshio.Mesh(box.nodes, [('tetra', box.tets)], field_data={'gel': np.array([4, 3])},
                      cell_data={'gmsh:physical': tags, 'gmsh:geometrical': tags})
    if kind == 'gmsh':
        raw.point_data['gmsh:dim_tags'] = np.tile([3, 4], (len(box.nodes), 1))
    meshio.write(tmp_path / 'm.msh', raw, file_format=kind, binary=binary)
    mesh = load_mesh(tmp_path / 'm.msh', 'mm')
    assert np.array_equal(mesh.tets, box.tets)
    np.testing.assert_allclose(mesh.nodes, 1e-3 * box.nodes, rtol=1e-14)
    assert len(mesh.node_sets['gel']) == len(box.nodes)


def test_version_2_repeats_an_element_in_two_groups(tmp_path, box):
    rows = [f'{k + 1} 4 2 {1 + (k >= len(box.tets))} 1 ' + ' '.join(map(str, tet + 1))
            for k, tet in enumerate(np.vstack([box.tets, box.tets[:5]]))]
    nodes = ['{} {!r} {!r} {!r}'.format(k + 1, *p) for k, p in enumerate(box.nodes.tolist())]
    text = ['$MeshFormat', '2.2 0 8', '$EndMeshFormat', '$Nodes', str(len(nodes)), *nodes,
            '$EndNodes', '$Elements', str(len(rows)), *rows, '$EndElements', '']
    mesh = load_mesh(save(tmp_path / 'm.msh', '\n'.join(text)), 'mm')
    assert np.array_equal(mesh.tets, box.tets)
    assert np.array_equal(mesh.node_sets['volume_2'], np.unique(box.tets[:5]))


def test_ten_nodes_are_read_by_their_corners(tmp_path, box):
    nodes, ten = with_ten_nodes(box)
    meshio.write(tmp_path / 'm.vtu', meshio.Mesh(nodes, [('tetra10', ten)]))
    save(tmp_path / 'm.msh', gmsh_41(box, order=2))
    save(tmp_path / 'm.inp', abaqus(nodes, ten, 'C3D10MH'))
    for name in ('m.vtu', 'm.msh', 'm.inp'):
        mesh = load_mesh(tmp_path / name, 'mm')
        assert np.array_equal(mesh.tets, box.tets), name
        assert mesh.notes == (f'{len(box.tets)} ten-node tetrahedra read by their corners',)
        assert volumes(mesh).sum() == pytest.approx(VOLUME)


def test_curved_edges_are_said_and_wild_ones_refused(tmp_path, box):
    for bend, words in ((0.5, 'are curved, by up to'), (30.0, 'off the middle of an edge')):
        nodes, ten = with_ten_nodes(box, bend=bend)
        meshio.write(tmp_path / 'm.vtu', meshio.Mesh(nodes, [('tetra10', ten)]))
        if bend < 1.0:
            assert words in load_mesh(tmp_path / 'm.vtu', 'mm').notes[0]
        else:
            with pytest.raises(MeshError, match=words):
                load_mesh(tmp_path / 'm.vtu', 'mm')


def abaqus(nodes, tets, kind='C3D4', more='', instance='', clamp=True):
    """Text of an input file with one part, or with an assembly of one instance."""
    lines = ['*Heading', '** a comment', '*Part, name=Gel', '*NODE',
             *('{}, {!r}, {!r}, {!r}'.format(7 * k + 7, *p) for k, p in enumerate(nodes.tolist())),
             f'*Element, type={kind}, elset=all',
             *(f'{k + 1}, ' + ', '.join(str(7 * n + 7) for n in row)
               for k, row in enumerate(tets))]
    if clamp:
        lines += ['*Nset, nset=Clamp, generate', '7, 49, 7', '*nset, nset=both', 'CLAMP, 56']
    lines += ['*End Part', more]
    if instance:
        lines += ['*Assembly, name=A', '*Instance, name=Gel-1, part=GEL', instance,
                  '*End Instance', '*Nset, nset=tip, instance=Gel-1', '7, 14', '*End Assembly']
    return '\n'.join([line for line in lines if line] + ['*Step', '*Static', '*End Step', ''])


@pytest.mark.parametrize('kind', ['C3D4', 'C3D4H', 'c3d4t'])
def test_abaqus_tetrahedra_of_every_formulation(tmp_path, box, kind):
    mesh = load_mesh(save(tmp_path / 'm.inp', abaqus(box.nodes, box.tets, kind)), 'mm')
    assert np.array_equal(mesh.tets, box.tets)
    assert mesh.node_sets['Clamp'].tolist() == list(range(7))
    assert mesh.node_sets['both'].tolist() == list(range(8))


def test_an_instance_stands_where_the_assembly_has_it(tmp_path, box):
    text = abaqus(box.nodes, box.tets, instance='10., 20., 30.\n10., 20., 30., 10., 20., 31., 90.')
    mesh = load_mesh(save(tmp_path / 'm.inp', text), 'mm')
    turned = box.nodes @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mesh.nodes, 1e-3 * (turned + [10.0, 20.0, 30.0]), atol=1e-15)
    assert mesh.node_sets['tip'].tolist() == [0, 1]


PLATE = ('*Part, name=Plate\n*Node\n1, 0, 0, -5\n2, 60, 0, -5\n3, 60, 40, -5\n4, 0, 40, -5\n'
         '*Element, type={}\n1, 1, 2, 3, 4\n*End Part')


def test_a_plate_beside_the_body_is_left_out_and_said(tmp_path, box):
    text = abaqus(box.nodes, box.tets, more=PLATE.format('R3D4'))
    mesh = load_mesh(save(tmp_path / 'm.inp', text), 'mm')
    assert np.array_equal(mesh.tets, box.tets)
    assert mesh.notes == (f'left out beside {len(box.tets)} tetrahedra: 1 R3D4',)


def test_other_solids_are_refused_by_name(tmp_path, box):
    text = abaqus(box.nodes, box.tets, more=PLATE.format('C3D8R').replace(
        '1, 1, 2, 3, 4\n*End', '1, 1, 2, 3, 4, 1, 2, 3, 4\n*End'))
    with pytest.raises(MeshError, match='holds 1 C3D8R beside 72 tetrahedra'):
        load_mesh(save(tmp_path / 'm.inp', text), 'mm')
    hexahedron = np.array([[0, 1, 2, 3, 4, 5, 6, 7]])
    meshio.write(tmp_path / 'm.vtu', meshio.Mesh(box.nodes, [('hexahedron', hexahedron)]))
    with pytest.raises(MeshError, match='no tetrahedra; it holds 1 hexahedron'):
        load_mesh(tmp_path / 'm.vtu', 'mm')


def nastran(box, system='', layout='free', ten=None):
    """Text of a bulk data file whose numbers are written in one of three layouts."""
    def card(name, *fields):
        words = [v if isinstance(v, str) else repr(v).replace('e-', '-') for v in fields]
        if layout == 'free':
            rows = [words[k:k + 8] for k in range(0, len(words), 8)]
            return '\n'.join(','.join([name if k == 0 else '+', *row])
                             for k, row in enumerate(rows))
        width, count, star = (8, 8, '') if layout == 'small' else (16, 4, '*')
        rows = [words[k:k + count] for k in range(0, len(words), count)]
        return '\n'.join((name + star if k == 0 else star or '+').ljust(8)
                         + ''.join(w.rjust(width) for w in row) for k, row in enumerate(rows))
    nodes, tets = (box.nodes, box.tets) if ten is None else ten
    rows = [card('GRID', k + 1, system, *np.round(p, 2).tolist()) for k, p in enumerate(nodes)]
    rows += [card('CTETRA', k + 1, 4, *(tet + 1).tolist()) for k, tet in enumerate(tets)]
    wall = faces_at(box, 0, 0.0)
    rows += [card('CTRIA3', 1000 + k, 5, *(face + 1).tolist()) for k, face in enumerate(wall)]
    return '\n'.join(['SOL 101', 'CEND', 'BEGIN BULK', '$ a comment', *rows, 'ENDDATA', ''])


@pytest.mark.parametrize('layout', ['free', 'small', 'large'])
@pytest.mark.parametrize('order', [1, 2])
def test_nastran(tmp_path, box, layout, order):
    ten = with_ten_nodes(box) if order == 2 else None
    mesh = load_mesh(save(tmp_path / 'm.bdf', nastran(box, layout=layout, ten=ten)), 'mm')
    assert np.array_equal(mesh.tets, box.tets)
    np.testing.assert_allclose(mesh.nodes, 1e-3 * box.nodes, atol=5e-6)
    assert np.array_equal(mesh.node_sets['surface_5'], np.flatnonzero(box.nodes[:, 0] < 1e-9))
    assert len(mesh.node_sets['volume_4']) == len(box.nodes)


def test_what_meshio_writes_as_nastran_has_no_property(tmp_path, box):
    raw = meshio.Mesh(box.nodes, [('tetra', box.tets)])
    meshio.nastran.write(tmp_path / 'm.bdf', raw)
    assert np.array_equal(load_mesh(tmp_path / 'm.bdf', 'mm').tets, box.tets)


def test_nastran_in_systems_of_its_own_is_refused(tmp_path, box):
    with pytest.raises(MeshError, match='GRID 1 in coordinate system 3'):
        load_mesh(save(tmp_path / 'm.bdf', nastran(box, system='3')), 'mm')


@pytest.mark.parametrize(('name', 'text'), [
    ('m.py', 'while True: pass'), ('m.py', 'print("x" * 9); b = bytes(10**12)'),
    ('m.py', 'import os; os.abort()'), ('m.py', 'raise ValueError("two\\nlines")')])
def test_a_reader_that_hangs_grows_or_dies_is_one_line(tmp_path, monkeypatch, name, text):
    monkeypatch.setattr(guard, 'SECONDS', 1.0)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with pytest.raises(MeshError, match='x.vtu: not a mesh: .*; export it again') as caught:
        guard.confined(save(tmp_path / name, text), save(tmp_path / 'x.vtu', ''), MeshError,
                       'a mesh', 'export it again')
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert '\n' not in str(caught.value)
    assert spent.ru_utime - before.ru_utime < 4.0
    # Until it starts its program a child counts the pages of its parent, which may be a gigabyte.
    own = 1.05 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert spent.ru_maxrss <= max(1e6, own, before.ru_maxrss)


@pytest.mark.parametrize(('name', 'text'), [
    ('m.xdmf', '<?xml version="1.0"?><Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry '
               'GeometryType="XYZ"><DataItem DataType="Float" Dimensions="8 3" Format="HDF" '
               'Precision="8">a.h5:/data0</DataItem></Geometry></Grid></Domain></Xdmf>'),
    ('m.xdmf', '<?xml version="1.0"?><Xdmf Version="3.0"><Domain>'), ('m.med', 'no HDF'),
    ('m.e', 'no netCDF'), ('m.vtu', '<VTKFile'), ('m.mesh', 'MeshVersionFormatted 2\nVertices\n9'),
    ('m.msh', '$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 99999999999 1 2\n'),
    ('m.msh', '$MeshFormat\n4.1 1 8\n'), ('m.msh', '(0 "fluent")'),
    ('m.inp', '*Element, type=C3D4'), ('m.bdf', 'BEGIN BULK'), ('m.bdf', 'GRID,1,,x,0.,0.'),
    ('m.inp', '*Node\n1, 0, zero, 0\n'), ('m.npz', 'PK')])
def test_damage_is_one_line(tmp_path, name, text):
    with pytest.raises(MeshError, match=name) as caught:
        load_mesh(save(tmp_path / name, text), 'mm')
    assert '\n' not in str(caught.value) and len(str(caught.value)) < 700


@pytest.mark.parametrize('share', [0.2, 0.5, 0.8, 0.97])
def test_a_cut_gmsh_file_is_one_line(tmp_path, box, share):
    text = gmsh_41(box)
    with pytest.raises(MeshError, match=r'm\.msh') as caught:
        load_mesh(save(tmp_path / 'm.msh', text[:int(share * len(text))]), 'mm')
    assert '\n' not in str(caught.value)
