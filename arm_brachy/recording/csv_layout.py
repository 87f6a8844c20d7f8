"""What an instrument's export says of itself: where its names stand, its rate and its unit.

Layouts, by their own documents and by files that are public:

- OptiTrack Motive, docs.optitrack.com "Data Export: CSV" (format 1.2x): pairs of key and value in
  the first line, then lines of Type, Name, ID, (Parent,) Rotation or Position, and the axes
- Vicon Nexus, "Export data to ASCII": a section `Trajectories`, its rate, names, axes, units
- Qualisys QTM user manual, "TSV file formats": NO_OF_FRAMES and its like, then the table, whose
  header may be left out; lengths are in mm
- NDI Toolbox and Track: `Tools`, then for every tool `Port n: name` and its columns, in mm
- ATI Net F/T manual 9620-05, "Demo CSV file format": counts, and by how many to divide

Test: recording/test_csv_layout.py
"""

import csv
import re
from dataclasses import dataclass, replace

LENGTHS = {'meters': 'm', 'm': 'm', 'centimeters': 'cm', 'cm': 'cm', 'millimeters': 'mm',
           'mm': 'mm'}
FORCES = {'n': 'N', 'kn': 'kN', 'lbf': 'lbf', 'lb': 'lbf', 'kgf': 'kgf', 'kg': 'kgf'}
PORT = 'Port'           # begins the cell before the columns of an NDI tool
QTM_KEY = re.compile(r'[A-Z]+(_[A-Z]+)+|FREQUENCY|DESCRIPTION|EVENT')
PREAMBLE = 40           # lines among which a header stands


@dataclass(frozen=True)
class Layout:
    """An export that was recognised.

    kind : in words;  preset : name of its preset
    header_line : number of the line with the columns' own names, from 1; 0 = the file has none,
        and `header` is what it should be
    name_lines, skip_below, group, until_blank : as `csv_map.CsvFile`
    rate : [Hz] that the file states, 0.0 = none;  unit : that it states, '' = none
    counts : divisor of forces;  bodies : markers and bodies of a header with several kinds, by
        kind ('Marker', 'Rigid Body')
    """

    kind: str
    preset: str
    header_line: int
    name_lines: tuple = ()
    skip_below: int = 0
    group: str = ''
    until_blank: bool = False
    rate: float = 0.0
    unit: str = ''
    counts: float = 1.0
    header: tuple = ()
    bodies: tuple = ()


def recognise(lines, delimiter):
    """Layout of a file by its lines (text each), or None."""
    if not lines:
        return None
    for look in (_motive, _qualisys, _ndi, _ati, _nexus):
        found = look(lines, delimiter)
        if found is not None:
            return found
    return None


def cells_of(line, delimiter):
    """The cells (stripped) of one line of text, whatever is wrong with its quotes."""
    try:
        row = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        row = line.split(delimiter)
    return [cell.strip() for cell in row]


def guess_delimiter(lines):
    """The sign between cells that a file's longest early line has most of: comma, semicolon, tab.
    """
    text = max(lines[:PREAMBLE], key=len, default='')
    return max(',;\t', key=text.count)


def filled(cells):
    """Names, each for the empty cells that follow it as well."""
    out, last = [], ''
    for cell in cells:
        last = cell or last
        out.append(last)
    return out


def number(text):
    """The number in a cell, with a point or a comma; 0.0 where there is none."""
    try:
        return float(text.replace(',', '.'))
    except ValueError:
        return 0.0


def _motive(lines, delimiter):
    head = cells_of(lines[0], delimiter)
    if head[:1] != ['Format Version']:
        return None
    said = dict(zip(head[::2], head[1::2], strict=False))
    rows = [cells_of(line, delimiter) for line in lines[:PREAMBLE]]
    at = next((i for i, row in enumerate(rows) if row[:1] == ['Frame']), None)
    if at is None:
        return None
    label = {row[1]: i for i, row in enumerate(rows[:at]) if len(row) > 1 and row[1]}
    names = [label['Name'] + 1] if 'Name' in label else []
    if set(rows[at - 1]) & {'Rotation', 'Position'}:
        names.append(at)        # the line above: number of its index and one
    kinds = rows[label['Type']] if 'Type' in label else []
    owners = rows[label['Name']] if 'Name' in label else []
    bodies = tuple(dict.fromkeys(zip(kinds[2:], owners[2:], strict=False)))
    return Layout('OptiTrack Motive', 'motive', at + 1, tuple(names),
                  rate=number(said.get('Export Frame Rate', '')),
                  unit=LENGTHS.get(said.get('Length Units', '').lower(), ''), bodies=bodies)


def _nexus(lines, delimiter):
    at = next((i for i, line in enumerate(lines)
               if line.strip(f' "\r\n{delimiter}') == 'Trajectories'), None)
    if at is None or at + 4 >= len(lines):
        return None
    units = [cell for cell in cells_of(lines[at + 4], delimiter) if cell]
    has_units = bool(units) and not any(map(_numeric, units))
    return Layout('Vicon Nexus', 'nexus', at + 4, (at + 3,), int(has_units), until_blank=True,
                  rate=number(cells_of(lines[at + 1], delimiter)[0]),
                  unit=LENGTHS.get(units[0].lower(), '') if has_units else '')


def _qualisys(lines, delimiter):
    rows = [cells_of(line, delimiter) for line in lines[:PREAMBLE]]
    said = {}
    at = next((i for i, row in enumerate(rows) if not QTM_KEY.fullmatch(row[0] if row else '')),
              None)
    if at is None:
        return None
    for row in rows[:at]:
        said.setdefault(row[0], row[1:])
    if said and not {'NO_OF_FRAMES', 'MARKER_NAMES'} & set(said):
        return None
    found = Layout('Qualisys', 'qualisys', 1, unit='mm',
                   rate=number((said.get('FREQUENCY') or [''])[0]))
    first = rows[at]
    if first[:2] == ['Frame', 'Time'] and len(first) > 2 and re.fullmatch('.+ [XYZ]', first[2]):
        return replace(found, header_line=at + 1)
    if not said:
        return None
    names = [name for name in said.get('MARKER_NAMES', []) if name]
    own = [f'{name} {axis}' for name in names for axis in 'XYZ']
    more = len([cell for cell in first if cell]) - len(own)
    lead = {2: ('Frame', 'Time'), 0: ()}.get(more)
    if lead is None or not own:
        return None
    return replace(found, header_line=0, skip_below=at, header=(*lead, *own))


def _ndi(lines, delimiter):
    row = cells_of(lines[0], delimiter)
    ports = [cell for cell in row[1:] if cell.startswith(PORT)]
    if not ports or row[0].lstrip('#') != 'Tools':
        return None
    return Layout('NDI', 'ndi', 1, group=PORT, unit='mm')


def _ati(lines, delimiter):
    at = next((i for i, line in enumerate(lines[:PREAMBLE])
               if {'RDT Sequence', 'Fx', 'Fy', 'Fz'} <= set(cells_of(line, delimiter))), None)
    if at is None:
        return None
    text = '\n'.join(lines[:at])

    def said(what):
        return (re.search(rf'{what}[:{delimiter}\s]*([\w.]+)', text) or ['', ''])[1]
    return Layout('ATI F/T', 'ati', at + 1, rate=number(said('RDT Sample Rate')),
                  unit=FORCES.get(said('Force Units').lower(), ''),
                  counts=number(said('Counts per Unit Force')) or 1.0)


def _numeric(text):
    return re.fullmatch(r'[-+]?\d[\d.,]*(e[-+]?\d+)?', text, re.IGNORECASE) is not None
