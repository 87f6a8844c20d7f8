"""The layers of the package, as data, and the imports held to them."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent / 'arm_brachy'

# A part may import itself and what stands in its row; nothing imports nodes.
NUMERICAL = {
    'core': set(),
    'tissue': {'core'},
    'devices': {'core'},
    'recording': {'core'},
    'evaluation': {'core', 'viewing'},
    'control': {'core', 'tissue'},
    'estimation': {'core', 'tissue'},
    'robot': {'core'},
    'viewing': {'core', 'robot'},
    'registry': {'core', 'tissue', 'devices'},
}
# Of these, each may import all numerical parts and whatever stands before it.
COMPOSITION = (
    'scenario', 'provenance', 'graph', 'cell', 'offline_procedure', 'offline', 'inprocess_log',
    'inprocess_probe', 'inprocess', 'diagnosis', 'evaluate', 'view', 'launcher', 'experiments',
    'prove', 'cli', '__main__',
)
ALLOWED = {
    '__init__': set(),
    **NUMERICAL,
    **{name: {*NUMERICAL, *COMPOSITION[:i]} for i, name in enumerate(COMPOSITION)},
    'nodes': {*NUMERICAL, 'scenario', 'provenance', 'graph', 'cell', 'diagnosis'},
}

# Sub-packages and modules of the diagnosis, low to high: each may import what stands before it.
DIAGNOSIS = ('progress', 'forked', 'settings', 'statistics', 'signals', 'results', 'isolation',
             'model', 'likelihood', 'estimation', 'selection', 'experiment_design', 'report',
             'stages', 'free_vibration', 'monitoring', 'residual_monitor', 'pipeline', 'bags',
             'partial')

# Each heavy package, and ROS, has its home; the generators of the trial and of a laboratory have
# solvers of their own.
HOMES = {
    'rclpy': {'nodes'},
    'arm_brachy_msgs': {'nodes'},
    'osqp': {'control'},
    'torch': {'estimation'},
    'pybullet': {'robot'},
    'cv2': {'devices'},
    'threadpoolctl': {'diagnosis'},
    'mcap': {'recording'},
    'mcap_ros2': {'recording'},
    'rosbags': {'recording', 'experiments'},   # there the second readers
    'ezc3d': {'recording', 'experiments'},
    'pypardiso': {'tissue', 'prove', 'experiments'},
}

TREES = {path: ast.parse(path.read_text(encoding='utf-8')) for path in PACKAGE.rglob('*.py')}


def part(path):
    """Sub-package, or top-level module, that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix('.py')


def imports(tree):
    """Names imported, in full: `from a import b` gives a and a.b; a relative import gives '.'."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level:
            yield '.'
        elif isinstance(node, ast.ImportFrom):
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def forbidden(importer, tree, parts):
    """Imports in `tree`, a file of part `importer`, that the two tables do not allow."""
    for name in imports(tree):
        head, _, rest = name.partition('.')
        used = rest.split('.')[0]
        if head == 'arm_brachy' and used in parts and used not in {*ALLOWED[importer], importer}:
            yield name
        elif importer not in HOMES.get(head, {importer}) or name == '.':
            yield name


def hidden_imports(tree):
    """Lines of imports inside functions."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from (node.lineno for node in ast.walk(function)
                        if isinstance(node, ast.Import | ast.ImportFrom))


def offenders(check):
    """{file: findings} over the files that have a row, for those with any."""
    found = {str(path.relative_to(PACKAGE)): sorted(set(check(path, tree)))
             for path, tree in TREES.items() if part(path) in ALLOWED}
    return {name: findings for name, findings in found.items() if findings}


def test_every_part_has_a_row_in_the_layer_table():
    assert {part(path) for path in TREES} - ALLOWED.keys() == set()


def test_imports_point_one_way_and_heavy_packages_stay_at_home():
    assert not offenders(lambda path, tree: forbidden(part(path), tree, ALLOWED.keys()))


def test_the_diagnosis_is_layered():
    home, rank = PACKAGE / 'diagnosis', {name: i for i, name in enumerate(DIAGNOSIS)}
    wrong = []
    for path in home.rglob('*.py'):
        name = path.relative_to(home).parts[0].removesuffix('.py')
        if name == '__init__':
            continue
        for used in imports(TREES[path]):
            above = used.removeprefix('arm_brachy.diagnosis.').split('.')[0]
            if used.startswith('arm_brachy.diagnosis.') and rank[above] > rank[name]:
                wrong.append((str(path.relative_to(home)), used))
    assert not wrong


def test_nothing_is_imported_inside_a_function():
    assert not offenders(lambda path, tree: hidden_imports(tree))


def test_no_module_imports_itself_by_a_detour():
    names = {path: '.'.join(('arm_brachy', *path.relative_to(PACKAGE).with_suffix('').parts))
             .removesuffix('.__init__') for path in TREES}
    graph = {names[path]: set(imports(tree)) & set(names.values())
             for path, tree in TREES.items()}
    while leaves := {name for name, used in graph.items() if not used}:
        graph = {name: used - leaves for name, used in graph.items() if name not in leaves}
    assert not graph, f'on or behind a cycle: {sorted(graph)}'


def test_the_checks_see_a_wrong_way_import():
    tree = ast.parse('from arm_brachy import cell\nimport rclpy.node\nfrom . import x\n'
                     'from arm_brachy.core import units\ndef f():\n    import json\n')
    assert set(forbidden('tissue', tree, ALLOWED.keys())) == {'arm_brachy.cell', 'rclpy.node', '.'}
    assert list(hidden_imports(tree)) == [6]
