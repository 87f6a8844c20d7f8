"""Column maps of instruments' own exports, made from what a file says of itself.

A preset is no second reader: it is the column map that a person would write for that file, and can
be printed and edited. The layouts are those of `csv_layout`.
Test: recording/test_csv_presets.py
"""

import re
from pathlib import Path

from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.recording.csv_header import Header, owners_above, owners_before
from arm_brachy.recording.csv_layout import cells_of, guess_delimiter, recognise
from arm_brachy.recording.csv_table import text_lines

PRESETS = {
    'nexus': 'Vicon Nexus, ASCII export: the section Trajectories -> optical markers',
    'motive': 'OptiTrack Motive, CSV export: markers -> optical, rigid bodies -> tools (em)',
    'qualisys': 'Qualisys QTM, TSV export of 3D data, with or without column header -> optical',
    'ndi': 'NDI Toolbox, Track or Capture, one tool or several -> tools (em); --rate where the '
           'file has frame numbers only',
    'ati': 'ATI Net F/T or Axia, demo program: counts -> forces of one cell, named as the file',
}
XYZ = ('X', 'Y', 'Z')
NAMELESS = re.compile(r'\*\d+|unlabell?ed.*', re.IGNORECASE)    # markers that nobody named


def preset_map(preset, files, *, rate=0.0, known=(), encoding='utf-8'):
    """The column map (a mapping, as YAML has it) of files that an instrument exported.

    preset : key of PRESETS;  files : paths, as the map shall have them
    rate : [Hz] of frame numbers, where the files do not state it;  known : names of the scene,
        which are taken where a file has them with a subject before (`gel:m1`)
    Raises ConfigError for an unknown preset, RecordingError for a file of another layout.
    """
    if preset not in PRESETS:
        raise ConfigError(f'preset {preset!r}; must be one of {", ".join(PRESETS)}')
    sections = {}
    for file in files:
        lines = text_lines(file, encoding)
        delimiter = guess_delimiter(lines)
        layout = recognise(lines, delimiter)
        if layout is None or layout.preset != preset:
            what = 'no layout that is known' if layout is None else f'an export of {layout.kind}'
            other = '' if layout is None else f': use --preset {layout.preset}'
            raise RecordingError(f'{file}: has {what}; must be one of {PRESETS[preset]}{other}')
        source = _csv(file, layout, delimiter, lines, encoding)
        for kind, section in _SECTIONS[preset](source, layout, _header(file, layout, lines,
                                                                       delimiter), rate, known):
            sections.setdefault(kind, []).append(section)
    return {'name': Path(files[0]).name.split('.')[0], **sections,
            'source': f'export of {preset}: {", ".join(Path(file).name for file in files)}'}


def _header(file, layout, lines, delimiter):
    if layout.header:
        return Header(str(file), layout.header)
    own = tuple(cells_of(lines[layout.header_line - 1], delimiter))
    above = [cells_of(lines[i - 1], delimiter) for i in layout.name_lines]
    owners = owners_above(above, len(own)) if above else ()
    if layout.group:
        own, owners = owners_before(own, layout.group)
    return Header(str(file), own, owners)


def _csv(file, layout, delimiter, lines, encoding):
    """The section `csv` of a map."""
    out = {'path': str(file), 'time': ''}
    if delimiter != ',':
        out['delimiter'] = delimiter
        below = '\n'.join(lines[layout.header_line + layout.skip_below:][:20])
        if delimiter == ';' and re.search(r'\d,\d', below) and not re.search(r'\d\.\d', below):
            out['decimal'] = ','
    if encoding != 'utf-8':
        out['encoding'] = encoding
    if layout.header_line > 1:
        out['header_line'] = layout.header_line
    out |= {key: list(value) if isinstance(value, tuple) else value
            for key in ('name_lines', 'skip_below', 'group', 'until_blank')
            if (value := getattr(layout, key)) and not layout.header}
    return out


