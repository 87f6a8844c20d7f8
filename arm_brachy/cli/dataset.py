"""`arm-brachy dataset`: states of a scene's body for the networks to learn from."""

import math
import os
from pathlib import Path

import click
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from arm_brachy.cli.output import console, errors, json_option, show, summary
from arm_brachy.core.paths import run_dir
from arm_brachy.estimation.graph_vae import dataset as shards
from arm_brachy.estimation.graph_vae.loads import LoadOptions
from arm_brachy.prove.workers import Workers


@click.command()
@click.argument('scene', type=click.Path())
@click.option('--states', default=10000, show_default=True, type=click.IntRange(1),
              help='How many states to solve for; those that do not converge are left out.')
@click.option('--seed', default=20260505, show_default=True, type=click.IntRange(0))
@click.option('--jobs', type=click.IntRange(1), metavar='N',
              help='Processes at a time. Default: one a core.')
@click.option('--cluster', default='', metavar='ADDRESS',
              help='Dask scheduler, e.g. tcp://host:8786, whose workers do the work instead; they '
                   'must see the same files and have one thread each.')
@click.option('--out', type=click.Path(file_okay=False), metavar='FOLDER',
              help='Goes on where the data set in it was ended. Default: runs/dataset/SCENE.')
@json_option
def dataset(scene, states, seed, jobs, cluster, out, json_file):
    """Solve for states of a SCENE's body, to train networks on.

    Each walk presses one or two contacts 5 to 30 mm into the tissue in equal steps; every step is
    a state. The same bytes for the same scene and seed, whoever works; may be ended and begun
    again at any time.

    \b
    Example:
      arm-brachy dataset config/scenes/breast.yaml --states 600 --out runs/states
    """
    options = LoadOptions()
    plan = shards.DatasetPlan(str(Path(scene).resolve()), seed,
                              math.ceil(states / options.steps), options)
    folder = Path(out or run_dir() / 'dataset' / Path(scene).stem).resolve()
    wanted = shards.begin(plan, folder)
    workers = Workers(jobs or len(os.sched_getaffinity(0)), cluster)
    with Progress(TextColumn('walks'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                  TimeRemainingColumn(), console=errors) as bar:
        done = bar.add_task('walks', total=plan.walks,
                            completed=plan.walks - sum(len(plan.shards[k]) for k in wanted))
        tasks = [(plan, folder, k) for k in wanted]
        for k, _ in zip(wanted, workers.each(shards.make_shard, tasks), strict=True):
            bar.advance(done, len(plan.shards[k]))
    show(_summary(shards.read(folder), seed), json_file)
    console.print(f'data set  {folder}')


def _summary(made, seed):
    rows = [{'part': part, 'states': len(made.part(part)),
             'walks': len(set(made.walk[made.part(part)].tolist()))} for part in shards.SPLITS]
    wanted = sum(w['wanted'] for w in made.walks)
    rows.append({'part': 'left out, not converged', 'states': wanted - len(made.walk),
                 'walks': sum(w['kept'] < w['wanted'] for w in made.walks)})
    return summary('dataset', rows, seed=seed)
