"""From tables, facts and figures to one HTML page that needs no other file."""

import math
from dataclasses import dataclass
from pathlib import Path

import jinja2

ENVIRONMENT = jinja2.Environment(
    loader=jinja2.PackageLoader('arm_brachy.evaluation', 'templates'), autoescape=True,
    undefined=jinja2.StrictUndefined, trim_blocks=False, lstrip_blocks=True,
    keep_trailing_newline=True)


@dataclass(frozen=True)
class Verdict:
    """The line read first.

    mood : 'good', 'bad', 'open' (cannot be judged, or no goal set) or '' (was not judged)
    """

    mood: str
    line: str
    detail: str = ''


@dataclass(frozen=True)
class Fact:
    """One of the few numbers shown large."""

    label: str
    value: str
    unit: str = ''


@dataclass(frozen=True)
class Column:
    """A column of a table; the unit stands under the title."""

    title: str
    unit: str = ''
    numeric: bool = True


@dataclass(frozen=True)
class Cell:
    """A cell; mood '' or as for Verdict."""

    text: str
    mood: str = ''


@dataclass(frozen=True)
class Grid:
    """A table: columns, rows of Cell, and a note below it."""

    columns: tuple = ()
    rows: tuple = ()
    note: str = ''


@dataclass(frozen=True)
class Picture:
    """A figure as the template wants it."""

    uri: str
    caption: str


def number(value, digits=2):
    """A number with fixed decimals and a proper minus sign; an en dash for what is unknown."""
    if value is None or not math.isfinite(value):
        return '–'
    return f'{value:z.{digits}f}'.replace('-', '−')


def pictures(plates):
    """Embed style.Plate figures, in order."""
    return tuple(Picture(plate.data_uri(), plate.caption) for plate in plates)


def provenance(source):
    """Seed, commit, machine and date of a RunData or ResidualData, as (name, text) pairs."""
    pairs = [('Seed', str(source.seed)), ('Commit', source.commit), ('Machine', source.machine),
             ('Recorded', getattr(source, 'recorded_at', '')),
             ('Source', getattr(source, 'source', ''))]
    return tuple((name, text) for name, text in pairs if text)


def write_page(template, path, **content):
    """Fill `template` and write it to `path`; Returns the path."""
    path = Path(path)
    path.write_text(ENVIRONMENT.get_template(template).render(**content), encoding='utf-8')
    return path
