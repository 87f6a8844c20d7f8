"""Run by `guard.confined`: one file through meshio, its arrays as .npz to standard output."""

import sys
from io import BytesIO

import meshio
import numpy as np


def arrays(mesh):
    """Return name -> array of a meshio.Mesh: points, cells, named point sets, Gmsh's groups."""
    found = {'points': np.asarray(mesh.points, dtype=float),
             'types': np.array([block.type for block in mesh.cells], dtype=str)}
    groups = mesh.cell_data.get('gmsh:physical', [None] * len(mesh.cells))
    for k, (block, group) in enumerate(zip(mesh.cells, groups, strict=True)):
        # cells of unequal lengths (polyhedra) are no array
        data = np.asarray(block.data, dtype=np.int64)
        found[f'cells_{k}'], found[f'dimension_{k}'] = data, np.array(block.dim)
        if group is not None:
            found[f'group_{k}'] = np.asarray(group, dtype=np.int64)
    found['set_names'] = np.array(list(mesh.point_sets), dtype=str)
    for k, members in enumerate(mesh.point_sets.values()):
        found[f'set_{k}'] = np.asarray(members, dtype=np.int64)
    return found


if __name__ == '__main__':
    target, sys.stdout = sys.stdout.buffer, sys.stderr   # meshio prints its complaints
    buffer = BytesIO()
    np.savez(buffer, **arrays(meshio.read(sys.argv[1])))
    target.write(buffer.getvalue())
