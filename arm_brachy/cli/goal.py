"""`arm-brachy goal`: brings a target of a running cell to a point, with its session key."""

import click

from arm_brachy.cli.keyed_client import run_client

FARTHEST_MM, LONGEST_S = 1e4, 1e6      # of a number that can be meant


class _Number(click.ParamType):
    """A number within a range, which nan is not."""

    name = 'number'

    def __init__(self, low, high):
        self._low, self._high = low, high

    def convert(self, value, param, ctx):
        """The number; refused in one line."""
        try:
            number = float(value)
        except ValueError:
            self.fail(f'{value!r} is no number.', param, ctx)
        if not self._low <= number <= self._high:
            self.fail(f'got {value}; must be {self._low:g} to {self._high:g}.', param, ctx)
        return number


def _axis(name):
    return click.option(f'--{name}', type=_Number(-FARTHEST_MM, FARTHEST_MM), metavar='MM',
                        help=f'Along {name} of the base frame; without it {name} is free.')


@click.command()
@click.argument('bag', type=click.Path())
@click.argument('target')
@_axis('x')
@_axis('y')
@_axis('z')
@click.option('--position', is_flag=True,
              help='MM is a position in the base frame. Default: a displacement from where the '
                   'target is now.')
@click.option('--settle', default=0.0, type=_Number(0.0, LONGEST_S), metavar='SECONDS',
              help='How long the target must stay within the dead band. Default: 1.')
@click.option('--timeout', default=0.0, type=_Number(0.0, LONGEST_S), metavar='SECONDS',
              help="Of the cell's time, after which the goal is given up. Default: never.")
def goal(bag, target, x, y, z, position, settle, timeout):
    """Bring TARGET to a point, in the running cell that records into BAG.

    A line a second says how far it is. Ctrl-C cancels: the pads stay where they are. A goal that
    was set before ends. It needs the key of the session, which lies beside the bag while the cell
    runs and which only the user who started the cell can read.

    Exit status 0: the target rests at its goal; 1: it does not, and why; 2: bad input; 130:
    cancelled by Ctrl-C.

    \b
    Example:
      arm-brachy goal runs/target_1/bag target_1 --x -5 --y 0
    """
    given = {axis: value for axis, value in (('x', x), ('y', y), ('z', z)) if value is not None}
    if not given:
        raise click.UsageError('got neither of --x, --y and --z; give at least one.')
    run_client(bag, 'goal_client', {
        'target': target, 'axes': ''.join(given),
        **{f'{axis}_mm': value for axis, value in given.items()},
        'relative': not position, 'settle_s': settle, 'timeout_s': timeout})
