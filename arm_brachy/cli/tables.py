"""`arm-brachy terms`, `nodes`: the tables of the documentation, as the program has them."""

import click

from arm_brachy import graph, registry


@click.command()
def terms():
    """Print the table of physics terms.

    Markdown: equation, parameters with units, range and prior, source, when it is invisible.

    \b
    Example:
      arm-brachy terms
    """
    click.echo(registry.documentation_table().rstrip('\n'))


@click.command()
def nodes():
    """Print the table of nodes and topics.

    Markdown: what each node does, publishes, subscribes and serves.

    \b
    Example:
      arm-brachy nodes
    """
    click.echo(graph.documentation_table())
