"""`arm-brachy abuse`: a campaign of faults against the cell, and what held."""

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
from arm_brachy.experiments import abuse as campaign


@click.command()
@click.option('--faults', default=campaign.FAULTS, type=click.IntRange(0), show_default=True,
              help='Forged and faulty orders to driver and supervisor, about 1 s each.')
@click.option('--cells', default=campaign.CELLS, type=click.IntRange(0), show_default=True,
              help='Whole cells of which a node is killed or stopped, about a minute each.')
@click.option('--files', default=campaign.FILES, type=click.IntRange(0), show_default=True,
              help='Damaged CSV files and column maps.')
@click.option('--seed', default=campaign.SEED, type=click.IntRange(0), show_default=True,
              help='Same seed, same campaign.')
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of the result; new or empty. Default: runs/<name>-<time>.')
@json_option
def abuse(faults, cells, files, seed, out, json_file):
    """Do faults to the cell and check that nothing moves that may not.

    Forged, replayed, skewed and flooding commands at wall pace, deaths of nodes in lockstep,
    damaged files. Pads are judged by the plant. Exit status 1 if an invariant was violated.

    \b
    Example:
      arm-brachy abuse --faults 28 --cells 0 --files 200 --seed 3
    """
    with new_folder(result_folder(out, campaign.NAME)) as folder, working('abusing the cell'):
        result = campaign.reproduce(folder, faults, cells, files, seed)
    show_table(result)
    result.to_json(folder / f'{campaign.NAME}.json')
    if json_file:
        result.to_json(json_file)
    console.print(f'results in {folder}')
    refuse_missed([result])
