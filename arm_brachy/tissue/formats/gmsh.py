"""Gmsh's MSH files, versions 2.2 and 4.1, text and binary, with all physical groups.

Read here because meshio 5.3.5 keeps the first physical group of an entity only, so that a face
in two groups is missing from one of them (nschloe/meshio#619).
Source: Gmsh reference manual 4.13, "MSH file format".
"""

import re
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import decoded
from arm_brachy.tissue.formats.raw import RawMesh

ADVICE = 'export it again from Gmsh as MSH 4.1 or 2.2'
SECTION = re.compile(rb'^\$([A-Za-z]\w*)[ \t\r]*$', re.M)
TET, TET_OF_TEN = 4, 11
SIZES = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18,
         14: 14, 15: 1, 16: 8, 17: 20, 18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15,
         25: 21, 26: 4, 27: 5, 28: 6, 29: 20, 30: 35, 31: 56, 92: 64, 93: 125}
LOW = {1: 1, 2: 2, 3: 2, 8: 1, 9: 2, 10: 2, 15: 0, 16: 2, 20: 2, 21: 2, 22: 2, 23: 2, 24: 2,
       25: 2, 26: 1, 27: 1, 28: 1}                # dimension of elements that bound a body
NAMES = {5: 'hexahedra', 6: 'prisms', 7: 'pyramids', 12: '27-node hexahedra',
         17: '20-node hexahedra', 29: '20-node tetrahedra', 30: '35-node tetrahedra'}
# Gmsh has the last two nodes of a ten-node tetrahedron exchanged.
TO_VTK = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
KIND = {2: 'surface', 3: 'volume'}


@dataclass
class Block:
    """Elements alike. kind : Gmsh's type;  groups : (dimension, tag);  tags : (m, a) nodes."""

    kind: int
    groups: tuple
    tags: np.ndarray


def is_gmsh(data):
    """True if bytes begin as an MSH file of version 2 or 4 does."""
    return data[:200].lstrip().startswith(b'$MeshFormat')


def read_gmsh(data, where):
    """Return the RawMesh of the bytes of an MSH file.

    Node sets: physical groups of surfaces and volumes by name, or `surface_<tag>` and
    `volume_<tag>`; an entity in several groups gives its nodes to all.
    where : file name. Raises MeshError, and what guard.guarded turns into one.
    """
    cursor = _Cursor(data)
    cursor.find(b'$MeshFormat')
    version, binary, size = cursor.line().split()[:3]
    if version not in (b'2.2', b'2', b'2.1', b'2.0', b'4.1'):
        raise MeshError(f'{where}: MSH version {decoded(version)}; must be 2.2 or 4.1; {ADVICE}')
    if int(binary):
        mark = cursor.take(4)
        if mark not in (b'\1\0\0\0', b'\0\0\0\1'):
            raise MeshError(f'{where}: byte order mark {mark!r}; must be 1; {ADVICE}')
        cursor.binary, cursor.order = True, '<' if mark[0] else '>'
    cursor.size = int(size)
    nodes, blocks, names = _sections(cursor, version.startswith(b'4'), where)
    raw = _joined(*nodes, blocks, names, where)
    return raw if version == b'4.1' else _once(raw)


class _Cursor:
    """Numbers one after the other, as text or as bytes."""

    def __init__(self, data):
        self._data, self._at = data, 0
        self.binary, self.order, self.size = False, '<', 8
        self._tokens, self._next = None, 0

    def find(self, mark):
        """Go behind a section's mark; raises ValueError without one."""
        self._at = self._data.index(mark, self._at) + len(mark)
        self.line()

    def section(self):
        """Go to the next section and return its name, None at the end."""
        found = SECTION.search(self._data, self._at)
        while found and found[1].startswith(b'End'):
            found = SECTION.search(self._data, found.end())
        if not found:
            return None
        self._at = found.end() + 1
        return found[1]

    def end(self, name, where):
        """Leave a section whose numbers have all been read."""
        mark = b'$End' + name
        if self._tokens is not None:
            if self._next != len(self._tokens):
                raise MeshError(f'{where}: ${decoded(name)} has {len(self._tokens)} numbers, its '
                                f'counts ask for {self._next}; the file is damaged; {ADVICE}')
            self._tokens = None
            return
        if self._data[self._at:self._at + 64].lstrip()[:len(mark)] != mark:
            raise MeshError(f'{where}: ${decoded(name)} does not end where its counts say; the '
                            f'file is damaged; {ADVICE}')

    def begin(self, name):
        """Get the numbers of a section of text ready."""
        if not self.binary:
            self._tokens, self._next = self.until(b'$End' + name).split(), 0

    def line(self):
        """Return the rest of the line, without its end."""
        end = self._data.index(b'\n', self._at)
        found, self._at = self._data[self._at:end], end + 1
        return found

    def until(self, mark):
        """Return what stands before a mark."""
        end = self._data.find(mark, self._at)
        if end < 0:
            raise EOFError(f'no {decoded(mark)}')
        found, self._at = self._data[self._at:end], end
        return found

    def take(self, count):
        """Return bytes; raises EOFError beyond the end."""
        if not 0 <= count <= len(self._data) - self._at:
            raise EOFError(f'{count} bytes asked for, {len(self._data) - self._at} left')
        found = self._data[self._at:self._at + count]
        self._at += count
        return found

    def _numbers(self, kind, count):
        count = int(count)
        if self.binary:
            return np.frombuffer(self.take(count * np.dtype(kind).itemsize), self.order + kind)
        if not 0 <= count <= len(self._tokens) - self._next:
            raise EOFError(f'{count} numbers asked for, {len(self._tokens) - self._next} left')
        words = self._tokens[self._next:self._next + count]
        self._next += count
        return np.array(words).astype(float if kind == 'f8' else np.int64) if words else (
            np.zeros(0, dtype=kind))

    def ints(self, count):
        """Return `count` of C's int."""
        return self._numbers('i4', count)

    def sizes(self, count):
        """Return `count` of C's size_t, of version 4."""
        return self._numbers(f'u{self.size}' if self.binary else 'i8', count).astype(np.int64)

    def doubles(self, count):
        """Return `count` of C's double."""
        return self._numbers('f8', count)

    def rest(self):
        """Return the numbers left in a section of text, as int64."""
        return self._numbers('i8', len(self._tokens) - self._next)


