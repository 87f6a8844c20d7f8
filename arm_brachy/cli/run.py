"""`arm-brachy run`, `replay`, `evaluate`: from a scenario or a bag to a report."""

import os
import shutil
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from arm_brachy import cell as cells
from arm_brachy import evaluate as evaluation
from arm_brachy import graph, launcher
from arm_brachy.cli.output import (
    console,
    errors,
    json_option,
    namespace_option,
    new_folder,
    refuse_missed,
    result_folder,
    show_table,
    working,
)
from arm_brachy.core.errors import InputError, Interrupted
from arm_brachy.offline import recorded_cell
from arm_brachy.recording.reader import BagReader, mcap_file
from arm_brachy.scenario import load_cell

REPLAYABLE = tuple(n.name for n in graph.NODES
                   if n not in (graph.CELL_CLOCK, graph.RECORDER, graph.OPERATOR,
                                graph.PUSH_PROTOCOL))

RUN_BAG = 'bag'     # what `run` and `replay` call the bag in their folder

out_option = click.option('--out', type=click.Path(), metavar='FOLDER',
                          help='Of the result; new or empty. Default: runs/<name>-<time>.')


@click.command()
@click.argument('scenario', type=click.Path())
@out_option
@click.option('--speed-limit', default=0.0, type=click.FloatRange(0.0), metavar='FACTOR',
              help='Simulated seconds per second; default: as fast as possible.')
@click.option('--watch', is_flag=True,
              help='Also run tissue_model and mismatch_monitor: which channel departs from the '
                   "model is on /diagnostics and among the report's outcomes.")
@click.option('--viewer/--no-viewer', default=True,
              help='Node cell_viewer draws the cell for Foxglove and RViz; it adds about a tenth '
                   'to the bag. Default: as the scenario says, which is yes.')
@namespace_option
@json_option
def run(scenario, out, speed_limit, watch, viewer, namespace, json_file):
    """Start the graph of a SCENARIO, record it, evaluate it.

    \b
    Example:
      arm-brachy run config/scenarios/target_1.yaml --out runs/target_1
    """
    namespace = launcher.cell_namespace(namespace)
    cell = load_cell(scenario)
    with new_folder(result_folder(out, cell.scenario.name)) as folder, \
            working('reading the scene'):
        _build(cell, 'plant', 'model')
        cells.build_actuators(cell, cell.scenario.actuators)
    processes = launcher.cell_processes(cell, cell.path, folder / RUN_BAG, speed_limit=speed_limit,
                                        watch=watch, viewer=viewer, namespace=namespace)
    leader = graph.CELL_CLOCK if cell.scenario.pace == 'lockstep' \
        else graph.conductor_of(cell.scenario)
    said = _launch(processes, leader.name, folder, cell.scenario.name)
    if 'factor' in said:
        console.print(f"simulated {said['t']:.1f} s at {said['factor']:.2f} x real time")
    inside = f' --namespace {namespace}' if namespace else ''
    _evaluate(folder / RUN_BAG, folder, json_file, command=f'arm-brachy run {scenario}{inside}')


@click.command()
@click.argument('bag', type=click.Path())
@click.option('--scenario', type=click.Path(), metavar='FILE',
              help='Default: the one recorded in the bag.')
@click.option('--node', 'nodes', multiple=True, default=('tissue_model',), show_default=True,
              type=click.Choice(REPLAYABLE), metavar='NAME',
              help=f'Node to run live; may be given several times: {", ".join(REPLAYABLE)}.')
