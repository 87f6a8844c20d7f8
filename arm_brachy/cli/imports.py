"""`arm-brachy import`: a laboratory's files to bags and scenes, and a sample of such files."""

import importlib
import io
import shutil
from pathlib import Path

import click
from ruamel.yaml import YAML

from arm_brachy.cli.output import (
    console,
    json_option,
    new_folder,
    show,
    summary,
    working,
    writable,
)
from arm_brachy.core import config
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.recording.csv_map import ColumnMap
from arm_brachy.recording.csv_presets import PRESETS, preset_map
from arm_brachy.recording.import_bag import import_bag
from arm_brachy.recording.import_c3d import C3dImport, import_c3d
from arm_brachy.recording.import_csv import import_csv, import_map
from arm_brachy.recording.scene_import import import_scene

scene_option = click.option(
    '--scene', type=click.Path(), metavar='FILE',
    help='Scene that was recorded: what `diagnose` would refuse of the recording is refused here, '
         'and what it would leave out is told.')
picture_option = click.option(
    '--picture', type=click.Path(), callback=writable, metavar='FILE',
    help='Also draw the streams over time, gaps marked, as .png, .svg or .pdf.')


@click.group(name='import')
def import_():
    """Turn a laboratory's files into bags.

    \b
    Example:
      arm-brachy import csv --help
    """


@import_.command(name='csv')
@click.argument('files', nargs=-1, required=True, type=click.Path(), metavar='COLUMN_MAP')
@click.option('--preset', metavar='NAME',
              help='The files given are what an instrument exported, not a column map; NAME: '
                   f'{", ".join(PRESETS)}.')
@click.option('--rate', 'rate', type=float, default=0.0, metavar='HZ',
              help='With --preset: of frame numbers, where the files do not state it.')
@click.option('--map', 'map_file', type=click.Path(), callback=writable, metavar='FILE',
              help='With --preset: also write the column map that it stands for, to be edited.')
@click.option('--folder', type=click.Path(), metavar='FOLDER',
              help='What the file names in the map are relative to. Default: the folder of the '
                   'map.')
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of the bag; new or empty. With --preset it may be left out: then the column '
                   'map is printed.')
@click.option('--name', help='Of the recording, where one map is for several. Default: that of '
                             'the map.')
@scene_option
@picture_option
@json_option
def csv_command(files, preset, rate, map_file, folder, out, name, scene, picture, json_file):
    """CSV files to a bag; COLUMN_MAP (YAML) says which column is what.

    Times, jitter included, are kept as they are. Columns that the map does not name are not read;
    what is no number in one that it names is refused by file, line and column. Numbers that stand
    for "not measured" are taken out and told. The map's keys: `arm-brachy keys columns`,
    arm_brachy/recording/README.md.

    Presets make the map for what an instrument exports: nexus (Vicon Nexus), motive (OptiTrack
    Motive), qualisys (Qualisys TSV), ndi (NDI Toolbox, Track, Capture), ati (ATI Net F/T).

    Told of every stream: rate_Hz by the median period, jitter_ms the standard deviation of the
    steps that are no gaps, the longest step, rows that are lost by that period, values that are
    missing, and the longest gap of any of its markers, tools or pads.

    \b
    Example:
      arm-brachy import csv config/imports/dome_rig.yaml \\
        --folder recordings/A --out runs/dome_rig_a
      arm-brachy import csv --preset ndi track.csv --rate 60 --out runs/track
    """
    recorded = load_scene(scene) if scene else None
    text = _preset_text(preset, files, rate, recorded) if preset else None
    if preset is None and (len(files) > 1 or rate or map_file):
        raise click.UsageError('one COLUMN_MAP; several files, --rate and --map are for --preset.')
    if map_file:
        map_file.write_text(text, encoding='utf-8')
    if out is None:
        if preset is None:
            raise click.UsageError("Missing option '--out'.")
        click.echo(text, nl=False)
        return
    with new_folder(out) as bag, working(f'reading the files of {files[0]}'):
        if preset:
            where = Path(f'{preset}.yaml')
            column_map = config.from_mapping(ColumnMap, YAML(typ='safe').load(text), where.name)
            found = import_map(column_map, where, bag, folder=folder, name=name, text=text)
        else:
            found = import_csv(files[0], bag, folder=folder, name=name)
        _note(f'{file}: not there, left out' for file in found['absent'])
        _note(found['notes'])
        _finish(bag, recorded, picture)
    _show_streams('import csv', found, json_file)