def _sections(cursor, fourth, where):
    """((tags, places), Blocks, names of groups) of a file."""
    names, groups, nodes, blocks = {}, None, None, None
    read_nodes, read_elements = (_nodes_4, _elements_4) if fourth else (_nodes_2, _elements_2)
    while (name := cursor.section()) is not None:
        if name == b'PhysicalNames':
            names = _names(cursor.until(b'$EndPhysicalNames'))
            continue
        if name == b'PartitionedEntities':
            raise MeshError(f'{where}: a mesh in partitions; must be in one; {ADVICE}')
        if name not in (b'Entities', b'Nodes', b'Elements'):
            if name == b'ParametricNodes':
                raise MeshError(f'{where}: parametric nodes; must be plain; {ADVICE}')
            cursor.until(b'$End' + name)
            continue
        cursor.begin(name)
        if name == b'Entities':
            groups = _entities(cursor)
        elif name == b'Nodes':
            nodes = read_nodes(cursor)
        else:
            blocks = read_elements(cursor, groups, where)
        cursor.end(name, where)
    if nodes is None or blocks is None:
        raise MeshError(f'{where}: no ${"Elements" if nodes else "Nodes"}; the file is cut short; '
                        f'{ADVICE}')
    return nodes, blocks, names


def _names(text):
    """(dimension, tag) -> name."""
    rows = re.findall(r'^\s*(\d+)\s+(\d+)\s+"(.*)"', decoded(text), re.M)
    return {(int(dimension), int(tag)): name for dimension, tag, name in rows}


def _entities(cursor):
    """(dimension, entity) -> ((dimension, group), ...)."""
    groups = {}
    for dimension, count in enumerate(cursor.sizes(4).tolist()):
        for _ in range(count):
            tag = int(cursor.ints(1)[0])
            cursor.doubles(3 if dimension == 0 else 6)
            found = cursor.ints(cursor.sizes(1)[0])
            groups[dimension, tag] = tuple((dimension, abs(int(one))) for one in found)
            if dimension:
                cursor.ints(cursor.sizes(1)[0])
    return groups


def _nodes_4(cursor):
    blocks, total = cursor.sizes(4)[:2].tolist()
    tags, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    for _ in range(blocks):
        dimension, _, parametric = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        tags.append(cursor.sizes(count))
        width = 3 + (dimension if parametric else 0)
        places.append(cursor.doubles(count * width).reshape(count, width)[:, :3])
    tags, places = np.concatenate(tags), np.concatenate(places)
    if len(tags) != total:
        raise ValueError(f'{len(tags)} nodes, {total} stated')
    return tags, places


def _elements_4(cursor, groups, where):
    blocks, total = cursor.sizes(4)[:2].tolist()
    found = []
    for _ in range(blocks):
        dimension, entity, kind = cursor.ints(3).tolist()
        count, width = int(cursor.sizes(1)[0]), _width(kind, where)
        rows = cursor.sizes(count * (1 + width)).reshape(count, 1 + width)
        if groups and (dimension, entity) not in groups:
            raise MeshError(f'{where}: elements of entity {entity}, dimension {dimension}, which '
                            f'$Entities does not have; the file is damaged; {ADVICE}')
        found.append(Block(kind, groups[dimension, entity] if groups else (), rows[:, 1:]))
    if sum(len(block.tags) for block in found) != total:
        raise ValueError(f'{total} elements stated, the blocks have others')
    return found


