"""cell.launch.py starts the same processes as `arm-brachy run`; `launch` is stood in for."""

import importlib.util
import sys
import types
from pathlib import Path

import pytest

from arm_brachy import graph
from arm_brachy.launcher import RECORDER_PATIENCE_S, cell_processes, node_environment
from arm_brachy.scenario import load_cell

ROOT = Path(__file__).resolve().parent.parent
SCENARIO = ROOT / 'config' / 'scenarios' / 'target_1.yaml'
PROBE = SCENARIO.with_name('probe_poor.yaml')


class Recorded:
    """Stands for any class of launch: remembers how it was made."""

    def __init__(self, *args, **kwargs):
        self.args, self.kwargs = args, kwargs

    def perform(self, context):
        return context[self.args[0]]


@pytest.fixture
def launch_file(monkeypatch):
    """The module, on stand-ins that only remember their arguments."""
    names = {'launch': ['LaunchDescription'],
             'launch.actions': ['DeclareLaunchArgument', 'EmitEvent', 'OpaqueFunction',
                                'RegisterEventHandler'],
             'launch.event_handlers': ['OnProcessExit'], 'launch.events': ['Shutdown'],
             'launch.substitutions': ['LaunchConfiguration'], 'launch_ros': [],
             'launch_ros.actions': ['Node']}
    for name, classes in names.items():
        module = types.ModuleType(name)
        for cls in classes:
            setattr(module, cls, type(cls, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location(
        'cell_launch', ROOT / 'launch_scripts' / 'cell.launch.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_starts_every_node_with_the_parameters_of_the_command(launch_file, tmp_path):
    description = launch_file.generate_launch_description()
    *arguments, action = description.args[0]
    assert [a.args[0] for a in arguments] == ['scenario', 'bag']
    context = {'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag')}
    made = action.kwargs['function'](context)
    nodes = [m for m in made if type(m).__name__ == 'Node']
    wanted = cell_processes(load_cell(SCENARIO), str(SCENARIO), str(tmp_path / 'bag'))
    assert [(n.kwargs['executable'], n.kwargs['parameters'][-1]) for n in nodes] \
        == [(p.name, p.parameters) for p in wanted]
    assert {n.kwargs['executable'] for n in nodes} == set(graph.CELL)
    assert all(n.kwargs['package'] == 'arm_brachy' for n in nodes)


def test_a_scenario_with_moves_starts_the_push_protocol(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(PROBE), 'bag': str(tmp_path / 'bag')})
    nodes = {m.kwargs['name']: m for m in made if type(m).__name__ == 'Node'}
    assert set(nodes) == set(graph.PROBING_CELL)
    assert nodes['push_protocol'].kwargs['parameters'][-1]['peers'] == list(graph.PROBING_CELL)


def test_nodes_run_and_close_as_under_the_command(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag')})
    nodes = {m.kwargs['name']: m.kwargs for m in made if type(m).__name__ == 'Node'}
    assert all(n['additional_env'] == node_environment() for n in nodes.values())
    assert node_environment()['OMP_NUM_THREADS'] == '1'
    assert float(nodes['recorder']['sigterm_timeout']) == RECORDER_PATIENCE_S


def test_the_end_of_any_node_ends_the_launch(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag')})
    handlers = [m for m in made if type(m).__name__ == 'RegisterEventHandler']
    watched = [h.args[0].kwargs['target_action'] for h in handlers]
    assert watched == [m for m in made if type(m).__name__ == 'Node']
