"""The set-up: steps and stamps of bootstrap.py, and what it leaves in the environment."""

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
IN_VENV = Path(sys.prefix) == ROOT / '.venv'
needs_venv = pytest.mark.skipif(not IN_VENV, reason='runs in the environment of `make setup` only')

# Type hash of tf2_msgs/msg/TFMessage in ROS 2 Jazzy, as `ros2 topic info --verbose /tf` prints it.
TF_MESSAGE_HASH = 'RIHS01_e369d0f05a23ae52'


@pytest.fixture
def bootstrap(tmp_path, monkeypatch):
    """bootstrap.py at work in an empty folder, with two steps that only record that they ran."""
    source = ROOT / 'launch_scripts' / 'bootstrap.py'
    spec = importlib.util.spec_from_file_location('bootstrap', source)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    venv = tmp_path / '.venv'
    (venv / 'bin').mkdir(parents=True)
    (venv / 'bin' / 'pip').touch()
    (venv / 'pyvenv.cfg').write_text(f'command = python3.11 -m venv {venv}\n')
    for name in ('first', 'second'):
        (tmp_path / name).write_text('1')
    module.ran = []
    steps = (('A', ('first',), lambda: module.ran.append('A')),
             ('B', ('second',), lambda: module.ran.append('B')))
    for name, value in {'ROOT': tmp_path, 'VENV': venv, 'STEPS': steps,
                        'STAMP': venv / 'stamp', 'LOG': venv / 'log'}.items():
        monkeypatch.setattr(module, name, value)
    return module


def test_a_second_call_does_nothing(bootstrap, capsys):
    assert bootstrap.main() == 0
    capsys.readouterr()
    assert bootstrap.main() == 0
    assert bootstrap.ran == ['A', 'B']
    assert capsys.readouterr() == ('', '')


@pytest.mark.parametrize('changed, again', [('first', ['A', 'B']), ('second', ['B'])])
def test_a_changed_input_repeats_its_step_and_those_after(bootstrap, tmp_path, changed, again):
    bootstrap.main()
    bootstrap.ran.clear()
    (tmp_path / changed).write_text('2')
    bootstrap.main()
    assert bootstrap.ran == again


def failing(bootstrap):
    """Step B, whose command fails."""
    return 'B', ('second',), lambda: bootstrap.run(sys.executable, '-c', 'raise OSError(28)')


def test_a_failed_step_leaves_no_stamp_and_is_resumed(bootstrap, monkeypatch, capsys):
    fine = bootstrap.STEPS
    monkeypatch.setattr(bootstrap, 'STEPS', (fine[0], failing(bootstrap)))
    assert bootstrap.main() == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'OSError: 28' in error and str(bootstrap.LOG) in error
    assert bootstrap.read_stamp()['B'] is None
    monkeypatch.setattr(bootstrap, 'STEPS', fine)
    assert bootstrap.main() == 0
    assert bootstrap.ran == ['A', 'B']


def test_a_failed_step_is_repeated_though_its_input_went_back(bootstrap, monkeypatch, tmp_path):
    bootstrap.main()
    fine = bootstrap.STEPS
    (tmp_path / 'second').write_text('2')
    monkeypatch.setattr(bootstrap, 'STEPS', (fine[0], failing(bootstrap)))
    assert bootstrap.main() == 2
    (tmp_path / 'second').write_text('1')
    monkeypatch.setattr(bootstrap, 'STEPS', fine)
    assert bootstrap.main() == 0
    assert bootstrap.ran == ['A', 'B', 'B']


def test_a_moved_environment_is_not_trusted(bootstrap):
    bootstrap.main()
    (bootstrap.VENV / 'pyvenv.cfg').write_text('command = python3.11 -m venv /elsewhere/.venv\n')
    assert bootstrap.read_stamp() == {}


def test_uv_finds_packages_where_pip_as_configured_does(bootstrap):
    listed = """:env:.find-links='/media/wheels /srv/wheels'
global.cert='/etc/ssl/ours.pem'
global.extra-index-url='https://a.example/simple\\nhttps://b.example/simple'
global.find-links='/opt/wheels'
global.index-url='https://elsewhere.example/simple'
global.no-cache-dir='true'
install.index-url='https://mirror.example/simple'
"""
    assert bootstrap.pip_settings(listed) == {
        'UV_FIND_LINKS': '/media/wheels,/srv/wheels', 'SSL_CERT_FILE': '/etc/ssl/ours.pem',
        'UV_INDEX': 'https://a.example/simple https://b.example/simple',
        'UV_DEFAULT_INDEX': 'https://mirror.example/simple'}
    assert bootstrap.pip_settings('') == {}


def test_what_is_set_for_uv_goes_before_what_is_set_for_pip(bootstrap, monkeypatch):
    monkeypatch.setattr(bootstrap, 'PYTHON', sys.executable)
    monkeypatch.setenv('PIP_INDEX_URL', 'https://mirror.example/simple')
    assert bootstrap.uv_settings()['UV_DEFAULT_INDEX'] == 'https://mirror.example/simple'
    monkeypatch.setenv('UV_DEFAULT_INDEX', 'https://other.example/simple')
    assert bootstrap.uv_settings()['UV_DEFAULT_INDEX'] == 'https://other.example/simple'


