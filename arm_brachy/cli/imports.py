"""`arm-brachy import csv | c3d | scene`: a laboratory's files to bags and scenes."""

import importlib
from pathlib import Path

import click

from arm_brachy.cli.output import console, json_option, new_folder, show, summary, working
from arm_brachy.core import config
from arm_brachy.core.scene import load_scene
from arm_brachy.recording.import_c3d import C3dImport, import_c3d
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.scene_import import import_scene


@click.group(name='import')
def import_():
    """Turn a laboratory's files into bags.

    \b
    Example:
      arm-brachy import csv --help
    """


@import_.command(name='csv')
@click.argument('column_map', type=click.Path())
@click.option('--folder', type=click.Path(), metavar='FOLDER',
              help='What the file names in the map are relative to. Default: the folder of the '
                   'map.')
@click.option('--out', required=True, type=click.Path(), metavar='FOLDER',
              help='Of the bag; new or empty.')
@click.option('--name', help='Of the recording, where one map is for several. Default: that of '
                             'the map.')
@click.option('--scene', type=click.Path(), metavar='FILE',
              help='Scene that was recorded: what `diagnose` would refuse of the recording is '
                   'refused here, and what it would leave out is told.')
@json_option
def csv_command(column_map, folder, out, name, scene, json_file):
    """CSV files to a bag; COLUMN_MAP (YAML) says which column is what.

    Times, jitter included, are kept as they are. What is no number is refused by file, line and
    column. The map's keys: `arm-brachy keys columns`, arm_brachy/recording/README.md.

    Told of every stream: rate_Hz by the median period, jitter_ms the standard deviation of the
    steps that are no gaps, the longest step, rows that are lost by that period, values that are
    missing, and the longest gap of any of its markers, tools or pads.

    \b
    Example:
      arm-brachy import csv config/imports/dome_rig.yaml \\
        --folder recordings/A --out runs/dome_rig_a
    """
    recorded = load_scene(scene) if scene else None
    with new_folder(out) as bag, working(f'reading the files of {column_map}'):
        found = import_csv(column_map, bag, folder=folder, name=name)
        _note(f'{file}: not there, left out' for file in found['absent'])
        _note(found['notes'])
        _note(_checked(bag, recorded) if recorded else ())
    rows = [{'stream': name, **figures} for name, figures in found['streams'].items()]
    show(summary('import csv', rows), json_file)
    console.print(f"bag  {found['bag']}  {sum(found['messages'].values())} messages",
                  highlight=False)


def _checked(bag, scene):
    """Notes of `scene_check`, which takes seconds to load: an import without a scene need not."""
    module = importlib.import_module('arm_brachy.cli.scene_check')
    return module.check_recording(bag, scene)


def _note(notes):
    for note in notes:
        console.print(f'note  {note}', markup=False, highlight=False)


@import_.command(name='c3d')
@click.argument('files', nargs=-1, required=True, type=click.Path())
@click.option('--options', 'options_file', type=click.Path(), metavar='FILE',
              help='YAML: names, unit, registration, trigger, part to keep.')
@click.option('--scene', type=click.Path(), metavar='FILE', help='Scene to register to.')
@click.option('--out', required=True, type=click.Path(), metavar='FOLDER',
              help='That receives a bag for each file; new or empty.')
@json_option
def c3d_command(files, options_file, scene, out, json_file):
    """Motion capture FILES (C3D), each to a bag.

    Without options every labelled point is taken as it is named, in the tracker's frame.

    \b
    Example:
      arm-brachy import c3d beam_a.c3d \\
        --options config/imports/silicone_beam.yaml \\
        --scene config/scenes/silicone_beam.yaml --out runs/beam
    """
    options = config.load(C3dImport, options_file) if options_file else C3dImport()
    reference = load_scene(scene) if scene else None
    with new_folder(out) as folder, working(f'reading {len(files)} files'):
        found = import_c3d(files, folder, options, reference)
    rows = [_capture_row(one) for one in found['bags']]
    show(summary('import c3d', rows), json_file)
    for one in found['bags']:
        console.print(f"bag  {one['bag']}", highlight=False)


def _capture_row(found):
    """One line of figures; of those per marker the worst."""
    row = {'file': Path(found['source']).name}
    row |= {key: found[key] for key in ('frames', 'rate_Hz', 'missing_values', 'longest_gap_s')}
    for key in ('registration_mm', 'rest_spread_mm'):
        if key in found:
            row[f'worst_{key}'] = max(found[key].values())
    if 'trigger_s' in found:
        row['trigger_s'] = found['trigger_s']
    return row


@import_.command(name='scene')
@click.argument('file', type=click.Path())
@click.option('--out', required=True, type=click.Path(), metavar='FOLDER',
              help='Of scene and column maps; new or empty.')
@click.option('--name', help='Of the scene; default: that of its folder.')
def scene_command(file, out, name):
    """A dome rig's description FILE to a scene and column maps.

    FILE has another laboratory's form; its meshes and CSV files stay where they are.

    \b
    Example:
      arm-brachy import scene dome_rig/scene.yaml --out runs/dome_rig
    """
    with new_folder(out) as folder:
        found = import_scene(file, folder, name=name)
    for key, value in found.items():
        several = list(value.values()) if isinstance(value, dict) else value
        for item in several if isinstance(several, (list, tuple)) else [several]:
            console.print(f'{key}  {item}', highlight=False, markup=False)
