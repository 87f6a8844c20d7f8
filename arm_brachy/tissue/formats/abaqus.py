"""Abaqus input files: tetrahedra of every formulation, parts and their instances, node sets.

Read here because meshio 5.3.5 refuses C3D4H (an error of its table), takes a part for the
assembly without its translation, and joins sets of the same name.
Source: Abaqus 2022 Keywords Guide, *NODE, *ELEMENT, *NSET, *PART, *INSTANCE, *INCLUDE.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import decoded, file_bytes
from arm_brachy.tissue.formats.raw import RawMesh

ADVICE = 'export the mesh of the body alone from Abaqus as an input file'
TET = re.compile(r'C3D(4|10)([A-Z]*)')   # hybrid H, modified M, improved I, thermal T, pore P...
SOLIDS = ('C3D', 'AC3D', 'DC3D', 'COH3D', 'SC6', 'SC8')
DEEPEST = 5                              # files that include each other


@dataclass
class Part:
    """Nodes, elements and sets as the file numbers them.

    nodes : number -> place;  tets : rows of numbers, for each count of nodes;  others : type ->
    rows;  sets : name -> numbers
    """

    nodes: dict = field(default_factory=dict)
    tets: dict = field(default_factory=dict)
    others: dict = field(default_factory=dict)
    sets: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Instance:
    """A part at its place: p -> turn (p + shift) about the instance's axis."""

    name: str
    part: str
    rows: tuple


def read_abaqus(path):
    """Return the RawMesh of an Abaqus input file.

    Parts stand where their instances have them; without an assembly, where they were drawn.
    Node sets by name, as it is first written; one of a part that has several instances is
    INSTANCE.NAME.
    Raises MeshError, and what guard.guarded turns into one.
    """
    parts, instances, assembly = _model(_blocks(Path(path), 0), path)
    if not instances:
        instances = [Instance('', name, ()) for name in parts if parts[name].nodes]
    joined = _Joined(path)
    for one in instances:
        if one.part not in parts:
            raise MeshError(f'{path}: *Instance {one.name} of part {one.part!r}, which is not '
                            f'there; the file has: {", ".join(filter(None, parts)) or "none"}')
        joined.add(one, parts[one.part], sum(one.part == other.part for other in instances) > 1)
    for name, owner, numbers in assembly:
        joined.add_set(name, owner, numbers)
    return joined.raw()


def _blocks(path, depth):
    """Yield (KEYWORD, {OPTION: value}, rows of words) of a file and of those that it includes."""
    if depth > DEEPEST:
        raise MeshError(f'{path}: more than {DEEPEST} files include each other; must be fewer')
    lines = [line for line in decoded(file_bytes(path, MeshError)).splitlines()
             if line.strip() and not line.startswith('**')]
    heads = [i for i, line in enumerate(lines) if line.startswith('*')]
    for head, after in zip(heads, [*heads[1:], len(lines)], strict=True):
        line, data = lines[head], head + 1
        while line.rstrip().endswith(',') and data < after:
            line, data = line + lines[data], data + 1
        words = [word.strip() for word in line[1:].split(',')]
        options = {key.strip().upper(): value.strip().strip('"') for key, _, value in (
            word.partition('=') for word in words[1:])}
        if words[0].upper() == 'INCLUDE' and 'INPUT' in options:
            yield from _blocks(path.parent / options['INPUT'], depth + 1)
            continue
        yield words[0].upper(), options, [[w.strip() for w in row.split(',')]
                                          for row in lines[data:after]]


def _model(blocks, path):
    """(PART -> Part, Instances, sets of the assembly as (name, INSTANCE, numbers))."""
    parts, instances, assembly, current = {'': Part()}, [], [], ''
    for keyword, options, rows in blocks:
        if keyword == 'PART':
            current = options.get('NAME', '').upper()
            parts[current] = Part()
        elif keyword in ('END PART', 'END ASSEMBLY', 'ASSEMBLY'):
            current = ''
        elif keyword == 'INSTANCE':
            instances.append(Instance(options.get('NAME', ''), options.get('PART', '').upper(),
                                      tuple(map(tuple, rows))))
        elif keyword == 'NSET' and 'INSTANCE' in options:
            assembly.append((_name(options, 'NSET'), options['INSTANCE'].upper(),
                             _numbers(options, rows, parts[current])))
        elif keyword in ('NODE', 'ELEMENT', 'NSET'):
            _fill(parts[current], keyword, options, rows, path)
        elif keyword in ('NGEN', 'NFILL', 'NCOPY', 'ELGEN', 'ELCOPY', 'SYSTEM'):
            raise MeshError(f'{path}: *{keyword}; must state nodes and elements one by one, in '
                            f'global axes; {ADVICE}')
    return parts, instances, assembly


def _name(options, key):
    return options.get(key, '')