def test_a_package_that_is_not_to_be_had_is_named_with_the_reason(bootstrap, monkeypatch, capsys):
    said = ('error: Failed to fetch: https://mirror.example/simple/numpy/\n'
            '  cause: tcp connect error\n  cause: Connection refused')
    monkeypatch.setattr(bootstrap, 'STEPS', [('A', (), lambda: bootstrap.run(
        sys.executable, '-c', f'import sys; sys.exit({said!r})'))])
    assert bootstrap.main() == 2
    assert ('error: Failed to fetch: https://mirror.example/simple/numpy/; cause: tcp connect '
            'error; cause: Connection refused (all of it') in capsys.readouterr().err


@pytest.mark.parametrize('absent, package', [
    ({'cmake'}, 'cmake'), ({'cc'}, 'build-essential'), ({'c++'}, 'build-essential'),
    ({'ninja', 'make'}, 'ninja-build'), ({'cmake', 'cc', 'c++'}, 'build-essential cmake'),
])
def test_a_missing_tool_is_one_line_naming_its_package(
        bootstrap, monkeypatch, capsys, absent, package):
    monkeypatch.delenv('CC', raising=False)
    monkeypatch.delenv('CXX', raising=False)
    monkeypatch.setattr(bootstrap.shutil, 'which', lambda tool: None if tool in absent else tool)
    assert bootstrap.main() == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and error.endswith(f'sudo apt install {package}\n')
    assert bootstrap.ran == [] and not bootstrap.STAMP.exists()


def test_make_without_ninja_is_enough(bootstrap, monkeypatch):
    monkeypatch.setattr(bootstrap.shutil, 'which', lambda tool: None if tool == 'ninja' else tool)
    assert bootstrap.main() == 0


def test_another_python_is_refused(bootstrap, monkeypatch, capsys):
    monkeypatch.setattr(bootstrap.sys, 'version_info', (3, 12, 3, 'final', 0))
    assert bootstrap.main() == 2
    assert 'python3.11' in capsys.readouterr().err


def test_no_variable_of_another_installation_reaches_a_step(bootstrap, monkeypatch):
    for name in bootstrap.FOREIGN_VARIABLES:
        monkeypatch.setenv(name, '/opt/elsewhere')
    names = repr(bootstrap.FOREIGN_VARIABLES)
    # -S: the environment running this test sets LD_LIBRARY_PATH by a .pth file
    bootstrap.run(sys.executable, '-S', '-c',
                  f'import os, sys; sys.exit(any(name in os.environ for name in {names}))')


def test_a_message_removed_from_the_tree_is_removed_from_the_environment(bootstrap, tmp_path):
    installed = tmp_path / 'Old.msg'
    installed.touch()
    manifest = tmp_path / 'install_manifest.txt'
    manifest.write_text(f'{installed}\n{tmp_path}/gone_already.msg')
    bootstrap.forget_installed(manifest)
    assert not installed.exists()


def test_every_requirement_is_pinned_with_a_reason():
    lines = (ROOT / 'requirements.txt').read_text().splitlines()
    loose = [line for line in lines if line and not line.startswith('#')
             and not re.fullmatch(r'[\w.-]+(\[\w+\])?==[\w.]+ +# .+', line)]
    assert not loose


def node_names():
    """NODES of setup.py, read without running it."""
    for statement in ast.parse((ROOT / 'setup.py').read_text()).body:
        if isinstance(statement, ast.Assign) and statement.targets[0].id == 'NODES':
            return ast.literal_eval(statement.value)
    raise AssertionError('setup.py names no NODES')


def test_setup_py_names_every_module_that_has_a_main():
    trees = {path.stem: ast.parse(path.read_text(encoding='utf-8'))
             for path in (ROOT / 'arm_brachy' / 'nodes').glob('*.py')}
    runnable = {name for name, tree in trees.items()
                if any(isinstance(n, ast.FunctionDef) and n.name == 'main' for n in tree.body)}
    assert set(node_names()) == runnable


@needs_venv
def test_every_node_is_an_executable_where_ros2_run_looks():
    folder = Path(sys.prefix) / 'lib' / 'arm_brachy'
    executables = {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}
    assert executables == {*node_names(), 'arm-brachy'}


@needs_venv
@pytest.mark.parametrize('command', [
    ('python', '-c', 'import rclpy, pypardiso, arm_brachy_msgs.msg, tf2_msgs.msg'),
    ('arm-brachy', '--help'),
], ids=['imports', 'arm-brachy'])
def test_nothing_needs_sourcing(command):
    program, *arguments = command
    done = subprocess.run([Path(sys.prefix) / 'bin' / program, *arguments], cwd='/',
                          env={'PATH': '/usr/bin:/bin'}, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr


@needs_venv
def test_generated_tf_message_has_the_hash_of_the_original():
    description = Path(sys.prefix) / 'share' / 'tf2_msgs' / 'msg' / 'TFMessage.json'
    hashes = {entry['type_name']: entry['hash_string']
              for entry in json.loads(description.read_text())['type_hashes']}
    assert hashes['tf2_msgs/msg/TFMessage'].startswith(TF_MESSAGE_HASH)
