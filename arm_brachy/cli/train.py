"""`arm-brachy train`: the graph network of a data set."""

import math
from dataclasses import replace
from pathlib import Path

import click
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from arm_brachy.cli.output import console, errors, json_option, show, summary
from arm_brachy.core.errors import InputError
from arm_brachy.core.paths import run_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.estimation.graph_vae import dataset
from arm_brachy.estimation.graph_vae.network import NetworkOptions
from arm_brachy.estimation.graph_vae.training import Training, TrainingOptions
from arm_brachy.tissue.build import load_scene_mesh


@click.command()
@click.argument('scene', type=click.Path())
@click.option('--data', required=True, type=click.Path(), metavar='FOLDER',
              help='Of `arm-brachy dataset`, of the same scene.')
@click.option('--epochs', default=TrainingOptions.epochs, show_default=True,
              type=click.IntRange(0))
@click.option('--hours', default=TrainingOptions.hours, show_default=True,
              type=click.FloatRange(0.0), help='Of processor time, all calls together.')
@click.option('--rate', default=TrainingOptions.rate, show_default=True,
              type=click.FloatRange(0.0, min_open=True), help='Learning rate of Adam.')
@click.option('--linear/--no-linear', default=NetworkOptions.linear, show_default=True,
              help='Add the layers to the linear modes, or leave them alone as in Table 5.1.')
@click.option('--seed', default=TrainingOptions.seed, show_default=True, type=click.IntRange(0))
@click.option('--out', type=click.Path(file_okay=False), metavar='FOLDER',
              help='Goes on where the training in it was ended. Default: runs/train/SCENE.')
@json_option
def train(scene, data, epochs, hours, rate, linear, seed, out, json_file):
    """Train the graph network of a data set.

    Writes weights.npz (the best epoch's on validation states), curve.csv and checkpoint.pt, from
    which it goes on after any end. The table has the linear baseline of as many modes beside it.

    \b
    Example:
      arm-brachy train config/scenes/breast.yaml --data runs/states --out runs/net
    """
    body, states = load_scene(scene), dataset.read(data)
    if states.manifest['scene_sha256'] != dataset.scene_hash(body):
        raise InputError(f'{data}: of scene {states.manifest["scene"]}, another than {scene} or '
                         'another version of it; must be of the same; make the data set again')
    options = replace(TrainingOptions(), seed=seed, epochs=epochs, hours=hours, rate=rate)
    folder = Path(out or run_dir() / 'train' / Path(scene).stem).resolve()
    training = Training(states, load_scene_mesh(body), folder, options, scene=body,
                        network=NetworkOptions(linear=linear))
    with Progress(TextColumn('epochs'), BarColumn(), TextColumn('{task.completed}/{task.total}'),
                  TextColumn('validation {task.fields[error]:.4f} mm'), TimeElapsedColumn(),
                  TimeRemainingColumn(), console=errors) as bar:
        task = bar.add_task('', total=epochs, completed=training.epoch, error=math.nan)
        training.run(lambda epoch, row: bar.update(task, completed=epoch,
                                                   error=row['validation_mm']))
    show(summary('train', training.rows(), seed=seed), json_file)
    console.print(f'weights   {folder / "weights.npz"}')
