"""The documentation: one strict build, and every internal link of README and site alive."""

import ast
import importlib
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from arm_brachy.cli import COMMANDS
from arm_brachy.cli.tables import FILES
from arm_brachy.core.config import key_rows

ROOT = Path(__file__).parents[1]
WRITTEN = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]
LINES = 150     # of README
FENCED = re.compile(r'^```.*?^```', re.DOTALL | re.MULTILINE)
PYTHON = re.compile(r'^```python\n(.*?)^```', re.DOTALL | re.MULTILINE)
LINK = re.compile(r'\]\(([^)\s]+)\)')


class Page(HTMLParser):
    """Anchors of a page, and where its links and pictures lead."""

    def __init__(self, path):
        super().__init__()
        self.anchors, self.links = set(), []
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors |= {given[key] for key in ('id', 'name') if given.get(key)}
        self.links += [(tag, given[key]) for key in ('href', 'src') if given.get(key)]


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """The folder of a strict build: a warning, such as a dead link, ends it."""
    folder = tmp_path_factory.mktemp('site')
    done = subprocess.run([sys.executable, '-m', 'mkdocs', 'build', '--strict',
                           '--site-dir', folder], cwd=ROOT, text=True, capture_output=True,
                          timeout=600, check=False,
                          env={**os.environ, 'NO_MKDOCS_2_WARNING': '1'})
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope='module')
def pages(site):
    return {path: Page(path) for path in site.rglob('*.html') if path.name != '404.html'}


def test_every_internal_link_of_the_site_leads_somewhere(pages):
    dead = []
    for path, page in pages.items():
        for _, link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            there = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            there = there / 'index.html' if there.is_dir() else there
            anchors = pages[there].anchors if there in pages else ()
            if not there.is_file() or (there in pages and parts.fragment
                                       and unquote(parts.fragment) not in anchors):
                dead.append(f'{path.name}: {link}')
    assert len(pages) > 30 and not dead


def test_a_reader_loads_nothing_from_elsewhere(pages):
    assert not [(path.name, link) for path, page in pages.items() for tag, link in page.links
                if tag in ('link', 'script', 'img') and urlsplit(link).netloc]


@pytest.mark.parametrize('name', FILES)
def test_every_key_is_on_the_page_of_keys(site, name):
    text = (site / 'reference' / 'keys.html').read_text(encoding='utf-8')
    assert not [key for key, *_ in key_rows(FILES[name]) if f'<code>{key}</code>' not in text]


def test_pages_beside_the_code_are_in_the_site(site):
    for page in ('arm_brachy/diagnosis/README.html', 'CONVENTIONS.html', 'CHANGELOG.html',
                 'results/trials/README.html', 'index.html'):
        assert (site / page).is_file() or (site / page.replace('README', 'index')).is_file()


@pytest.mark.parametrize('path', WRITTEN, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_are_files_for_a_reader_of_the_repository(path):
    """As GitHub and an editor follow them, before any site is built."""
    text = FENCED.sub('', path.read_text(encoding='utf-8'))
    local = [link.partition('#')[0] for link in LINK.findall(text) if '://' not in link]
    assert not [link for link in local if link and not (path.parent / link).is_file()]


def test_what_blocks_of_python_import_is_there():
    """Blocks that are files are run elsewhere; of the others at least the names are right."""
    wanted = {(node.module, alias.name) for path in WRITTEN
              for block in PYTHON.findall(path.read_text(encoding='utf-8'))
              if not block.startswith('# ')
              for node in ast.walk(ast.parse(block)) if isinstance(node, ast.ImportFrom)
              and node.module.startswith('arm_brachy.') for alias in node.names}
    assert ('arm_brachy.diagnosis.bags', 'diagnose_bags') in wanted
    assert [f'{module}.{name}' for module, name in sorted(wanted)
            if not hasattr(importlib.import_module(module), name)] == []


def test_readme_is_short():
    assert len((ROOT / 'README.md').read_text(encoding='utf-8').splitlines()) <= LINES


def test_every_command_has_its_line():
    text = (ROOT / 'docs' / 'reference' / 'commands.md').read_text(encoding='utf-8')
    assert not [name for name in COMMANDS if f'`arm-brachy {name}' not in text]