@out_option
@json_option
def replay(bag, scenario, nodes, out, json_file):
    """Feed a recording back to live nodes and evaluate what they say.

    The default node predicts from the recorded encoders what trackers and force sensors should
    have seen; the report shows what it misses. `gain` is measured over predicted motion (or
    force): below 1 the model moves too much. It takes about as long as the recording lasts.

    \b
    Example:
      arm-brachy replay runs/target_1/bag --out runs/target_1_replayed
    """
    with BagReader(bag) as reader:
        source = reader.path.resolve()
    with new_folder(result_folder(out, f'replay-{source.stem}')) as folder:
        cell = recorded_cell(bag, folder / 'cell') if scenario is None else load_cell(scenario)
        with working('reading the scene'):
            _build(cell, 'model')
    processes = launcher.replay_processes(cell, cell.path, source, nodes, folder / RUN_BAG)
    _launch(processes, 'replayer', folder, f'replay of {source.stem}')
    _evaluate(folder / RUN_BAG, folder, json_file, command=_replayed(bag, scenario, nodes))


def _replayed(bag, scenario, nodes):
    """What to type to get this replay again."""
    words = ['arm-brachy replay', str(bag)]
    words += [f'--scenario {scenario}'] if scenario else []
    return ' '.join(words + [f'--node {n}' for n in nodes if nodes != ('tissue_model',)])


@click.command()
@click.argument('bag', type=click.Path())
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of the report; new or empty. Default: the folder of the run, or beside the '
                   'bag <name>_report, where an earlier report of the same bag is replaced.')
@json_option
def evaluate(bag, out, json_file):
    """Metrics of a recording as a table, as JSON and as an HTML report.

    \b
    Example:
      arm-brachy evaluate runs/target_1/bag --json runs/target_1.json
    """
    command = f'arm-brachy evaluate {bag}'
    if out is None:
        mcap_file(bag)      # refuses what is no bag, before there is a folder for its report
        folder = _report_folder(Path(bag).resolve())
        if not os.access(folder if folder.is_dir() else folder.parent, os.W_OK):
            raise InputError(f'{folder}: cannot be written to; name another folder with --out')
        with _kept(folder):
            results, pages = _report(bag, folder, command)
        _show(bag, results, pages, json_file)
        return
    with new_folder(out) as folder:
        results, pages = _report(bag, folder, command)
    _show(bag, results, pages, json_file)


def _report_folder(bag):
    """Where the report of a bag goes: a run's own folder, else one that bears the bag's name.

    Bags that were recovered or imported stand side by side; one folder would hold the report of
    the last alone.
    """
    return bag.parent if bag.name == RUN_BAG else bag.parent / f'{bag.stem}_report'


@contextmanager
def _kept(folder):
    """Make a folder, or use it as it is; what was made is removed if the work fails."""
    made = not folder.exists()
    folder.mkdir(exist_ok=True)
    try:
        yield
    except BaseException:
        if made:
            shutil.rmtree(folder)
        raise


def _build(cell, *sides):
    """Build the bodies that the nodes will build, so that what is wrong is told before a start."""
    for side in sides:
        cells.build_tissue(cell, side)


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

        done = launcher.Launcher(
            processes, leader, folder / 'logs', show,
            lambda domain: console.print(launcher.where(domain, processes[0].namespace),
                                         highlight=False)).run()
    if not done:
        raise Interrupted(f'interrupted; what was recorded until then is in {folder}/bag')
    return said


def _evaluate(bag, folder, json_file, command):
    results, pages = _report(bag, folder, command)
    _show(bag, results, pages, json_file)


def _report(bag, folder, command):
    with working(f'evaluating {bag}'):
        return evaluation.evaluate_bag(bag, folder, command=command)


def _show(bag, results, pages, json_file):
    for one in results:
        show_table(one)
    if json_file:
        _merged(results).to_json(json_file)
    console.print(f'bag     {bag}')
    for page in pages:
        console.print(f'report  {page}')
    refuse_missed(results)


def _merged(results):
    """One Result that holds the rows of all, each with the table it stood in."""
    if len(results) == 1:
        return results[0]
    rows = tuple({'table': one.name, **row} for one in results for row in one.rows)
    return replace(results[0], rows=rows, targets=tuple(t for one in results for t in one.targets))
