"""STL files, binary and text.

Read here because trimesh 5.2.0 takes a binary file whose length is not that of its count for
text, in whatever encoding it then guesses (mikedh/trimesh#236, #1720).
Source: 3D Systems, StereoLithography Interface Specification, 1989.
"""

import re

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import decoded

HEAD = 84               # bytes: a comment of 80, the count of triangles
TRIANGLE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])
CORNER = re.compile(rb'^[ \t]*vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t\r]*$', re.M | re.I)
FACET = re.compile(rb'^[ \t]*facet\b', re.M | re.I)
END = re.compile(rb'^[ \t]*endfacet\b', re.M | re.I)
ADVICE = 'export it again'


def read_stl(data, where):
    """Return (vertices (3 n, 3), faces (n, 3), notes) of the bytes of an STL file.

    where : file name. Bytes behind the last triangle are left out, with a note.
    Raises MeshError, and what guard.guarded turns into one.
    """
    if _is_text(data):
        corners, notes = _text(data, where), ()
    else:
        corners, notes = _binary(data, where)
    return corners, np.arange(len(corners)).reshape(-1, 3), notes


def _is_text(data):
    """True for text; binary files may begin with `solid` too."""
    if _fits(data) or not data[:80].lstrip().lower().startswith(b'solid'):
        return False
    return b'\0' not in data[:HEAD] and FACET.search(data) is not None


def _fits(data):
    return len(data) >= HEAD and len(data) == HEAD + _count(data) * TRIANGLE.itemsize


def _count(data):
    return int.from_bytes(data[80:HEAD], 'little')


def _binary(data, where):
    if len(data) < HEAD:
        raise MeshError(f'{where}: {len(data)} bytes; must be an STL file, binary (at least '
                        f'{HEAD} bytes) or text with facets; {ADVICE}')
    count, room = _count(data), (len(data) - HEAD) // TRIANGLE.itemsize
    if count > room:
        raise MeshError(f'{where}: says {count} triangles and holds {room}; the file is cut '
                        f'short; {ADVICE}')
    rows = np.frombuffer(data, TRIANGLE, count, HEAD)
    left = len(data) - HEAD - count * TRIANGLE.itemsize
    notes = (f'{left} bytes behind the last triangle left out',) if left else ()
    return rows['corners'].reshape(-1, 3).astype(float), notes


def _text(data, where):
    words = CORNER.findall(data)
    begun, ended = len(FACET.findall(data)), len(END.findall(data))
    if not len(words) == 3 * begun == 3 * ended:
        raise MeshError(f'{where}: {begun} facets begin, {ended} end, with {len(words)} corners; '
                        f'must be triangles, all complete: the file is cut short; {ADVICE}')
    try:
        return np.array(words).astype(float).reshape(-1, 3)
    except ValueError:
        bad = next(v for row in words for v in row if not _is_number(v))
        raise MeshError(f'{where}: a corner has {decoded(bad)!r}; must be a number with a decimal '
                        f'point; {ADVICE}') from None


def _is_number(word):
    try:
        return float(word) is not None
    except ValueError:
        return False
