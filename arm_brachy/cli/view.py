"""`arm-brachy view`: a recording, or the live cell, in the browser."""

import json
import os
import subprocess
import webbrowser

import click

from arm_brachy.cli.output import console, working
from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.session import Session, place_of
from arm_brachy.launcher import NodeProcess, die_with_parent, node_environment, session_key
from arm_brachy.view import bag_pages
from arm_brachy.viewing.server import PageServer


@click.command()
@click.argument('bag', type=click.Path(), required=False)
@click.option('--live', is_flag=True,
              help='Show the running cell that records into BAG, and set its goals. Without BAG: '
                   'show the cell in the DDS domain $ROS_DOMAIN_ID of this machine.')
@click.option('--port', default=0, type=click.IntRange(0, 65535), metavar='N',
              help='Of this machine, 127.0.0.1; default: a free one.')
@click.option('--browser/--no-browser', default=True, help='Open the page. Default: yes.')
def view(bag, live, port, browser):
    """Show a BAG in the browser: body, forces, pictures, curves over time.

    The page is served to this machine alone and asks nobody else for anything. Ctrl-C ends it.

    With --live, BAG tells the domain, the namespace and the session key of the running cell.

    \b
    Example:
      arm-brachy view runs/target_1/bag
    """
    if not live and not bag:
        raise InputError('view: got neither of BAG and --live; give one of them')
    if live:
        _show_live(bag, port, browser)
    else:
        _show_bag(bag, port, browser)


def _show_bag(bag, port, browser):
    with working(f'reading {bag}'):
        pages = bag_pages(bag)
    server = PageServer(port, pages)
    _say(server.address, browser)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        pass
    finally:
        server.server_close()


def _show_live(bag, port, browser):
    """Node live_view in a process of its own, as every node; Ctrl-C reaches it too."""
    parameters, environment, namespace = {'port': str(port)}, {}, ''
    if bag:
        key = session_key(bag)
        Session.load(key)       # says in one line what is wrong with it
        parameters['session_key'] = str(key)
        environment['ROS_DOMAIN_ID'], namespace = place_of(key)
    argv = NodeProcess('live_view', parameters, namespace).argv()
    with subprocess.Popen(argv, stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent,
                          env={**os.environ, **node_environment(), **environment}) as node:
        try:
            for line in node.stdout:
                _say(json.loads(line)['progress']['address'], browser)
            status = node.wait()
        except KeyboardInterrupt:
            return
    if status:
        error = ArmBrachyError('live_view has ended; what it said stands above')
        error.exit_status = status
        raise error


def _say(address, browser):
    console.print(f'view    {address}   (Ctrl-C ends it)')
    if browser:
        webbrowser.open(address)
