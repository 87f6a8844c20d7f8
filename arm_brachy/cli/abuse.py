"""`arm-brachy abuse`: a campaign of faults against the cell, and what held."""

from pathlib import Path

import click

from arm_brachy.cli.output import (
    console,
    json_option,
    refuse_missed,
    result_folder,
    show_table,
    working,
)
from arm_brachy.core.errors import InputError
from arm_brachy.experiments import abuse as campaign


@click.command()
@click.option('--faults', default=campaign.FAULTS, type=click.IntRange(0), show_default=True,
              help='To pads, needle and probe: forged and faulty orders, forged sensors, frozen '
                   'nodes; about 3 s each.')
@click.option('--cells', default=campaign.CELLS, type=click.IntRange(0), show_default=True,
              help='Whole cells of which a node is killed or stopped, about a minute each.')
@click.option('--files', default=campaign.FILES, type=click.IntRange(0), show_default=True,
              help='Damaged files: half of them CSV files and column maps, half meshes, '
                   'surfaces, C3D, YAML and MCAP files.')
@click.option('--seed', default=campaign.SEED, type=click.IntRange(0), show_default=True,
              help='Same seed, same campaign.')
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of the result; new, empty, or of a campaign of this seed, which goes on where '
                   'it ended. Default: runs/<name>-<time>.')
@json_option
def abuse(faults, cells, files, seed, out, json_file):
    """Do faults to the cell and check that nothing moves that may not.

    Forged, replayed, skewed and flooding commands, goals, services and sensors and frozen nodes at
    wall pace, deaths of nodes in lockstep, damaged files. Pads, needle and probe are judged by the
    plant. Exit status 1 if an invariant was violated.

    \b
    Example:
      arm-brachy abuse --faults 28 --cells 0 --files 200 --seed 3
    """
    begun = out is not None and (Path(out) / campaign.KEPT).is_file()
    folder = Path(out) if begun else result_folder(out, campaign.NAME)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{folder}: cannot be made: {error.strerror}; name another folder with '
                         '--out') from None
    with working('abusing the cell'):
        result = campaign.reproduce(folder, faults, cells, files, seed)
    show_table(result)
    result.to_json(folder / f'{campaign.NAME}.json')
    if json_file:
        result.to_json(json_file)
    console.print(f'results in {folder}')
    refuse_missed([result])
