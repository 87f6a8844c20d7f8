"""MkDocs hook: pages that live beside the code join the site, links lead to them, keys are listed.

A page in docs/ links into the repository as GitHub reads it (`../results/x.png`). The site has the
repository's layout with docs/ as its root: README.md is its front page, every other file that a
page links to is copied to its path in the repository. `<!-- keys: FILE -->` becomes the table of
the keys of that file.
Test: test_docs.py
"""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

from arm_brachy.experiments import reference_tables

ROOT = Path(__file__).resolve().parents[1]
DOCS = 'docs/'
FRONT = {'README.md': 'index.md'}
SKIPPED = ('.venv', 'build', 'docs', 'install', 'log', 'runs', 'site')
FENCED = re.compile(r'(^```.*?^```)', re.DOTALL | re.MULTILINE)
KEYS = re.compile(r'<!-- keys: (\w+) -->')
LINK = re.compile(r'(?<=\]\()([^)\s:#]+)(#[^)\s]*)?(?=\))')


def beside_the_code():
    """Paths in the repository of all Markdown files outside docs/, README.md first."""
    paths = (p.relative_to(ROOT) for p in ROOT.rglob('*.md'))
    return sorted((p.as_posix() for p in paths
                   if not p.parts[0].startswith('.') and p.parts[0] not in SKIPPED),
                  key=lambda name: name not in FRONT)


def place(name):
    """Path in the site of a path in the repository."""
    return FRONT.get(name, name.removeprefix(DOCS))


def source(uri):
    """Path in the repository of a page of the site."""
    fronts = {there: here for here, there in FRONT.items()}
    return fronts.get(uri, uri if not (ROOT / DOCS / uri).is_file() else DOCS + uri)


def targets(name, text):
    """Paths in the repository, outside docs/, of files that a page links to."""
    for part in FENCED.split(text)[::2]:
        for match in LINK.finditer(part):
            path = posixpath.normpath(posixpath.join(posixpath.dirname(name), match[1]))
            if not path.startswith(('..', DOCS)) and (ROOT / path).is_file():
                yield path


def on_files(files, config):
    """Add the Markdown beside the code, and every file that any page links to."""
    pages = {name: ROOT / name for name in beside_the_code()}
    pages |= {source(f.src_uri): Path(f.abs_src_path) for f in files.documentation_pages()}
    linked = [path for name, file in pages.items()
              for path in targets(name, file.read_text(encoding='utf-8'))]
    for name in dict.fromkeys([*beside_the_code(), *linked]):
        if files.get_file_from_path(place(name)) is None:
            files.append(File.generated(config, place(name), abs_src_path=str(ROOT / name)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turn links of the repository into links of the site; fill in tables of keys."""
    name = source(page.file.src_uri)

    def turned(match):
        path = posixpath.normpath(posixpath.join(posixpath.dirname(name), match[1]))
        start = posixpath.dirname(page.file.src_uri) or '.'
        return posixpath.relpath(place(path), start) + (match[2] or '')

    markdown = KEYS.sub(lambda match: reference_tables.keys(match[1]), markdown)
    parts = FENCED.split(markdown)
    parts[::2] = [LINK.sub(turned, part) for part in parts[::2]]
    return ''.join(parts)
