"""Nastran bulk data: grid points and tetrahedra in free, small and large fields.

Read here because meshio 5.3.5 takes coordinates of any system for basic ones, waits for ever
behind a bare BEGIN BULK, and refuses what Gmsh writes.
Source: MSC Nastran 2021 Quick Reference Guide, "Bulk Data Entries": GRID, CTETRA, format rules.
"""

import re

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import decoded
from arm_brachy.tissue.formats.raw import RawMesh

ADVICE = 'export it in the basic coordinate system, without INCLUDE, or as .msh, .vtu or .inp'
SOLIDS = ('CHEXA', 'CPENTA', 'CPYRAM', 'CPYRA', 'CHEX8', 'CHEX20')
SKINS = {'CTRIA3': 3, 'CTRIAR': 3, 'CTRIA6': 6, 'CQUAD4': 4, 'CQUADR': 4, 'CQUAD8': 8}
RODS = {'CROD': 2, 'CBAR': 2, 'CBEAM': 2, 'CTUBE': 2}


def read_nastran(data, where):
    """Return the RawMesh of the bytes of a bulk data file.

    Node sets: `volume_<property>` of tetrahedra and `surface_<property>` of shells.
    where : file name. Raises MeshError, and what guard.guarded turns into one.
    """
    places, tets, solids, others = {}, [], {}, {}
    for name, fields in _cards(decoded(data), where):
        if name == 'GRID':
            if fields[1].strip() not in ('', '0'):
                _refuse(where, f'GRID {fields[0]} in coordinate system {fields[1].strip()}')
            if int(fields[0]) in places:
                _refuse(where, f'GRID {fields[0]} twice')
            places[int(fields[0])] = [_number(v) for v in (*fields[2:5], '', '', '')[:3]]
        elif name == 'GRDSET' and fields[1].strip() not in ('', '0'):
            _refuse(where, f'GRDSET with coordinate system {fields[1].strip()}')
        elif name == 'CTETRA':
            tets.append((int(fields[1] or 0), [int(v) for v in fields[2:12] if v.strip()]))
        elif name in SOLIDS:
            solids[name] = solids.get(name, 0) + 1
        elif name in SKINS or name in RODS:
            count = SKINS.get(name) or RODS[name]
            others.setdefault(name, []).append(
                (int(fields[1] or 0), [int(v) for v in fields[2:2 + count] if v.strip()]))
    return _joined(places, tets, solids, others, where)


def _refuse(where, what):
    raise MeshError(f'{where}: {what}; must be plain basic coordinates, each once; {ADVICE}')


def _cards(text, where):
    """Yield (NAME, fields) of each entry, continuations joined; fields are padded to 12."""
    lines = [line.split('$')[0].expandtabs(8).rstrip() for line in text.splitlines()]
    begin = [k for k, line in enumerate(lines) if line.upper().startswith('BEGIN')]
    name, fields = '', []
    for line in lines[begin[-1] + 1 if begin else 0:]:
        head = line[:8].upper().strip()
        if not line.strip():
            continue
        if head.startswith('ENDDATA'):
            break
        if head.startswith('INCLUDE'):
            _refuse(where, 'INCLUDE')
        first, more = _fields(line)
        if first == '' or first[0] in '+*':
            fields += more
            continue
        if name:
            yield name, fields + [''] * (12 - len(fields))
        name, fields = first.rstrip('*').strip(), more
    if name:
        yield name, fields + [''] * (12 - len(fields))


def _fields(line):
    """(first field in capitals, the data fields) of one line."""
    if ',' in line:
        words = [word.strip() for word in line.split(',')]
        large = words[0].endswith('*') or words[0].startswith('*')
        data = words[1:5 if large else 9]
        return words[0].upper(), data + [''] * ((4 if large else 8) - len(data))
    first = line[:8].strip().upper()
    wide, ends = (16, 72) if '*' in first else (8, 72)
    return first, [line[k:k + wide].strip() for k in range(8, ends, wide)]


def _number(word):
    """A real number as Nastran writes it: 1.5-3 is 0.0015."""
    word = word.strip().upper().replace('D', 'E')
    return float(re.sub(r'(?<=[\d.])([+-])', r'E\1', word)) if word else 0.0


def _joined(places, tets, solids, others, where):
    at = dict(zip(places, range(len(places)), strict=True))
    rows, sets = [], {}

    def known(numbers):
        missing = [n for n in numbers if n not in at]
        if missing:
            raise MeshError(f'{where}: an element names GRID {missing[0]}, which is not there; '
                            f'{ADVICE}')
        return [at[n] for n in numbers]

    for group, numbers in tets:
        rows.append(known(numbers))
        sets.setdefault(f'volume_{group}', []).extend(rows[-1][:4])
    aside = {}
    for name, elements in others.items():
        nodes = [known(numbers) for _, numbers in elements]
        aside[name] = len(elements), np.unique([n for row in nodes for n in row])
        for (group, _), row in zip(elements, nodes, strict=True):
            if name in SKINS:
                sets.setdefault(f'surface_{group}', []).extend(row)
    if len({len(row) for row in rows} - {4, 10}) or len({len(row) for row in rows}) > 1:
        raise MeshError(f'{where}: CTETRA of {sorted({len(row) for row in rows})} nodes; must all '
                        f'be of 4 or all of 10; {ADVICE}')
    return RawMesh(np.array(list(places.values())).reshape(-1, 3),
                   np.array(rows, dtype=np.int64) if rows else np.zeros((0, 4), dtype=np.int64),
                   {name: np.unique(members) for name, members in sets.items()}, solids, aside)
