"""What the commands share: where results go, how they are shown, progress on long work."""

import itertools
import shutil
import sys
import threading
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import run_dir, share_dir
from arm_brachy.evaluation.result import Result, cell_text, commit_of, machine_description

# A file or a pipe has no width; a table in it is never cut.
PIPE_WIDTH = 1000
QUICK = 5.0  # s
PROSE = 32  # characters from which the text of a cell may be wrapped
BORDER = 3  # a rule and two spaces beside every cell of a table

console = Console(soft_wrap=True, width=None if sys.stdout.isatty() else PIPE_WIDTH)
errors = Console(stderr=True, soft_wrap=True)


def writable(ctx, param, value):
    """Refuse a place that cannot be written before the work, not after it."""
    if value is None:
        return None
    path = Path(value)
    if path.is_dir():
        raise click.BadParameter(f'{path} is a folder; name a file.')
    if not path.parent.is_dir():
        raise click.BadParameter(f'{path.parent}: no such folder; make it first.')
    return path


json_option = click.option('--json', 'json_file', type=click.Path(), callback=writable,
                           metavar='FILE', help='Also write the result here, as JSON.')
namespace_option = click.option('--namespace', default='', metavar='NAME',
                                help='Of the nodes, topics and services of the cell: several '
                                     'cells may then share one $ROS_DOMAIN_ID. Default: none.')


def fresh(folder):
    """Refuse a folder that holds something, since nothing is ever overwritten; returns Path."""
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f'{folder}: exists and is not empty; name another folder with --out')
    return folder


def result_folder(out, name):
    """The folder of a run: `out` if given, else runs/<name>-<time>; new or empty, not made here.

    Raises InputError if it holds something.
    """
    now = datetime.now()    # of two that begin in one second each has its own
    stamp = f'{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03d}'
    return fresh(out or run_dir() / f'{name}-{stamp}')


@contextmanager
def new_folder(out):
    """Make a folder for the work inside; if that fails, what it wrote is removed again.

    Yields its Path. Raises InputError if it holds something or cannot be made.
    """
    folder = fresh(out)
    with ExitStack() as undo:
        undo.callback(_remove, folder, [p for p in folder.parents if not p.exists()])
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f'{folder}: cannot be made: {error.strerror}; name another folder '
                             'with --out') from None
        yield folder
        undo.pop_all()


def _remove(folder, made):
    shutil.rmtree(folder, ignore_errors=True)
    for parent in made:
        with suppress(OSError):  # another run may have put something there by now
            parent.rmdir()


@contextmanager
def working(text):
    """Context: a line on the terminal that shows that something is going on.

    In a log or a pipe it is written once, and only of what takes longer than QUICK.
    """
    if errors.is_terminal:
        with errors.status(escape(text)):
            yield
        return
    late = threading.Timer(QUICK, lambda: errors.print(f'{text} ...', markup=False))
    late.daemon = True
    late.start()
    try:
        yield
    finally:
        late.cancel()
        late.join()     # else it may be told of after its result


def summary(name, rows, *, seed=None):
    """A Result of work on files: rows as flat dicts, with commit and machine of this call."""
    return Result(name, seed, commit_of(share_dir()), machine_description(), tuple(rows))


def show(result, json_file=None):
    """Print a Result, one row as lines and several as a table; write it to `json_file` if given.

    Raises ArmBrachyError (exit status 1) naming the targets that were missed.
    """
    if len(result.rows) == 1 and not result.targets:
        width = max(map(len, result.rows[0]))
        for key, value in result.rows[0].items():
            console.print(f'{key:<{width}}  {cell_text(value)}', markup=False, highlight=False)
    else:
        show_table(result)
    if json_file:
        result.to_json(json_file)


def show_table(result):
    """Print rows and targets of a Result as tables that fit the terminal.

    Rows with other keys get a table of their own. The rows become columns where that is narrower;
    what is still too wide is cut into blocks that repeat the leading columns of text.
    """
    tables = [tuple(rows) for _, rows in itertools.groupby(result.rows, key=tuple)]
    blocks = [block for rows in tables for block in _blocks(_narrower(rows))]
    *blocks, last = blocks or [()]
    for block in blocks:
        table = Table(*block[0], title=result.name, title_justify='left')
        for row in block:
            table.add_row(*(escape(cell_text(value)) for value in row.values()))
        console.print(table)
    replace(result, rows=last).table(console)


def _narrower(rows):
    columns = _columns(rows)
    return rows if len(columns) <= len(rows) + 1 else _turned(rows, columns)


def _columns(rows):
    return list(dict.fromkeys(key for row in rows for key in row))


def _blocks(rows):
    """The rows cut between columns, so that each block is at most as wide as the console."""
    columns = _columns(rows)
    width = {c: BORDER + _least_width(c, [cell_text(row.get(c)) for row in rows])
             for c in columns}
    keys = list(itertools.takewhile(
        lambda c: all(isinstance(row.get(c), str) for row in rows), columns[:-1]))
    blocks, used = [[]], 0
    room = console.width - sum(width[c] for c in keys) - 1
    for column in columns[len(keys):]:
        if blocks[-1] and used + width[column] > room:
            blocks.append([])
            used = 0
        blocks[-1].append(column)
        used += width[column]
    return [tuple({c: row.get(c) for c in (*keys, *block)} for row in rows) for block in blocks]


def _least_width(column, texts):
    """Characters that a column takes: as wide as its widest text, but sentences are wrapped."""
    widest = max(map(len, texts), default=0)
    word = max((len(word) for text in texts for word in text.split()), default=0)
    return max(len(column), word, min(widest, PROSE))


def _turned(rows, columns):
    """One row per column, headed by the entries of the first."""
    head, *others = columns
    names = [cell_text(row.get(head)) for row in rows]
    if len(set(names)) < len(names):
        names = [f'{name} ({i + 1})' for i, name in enumerate(names)]
    return tuple({head: key} | {name: row.get(key) for name, row in zip(names, rows, strict=True)}
                 for key in others)


def refuse_missed(results):
    """Raise ArmBrachyError (exit status 1) naming the targets that any Result missed."""
    missed = [t.name for one in results for t in one.targets if t.met is False]
    if missed:
        raise ArmBrachyError('goals missed: ' + '; '.join(missed))