def _nodes_2(cursor):
    if not cursor.binary:
        count = int(cursor.ints(1)[0])
        rows = cursor.doubles(4 * count).reshape(count, 4)
        tags = rows[:, 0].astype(np.int64)
        return tags, rows[:, 1:]
    count = int(cursor.line())
    row = np.dtype([('tag', cursor.order + 'i4'), ('place', cursor.order + 'f8', 3)])
    rows = np.frombuffer(cursor.take(count * row.itemsize), row)
    return rows['tag'].astype(np.int64), rows['place'].astype(float)


def _elements_2(cursor, _, where):
    """Blocks of elements of one kind in one group, in the order of the file."""
    rows = _binary_rows_2(cursor, where) if cursor.binary else _text_rows_2(cursor, where)
    out = []
    for (kind, group), run in groupby(rows, key=lambda row: row[:2]):
        out.append(Block(kind, ((LOW.get(kind, 3), group),) if group else (),
                         np.array([nodes for *_, nodes in run], dtype=np.int64)))
    return out


def _text_rows_2(cursor, where):
    count, numbers, at = int(cursor.ints(1)[0]), cursor.rest().tolist(), 0
    for _ in range(count):
        kind, tags = numbers[at + 1], numbers[at + 2]
        start = at + 3 + tags
        at = start + _width(kind, where)
        if at > len(numbers) or tags < 0:
            raise EOFError(f'{count} elements stated, the section ends before')
        yield kind, abs(numbers[start - tags]) if tags else 0, numbers[start:at]
    if at != len(numbers):
        raise ValueError(f'{count} elements stated, the section goes on behind them')


def _binary_rows_2(cursor, where):
    count = int(cursor.line())
    while count > 0:
        kind, several, tags = cursor.ints(3).tolist()
        width = 1 + tags + _width(kind, where)
        rows = cursor.ints(several * width).reshape(several, width)
        if several < 1 or tags < 0:
            raise ValueError(f'a block of {several} elements with {tags} tags')
        for row in rows.tolist():
            yield kind, abs(row[1]) if tags else 0, row[1 + tags:]
        count -= several


def _width(kind, where):
    if kind not in SIZES:
        raise MeshError(f'{where}: elements of Gmsh type {kind}; must be one of '
                        f'{", ".join(map(str, SIZES))}; {ADVICE}')
    return SIZES[kind]


def _joined(tags, places, blocks, names, where):
    """The RawMesh of nodes and Blocks, tags replaced by positions."""
    order = np.argsort(tags, kind='stable')
    ordered = tags[order]
    if (np.diff(ordered) == 0).any():
        twice = ordered[np.flatnonzero(np.diff(ordered) == 0)[0]]
        raise MeshError(f'{where}: node {twice} is there twice; must be once; {ADVICE}')
    tets, sets, solids = {TET: [], TET_OF_TEN: []}, {}, {}
    for block in blocks:
        at = np.searchsorted(ordered, block.tags).clip(max=max(len(ordered) - 1, 0))
        if block.tags.size and not (len(ordered) and np.array_equal(ordered[at], block.tags)):
            unknown = block.tags[ordered[at] != block.tags][0] if len(ordered) else block.tags[0]
            raise MeshError(f'{where}: an element names node {unknown}, which is not there; '
                            f'{ADVICE}')
        members = order[at] if block.tags.size else block.tags
        if block.kind in tets:
            tets[block.kind].append(members)
        elif block.kind not in LOW and len(members):
            name = NAMES.get(block.kind, f'elements of Gmsh type {block.kind}')
            solids[name] = solids.get(name, 0) + len(members)
        for dimension, group in block.groups:
            if dimension in KIND:
                name = names.get((dimension, group), f'{KIND[dimension]}_{group}')
                sets[name] = np.union1d(sets.get(name, members.ravel()), members).astype(np.int64)
    return RawMesh(places, _volume(tets, where), sets, solids)


def _volume(tets, where):
    four, ten = (np.concatenate(rows) if rows else None for rows in tets.values())
    if four is not None and ten is not None:
        raise MeshError(f'{where}: {len(four)} tetrahedra of 4 nodes and {len(ten)} of 10; must '
                        f'be of one kind; {ADVICE}')
    if four is None and ten is None:
        return np.zeros((0, 4), dtype=np.int64)
    return four if ten is None else ten[:, TO_VTK]


def _once(raw):
    """The RawMesh with each tetrahedron once: version 2 repeats what is in several groups."""
    _, first = np.unique(raw.tets, axis=0, return_index=True)
    return replace(raw, tets=raw.tets[np.sort(first)])
