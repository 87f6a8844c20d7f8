"""The command `arm-brachy`. Exit status 0: done; 1: ran, bad news; 2: bad input; 130: Ctrl-C.

Commands are looked up when they are called, so that `--help` need not load the physics.
"""

import importlib

import click
from click.exceptions import NoArgsIsHelpError

from arm_brachy import __version__
from arm_brachy.core.errors import ArmBrachyError

INTERRUPTED = 130  # 128 + SIGINT, as shells have it

COMMANDS = {  # name -> (module:object, first line of its help)
    'run': ('run:run', 'Start the graph of a SCENARIO, record it, evaluate it.'),
    'replay': ('run:replay', 'Feed a recording back to live nodes and evaluate what they say.'),
    'evaluate': ('run:evaluate',
                 'Metrics of a recording as a table, as JSON and as an HTML report.'),
    'view': ('view:view', 'Show a BAG in the browser: body, forces, pictures, curves over time.'),
    'diagnose': ('diagnose:diagnose',
                 'Say where BAGs differ from their model and what physics is missing.'),
    'prove': ('prove:prove', 'Put the diagnosis to a sealed blind trial and score it.'),
    'reproduce': ('reproduce:reproduce',
                  'Compute one published table or figure, ours beside theirs.'),
    'dataset': ('dataset:dataset', "Solve for states of a SCENE's body, to train networks on."),
    'train': ('train:train', 'Train the graph network of a data set.'),
    'bench': ('bench:bench', "Time the tissue solvers, ours beside others' in one run."),
    'import': ('imports:import_', "Turn a laboratory's files into bags."),
    'recover': ('bags:recover', 'Save every complete message of a damaged BAG.'),
    'conceal': ('bags:conceal', 'Copy a BAG without truth, plant, names, seed and dates.'),
    'hashes': ('bags:hashes', 'Hash the payloads of each topic; compare several BAGS.'),
    'check': ('check:check',
              'Say what a SCENE makes of its mesh, and what in it cannot be meant.'),
    'mesh': ('mesh:mesh', 'Fill a closed SURFACE with tetrahedra.'),
    'rcm': ('rcm:rcm', 'Pose, stiffness and isotropy of the scissor probe holder.'),
    'release': ('release:release', 'End a HOLD or an emergency stop of the running cell that '
                'records into BAG.'),
    'goal': ('goal:goal', 'Bring TARGET to a point, in the running cell that records into BAG.'),
    'abuse': ('abuse:abuse',
              'Do faults to the cell and check that nothing moves that may not.'),
    'terms': ('tables:terms', 'Print the table of physics terms, or all about one of them.'),
    'nodes': ('tables:nodes', 'Print the table of nodes and topics.'),
    'keys': ('tables:keys',
             'Print the keys of scenes, scenarios, calibrations, column and topic maps.'),
}


class Commands(click.Group):
    """The commands of COMMANDS, each imported when it is called; errors are one line."""

    def list_commands(self, ctx):
        """Names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx, name):
        """The command called `name`, or None."""
        if name not in COMMANDS:
            return None
        module, attribute = COMMANDS[name][0].split(':')
        return getattr(importlib.import_module(f'arm_brachy.cli.{module}'), attribute)

    def resolve_command(self, ctx, args):
        """Refuse a command that does not exist, listing those that do."""
        if args[0] not in COMMANDS:
            ctx.fail(f'No command {args[0]!r}; must be one of {", ".join(COMMANDS)}.')
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx, formatter):
        """Write the list of commands from the table, importing none of them."""
        with formatter.section('Commands'):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])

    def main(self, args=None, prog_name=None, **extra):
        """Run the command line `args` and leave with its status.

        An ArmBrachyError or a wrong option is told in one line; Ctrl-C ends with 130. Any other
        exception is a bug and shows its traceback.
        """
        extra.pop('standalone_mode', None)
        raise SystemExit(self._status(args, prog_name, extra))

    def _status(self, args, prog_name, extra):
        try:
            return super().main(args, prog_name, standalone_mode=False, **extra) or 0
        except ArmBrachyError as error:
            click.echo(f'error: {error}', err=True)
            return error.exit_status
        except NoArgsIsHelpError as error:
            error.show()
            return error.exit_code
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else self.name
            click.echo(f'error: {" ".join(error.format_message().split())} See: {command} --help',
                       err=True)
            return error.exit_code
        except click.Abort:  # Ctrl-C
            click.echo('interrupted', err=True)
            return INTERRUPTED


@click.group(cls=Commands, name='arm-brachy',
             context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(__version__)
def main():
    """A robotic cell for breast brachytherapy: run it, record it, replay it, evaluate it.

    Exit status 0: done; 1: ran, and the news is bad; 2: bad input; 130: interrupted.

    \b
    Example:
      arm-brachy run config/scenarios/target_1.yaml --out runs/target_1
    """
