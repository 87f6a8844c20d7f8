"""Nodes that act in a running cell for a person: found by the cell's bag, allowed by its key."""

import os
import signal
import subprocess
from contextlib import contextmanager

import click

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.session import Session, place_of
from arm_brachy.launcher import NodeProcess, die_with_parent, node_environment, session_key


def run_client(bag, name, parameters=None):
    """Run node `name` in the running cell that records into `bag`; what it prints is shown.

    Ctrl-C is handed to the node, which ends in its own way.
    parameters : ROS parameters of the node, beside `session_key`
    Raises ConfigError if there is no such cell, ArmBrachyError with the node's status and its last
    line if it ends with another status than 0.
    """
    key = session_key(bag)
    Session.load(key)       # says in one line what is wrong with it
    domain, namespace = place_of(key)
    node = NodeProcess(name, {'session_key': str(key), **(parameters or {})}, namespace)
    with subprocess.Popen(
            node.argv(), stderr=subprocess.PIPE, text=True, start_new_session=True,
            preexec_fn=die_with_parent,
            env={**os.environ, **node_environment(), 'ROS_DOMAIN_ID': domain}) as process:
        with _interrupting(process) as interrupts:
            said = process.communicate()[1]
    if process.returncode == 0 and interrupts:     # on its way up, before anything was done
        raise click.Abort
    if process.returncode != 0:
        lines = said.strip().splitlines()
        error = ArmBrachyError(lines[-1].removeprefix('arm_brachy: ') if lines
                               else f'{name} ended with status {process.returncode}')
        error.exit_status = max(process.returncode, 1)
        raise error


@contextmanager
def _interrupting(process):
    """Ctrl-C reaches the process, not us; yields a list that grows with each."""
    interrupts = []

    def hand_on(number, frame):
        interrupts.append(number)
        process.send_signal(number)

    before = signal.signal(signal.SIGINT, hand_on)
    try:
        yield interrupts
    finally:
        signal.signal(signal.SIGINT, before)
