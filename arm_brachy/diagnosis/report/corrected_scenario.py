"""The scene as the diagnosis would have it: a scenario file that `arm-brachy run` accepts."""

import os
import textwrap
from dataclasses import replace
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from arm_brachy import registry
from arm_brachy.core.config import to_mapping
from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.core.scene import Material
from arm_brachy.diagnosis.results import formatting
from arm_brachy.scenario import Scenario, load_cell

WIDTH = 99


def base_scenario(scene, name, seed, moves=()):
    """A Scenario on a scene file alone, for recordings that came without one.

    scene : path;  moves : control.moves.Move that a run shall make
    """
    return Scenario(name=name, seed=seed, scene=str(Path(scene).resolve()), moves=tuple(moves))


def write_corrected(diagnosis, base, path):
    """Write what was found into a scenario file and read it back; returns its path.

    diagnosis : the terms of its most probable option and its recalibrated parameters are written
    base : Scenario to which they are added, its paths absolute (`base_scenario`,
        `with_absolute_paths`); what its own plant was is dropped
    path : file to write;  paths inside it are relative to its folder
    The model gets them, and the plant is the same body, so that a run shows the recording's
    physics; a term that acts on actuators or sensors acts in the plant alone. A mesh at fault is
    no term and is left to a person.
    Raises InputError if nothing was found, ConfigError if a value lies outside what its term
    allows: then there is no file.
    Test: diagnosis/test_corrected.py
    """
    causes = [cause for cause in diagnosis.likeliest() if cause.physical]
    if not causes and not diagnosis.recalibrated:
        raise InputError(f'{path}: {diagnosis.provenance.name} found no term and no parameter to '
                         'correct; the scene as given is the best there is')
    path = Path(path).resolve()
    model = _overlay(base.model, causes, diagnosis.recalibrated)
    scenario = replace(base, model=model, plant=model, name=_name(base.name))
    path.write_text(_head(diagnosis), encoding='utf-8')
    with path.open('a', encoding='utf-8') as file:
        _yaml().dump(_commented(_relative(scenario, path.parent), causes, diagnosis), file)
    try:
        load_cell(path)
    except ConfigError:
        path.unlink()
        raise
    return path


def with_absolute_paths(cell):
    """The Scenario of a scenario.Cell with the paths that it names made absolute."""
    folder = cell.path.parent

    def absolute(overlay):
        return overlay if overlay.mesh is None else replace(overlay, mesh=replace(
            overlay.mesh, file=str((folder / overlay.mesh.file).resolve())))

    return replace(cell.scenario, scene=str((folder / cell.scenario.scene).resolve()),
                   plant=absolute(cell.scenario.plant), model=absolute(cell.scenario.model))


def _name(name):
    return name if name.endswith('_corrected') else f'{name}_corrected'


def _overlay(overlay, causes, recalibrated):
    """The overlay with found terms added; a term that it already had is replaced."""
    found = {cause.term for cause in causes}
    kept = tuple(entry for entry in overlay.terms if entry['name'] not in found)
    entries = registry.to_entries([cause.build() for cause in causes])
    return replace(overlay, terms=(*kept, *entries),
                   **{name: one.value for name, one in recalibrated.items()})


def _relative(scenario, folder):
    def relative(file):
        return os.path.relpath(file, folder)

    def overlay(one):
        return one if one.mesh is None else replace(
            one, mesh=replace(one.mesh, file=relative(one.mesh.file)))

    return replace(scenario, scene=relative(scenario.scene), plant=overlay(scenario.plant),
                   model=overlay(scenario.model))


def _commented(scenario, causes, diagnosis):
    """The departures from the defaults, each found value with its interval behind it."""
    default = to_mapping(Scenario(name='', seed=-1, scene=''))
    out = CommentedMap(_departures(to_mapping(scenario), default))
    comments = {cause.term: cause for cause in causes}
    for side in ('model', 'plant'):
        overlay = out[side] = CommentedMap(out[side])
        for name, one in diagnosis.recalibrated.items():
            _remark(overlay, Material, name, one)
        if 'terms' in overlay:
            overlay['terms'] = CommentedSeq(_entry(entry, comments.get(entry['name']))
                                            for entry in overlay['terms'])
    return out


def _departures(given, default):
    """What differs from the default, section by section."""
    out = {}
    for key, value in given.items():
        usual = default.get(key)
        if isinstance(value, dict) and isinstance(usual, dict):
            if changed := _departures(value, usual):
                out[key] = changed
        elif value != usual:
            out[key] = value
    return out


def _entry(entry, cause):
    out = CommentedMap({key: _row(value) for key, value in entry.items()})
    if cause is not None:
        out.yaml_add_eol_comment(f'probability {formatting.percent(cause.probability)}', 'name')
        for name, one in cause.parameters.items():
            _remark(out, cause.declared, name, one)
    return out


def _row(value):
    """A list on one line."""
    if not isinstance(value, list):
        return value
    row = CommentedSeq(value)
    row.fa.set_flow_style()
    return row


def _remark(mapping, declared, name, one):
    info = quantities(declared)[name]
    shown = (info.to_edge(v) for v in (one.value, one.low, one.high))
    mapping.yaml_add_eol_comment(formatting.bounds(UNITS[info.unit][1], *shown), info.key(name))


def _head(diagnosis):
    source = diagnosis.provenance
    used = ', '.join(r.name for r in source.recordings)
    lines = [diagnosis.sentence]
    if diagnosis.verdict == 'equivalent':
        chosen = formatting.listed([formatting.spoken(cause.term)
                                    for cause in diagnosis.likeliest()])
        lines.append(f'Written for the most probable: {chosen}.')
    lines += [f'Found by arm-brachy diagnose in {used}; seed {source.seed}, '
             f'commit {source.commit}.']
    wrapped = (part for line in lines for part in textwrap.wrap(line, WIDTH - 2))
    return ''.join(f'# {part}\n' for part in wrapped) + '\n'


def _yaml():
    yaml = YAML()
    yaml.width = WIDTH
    return yaml
