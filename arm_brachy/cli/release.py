"""`arm-brachy release`: ends a HOLD or an emergency stop of a running cell, with its key."""

import click

from arm_brachy.cli.keyed_client import run_client


@click.command()
@click.argument('bag', type=click.Path())
@click.option('--resume', is_flag=True,
              help='Then go on with the moves of the scenario that were interrupted: pads move.')
def release(bag, resume):
    """End a HOLD or an emergency stop of the running cell that records into BAG.

    The supervisor is reset and every drive released. It needs the key of the session, which lies
    beside the bag while the cell runs and which only the user who started the cell can read.

    \b
    Example:
      arm-brachy release runs/target_1/bag
    """
    run_client(bag, 'release_client', {'resume': resume})
