"""The generator shares nothing with what is to be tested by it."""

import ast
from pathlib import Path

from arm_brachy.experiments import half_cylinder

FOREIGN = ('arm_brachy.tissue', 'arm_brachy.devices', 'arm_brachy.prove',
           'arm_brachy.experiments.gel_block')


def test_no_module_imports_the_tissue_or_the_devices():
    for path in Path(half_cylinder.__file__).parent.glob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ImportFrom):
                assert not node.module.startswith(FOREIGN), (path.name, node.module)
