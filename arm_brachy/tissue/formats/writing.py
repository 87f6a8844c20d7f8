"""Mesh files that `arm-brachy mesh` writes: formats that hold tetrahedra and come back alike."""

import tempfile
from pathlib import Path

import meshio
import numpy as np

from arm_brachy.core.errors import MeshError

# extension -> meshio's name and options; None = numpy's own
FORMATS = {
    '.msh': ('gmsh22', {'binary': False}),
    '.vtu': ('vtu', {}),
    '.vtk': ('vtk', {}),
    '.xdmf': ('xdmf', {'data_format': 'XML'}),   # one file, not one beside it
    '.inp': ('abaqus', {}),
    '.mesh': ('medit', {}),
    '.npz': None,
}


def format_of(path):
    """Return the extension of a path that a mesh can be written to; MeshError for others."""
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise MeshError(f'{path}: cannot write {suffix or "a file without extension"} (it must '
                        f'hold tetrahedra); must end on {", ".join(FORMATS)}')
    return suffix


def write_mesh(path, mesh):
    """Write a TetMesh in metres, format by extension: .msh is Gmsh 2.2 text, .vtu VTK, and so on.

    path : file to write;  mesh : TetMesh. The file appears when it is complete.
    Raises MeshError for an extension that is none of FORMATS.
    """
    path, suffix = Path(path), format_of(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        file = Path(folder) / path.name
        if FORMATS[suffix] is None:
            np.savez(file, nodes=mesh.nodes, tets=mesh.tets, **mesh.node_sets)
        else:
            kind, options = FORMATS[suffix]
            tags = [np.ones(len(mesh.tets), dtype=np.int32)]
            data = {'gmsh:physical': tags, 'gmsh:geometrical': tags} if suffix == '.msh' else {}
            out = meshio.Mesh(mesh.nodes, [('tetra', mesh.tets)], cell_data=data)
            meshio.write(file, out, file_format=kind, **options)
        file.replace(path)
