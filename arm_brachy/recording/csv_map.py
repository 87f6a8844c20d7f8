"""The column map: which column of which CSV file is what, in YAML. Documented in README.md.

Column patterns: `{key}` stands for the name of an actuator, pad, marker or tool as the header line
spells it, `{axis}` for one of `axes`. `names` maps our names to those keys; left empty, the names
are those found in the header, in its order.
"""

from dataclasses import dataclass
from typing import Literal

from arm_brachy.core.quantity import quantity, word

TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
LENGTH_UNITS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3}
POUND = 4.4482216152605     # N, of a pound force (NIST SP 811)
FORCE_UNITS = {'N': 1.0, 'mN': 1e-3, 'kN': 1e3, 'lbf': POUND, 'kgf': 9.80665}
# What the recorded topic holds is the force on the tool: what the tissue does to the pad.
FORCE_SIGNS = {'on_tool': 1.0, 'on_tissue': -1.0}

Way = tuple[float, float, float]


ZEROS = ('gap: 0 0 0 in all axes, where no motion leads, was not measured; place: it is a place, '
         'such as that of a marker that is the origin')
STATE = ('pattern of the columns that say in words whether a place was measured; empty = the '
         'numbers say')
COLUMNS = 'pattern of the column names, any other signs as in the header: {key} and {axis}'
NAMES = ("name in the scene -> key in the header, of those that this recording has; left out, the "
         "header's names are the scene's")
AXES = 'what {axis} stands for, along x, y and z'


def _length_unit():
    return word('of the values', default='m')


@dataclass(frozen=True)
class CsvFile:
    """How one CSV file is written. `.gz` is unpacked."""

    path: str = word('relative to the map file, or to the folder given with it')
    time: str = word('name of the column of times, or of frame numbers at `rate_Hz`; empty = rows '
                     'are counted, at `rate_Hz`')
    optional: bool = word('true: recordings that lack the file are imported without it',
                          default=False)
    time_unit: Literal['s', 'ms', 'us', 'ns'] = word('of that column', default='s')
    rate: float = quantity(0.0, 'Hz', 'of the frame numbers in that column: a time is the number '
                           'over the rate; 0 = the column holds times', low=0.0)
    delimiter: str = word('between cells; a tab is "\\t", in double quotes', default=',')
    decimal: Literal['.', ','] = word('sign before the decimals', default='.')
    encoding: str = word('of the text, such as cp1252; a byte order mark is obeyed',
                         default='utf-8')
    header_line: int = word('number of the line with the column names, from 1; lines before it '
                            'are skipped', default=1)
    name_lines: tuple[int, ...] = word(
        'lines above it that have names, each for the empty cells that follow it as well: a '
        'column is called by the first of them and its own, `m1 X` or `m1X`', default=())
    group: str = word('word with which cells of the header begin that stand before the columns '
                      'of one tool (NDI: Port): these are called by the tool and their own name',
                      default='')
    skip_below: int = word('lines below the column names that are skipped, e.g. one of units',
                           default=0)
    until_blank: bool = word('true: the table ends at the first empty line', default=False)
    incomplete: Literal['refuse', 'missing', 'skip'] = word(
        'what to do with a row that ends early or has no time: a row that ends early may be taken '
        'for not measured where it does, either may be skipped; what was done is told',
        default='refuse')
    unsorted: Literal['refuse', 'sort'] = word('what to do with a row earlier than the one before '
                                               'it', default='refuse')
    duplicates: Literal['refuse', 'first', 'last'] = word(
        'what to do with a second row of the same time, or which to keep', default='refuse')
    missing: tuple[str, ...] = word('cells that mean "not measured", besides the empty cell, NaN '
                                    'as programs write it, NA, NULL and None', default=())
    codes: tuple[float, ...] = word(
        'numbers that mean "not measured", besides those above 1e20, and 999, 9999 and their like '
        'where they are far from everything else', default=())
    frame_column: str = word("the device's own frame counter; empty = counted from the times, so "
                             'that a gap in time is a gap in the counter', default='')
    clock_offset: float = quantity(0.0, 'ms', "added to this file's clock to get the common time")


