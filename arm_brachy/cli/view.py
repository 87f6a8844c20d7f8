"""`arm-brachy view`: a recording in the browser."""

import webbrowser

import click

from arm_brachy.cli.output import console, working
from arm_brachy.view import bag_pages
from arm_brachy.viewing.server import PageServer


@click.command()
@click.argument('bag', type=click.Path())
@click.option('--port', default=0, type=click.IntRange(0, 65535), metavar='N',
              help='Of this machine, 127.0.0.1; default: a free one.')
@click.option('--browser/--no-browser', default=True, help='Open the page. Default: yes.')
def view(bag, port, browser):
    """Show a BAG in the browser: body, forces, pictures, curves over time.

    The page is served to this machine alone and asks nobody else for anything. Ctrl-C ends it.

    \b
    Example:
      arm-brachy view runs/target_1/bag
    """
    with working(f'reading {bag}'):
        pages = bag_pages(bag)
    server = PageServer(port, pages)
    console.print(f'view    {server.address}   (Ctrl-C ends it)')
    if browser:
        webbrowser.open(server.address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        pass
    finally:
        server.server_close()
