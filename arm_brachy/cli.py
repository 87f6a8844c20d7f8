"""The command `arm-brachy`. Exit status 0: done; 1: ran, bad news; 2: bad input, in one line."""

from datetime import datetime
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from arm_brachy import __version__, graph, launcher, registry
from arm_brachy import evaluate as evaluation
from arm_brachy.core import config
from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import run_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.experiments import EXPERIMENTS
from arm_brachy.offline import recorded_cell
from arm_brachy.recording.conceal import conceal as conceal_bag
from arm_brachy.recording.import_c3d import C3dImport, import_c3d
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.reader import payload_hashes
from arm_brachy.recording.recover import recover as recover_bag
from arm_brachy.recording.scene_import import import_scene
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.meshing import mesh_command

console = Console(soft_wrap=True)
errors = Console(stderr=True, soft_wrap=True)
REPLAYABLE = tuple(n.name for n in graph.NODES
                   if n not in (graph.CELL_CLOCK, graph.RECORDER, graph.OPERATOR))


class Commands(click.Group):
    """Turns expected errors into one line and their exit status."""

    def invoke(self, ctx):
        """Run the command; anything that is not an ArmBrachyError is a bug and shows itself."""
        try:
            return super().invoke(ctx)
        except ArmBrachyError as error:
            errors.print(f'error: {error}', markup=False, highlight=False)
            raise SystemExit(error.exit_status) from None


@click.group(cls=Commands, context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(__version__)
def main():
    """A robotic cell for breast brachytherapy: run it, record it, replay it, evaluate it."""


def _fresh(folder):
    """Refuse a folder that holds something: nothing is ever overwritten."""
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f'{folder}: exists and is not empty; name another folder with --out')
    return folder


def _result_folder(out, name):
    stamp = datetime.now().strftime('%Y%m%d-%H%M%S')
    return _fresh(out or run_dir() / f'{name}-{stamp}')


def _launch(processes, leader, folder, label):
    """Run processes under a progress line; returns the leader's last words."""
    said = {}
    with Progress(SpinnerColumn(), TextColumn('{task.description}'), BarColumn(pulse_style='blue'),
                  TimeElapsedColumn(), console=errors, transient=True) as bar:
        task = bar.add_task(f'{label}: starting {len(processes)} nodes', total=None)

        def show(name, values):
            if name != leader:
                return
            said.update(values)
            if 't' in values:
                speed = f", {values['factor']:.1f} x real time" if 'factor' in values else ''
                what = f" {values['task']}" if values.get('task') else ''
                bar.update(task, description=f"{label}:{what} t = {values['t']:.1f} s{speed}")

        done = launcher.Launcher(processes, leader, folder / 'logs', show).run()
    if not done:
        raise ArmBrachyError(f'interrupted; what was recorded until then is in {folder}/bag')
    return said


@main.command()
@click.argument('scenario', type=click.Path())
@click.option('--out', type=click.Path(), help='Folder of the result; must be new or empty.')
@click.option('--speed-limit', default=0.0, help='Simulated seconds per second; 0 = no limit.')
@click.option('--json', 'json_file', type=click.Path(), help='Also write the result here.')
def run(scenario, out, speed_limit, json_file):
    """Start the graph of a SCENARIO, record it, evaluate it.

    Example: arm-brachy run config/scenarios/target_1.yaml
    """
    cell = load_cell(scenario)
    folder = _result_folder(out, cell.scenario.name)
    processes = launcher.cell_processes(cell, cell.path, folder / 'bag', speed_limit=speed_limit)
    leader = 'cell_clock' if cell.scenario.pace == 'lockstep' else 'operator'
    said = _launch(processes, leader, folder, cell.scenario.name)
    if 'factor' in said:
        console.print(f"simulated {said['t']:.1f} s at {said['factor']:.2f} x real time")
    _evaluate(folder / 'bag', folder, json_file, command=f'arm-brachy run {scenario}')


def _evaluate(bag, folder, json_file, command):
    result, pages = evaluation.evaluate_bag(bag, folder, command=command)
    for one in result:
        one.table(console)
    if json_file:
        result[0].to_json(json_file)
    console.print(f'bag     {bag}')
    for page in pages:
        console.print(f'report  {page}')
    missed = [t.name for one in result for t in one.targets if t.met is False]
    if missed:
        raise ArmBrachyError('goals missed: ' + '; '.join(missed))


@main.command()
@click.argument('bag', type=click.Path())
@click.option('--scenario', type=click.Path(), help='Default: the one recorded in the bag.')
@click.option('--node', 'nodes', multiple=True, default=('tissue_model',), show_default=True,
              type=click.Choice(REPLAYABLE), help='Node to run live; may be given several times.')
@click.option('--out', type=click.Path(), help='Folder of the result; must be new or empty.')
@click.option('--json', 'json_file', type=click.Path(), help='Also write the result here.')
def replay(bag, scenario, nodes, out, json_file):
    """Feed a recording back to live nodes and evaluate what they say.

    The default node predicts from the recorded encoders what trackers and force sensors should
    have seen; the report shows what it misses.

    Example: arm-brachy replay runs/beam_a/bag --scenario config/scenarios/beam_gravity.yaml
    """
    folder = _result_folder(out, f'replay-{Path(bag).name}')
    if scenario is None:
        scenario = recorded_cell(bag, folder / 'cell').path
    cell = load_cell(scenario)
    processes = launcher.replay_processes(cell, cell.path, Path(bag).resolve(), nodes,
                                          folder / 'bag')
    _launch(processes, 'replayer', folder, f'replay of {Path(bag).name}')
    _evaluate(folder / 'bag', folder, json_file, command=f'arm-brachy replay {bag}')


