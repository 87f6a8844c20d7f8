"""The keys of a file as a person reads them: no Python, no Markdown, nothing cut."""

import re

import pytest
from rich.console import Console

from arm_brachy.cli.key_table import key_table
from arm_brachy.cli.tables import FILES
from arm_brachy.core.config import key_rows


def printed(kind, room):
    console = Console(width=room)
    with console.capture() as captured:
        console.print(key_table(key_rows(FILES[kind]), 'meaning', room))
    return captured.get()


PYTHON = re.compile(r'\b(tuple|dict|str|int|bool|None|NoneType|True|False)\b|\(\)')


@pytest.mark.parametrize('kind', FILES)
@pytest.mark.parametrize('room', [80, 1000])
def test_no_markdown_and_it_fits(kind, room):
    text = printed(kind, room)
    assert '|' not in text and max(map(len, text.splitlines())) <= min(room, 110)


@pytest.mark.parametrize('kind', FILES)
def test_defaults_and_types_are_in_words(kind):
    assert not [row for row in key_rows(FILES[kind]) if PYTHON.search(' '.join(row[1:3]))]


@pytest.mark.parametrize('kind', FILES)
def test_every_key_is_there_under_its_part(kind):
    lines = printed(kind, 1000).splitlines()
    for key, *_ in key_rows(FILES[kind]):
        *parts, name = key.split('.')
        heading = ' '.join(f'{part.removesuffix("[]")}:' for part in parts)
        ends = [i for i, line in enumerate(lines) if line.strip() == heading] if parts else [0]
        assert any(re.match(rf' *(- )?{name}\s', line) for i in ends for line in lines[i:])


def test_items_of_lists_begin_with_a_dash_and_defaults_are_as_in_yaml():
    text = printed('columns', 1000)
    assert re.search(r'optical: *\n - columns', text) and re.search(r'optional +false', text)
    assert '[x, y, z]' in text and 'mapping of text to text' in text