def _preset_text(preset, files, rate, scene):
    """The column map of a preset as YAML."""
    known = () if scene is None else tuple(m.name for m in scene.markers)
    mapping = preset_map(preset, files, rate=rate, known=known)
    stream = io.StringIO()
    yaml = YAML()
    yaml.width = 99
    yaml.dump(mapping, stream)
    return (f'# Column map of --preset {preset}; paths are relative to the folder of this file.\n'
            + stream.getvalue())


def _finish(bag, scene, picture):
    """Check a new bag beside its scene, and draw it, as was asked for."""
    if scene is not None:
        _note(_checked(bag, scene))
    if picture is not None:
        importlib.import_module('arm_brachy.cli.picture').draw_streams(bag, picture)
        console.print(f'picture  {picture}', highlight=False)


def _show_streams(name, found, json_file):
    rows = [{'stream': topic, **figures} for topic, figures in found['streams'].items()]
    show(summary(name, rows), json_file)
    console.print(f"bag  {found['bag']}  {sum(found['messages'].values())} messages",
                  highlight=False)


def _checked(bag, scene):
    """Notes of `scene_check`, which takes seconds to load: an import without a scene need not."""
    module = importlib.import_module('arm_brachy.cli.scene_check')
    return module.check_recording(bag, scene)


def _note(notes):
    for note in notes:
        console.print(f'note  {note}', markup=False, highlight=False)


@import_.command(name='bag')
@click.argument('bag', type=click.Path())
@click.argument('topic_map', type=click.Path())
@click.option('--out', required=True, type=click.Path(), metavar='FOLDER',
              help='Of the new bag; new or empty.')
@click.option('--name', help='Of the recording. Default: that of the map.')
@scene_option
@picture_option
@json_option
def bag_command(bag, topic_map, out, name, scene, picture, json_file):
    """A laboratory's own ROS 2 BAG to a bag; TOPIC_MAP (YAML) says which topic is what.

    BAG is a rosbag2 folder, MCAP or sqlite3, or an .mcap file. Of it are read JointState,
    WrenchStamped, PoseStamped, PointStamped, TransformStamped, TFMessage, PoseArray, PointCloud2
    and OpticalFrame. The map's keys: `arm-brachy keys topics`.

    \b
    Example:
      arm-brachy import bag lab_bag config/imports/lab_bag.yaml \\
        --scene config/scenes/breast.yaml --out runs/lab
    """
    recorded = load_scene(scene) if scene else None
    with new_folder(out) as folder, working(f'reading {bag}'):
        found = import_bag(bag, topic_map, folder, name=name)
        _note(found['notes'])
        _finish(folder, recorded, picture)
    _show_streams('import bag', found, json_file)


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
        _note(one['notes'])
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


@import_.command(name='sample')
@click.option('--out', required=True, type=click.Path(), metavar='FOLDER',
              help='Of the files; new or empty.')
def sample_command(out):
    """Write files to try `mesh`, `check`, `import csv` and `diagnose` on.

    Surface, scene and column map of a simulated phantom with two pads, and the CSV files of one
    recording. Its eastern pad goes 7 % less far than its encoder says, which the scene does not
    know. docs/tutorials/own_phantom.md goes on with them.

    \b
    Example:
      arm-brachy import sample --out lab
    """
    sample = config_dir() / 'imports' / 'phantom'
    with new_folder(out) as folder:
        shutil.copytree(sample, folder, dirs_exist_ok=True)
    for path in sorted(path for path in sample.rglob('*') if path.is_file()):
        console.print(f'file  {Path(out) / path.relative_to(sample)}', highlight=False,
                      markup=False)
