"""cell.launch.py starts the same processes as `arm-brachy run`; `launch` is stood in for."""

import importlib.util
import re
import sys
import types
from pathlib import Path
from xml.etree import ElementTree

import pytest

from arm_brachy import graph, launcher
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.launcher import RECORDER_PATIENCE_S, cell_processes, node_environment
from arm_brachy.scenario import load_cell

ROOT = Path(__file__).resolve().parent.parent
SCENARIO = ROOT / 'config' / 'scenarios' / 'target_1.yaml'
DOMAIN = '98'
DEFAULTS = {'namespace': '', 'speed_limit': '0', 'watch': 'false', 'log_level': 'info'}
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
    monkeypatch.setenv('ROS_DOMAIN_ID', DOMAIN)
    monkeypatch.delenv(launcher.DISCOVERY, raising=False)
    names = {'launch': ['LaunchDescription'],
             'launch.actions': ['DeclareLaunchArgument', 'EmitEvent', 'LogInfo',
                                'OpaqueFunction', 'RegisterEventHandler'],
             'launch.event_handlers': ['OnProcessExit', 'OnShutdown'],
             'launch.events': ['Shutdown'],
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
    assert [a.args[0] for a in arguments] == ['scenario', 'bag', *DEFAULTS]
    assert {a.args[0]: a.kwargs['default_value'] for a in arguments[2:]} == DEFAULTS
    context = {'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag'), **DEFAULTS}
    made = action.kwargs['function'](context)
    nodes = [m for m in made if type(m).__name__ == 'Node']
    wanted = cell_processes(load_cell(SCENARIO), str(SCENARIO), str(tmp_path / 'bag'))
    assert [(n.kwargs['executable'], n.kwargs['parameters'][-1]) for n in nodes] \
        == [(p.name, p.parameters) for p in wanted]
    assert {n.kwargs['executable'] for n in nodes} == set(graph.CELL)
    assert all(n.kwargs['package'] == 'arm_brachy' for n in nodes)


def test_a_scenario_with_moves_starts_the_push_protocol(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(PROBE), 'bag': str(tmp_path / 'bag'),
                                      **DEFAULTS})
    nodes = {m.kwargs['name']: m for m in made if type(m).__name__ == 'Node'}
    assert set(nodes) == set(graph.PROBING_CELL)
    assert nodes['push_protocol'].kwargs['parameters'][-1]['peers'] == list(graph.PROBING_CELL)


def test_nodes_run_and_close_as_under_the_command(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag'),
                                      **DEFAULTS})
    nodes = {m.kwargs['name']: m.kwargs for m in made if type(m).__name__ == 'Node'}
    assert all(n['additional_env'] == node_environment() for n in nodes.values())
    assert node_environment()['OMP_NUM_THREADS'] == '1'
    assert float(nodes['recorder']['sigterm_timeout']) == RECORDER_PATIENCE_S


def test_the_end_of_any_node_ends_the_launch(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag'),
                                      **DEFAULTS})
    handlers = [m for m in made if type(m).__name__ == 'RegisterEventHandler']
    ends = [h.args[0].kwargs for h in handlers if type(h.args[0]).__name__ == 'OnProcessExit']
    assert [e['target_action'] for e in ends] == [m for m in made if type(m).__name__ == 'Node']
    event, running = types.SimpleNamespace(returncode=0), types.SimpleNamespace(is_shutdown=False)
    (action,) = ends[0]['on_exit'](event, running)
    assert str(tmp_path / 'bag') in action.kwargs['event'].kwargs['reason']


def test_a_node_that_dies_fails_the_launch_and_says_where_the_bag_is(launch_file, tmp_path):
    """An exception of a handler is what makes `ros2 launch` end with status 1."""
    handle = launch_file._ended('em_tracker', tmp_path / 'bag')
    dead = types.SimpleNamespace(returncode=-9)
    with pytest.raises(ArmBrachyError, match='em_tracker ended with status -9.*arm-brachy recov'):
        handle(dead, types.SimpleNamespace(is_shutdown=False))
    assert handle(dead, types.SimpleNamespace(is_shutdown=True))    # it was asked to end


def test_a_namespace_moves_every_node(launch_file, tmp_path):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag'),
                                      **DEFAULTS, 'namespace': '/left/'})
    assert {m.kwargs['namespace'] for m in made if type(m).__name__ == 'Node'} == {'left'}
    assert not [t for t in graph.TOPICS if t.name.startswith('/')]
    assert launcher.NodeProcess('recorder', {}, 'left').argv()[-2:] == ['-r', '__ns:=/left']


def test_the_bag_of_another_run_is_refused_and_its_key_stays(launch_file, tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag.key').write_text('of a cell that is running')
    action = launch_file.generate_launch_description().args[0][-1]
    with pytest.raises(ArmBrachyError, match='exists; a recording is never overwritten'):
        action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag'),
                                   **DEFAULTS})
    assert (tmp_path / 'bag.key').read_text() == 'of a cell that is running'


def test_domain_and_key_are_made_and_named(launch_file, tmp_path, monkeypatch):
    action = launch_file.generate_launch_description().args[0][-1]
    made = action.kwargs['function']({'scenario': str(SCENARIO), 'bag': str(tmp_path / 'bag'),
                                      **DEFAULTS})
    said = next(m for m in made if type(m).__name__ == 'LogInfo').kwargs['msg']
    key = tmp_path / 'bag.key'
    assert f'DDS domain {DOMAIN}, discovery LOCALHOST' in said and str(key) in said
    assert key.stat().st_mode & 0o777 == 0o600
    (end,) = [m.args[0] for m in made if type(m).__name__ == 'RegisterEventHandler'
              and type(m.args[0]).__name__ == 'OnShutdown']
    end.kwargs['on_shutdown'](None, None)
    assert not key.exists()


def test_package_xml_names_every_ros_package_that_is_imported():
    """launch files, too; what has no rosdep key is in requirements.txt."""
    declared = {e.text for e in ElementTree.parse(ROOT / 'package.xml').iter('exec_depend')}
    sources = [*(ROOT / 'arm_brachy').rglob('*.py'), *(ROOT / 'launch_scripts').glob('*.py')]
    imported = {name for path in sources for name in re.findall(
        r'^ *(?:from|import) (rclpy|launch\w*|rosidl_\w+|\w+_(?:msgs|srvs|interfaces))\b',
        path.read_text(encoding='utf-8'), re.MULTILINE)}
    assert len(imported) > 8 and imported <= declared, imported - declared


def test_a_domain_in_use_is_refused(monkeypatch):
    monkeypatch.setattr(launcher, '_claimed', {})
    with launcher._lock('97') as lock:
        assert lock
        with pytest.raises(ArmBrachyError, match='97 is in use by another cell'):
            launcher.claim_domain('97')
    assert launcher.claim_domain('97') == launcher.claim_domain('97') == '97'