@main.command()
@click.argument('bag', type=click.Path())
@click.option('--out', type=click.Path(), help='Folder for the report; default: beside the bag.')
@click.option('--json', 'json_file', type=click.Path(), help='Also write the result here.')
def evaluate(bag, out, json_file):
    """Metrics of a recording as a table, as JSON and as an HTML report.

    Example: arm-brachy evaluate runs/target_1-20260107-120000/bag --json result.json
    """
    folder = Path(out) if out else Path(bag).resolve().parent
    _evaluate(Path(bag), folder, json_file, command=f'arm-brachy evaluate {bag}')


@main.command()
@click.argument('name', type=click.Choice(sorted(EXPERIMENTS)))
@click.option('--out', type=click.Path(), help='Folder of the results.')
@click.option('--json', 'json_file', type=click.Path(), help='Also write the result here.')
def reproduce(name, out, json_file):
    """Compute one published table or figure, ours beside theirs.

    Example: arm-brachy reproduce table-3.1
    """
    folder = Path(out) if out else run_dir() / name
    folder.mkdir(parents=True, exist_ok=True)
    result = EXPERIMENTS[name](folder)
    result.table(console)
    result.to_json(json_file or folder / f'{name}.json')
    console.print(f'results in {folder}')
    missed = [t.name for t in result.targets if t.met is False]
    if missed:
        raise ArmBrachyError('goals missed: ' + '; '.join(missed))


@main.group(name='import')
def import_():
    """Turn a laboratory's files into bags."""


@import_.command(name='csv')
@click.argument('column_map', type=click.Path())
@click.option('--out', required=True, type=click.Path(), help='Folder of the bag.')
def import_csv_command(column_map, out):
    """CSV files, as the YAML file COLUMN_MAP says which column is what.

    Example: arm-brachy import csv config/imports/example.yaml --out runs/imported
    """
    _report(import_csv(column_map, _fresh(out)))


@import_.command(name='c3d')
@click.argument('files', nargs=-1, required=True, type=click.Path())
@click.option('--options', 'options_file', type=click.Path(),
              help='YAML: names, unit, registration, trigger, part to keep.')
@click.option('--scene', type=click.Path(), help='Scene to register to.')
@click.option('--out', required=True, type=click.Path(), help='Folder that receives the bags.')
def import_c3d_command(files, options_file, scene, out):
    """Motion capture FILES (C3D), each to a bag.

    Example: arm-brachy import c3d beam_a.c3d --options config/imports/beam.yaml --out runs/beam
    """
    options = config.load(C3dImport, options_file) if options_file else C3dImport()
    _report(import_c3d(files, out, options, load_scene(scene) if scene else None))


@import_.command(name='scene')
@click.argument('file', type=click.Path())
@click.option('--out', required=True, type=click.Path(), help='Folder of scene and column maps.')
@click.option('--name', help='Name of the scene; default: that of its folder.')
def import_scene_command(file, out, name):
    """Another laboratory's rig description FILE to a scene and column maps.

    Example: arm-brachy import scene rig/scene.yaml --out rig_imported
    """
    _report(import_scene(file, out, name=name))


@main.command()
@click.argument('bag', type=click.Path())
@click.option('--out', required=True, type=click.Path(), help='Folder of the mended bag.')
def recover(bag, out):
    """Rewrite every complete message of a damaged BAG into a valid one.

    Example: arm-brachy recover runs/killed/bag --out runs/killed/mended
    """
    _report(recover_bag(bag, _fresh(out)))


@main.command()
@click.argument('bag', type=click.Path())
@click.option('--out', required=True, type=click.Path(), help='Folder of the concealed bag.')
def conceal(bag, out):
    """Copy a BAG without truth, plant, names, seed and dates.

    Example: arm-brachy conceal runs/target_1/bag --out case_17
    """
    _report(conceal_bag(bag, _fresh(out)))


@main.command()
@click.argument('surface', type=click.Path())
@click.argument('output', type=click.Path())
@click.option('--edge-length-mm', required=True, type=float, help='Edge length wished for.')
@click.option('--unit', default='mm', type=click.Choice(['mm', 'm']), help='Of the surface file.')
def mesh(surface, output, edge_length_mm, unit):
    """Fill a closed SURFACE (STL, OBJ, PLY) with tetrahedra and write OUTPUT (.msh, .vtu).

    Example: arm-brachy mesh phantom.stl phantom.msh --edge-length-mm 10
    """
    _report(mesh_command(surface, output, edge_length_mm=edge_length_mm, unit=unit))


@main.command()
@click.argument('bags', nargs=-1, required=True, type=click.Path())
def hashes(bags):
    """Hash the payloads of each topic; with several BAGS, compare them (status 1 if they differ).

    Example: arm-brachy hashes runs/a/bag runs/b/bag
    """
    found = [payload_hashes(b) for b in bags]
    for topic in sorted(set().union(*found)):
        digests = {f.get(topic, 'absent') for f in found}
        mark = 'equal ' if len(digests) == 1 else 'DIFFER'
        console.print(f'{mark} {topic} {" ".join(sorted(d[:12] for d in digests))}')
    if any(f != found[0] for f in found):
        raise ArmBrachyError('the recordings differ')


@main.command()
def terms():
    """Print the table of physics terms: equation, parameters, source, when invisible."""
    click.echo(registry.documentation_table())


@main.command()
def nodes():
    """Print the table of nodes and topics."""
    click.echo(graph.documentation_table())


def _report(rows):
    for key, value in rows.items():
        if isinstance(value, dict):
            for name, item in value.items():
                console.print(f'{key}  {name}  {item}', highlight=False)
        elif isinstance(value, (list, tuple)):
            for item in value:
                _report(item) if isinstance(item, dict) else console.print(f'{key}  {item}')
        else:
            console.print(f'{key}  {value}', highlight=False)
