"""`arm-brachy release`: ends an emergency stop of a running cell, with its session key."""

import os
import subprocess

import click

from arm_brachy import launcher
from arm_brachy.cli.output import console
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.session import Session, place_of


@click.command()
@click.argument('bag', type=click.Path())
def release(bag):
    """End an emergency stop of the running cell that records into BAG.

    The supervisor is reset and every drive released. It needs the key of the session, which lies
    beside the bag while the cell runs and which only the user who started the cell can read.

    \b
    Example:
      arm-brachy release runs/target_1/bag
    """
    key = launcher.session_key(bag)
    Session.load(key)       # says in one line what is wrong with it
    domain, namespace = place_of(key)
    process = launcher.NodeProcess('release_client', {'session_key': str(key)}, namespace)
    done = subprocess.run(
        process.argv(), capture_output=True, text=True, check=False,
        env={**os.environ, **launcher.node_environment(), 'ROS_DOMAIN_ID': domain})
    console.print(done.stdout.rstrip(), highlight=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        raise ArmBrachyError(lines[-1] if lines else f'ended with status {done.returncode}')