def _names(header, pattern, axes, known, file):
    """Our names -> keys of the file: without the subject where that leaves them apart."""
    keys = [key for key in header.keys(pattern, axes) if not NAMELESS.fullmatch(
        key.rsplit(':', 1)[-1])]
    short = [key.rsplit(':', 1)[-1] for key in keys]
    if len(set(short)) < len(short):
        short = keys
    if set(known) & set(keys):      # the scene has them with their subject
        short = [key if key in known else one for key, one in zip(keys, short, strict=True)]
    if not keys:
        raise RecordingError(f'{file}: has no marker that is named')
    return dict(zip(short, keys, strict=True))


def _rated(source, layout, rate, time):
    rate = rate or layout.rate
    if not rate:
        raise RecordingError(f'{source["path"]}: has frame numbers and states no rate; give --rate'
                             ', the frames a second that its counter counts (NDI Polaris 60, '
                             'Aurora 40)')
    return {**source, 'time': time, 'rate_Hz': rate}


def _nexus(source, layout, header, rate, known):
    source = _rated(source, layout, rate, 'Frame')
    source['clock_offset_ms'] = -1e3 / source['rate_Hz']    # frame 1 is time zero
    yield 'optical', {
        'csv': source, 'columns': '{key} {axis}', 'axes': list(XYZ), 'unit': layout.unit or 'mm',
        'names': _names(header, '{key} {axis}', XYZ, known, source['path'])}


def _motive(source, layout, header, rate, known):
    source = {**source, 'time': 'Time (Seconds)'}
    of = {}
    for kind, name in layout.bodies:
        of.setdefault(kind.lower(), []).append(name)
    axes = list(XYZ)
    markers = of.get('marker', [])
    if markers:
        names = _names(header, '{key} Position {axis}', XYZ, known, source['path'])
        names = {ours: key for ours, key in names.items() if key in markers}
    if markers and names:
        yield 'optical', {'csv': source, 'columns': '{key} Position {axis}', 'axes': axes,
                          'unit': layout.unit or 'm', 'names': names}
    bodies = of.get('rigid body', [])
    if bodies:
        turns = all(f'{body} Rotation W' in header.forms[-1] for body in bodies)
        yield 'em', {'csv': source, 'columns': '{key} Position {axis}', 'axes': axes,
                     'unit': layout.unit or 'm',
                     **({'quaternion': '{key} Rotation {axis}',
                         'quaternion_axes': ['X', 'Y', 'Z', 'W']} if turns else {}),
                     'names': {_topic_part(body): body for body in bodies}}


def _qualisys(source, layout, header, rate, known):
    if 'Time' in header.own:
        source = {**source, 'time': 'Time'}
    else:
        source = _rated(source, layout, rate, '')
    yield 'optical', {
        'csv': source, 'columns': '{key} {axis}', 'axes': list(XYZ), 'unit': 'mm',
        'names': _names(header, '{key} {axis}', XYZ, known, source['path'])}


def _ndi(source, layout, header, rate, known):
    tools = list(dict.fromkeys(above[0] for above in header.owners if above))
    if 'Time [sec]' in header.own and not rate:
        source = {**source, 'time': f'{tools[0]} Time [sec]'}
    else:
        source = _rated(source, layout, rate, f'{tools[0]} Frame')
    axes = ['Tx', 'Ty', 'Tz']
    yield 'em', {
        'csv': source, 'columns': '{key} {axis}', 'axes': axes, 'unit': 'mm',
        'quaternion': '{key} Q{axis}', 'quaternion_axes': ['x', 'y', 'z', '0'],
        'quality': '{key} Error', 'state': '{key} State', 'measured': ['OK'],
        'names': {_topic_part(tool): tool for tool in tools}}


def _ati(source, layout, header, rate, known):
    name = _topic_part(Path(source['path']).name.split('.')[0])
    yield 'forces', {
        'csv': _rated(source, layout, rate, 'RDT Sequence'), 'columns': '{key}{axis}',
        'sign': 'on_tool', 'unit': layout.unit or 'N', 'counts': layout.counts,
        'names': {name: 'F'}}


def _topic_part(name):
    part = re.sub(r'\W+', '_', name, flags=re.ASCII).strip('_') or 'tool'
    return f'_{part}' if part[0].isdigit() else part


_SECTIONS = {'nexus': _nexus, 'motive': _motive, 'qualisys': _qualisys, 'ndi': _ndi, 'ati': _ati}
