"""Surface files: STL, OBJ, PLY and OFF, whatever their comments are written in."""

from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import decoded, file_bytes, guarded
from arm_brachy.tissue.formats.stl import read_stl

KINDS = ('.stl', '.obj', '.ply', '.off')
CAD = ('.step', '.stp', '.iges', '.igs', '.brep', '.sldprt', '.x_t', '.3mf', '.fcstd')
LEAST = 2   # bytes in which one number of a PLY file fits, a text's digit and blank


def read_surface_file(path):
    """Return (vertices (n, 3), faces (s, 3), notes) of a file, in its unit.

    Raises MeshError for a file of another kind, and one that is cut short or damaged.
    """
    path = Path(path)
    kind = path.suffix.lower()
    data = file_bytes(path, MeshError)
    if kind not in KINDS:
        cure = ('export the body as STL from the CAD program, in mm' if kind in CAD
                else 'convert it to one of these')
        raise MeshError(f'{path}: a {kind or "file without extension"}; must be an STL, OBJ, PLY '
                        f'or OFF file; {cure}')
    with guarded(path, MeshError, 'a readable surface (STL, OBJ, PLY or OFF)', 'export it again'):
        if kind == '.stl':
            return read_stl(data, str(path))
        if kind == '.ply':
            _refuse_counts(data, path)
        else:  # trimesh asks for a package that guesses encodings where text is not UTF-8
            data = decoded(data).encode()
        options = {'skip_materials': True} if kind == '.obj' else {}
        found = trimesh.load(BytesIO(data), file_type=kind[1:], force='mesh', process=False,
                             **options)
        return (np.asarray(getattr(found, 'vertices', np.zeros((0, 3))), dtype=float),
                np.asarray(getattr(found, 'faces', np.zeros((0, 3))), dtype=np.int64), ())


def _refuse_counts(data, path):
    """Refuse a PLY file whose header promises more than the file can hold."""
    for line in data[:data.find(b'end_header') + 1].splitlines():
        words = line.split()
        if words[:1] == [b'element'] and int(words[2]) * LEAST > len(data):
            raise MeshError(f'{path}: says {int(words[2])} of element {decoded(words[1])}; the '
                            f'file of {len(data)} bytes is cut short or damaged; export it again')
