"""Another laboratory's dome rig (its scene.yaml) -> our scene file and column maps.

The classes below are that form, field by field; lengths in m, pressure in Pa. Keys that have no
counterpart here are listed in the report, not dropped in silence.
"""

import dataclasses
import math
import os
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.recording.csv_map import ColumnMap, CsvFile, Encoders, Forces, Optical, Tools
from arm_brachy.recording.csv_table import read_header

Vector = tuple[float, float, float]
SEED = 1  # a replay draws no random numbers; scenarios always state one


@dataclass(frozen=True)
class Units:
    """Only SI is converted; another unit is refused."""

    length: Literal['m']
    force: Literal['N']
    time: Literal['s']
    pressure: Literal['Pa']


@dataclass(frozen=True)
class TheirMesh:
    """npz : nodes (n, 3) [m], tets (m, 4), base_nodes and pad_nodes_<k> (node indices)."""

    npz: str


@dataclass(frozen=True)
class TheirMaterial:
    """Isochoric Neo-Hookean, mu = E / (2 (1 + nu)), kappa = E / (3 (1 - 2 nu)), as (3.18)."""

    model: Literal['neo_hookean']
    E: float
    nu: float
    density: float


@dataclass(frozen=True)
class TheirFixed:
    """Name of the node set that does not move."""

    set: str


@dataclass(frozen=True)
class TheirPad:
    """A bonded rigid disc; direction is a unit vector into the tissue; lengths in m."""

    name: str
    centre: Vector
    radius: float
    direction: Vector
    stroke_max: float
    node_set: str


@dataclass(frozen=True)
class TheirPoint:
    """A marker or EM target at rest [m]; body: tissue, base or the name of a pad."""

    id: str
    reference: Vector
    body: str = 'tissue'


@dataclass(frozen=True)
class TheirForces:
    """sign : in words, what acts on what."""

    sign: str
    rate_hz: float = 100.0


@dataclass(frozen=True)
class TheirEncoders:
    """rate_hz : samples per second."""

    rate_hz: float = 100.0


@dataclass(frozen=True)
class TheirSensors:
    """Of the sensors only the sign of the forces and the rates are needed to read their files.

    forces : None = none were recorded
    """

    forces: TheirForces | None = None
    encoders: TheirEncoders = field(default_factory=TheirEncoders)


@dataclass(frozen=True)
class TheirRecording:
    """A folder with encoders.csv.gz and what there is of forces, optical and em .csv.gz.

    lab_time_start_s : at which their times begin, on one clock for all recordings
    """

    name: str
    folder: str
    lab_time_start_s: float = 0.0


@dataclass(frozen=True)
class TheirScene:
    """The whole file."""

    units: Units
    mesh: TheirMesh
    material: TheirMaterial
    gravity: Vector
    fixed: TheirFixed
    pads: tuple[TheirPad, ...]
    markers: tuple[TheirPoint, ...] = ()
    em_targets: tuple[TheirPoint, ...] = ()
    sensors: TheirSensors = field(default_factory=TheirSensors)
    recordings: tuple[TheirRecording, ...] = ()


# Their sentence about the sign -> ours.
FORCE_SIGNS = {'tissue exerts on the pad': 'on_tool', 'pad exerts on the tissue': 'on_tissue'}


def import_scene(path, out_dir, *, name=None):
    """Write our scene file, and one column map per recording, for a scene of that form.

    path : their scene.yaml
    out_dir : receives `<name>.yaml` and, per recording, `<name>_<recording>.columns.yaml`
    name : of the scene, by default that of the folder the file is in
    The mesh and the CSV files stay where they are and are referred to by relative path.
    Returns a dict: scene, maps (recording -> path), unused (their keys that have no counterpart,
    files of streams that they do not describe), absent (markers, tools and pads without a column
    in the file of their stream, which the maps leave out), shift_s (where a recording begins
    before time zero, by how much all begin later).
    Raises ConfigError with file and line.
    """
    path, out_dir = Path(path), Path(out_dir)
    data = config.read_yaml(path)
    unused = []
    theirs = config.from_mapping(TheirScene, _known(TheirScene, data, '', unused), str(path))
    name = name or path.resolve().parent.name
    out_dir.mkdir(parents=True, exist_ok=True)
    base = Path(os.path.relpath(path.resolve().parent, out_dir.resolve()))
    scene_file = out_dir / f'{name}.yaml'
    _write(scene_file, _scene(theirs, base, name))
    maps, absent = {}, []
    shift = _shift(theirs.recordings)
    for recording in theirs.recordings:
        maps[recording.name] = str(out_dir / f'{name}_{recording.name}.columns.yaml')
        columns = _columns(theirs, path, base, name, recording, shift)
        unused += _left_out(columns, path.parent / recording.folder, recording)
        columns, missing = _present(columns, path.parent / recording.folder)
        absent += [f'{recording.folder}/{one}' for one in missing]
        _write(Path(maps[recording.name]), columns)
    scenario_file = out_dir / f'{name}.scenario.yaml'
    _dump(scenario_file, _scenario(theirs, name, scene_file.name))
    return {'scene': str(scene_file), 'scenario': str(scenario_file), 'maps': maps,
            'unused': unused, 'absent': absent,
            **({'shift_s': shift} if shift else {})}


