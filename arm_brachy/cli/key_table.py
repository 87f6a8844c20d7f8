"""The keys of a file as a table for the eye: one part of the file after another."""

from rich import box
from rich.markup import escape
from rich.table import Table

WIDE = 110      # columns, of a file or a pipe: as wide as a page of a listing


def key_table(rows, meaning, room):
    """A rich Table of the rows of core.config.key_rows: key, default, allowed, meaning.

    meaning : heading of the last column;  room : columns that there are
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), width=min(WIDE, room))
    table.add_column('key', no_wrap=True)
    table.add_column('default', width=12, overflow='fold')
    table.add_column('allowed', ratio=1)
    table.add_column(meaning, ratio=2)
    part, begun = '', set()
    for key, default, allowed, text in rows:
        *parts, name = key.split('.')
        if '.'.join(parts) != part:
            part = '.'.join(parts)
            table.add_section()
            if parts:
                table.add_row(f'[bold]{escape(_heading(parts))}[/bold]')
        table.add_row(escape(_indented(key, name, parts, begun)),
                      *map(escape, (default, allowed, text)))
    return table


def _heading(parts):
    """`pads[]` -> `pads:`, `encoders[].csv` -> `encoders: csv:`."""
    return ' '.join(f'{part.removesuffix("[]")}:' for part in parts)


def _indented(key, name, parts, begun):
    """The name under its part; the first of a list's item is marked as in YAML."""
    if not parts:
        return name
    item = parts[-1].endswith('[]') and tuple(parts) not in begun
    begun.add(tuple(parts))
    return ('- ' if item else '  ') + name
