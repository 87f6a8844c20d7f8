"""The generator shares no code with what it tests."""
import ast
import sys
from pathlib import Path

from arm_brachy.prove import generator

OWN = 'arm_brachy.prove.generator'
OTHERS = {'numpy', 'scipy', 'skfem', 'pypardiso', 'numba'}


def imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield '.' * node.level + (node.module or '')


def test_it_imports_nothing_but_itself_and_public_libraries():
    files = sorted(Path(generator.__file__).parent.glob('**/*.py'))
    assert len(files) > 20
    for path in files:
        for name in imported(path):
            allowed = name == OWN or name.startswith(OWN + '.') or (
                name.split('.')[0] in OTHERS | sys.stdlib_module_names)
            assert allowed, f'{path.name} imports {name}'
