"""The column map: which column of which CSV file is what, in YAML. Documented in README.md.

Column patterns: `{key}` stands for the name of an actuator, pad, marker or tool as the header line
spells it, `{axis}` for one of `axes`. `names` maps our names to those keys; left empty, the names
are those found in the header, in its order.
"""

from dataclasses import dataclass
from typing import Literal

from arm_brachy.core.quantity import quantity, word

TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
LENGTH_UNITS = {'m': 1.0, 'mm': 1e-3}
FORCE_UNITS = {'N': 1.0, 'mN': 1e-3}
# What the recorded topic holds is the force on the tool: what the tissue does to the pad.
FORCE_SIGNS = {'on_tool': 1.0, 'on_tissue': -1.0}

Way = tuple[float, float, float]


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
    time: str = word('name of the column of times')
    optional: bool = word('true: recordings that lack the file are imported without it',
                          default=False)
    time_unit: Literal['s', 'ms', 'us', 'ns'] = word('of that column', default='s')
    delimiter: str = word('between cells; a tab is "\\t", in double quotes', default=',')
    decimal: Literal['.', ','] = word('sign before the decimals', default='.')
    header_line: int = word('number of the line with the column names, from 1; lines before it '
                            'are skipped', default=1)
    skip_below: int = word('lines below the column names that are skipped, e.g. one of units',
                           default=0)
    unsorted: Literal['refuse', 'sort'] = word('what to do with a row earlier than the one before '
                                               'it', default='refuse')
    duplicates: Literal['refuse', 'first', 'last'] = word(
        'what to do with a second row of the same time, or which to keep', default='refuse')
    missing: tuple[str, ...] = word('cells that mean "not measured", besides NaN in any case and '
                                    'the empty cell', default=())
    frame_column: str = word("the device's own frame counter; empty = counted from the times, so "
                             'that a gap in time is a gap in the counter', default='')
    clock_offset: float = quantity(0.0, 'ms', "added to this file's clock to get the common time")


@dataclass(frozen=True)
class Encoders:
    """Actuator positions along their push directions, zero at touch -> actuators/state."""

    csv: CsvFile
    columns: str = word(COLUMNS)
    unit: Literal['m', 'mm'] = _length_unit()
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
    unit: Literal['N', 'mN'] = word('of the values', default='N')
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
    unit: Literal['m', 'mm'] = _length_unit()
    axes: tuple[str, str, str] = word(AXES, default=('x', 'y', 'z'))
    names: dict[str, str] = word(f'markers: {NAMES}', default_factory=dict)
    frame: str = word('frame_id that is written', default='world')


@dataclass(frozen=True)
class Tools:
    """Tracked tools -> em/<tool>/pose where present, em/<tool>/status always."""

    csv: CsvFile
    columns: str = word(COLUMNS)
    unit: Literal['m', 'mm'] = _length_unit()
    axes: tuple[str, str, str] = word(AXES, default=('x', 'y', 'z'))
    names: dict[str, str] = word(f'targets: {NAMES}', default_factory=dict)
    frame: str = word('frame_id that is written', default='world')
    quaternion: str = word('pattern with {axis} in x, y, z, w; empty = orientation not measured, '
                           'the identity is written', default='')
    quality: str = word("pattern of the fit's indicator value; empty = NaN is written", default='')


@dataclass(frozen=True)
class ColumnMap:
    """One recording: any number of files of each kind."""

    name: str = word('of the recording, unless one is given at the import')
    encoders: tuple[Encoders, ...] = ()
    forces: tuple[Forces, ...] = ()
    optical: tuple[Optical, ...] = ()
    em: tuple[Tools, ...] = ()
    start: float = quantity(0.0, 's', 'added to every time of the recording, so that none is '
                            'negative (a clock offset may make it so)')
    source: str = word('where it comes from, kept in the bag', default='')
