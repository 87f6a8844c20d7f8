"""`arm-brachy bench`: our solver beside its peers, and how its cost grows."""

import itertools
from dataclasses import replace

import click

from arm_brachy.cli.output import (
    console,
    json_option,
    new_folder,
    refuse_missed,
    result_folder,
    show_table,
    working,
)
from arm_brachy.experiments import bench_growth, bench_solvers

BENCHES = {'solvers': bench_solvers, 'growth': bench_growth}


@click.command(epilog='NAME: solvers (peers: pip install -r requirements-bench.txt), growth')
@click.argument('name', type=click.Choice(list(BENCHES)), metavar='NAME')
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of the result; new or empty. Default: runs/bench-<name>-<time>.')
@json_option
def bench(name, out, json_file):
    """Time the tissue solvers, ours beside others' in one run.

    \b
    Example:
      arm-brachy bench solvers --out runs/bench-solvers
    """
    module = BENCHES[name]
    with new_folder(result_folder(out, module.NAME)) as folder, working(f'timing {name}'):
        result = module.bench(folder)
    show_groups(result)
    result.to_json(folder / f'{module.NAME}.json')
    if json_file:
        result.to_json(json_file)
    console.print(f'results in {folder}')
    refuse_missed([result])


def show_groups(result):
    """Print a Result whose rows are of several forms: a table for each, then the targets."""
    groups = [tuple(rows) for _, rows in itertools.groupby(result.rows, key=tuple)]
    for rows in groups[:-1]:
        show_table(replace(result, rows=rows, targets=()))
    show_table(replace(result, rows=groups[-1]))
