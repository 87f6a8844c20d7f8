"""`arm-brachy terms`, `nodes`, `keys`: tables of the documentation, as the program has them."""

import click

from arm_brachy import graph, registry
from arm_brachy.cli.key_table import key_table
from arm_brachy.cli.output import console
from arm_brachy.cli.term_sheet import term_sheet
from arm_brachy.core.config import key_rows
from arm_brachy.core.scene import Scene
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.recording.csv_map import ColumnMap
from arm_brachy.recording.topic_map import TopicMap
from arm_brachy.scenario import Scenario

FILES = {'scene': Scene, 'scenario': Scenario, 'calibration': Calibration, 'columns': ColumnMap,
         'topics': TopicMap}


@click.command()
@click.argument('name', required=False)
def terms(name):
    """Print the table of physics terms, or all about one of them.

    Markdown: equation, parameters with units, range and prior, source, when it is invisible.
    With NAME, that term in lines: also typical sizes, and how a scenario switches it on.

    \b
    Example:
      arm-brachy terms inclusion
    """
    click.echo(term_sheet(name) if name else registry.documentation_table().rstrip('\n'))


@click.command()
def nodes():
    """Print the table of nodes and topics.

    Markdown: what each node does, publishes, subscribes and serves.

    \b
    Example:
      arm-brachy nodes
    """
    click.echo(graph.documentation_table())


@click.command()
@click.argument('file', type=click.Choice(list(FILES)))
def keys(file):
    """Print the keys of scenes, scenarios, calibrations, column and topic maps.

    Default, allowed values, meaning, under the part of the file that they belong to; `- ` begins
    what is one item of a list. A calibration is for `arm-brachy diagnose`: standard deviations of
    what a sound laboratory leaves uncalibrated, the defaults where none is given. A column map
    (`columns`) is for `arm-brachy import csv`, a topic map (`topics`) for `import bag`.

    \b
    Example:
      arm-brachy keys scenario
    """
    meaning = 'standard deviation of' if file == 'calibration' else 'meaning'
    console.print(key_table(key_rows(FILES[file]), meaning, console.width))
