"""The one JSON form of every result: what, with which seed, commit and machine."""

import itertools
import json
import math
import os
import platform
import subprocess
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

# written next to the package by the build, so that an installed copy knows where it came from
COMMIT_FILE = 'COMMIT'
UNKNOWN = 'unknown'


@dataclass(frozen=True)
class Target:
    """A goal that was set beforehand, and what came out.

    value : in `unit`;  goal : as text with its comparison, e.g. '< 0.3'
    met : True, False, or None if these data cannot say
    """

    name: str
    value: float
    unit: str
    goal: str
    met: bool | None


@dataclass(frozen=True)
class Result:
    """Rows of a table with all that is needed to get them again.

    rows : flat dicts, one per line of the table, units in the key names (`itae_mm_s2`)
    targets : Target, possibly none;  seed : None where nothing is drawn
    """

    name: str
    seed: int | None
    commit: str
    machine: str
    rows: tuple = ()
    targets: tuple = ()

    @property
    def met(self):
        """False if any target was missed (one that cannot be judged is not missed)."""
        return not any(target.met is False for target in self.targets)

    def to_json(self, path=None):
        """The result as JSON text; also written to `path` if given. NaN and infinity are null."""
        body = {**asdict(self), 'rows': list(self.rows),
                'targets': [asdict(target) for target in self.targets]}
        text = json.dumps(_plain(body), indent=2, allow_nan=False, ensure_ascii=False) + '\n'
        if path is not None:
            Path(path).write_text(text, encoding='utf-8')
        return text

    def table(self, console):
        """Print rows and targets on a rich Console; rows with other keys get their own table."""
        for columns, rows in itertools.groupby(self.rows, key=tuple):
            self._print_whole(console, _row_table(self.name, columns, list(rows)))
        if self.targets:
            self._print_whole(console, self._target_table())
        drawn = '' if self.seed is None else f'seed {self.seed}   '
        console.print(f'{drawn}commit {self.commit}   {self.machine}',
                      highlight=False, markup=False)

    def _print_whole(self, console, table):
        """A cut number is worse than a wrapped line: tables are as wide as they need to be."""
        needed = Measurement.get(console, console.options.update(max_width=10_000), table).maximum
        console.print(table, width=max(needed, console.width), crop=False, no_wrap=True)

    def _target_table(self):
        table = Table(title='targets', title_justify='left')
        for name in ('name', 'value', 'unit', 'goal', 'met'):
            table.add_column(name, justify='right' if name == 'value' else 'left')
        for goal in self.targets:
            colour = {True: 'green', False: 'red', None: 'yellow'}[goal.met]
            table.add_row(escape(goal.name), cell_text(goal.value), goal.unit, goal.goal,
                          f'[{colour}]{cell_text(goal.met)}[/{colour}]')
        return table


def _row_table(title, columns, rows):
    body = Table(title=title, title_justify='left')
    for name in columns:
        numeric = any(_is_number(row.get(name)) for row in rows)
        body.add_column(name, justify='right' if numeric else 'left')
    for row in rows:
        body.add_row(*[escape(cell_text(row.get(name))) for name in columns])
    return body


def cell_text(value):
    """A table cell as text: four significant digits, 'yes' and 'no', '-' for what is unknown."""
    if value is None:
        return '-'
    if isinstance(value, (bool, np.bool_)):
        return 'yes' if value else 'no'
    if isinstance(value, (float, np.floating)):
        return f'{value:.4g}' if math.isfinite(value) else '-'
    return str(value)


def machine_description():
    """Cores usable by this process, processor model, Python and operating system, in one line."""
    cores = len(os.sched_getaffinity(0))
    plural = 's' if cores != 1 else ''
    return (f'{cores} core{plural}, {_cpu_model()}, Python {platform.python_version()}, '
            f'{platform.system()} {platform.machine()}')


def commit_of(root):
    """The commit the code at folder `root` comes from.

    The commit recorded at build time if this is an installed copy, else
    `git describe --always --dirty` in `root`, else 'unknown' (no git, no commit yet).
    """
    recorded = resources.files('arm_brachy') / COMMIT_FILE
    if recorded.is_file():
        return recorded.read_text(encoding='utf-8').strip()
    try:
        answer = subprocess.run(['git', '-C', str(root), 'describe', '--always', '--dirty'],
                                capture_output=True, text=True, check=True, timeout=10)
    except (FileNotFoundError, subprocess.CalledProcessError, subprocess.TimeoutExpired):
        return UNKNOWN
    return answer.stdout.strip()


def _cpu_model():
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except FileNotFoundError:
        return platform.processor() or 'unknown processor'
    named = [line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')]
    return named[0] if named else 'unknown processor'


def _is_number(value):
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def _plain(value):
    """numpy -> Python; what JSON cannot hold (NaN, infinity) -> None."""
    if isinstance(value, dict):
        return {str(key): _plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
