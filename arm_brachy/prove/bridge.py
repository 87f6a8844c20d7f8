"""What another laboratory hands over (a body's description, CSV files) -> our scene and bag.

Form: `known` and `write_streams` of the generator. SI, world frame, z out of the base plane.
Test: prove/test_bridge.py
"""

from pathlib import Path

import numpy as np
import trimesh
from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.recording.csv_map import ColumnMap, CsvFile, Encoders, Forces, Optical, Tools
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.tissue.disc_meshing import mesh_with_discs
from arm_brachy.tissue.formats.writing import write_mesh

FEWEST, MOST = 1900, 2600       # tetrahedra of a mesh, quadratic
FIRST_EDGE = 0.16               # of the cube root of the volume; then searched
TRIES = 8
START = 0.5                     # s, added to all times: a clock that is early begins after 0 too
BASE, ON = 'base_', 'on_'       # what names of markers on the base and on pads begin with


def mesh_body(body, path):
    """Mesh the surface of a body with the rims of its pads among the edges; write it to `path`.

    body : the description as read from its JSON. Returns the number of tetrahedra, the nearest
    to FEWEST..MOST in at most TRIES meshes. Raises MeshError.
    """
    surface = trimesh.Trimesh(np.array(body['surface']['vertices_m']),
                              np.array(body['surface']['triangles']), process=False)
    patches, middle = _pads(body), 0.5 * (FEWEST + MOST)
    edge, found = FIRST_EDGE * np.cbrt(surface.volume), None
    for _ in range(TRIES):
        mesh = mesh_with_discs(surface, patches, edge_length=edge, unit='m')
        if found is None or abs(len(mesh.tets) - middle) < abs(len(found.tets) - middle):
            found = mesh
        if FEWEST <= len(mesh.tets) <= MOST:
            break
        edge *= np.cbrt(len(mesh.tets) / middle)
    write_mesh(path, found)
    return len(found.tets)


def write_scene(body, mesh_file, path):
    """Write the scene of a body on `mesh_file` (relative to it) to `path`."""
    scene = Scene(
        name='body', mesh=MeshFile(str(mesh_file)),
        fixed=Region('half_space', point=(0.0, 0.0, 0.5e-3), normal=(0.0, 0.0, -1.0)),
        material=Material(body['E_Pa'], body['nu'], body['density_kg_m3']),
        gravity=tuple(body['gravity_m_s2']), pads=_pads(body),
        markers=tuple(Marker(name, tuple(at), _carrier(name))
                      for name, at in body['markers_m'].items()),
        targets=tuple(Target(name, tuple(at)) for name, at in body['targets_m'].items()))
    _dump(path, config.to_mapping(scene))


def write_bag(body, folder, out, *, withheld=()):
    """Import the CSV files in `folder` as the bag `out`; their column map is left in `folder`.

    withheld : what is not handed over, of 'forces', 'em' and 'tissue' (markers on it)
    """
    pads = _same(p['name'] for p in body['pads'])
    seen = [n for n in body['markers_m'] if 'tissue' not in withheld or _carrier(n) != 'tissue']
    streams = {
        'encoders': Encoders(_file('encoders'), 'q_{key}_m', names=pads),
        'forces': Forces(_file('forces'), 'f_{key}_{axis}_N', 'on_tool', names=pads),
        'optical': Optical(_file('optical'), '{key}_{axis}_m', names=_same(seen)),
        'em': Tools(_file('em'), '{key}_{axis}_m', names=_same(body['targets_m']))}
    given = {kind: (one,) for kind, one in streams.items() if kind not in withheld}
    path = Path(folder) / 'columns.yaml'
    _dump(path, config.to_mapping(ColumnMap('recording', start=START, **given)))
    import_csv(path, out)


def _pads(body):
    return tuple(PadPatch(p['name'], tuple(p['centre_m']), tuple(p['direction']), p['radius_m'],
                          p['stroke_m']) for p in body['pads'])


def _carrier(name):
    if name.startswith(BASE):
        return 'base'
    return name.removeprefix(ON) if name.startswith(ON) else 'tissue'


def _file(stem):
    return CsvFile(f'{stem}.csv.gz', time='t_s')


def _same(names):
    return {name: name for name in names}


def _dump(path, mapping):
    yaml = YAML()
    yaml.width = 99
    with Path(path).open('w', encoding='utf-8') as stream:
        yaml.dump(mapping, stream)
