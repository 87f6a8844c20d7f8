"""Scores of the inside's estimators on disk, valid while none of what made them has changed.

A job of a table takes minutes and a table hours: a run that was ended goes on where it was, and
one estimator that was changed does not ask for all others again. The key of a job is a hash of
the sources of its estimator and of all of the package that these import, of the files that they
read, and of the plant.
Test: experiments/test_kept_scores.py
"""

import ast
import hashlib
from dataclasses import astuple, fields
from functools import lru_cache
from pathlib import Path

import numpy as np

import arm_brachy
from arm_brachy.core.paths import config_dir

PACKAGE = Path(arm_brachy.__file__).parent
DATA = ('.npz', '.msh', '.yaml')    # suffixes of files that estimators and plants are made of


def sources(module):
    """Paths of a module of the package and of all of the package that it imports, in order."""
    found, ahead = {}, [module]
    while ahead:
        name = ahead.pop()
        path = _path(name)
        if path is None or path in found:
            continue
        found[path] = None
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                ahead += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                ahead += [node.module, *(f'{node.module}.{a.name}' for a in node.names)]
    return sorted(found)


def _path(name):
    """File of a module `arm_brachy...`; None for others, and for names that are no module."""
    if not name.startswith(f'{PACKAGE.name}.'):
        return None
    place = PACKAGE.joinpath(*name.split('.')[1:])
    for path in (place.with_suffix('.py'), place / '__init__.py'):
        if path.is_file():
            return path
    return None


def key(modules, *more):
    """Hash of the sources behind modules (names), of data beside them and of scenes, and of more.

    more : anything whose repr says all of it
    """
    said = hashlib.sha256(repr(more).encode())
    said.update(_behind(tuple(modules), PACKAGE))
    return said.hexdigest()[:16]


@lru_cache
def _behind(modules, package):
    """Digest of the files behind modules of a package: read once in a process."""
    said = hashlib.sha256()
    paths = {path for module in modules for path in sources(module)}
    for folder in sorted({path.parent for path in paths} - {package}):
        paths |= {path for path in folder.rglob('*') if path.suffix in DATA}
    paths |= {path for path in (config_dir() / 'scenes').rglob('breast*') if path.suffix in DATA}
    for path in sorted(paths):
        said.update(path.name.encode() + b'\0' + path.read_bytes())
    return said.digest()


def read(path, kind):
    """The dataclass `kind` of arrays at a path; None if it is not there."""
    if not path.is_file():
        return None
    with np.load(path) as file:
        return kind(*(file[one.name] for one in fields(kind)))


def write(path, scores):
    """Keep a dataclass of arrays at a path; it is there whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix('.part.npz')
    np.savez_compressed(part, **dict(zip((one.name for one in fields(scores)), astuple(scores),
                                         strict=True)))
    part.replace(path)