@dataclass(frozen=True)
class Encoders:
    """Actuator positions along their push directions, zero at touch -> actuators/state."""

    csv: CsvFile
    columns: str = word(COLUMNS)
    unit: Literal['m', 'cm', 'mm'] = _length_unit()
    names: dict[str, str] = word(f'pads: {NAMES}', default_factory=dict)
    frame: str = word('frame_id that is written', default='world')


@dataclass(frozen=True)
class Forces:
    """One force vector per pad -> force/<pad>/wrench."""

    csv: CsvFile
    columns: str = word(f'{COLUMNS}; without {{axis}} for cells of one axis')
    sign: Literal['on_tool', 'on_tissue'] = word(
        "on what the file's force acts; a cell that counts pressure as positive, with its "
        'direction that of the push, is of sign on_tissue')
    unit: Literal['N', 'mN', 'kN', 'lbf', 'kgf'] = word('of the values', default='N')
    counts: float = word('by which the values are divided first (ATI: Counts per Unit Force)',
                         default=1.0)
    axes: tuple[str, str, str] = word(AXES, default=('x', 'y', 'z'))
    directions: dict[str, Way] = word(
        'name in the scene -> axis along which a load cell of one axis counts as positive',
        default_factory=dict)
    mounted: dict[str, tuple[Way, Way]] = word(
        'name in the scene -> where x and z of a three-axis load cell point, in the axes of the '
        'scene; cells left out have these axes', default_factory=dict)
    names: dict[str, str] = word(f'pads: {NAMES}', default_factory=dict)
    frame: str = word('frame_id that is written; in the axes of the scene', default='world')


@dataclass(frozen=True)
class Optical:
    """Positions of markers, all in one frame -> optical/markers."""

    csv: CsvFile
    columns: str = word(COLUMNS)
    unit: Literal['m', 'cm', 'mm'] = _length_unit()
    axes: tuple[str, str, str] = word(AXES, default=('x', 'y', 'z'))
    names: dict[str, str] = word(f'markers: {NAMES}', default_factory=dict)
    frame: str = word('frame_id that is written', default='world')
    zeros: Literal['gap', 'place'] = word(ZEROS, default='gap')
    state: str = word(STATE, default='')
    measured: tuple[str, ...] = word('words of that column of what was measured',
                                     default=('OK',))


@dataclass(frozen=True)
class Tools:
    """Tracked tools -> em/<tool>/pose where present, em/<tool>/status always."""

    csv: CsvFile
    columns: str = word(COLUMNS)
    unit: Literal['m', 'cm', 'mm'] = _length_unit()
    axes: tuple[str, str, str] = word(AXES, default=('x', 'y', 'z'))
    names: dict[str, str] = word(f'targets: {NAMES}', default_factory=dict)
    frame: str = word('frame_id that is written', default='world')
    quaternion: str = word('pattern with {axis}, of `quaternion_axes`; empty = orientation not '
                           'measured, the identity is written', default='')
    quaternion_axes: tuple[str, str, str, str] = word(
        'what {axis} stands for in it, along x, y, z and of the real part w',
        default=('x', 'y', 'z', 'w'))
    zeros: Literal['gap', 'place'] = word(ZEROS, default='gap')
    state: str = word(STATE, default='')
    measured: tuple[str, ...] = word('words of that column of what was measured',
                                     default=('OK',))
    quality: str = word("pattern of the fit's indicator value; empty = NaN is written", default='')


@dataclass(frozen=True)
class ColumnMap:
    """One recording: any number of files of each kind."""

    name: str = word('of the recording, unless one is given at the import')
    encoders: tuple[Encoders, ...] = ()
    forces: tuple[Forces, ...] = ()
    optical: tuple[Optical, ...] = ()
    em: tuple[Tools, ...] = ()
    start: float = quantity(0.0, 's', 'added to every time of the recording; where one is still '
                            'negative, all are shifted by whole seconds, which is told')
    folder: str = word('what the paths of the files are relative to, itself relative to the '
                       'folder of the map; --folder is used in its place', default='')
    source: str = word('where it comes from, kept in the bag', default='')
