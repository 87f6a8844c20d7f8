"""Mesh files of all formats that meshio reads, in a process of its own with limits.

In its own: its readers allocate by counts in the file, print, leave the interpreter, and wait for
lines that do not come.
"""

from io import BytesIO
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import confined
from arm_brachy.tissue.formats.raw import RawMesh

SCRIPT = Path(__file__).with_name('meshio_script.py')
ADVICE = 'convert it to .msh (Gmsh 2.2 or 4.1), .vtu or .inp'
PLANE = ('triangle', 'quad', 'line', 'vertex', 'polygon')


def read_other(path):
    """Return the RawMesh of a file in a format of meshio's, chosen by the extension.

    Raises MeshError.
    """
    data = confined(SCRIPT, path, MeshError, f'a readable {Path(path).suffix or "mesh"} file',
                    ADVICE)
    with np.load(BytesIO(data)) as file:
        found = dict(file)
    tets, sets, solids = {}, {}, {}
    for k, kind in enumerate(found['types'].tolist()):
        cells = found[f'cells_{k}']
        if kind in ('tetra', 'tetra10'):
            tets.setdefault(kind, []).append(cells)
        elif not kind.startswith(PLANE) and len(cells):
            solids[kind] = solids.get(kind, 0) + len(cells)
        _add_groups(sets, cells, found.get(f'group_{k}'), int(found[f'dimension_{k}']))
    for k, name in enumerate(found['set_names'].tolist()):
        sets[name] = np.unique(found[f'set_{k}'])
    if len(tets) > 1:
        raise MeshError(f'{path}: tetrahedra of 4 and of 10 nodes; must be of one kind; {ADVICE}')
    rows = np.concatenate(next(iter(tets.values()))) if tets else np.zeros((0, 4), np.int64)
    return RawMesh(found['points'], rows, sets, solids)


def _add_groups(sets, cells, groups, dimension):
    """Node sets of Gmsh's physical groups that another format carries as cell data."""
    kind = {2: 'surface', 3: 'volume'}.get(dimension)
    for group in np.unique(groups) if kind and groups is not None else ():
        members = np.unique(cells[groups == group])
        name = f'{kind}_{group}'
        sets[name] = np.union1d(sets.get(name, members), members).astype(np.int64)
