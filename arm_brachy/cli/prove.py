"""`arm-brachy prove`: the sealed blind trial of the diagnosis, by anyone, on any machine."""

import os
from dataclasses import replace
from pathlib import Path

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from arm_brachy.cli.output import (
    console,
    errors,
    json_option,
    refuse_missed,
    show_table,
    summary,
)
from arm_brachy.core.paths import run_dir
from arm_brachy.prove import oracle, recovery, rivals, totals, trial
from arm_brachy.prove.answering import ABSOLUTE, LIMIT, NULL
from arm_brachy.prove.folder import TrialFolder
from arm_brachy.prove.report import report
from arm_brachy.prove.workers import Workers

SOURCE, SIGNALS = 'arm_brachy.prove.source', 'arm_brachy.prove.signals'
MODES = {'absolute': (ABSOLUTE,), 'null': (NULL,), 'both': (ABSOLUTE, NULL)}


@click.command()
@click.option('--cases', default=60, show_default=True, type=click.IntRange(1, 5000),
              help='How many recordings are made; 540 is the full trial.')
@click.option('--beacon', default='', metavar='TEXT',
              help='Public text that was not known when the detector was committed, e.g. a '
                   'lottery draw; the cases follow from it. Default: fresh random bytes.')
@click.option('--mode', default='both', show_default=True, type=click.Choice(list(MODES)),
              help='With a recording of the same set-up in which nothing is wrong, or without.')
@click.option('--workers', type=click.IntRange(1), metavar='N',
              help='Processes at a time. Default: one a core.')
@click.option('--cluster', default='', metavar='ADDRESS',
              help='Dask scheduler, e.g. tcp://host:8786, whose workers do the work instead; they '
                   'must see the same files and have one thread each.')
@click.option('--limit-s', default=LIMIT, show_default=True, type=click.FloatRange(1.0),
              help='Time for one answer; what takes longer is wrong.')
@click.option('--baselines', is_flag=True,
              help='Also put five simple ways to answer to the same cases; doubles the time.')
@click.option('--out', type=click.Path(file_okay=False), metavar='FOLDER',
              help='Goes on where the trial in it was ended. Default: runs/prove.')
@json_option
def prove(cases, beacon, mode, workers, cluster, limit_s, baselines, out, json_file):
    """Put the diagnosis to a sealed blind trial and score it.

    A generator that shares nothing with the diagnosis makes recordings with an effect concealed
    in them, publishes hashes of what it is, and has each diagnosed by a process that can read
    that recording alone. Exit status 1 if a goal is missed.

    \b
    Example:
      arm-brachy prove --cases 60 --out runs/prove
    """
    workers = Workers(workers or len(os.sched_getaffinity(0)), cluster)
    setup = trial.Setup(cases, MODES[mode], beacon, workers, limit_s)
    folder = TrialFolder(Path(out or run_dir() / 'prove').resolve())
    with Progress(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                  TimeElapsedColumn(), console=errors) as bar:
        tasks = {}

        def show(stage, done, of):
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=of)
            bar.update(tasks[stage], completed=done, total=of)

        jobs, truths, records = trial.run(setup, folder.path, SOURCE, show)
        begun = trial.begin(setup, folder)
        seen = oracle.analyse_all(folder, jobs, setup.modes, SIGNALS, workers, show)
        gained = recovery.recover_all(folder, begun['key'], truths, records, workers, show)
        named = {} if not baselines else rivals.answer_all(
            folder, begun['key'], truths, workers, show)
    extras = {(mode, case): {**seen.get(case, {}).get(mode, {}),
                             **gained.get(f'{mode}/{case}', {})}
              for mode, case in records}
    result = report(folder, begun, truths, records, extras, frozen=trial.frozen(folder),
                    baselines=(*rivals.rows(truths, named), rivals.gain_row(named, gained))
                    if named else ())
    if json_file:
        result.to_json(json_file)
    _show(result, setup.modes, folder)


def _show(result, modes, folder):
    for mode in modes:
        rows = totals.in_mode([row for row in result.rows if 'mode' in row], mode)
        goals = tuple(goal for goal in result.targets if goal.name.startswith(mode))
        show_table(replace(summary(f'blind trial, mode {mode}', totals.shares(rows)),
                           targets=goals))
    console.print(f'report    {folder / "index.html"}')
    console.print(f'result    {folder / "result.json"}')
    refuse_missed([result])
