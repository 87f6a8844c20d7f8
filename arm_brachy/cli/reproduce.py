"""`arm-brachy reproduce`: published tables and figures, ours beside theirs."""

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
from arm_brachy.experiments.catalogue import EXPERIMENTS


@click.command(epilog='\b\nNAME is one of\n  ' + '\n  '.join(sorted(EXPERIMENTS)))
@click.argument('name', type=click.Choice(sorted(EXPERIMENTS)), metavar='NAME')
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of the result; new or empty. Default: runs/<name>-<time>.')
@json_option
def reproduce(name, out, json_file):
    """Compute one published table or figure, ours beside theirs.

    \b
    Example:
      arm-brachy reproduce table-3.1 --out runs/table-3.1
    """
    with new_folder(result_folder(out, name)) as folder, working(f'computing {name}'):
        result = EXPERIMENTS[name](folder)
    show_table(result)
    result.to_json(folder / f'{name}.json')
    if json_file:
        result.to_json(json_file)
    console.print(f'results in {folder}')
    refuse_missed([result])