def _fill(part, keyword, options, rows, path):
    if keyword == 'NODE':
        if options.get('SYSTEM', 'R').upper() != 'R':
            raise MeshError(f'{path}: *Node in system {options["SYSTEM"]}; must be rectangular; '
                            f'{ADVICE}')
        found = {int(row[0]): [float(v) if v else 0.0 for v in (*row[1:4], '', '')[:3]]
                 for row in rows}
        part.nodes.update(found)
        if 'NSET' in options:
            part.sets.setdefault(_name(options, 'NSET'), []).extend(found)
    elif keyword == 'NSET':
        part.sets.setdefault(_name(options, 'NSET'), []).extend(_numbers(options, rows, part))
    else:
        _fill_elements(part, options, rows, path)


def _fill_elements(part, options, rows, path):
    kind = options.get('TYPE', '').upper()
    match = TET.fullmatch(kind)
    if not match:
        part.others.setdefault(kind or 'without type', []).extend(
            [int(v) for v in row if v] for row in rows)
        return
    width = 1 + int(match[1])
    numbers = [int(v) for row in rows for v in row if v]
    if len(numbers) % width:
        raise MeshError(f'{path}: *Element {kind} with {len(numbers)} numbers; must be a multiple '
                        f'of {width}; {ADVICE}')
    part.tets.setdefault(width - 1, []).extend(
        numbers[k + 1:k + width] for k in range(0, len(numbers), width))


def _numbers(options, rows, part):
    """Node numbers of a set: listed, generated, or those of other sets."""
    if 'GENERATE' in options:
        found = []
        for row in rows:
            first, last, step = (*[int(v) for v in row if v], 1)[:3]
            if last - first > 10**8:
                raise ValueError(f'nodes {first} to {last}')
            found += [k for k in range(first, last + 1, step) if k in part.nodes or not part.nodes]
        return found
    found, named = [], {name.upper(): numbers for name, numbers in part.sets.items()}
    for word in (w for row in rows for w in row if w):
        if word.lstrip('-').isdigit():
            found.append(int(word))
        elif word.upper() in named:
            found += named[word.upper()]
        else:
            raise ValueError(f'a set holds {word!r}, which is no number and no set before it')
    return found


class _Joined:
    """The instances of a model in one numbering."""

    def __init__(self, path):
        self._path, self._places, self._tets, self._sets = path, [], {}, {}
        self._solids, self._aside, self._at, self._count = {}, {}, {}, 0

    def add(self, instance, part, several):
        """Append a part as an instance has it."""
        if not part.nodes:
            return
        places = np.array(list(part.nodes.values()))
        at = dict(zip(part.nodes, range(self._count, self._count + len(places)), strict=True))
        self._at[instance.name.upper()] = at
        self._places.append(_placed(places, instance.rows))
        self._count += len(places)
        for width, rows in part.tets.items():
            self._tets.setdefault(width, []).extend(self._row(row, at) for row in rows)
        for kind, rows in part.others.items():
            if kind.startswith(SOLIDS):
                self._solids[kind] = self._solids.get(kind, 0) + len(rows)
                continue
            count, nodes = self._aside.get(kind, (0, np.zeros(0, dtype=np.int64)))
            known = [at[k] for row in rows for k in row[1:] if k in at]
            self._aside[kind] = count + len(rows), np.union1d(nodes, known).astype(np.int64)
        for name, numbers in part.sets.items():
            full = f'{instance.name}.{name}' if several else name
            self._gather(full, self._row(numbers, at))

    def add_set(self, name, owner, numbers):
        """Add a set that the assembly makes of an instance's nodes."""
        if owner not in self._at:
            raise MeshError(f'{self._path}: *Nset {name} of instance {owner!r}, which is not '
                            'there')
        self._gather(name, self._row(numbers, self._at[owner]))

    def _gather(self, name, members):
        self._sets.setdefault(name, []).extend(members)

    def _row(self, numbers, at):
        unknown = [k for k in numbers if k not in at]
        if unknown:
            raise MeshError(f'{self._path}: node {unknown[0]} is named and is not there; the file '
                            f'is damaged; {ADVICE}')
        return [at[k] for k in numbers]

    def raw(self):
        """Return the RawMesh."""
        if len(self._tets) > 1:
            raise MeshError(f'{self._path}: {len(self._tets[4])} tetrahedra of 4 nodes and '
                            f'{len(self._tets[10])} of 10; must be of one kind; {ADVICE}')
        places = np.concatenate(self._places) if self._places else np.zeros((0, 3))
        tets = next(iter(self._tets.values()), np.zeros((0, 4)))
        return RawMesh(places, np.array(tets, dtype=np.int64),
                       {name: np.unique(members).astype(np.int64)
                        for name, members in self._sets.items()}, self._solids,
                       self._aside)


def _placed(places, rows):
    """Places (n, 3) translated, then turned about an axis through two points by an angle [deg]."""
    numbers = [[float(v) if v else 0.0 for v in row] for row in rows]
    if numbers:
        places = places + np.array((*numbers[0], 0.0, 0.0, 0.0)[:3])
    if len(numbers) > 1:
        a, b, angle = np.array(numbers[1][:3]), np.array(numbers[1][3:6]), numbers[1][6]
        turn = Rotation.from_rotvec(np.deg2rad(angle) * (b - a) / np.linalg.norm(b - a))
        places = a + turn.apply(places - a)
    return places
