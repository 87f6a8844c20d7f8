"""The column map: which column of which CSV file is what, in YAML. Documented in README.md.

Column patterns: `{key}` stands for the name of an actuator, pad, marker or tool as the header line
spells it, `{axis}` for one of `axes`. `names` maps our names to those keys; left empty, the names
are those found in the header, in its order.
"""

from dataclasses import dataclass, field
from typing import Literal

from arm_brachy.core.quantity import quantity

TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
LENGTH_UNITS = {'m': 1.0, 'mm': 1e-3}
FORCE_UNITS = {'N': 1.0, 'mN': 1e-3}
# What the recorded topic holds is the force on the tool: what the tissue does to the pad.
FORCE_SIGNS = {'on_tool': 1.0, 'on_tissue': -1.0}


@dataclass(frozen=True)
class CsvFile:
    """How one CSV file is written. `.gz` is unpacked.

    path : relative to the map file, or to the folder given with it;  time : column name
    header_line : number of the line with the column names, from 1; lines before it are skipped
    unsorted : 'refuse' a row earlier than the one before it, or 'sort' the rows
    duplicates : 'refuse' a second row with the same time, or keep the 'first' or the 'last'
    missing : cells that mean "not measured", besides NaN in any case and the empty cell
    frame_column : the device's own frame counter; '' = counted from the times, so that a gap in
        time is a gap in the counter
    """

    path: str
    time: str
    time_unit: Literal['s', 'ms', 'us', 'ns'] = 's'
    delimiter: str = ','
    header_line: int = 1
    unsorted: Literal['refuse', 'sort'] = 'refuse'
    duplicates: Literal['refuse', 'first', 'last'] = 'refuse'
    missing: tuple[str, ...] = ()
    frame_column: str = ''
    clock_offset: float = quantity(0.0, 'ms', "added to this file's clock to get the common time")


@dataclass(frozen=True)
class Encoders:
    """Actuator positions along their push directions, zero at touch -> actuators/state."""

    csv: CsvFile
    columns: str
    unit: Literal['m', 'mm'] = 'm'
    names: dict[str, str] = field(default_factory=dict)
    frame: str = 'world'


@dataclass(frozen=True)
class Forces:
    """One force vector per pad -> force/<pad>/wrench. sign : on what the file's force acts.

    frame : whose axes `axes` are; forces are not turned into another one
    directions : name -> axis (3,) in `frame` along which a load cell counts as positive, for cells
        of one axis: `columns` then has no {axis}. A cell that counts pressure as positive, with
        its direction that of the push, is of sign on_tissue.
    """

    csv: CsvFile
    columns: str
    sign: Literal['on_tool', 'on_tissue']
    unit: Literal['N', 'mN'] = 'N'
    axes: tuple[str, str, str] = ('x', 'y', 'z')
    directions: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    frame: str = 'world'


@dataclass(frozen=True)
class Optical:
    """Positions of markers, all in one frame -> optical/markers."""

    csv: CsvFile
    columns: str
    unit: Literal['m', 'mm'] = 'm'
    axes: tuple[str, str, str] = ('x', 'y', 'z')
    names: dict[str, str] = field(default_factory=dict)
    frame: str = 'world'


@dataclass(frozen=True)
class Tools:
    """Tracked tools -> em/<tool>/pose where present, em/<tool>/status always.

    quaternion : column pattern with `{axis}` in x, y, z, w ('' = orientation not measured;
        the identity is written)
    quality : column pattern of the fit's indicator value ('' = NaN is written)
    """

    csv: CsvFile
    columns: str
    unit: Literal['m', 'mm'] = 'm'
    axes: tuple[str, str, str] = ('x', 'y', 'z')
    names: dict[str, str] = field(default_factory=dict)
    frame: str = 'world'
    quaternion: str = ''
    quality: str = ''


@dataclass(frozen=True)
class ColumnMap:
    """One recording: any number of files of each kind.

    start : added to all times, so that none is negative (a clock offset may make it so)
    """

    name: str
    encoders: tuple[Encoders, ...] = ()
    forces: tuple[Forces, ...] = ()
    optical: tuple[Optical, ...] = ()
    em: tuple[Tools, ...] = ()
    start: float = quantity(0.0, 's', 'added to every time of the recording')
    source: str = ''