def _shift(recordings):
    """[s] by which all recordings are shifted alike, so that none begins before zero."""
    return max(0.0, *(float(math.ceil(-one.lab_time_start_s)) for one in recordings), 0.0)


def _scenario(theirs, name, scene_file):
    """The least that a replay needs, ticking with their fastest encoder or force stream."""
    sensors = theirs.sensors
    rate = max(one.rate_hz for one in (sensors.encoders, sensors.forces) if one is not None)
    return {'name': name, 'description': f'recordings of {name}, to replay', 'seed': SEED,
            'scene': scene_file, 'tick_ms': round(1e3 / rate, 6)}


def _scene(theirs, base, name):
    material = Material(theirs.material.E, theirs.material.nu, theirs.material.density)
    pads = tuple(PadPatch(p.name, p.centre, p.direction, p.radius, p.stroke_max, p.node_set)
                 for p in theirs.pads)
    return Scene(
        name=name,
        mesh=MeshFile(str(base / theirs.mesh.npz)),
        fixed=Region('set', set=theirs.fixed.set),
        material=material,
        gravity=theirs.gravity,
        pads=pads,
        markers=tuple(Marker(m.id, m.reference, m.body) for m in theirs.markers),
        targets=tuple(Target(t.id, t.reference) for t in theirs.em_targets),
        source=f'converted from the rig description of {name}',
    )


def _columns(theirs, path, base, name, recording, shift):
    pads = {pad.name: str(i) for i, pad in enumerate(theirs.pads)}

    def file(stem, optional=True):
        return CsvFile(f'{recording.folder}/{stem}.csv.gz', time='t_s', optional=optional)

    forces = optical = em = ()
    if theirs.sensors.forces is not None:
        forces = (Forces(file('forces'), 'f{key}{axis}_N', _sign(theirs, path), names=pads),)
    if theirs.markers:
        optical = (Optical(file('optical'), '{key}_{axis}_m', names=_names(theirs.markers)),)
    if theirs.em_targets:
        em = (Tools(file('em'), '{key}_{axis}_m', names=_names(theirs.em_targets)),)
    return ColumnMap(
        name=f'{name}_{recording.name}', folder=str(base),
        start=recording.lab_time_start_s + shift,
        encoders=(Encoders(file('encoders', optional=False), 'q{key}_m', names=pads),),
        forces=forces, optical=optical, em=em)


def _left_out(columns, folder, recording):
    """Files of a recording that its ColumnMap does not read: the description is silent on them."""
    return [f'{recording.folder}/{kind}.csv.gz' for kind in ('forces', 'optical', 'em')
            if not getattr(columns, kind) and (folder / f'{kind}.csv.gz').exists()]


def _present(columns, folder):
    """(A ColumnMap without what no column of its file is of, 'file: name' of each left out).

    A load cell that one pad lacks. Of a file in which nothing is found none is left out: its names
    are others, and reading it says so.
    """
    kept, absent = {}, []
    for kind in ('forces', 'optical', 'em'):
        for part in getattr(columns, kind):
            file = folder / Path(part.csv.path).name
            header = _header_of(file, part.csv)
            there = {name: key for name, key in part.names.items() if header.intersection(
                part.columns.format(key=key, axis=axis) for axis in part.axes)}
            if there and len(there) < len(part.names):
                kept[kind] = (dataclasses.replace(part, names=there),)
                absent += [f'{file.name}: {name}' for name in part.names if name not in there]
    return dataclasses.replace(columns, **kept), absent


def _header_of(file, options):
    """Names of the columns of a file; none where it has no header, or is not there."""
    try:
        return set(read_header(file, options))
    except RecordingError:
        return set()


def _names(points):
    return {point.id: point.id for point in points}


def _sign(theirs, path):
    said = theirs.sensors.forces.sign
    found = [ours for words, ours in FORCE_SIGNS.items() if words in said]
    if len(found) != 1:
        raise ConfigError(f'{path}: sensors.forces.sign = {said!r}; must say one of: '
                          f'{", ".join(FORCE_SIGNS)}')
    return found[0]


def _known(cls, data, where, unused):
    """What of `data` `cls` has fields for, line numbers kept; the rest goes to `unused`."""
    if isinstance(data, list):
        for i, item in enumerate(data):
            data[i] = _known(cls, item, f'{where}{i}.', unused)
        return data
    if not isinstance(data, dict):
        return data
    hints = typing.get_type_hints(cls)
    for key in [k for k in data if k not in hints]:
        unused.append(f'{where}{key}')
        del data[key]
    for key, value in data.items():
        inner = _dataclass_in(hints[key])
        if inner is not None:
            data[key] = _known(inner, value, f'{where}{key}.', unused)
    return data


def _dataclass_in(hint):
    if dataclasses.is_dataclass(hint):
        return hint
    return next((a for a in typing.get_args(hint) if dataclasses.is_dataclass(a)), None)


def _write(path, obj):
    _dump(path, config.to_mapping(obj))


def _dump(path, mapping):
    yaml = YAML()
    yaml.width = 99
    with path.open('w', encoding='utf-8') as stream:
        yaml.dump(mapping, stream)
