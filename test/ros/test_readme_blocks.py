"""Every block of README is run as it stands, in a folder that has what it asks for.

Blocks of one kind are told by the comment before them:
    set-up              make; looked at without being done, as a test runs inside what it makes
    ROS machine         an Ubuntu with ROS 2; the build is test_colcon_build.py's
    laboratory          a laboratory's files, which are made here
    long, and laboratory, long      of minutes and hours: every command's words are parsed, its
                        scenarios are run by test_shipped_scenarios.py
    node, node, second shell    together, with the Python block between them
All others run in a folder like a clone's, its scenarios cut short.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
import yaml

from arm_brachy.cli import main
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import boundary_faces

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / 'README.md').read_text(encoding='utf-8')
BLOCK = re.compile(r'(?:<!-- ([a-zA-Z, -]+) -->\n)?```(\w+)\n(.*?)```', re.DOTALL)
BLOCKS = [(m[1] or '', m[2], m[3]) for m in BLOCK.finditer(TEXT)]
SIZE = (0.1, 0.04, 0.06)    # m, of the phantom, on z = 0
BRIEF = {'tasks': {'duration_s': 4.0, 'displacement_mm': [-1, 0, 0]},
         'moves': {'hold_s': 0.2, 'cycles': 0}}
T = np.arange(0.0, 3.0, 0.02)
PUSH = np.interp(T, [0, 0.5, 1, 1.5, 2, 3], [0, 0, 4, 4, 0, 0])    # mm, of the eastern pad


def blocks(kind, language='bash'):
    found = [text for name, lang, text in BLOCKS if (name, lang) == (kind, language)]
    assert found
    return found


def activated():
    """The environment of a shell after `source .venv/bin/activate`."""
    path = f'{Path(sys.prefix) / "bin"}{os.pathsep}{os.environ["PATH"]}'
    return {**os.environ, 'PATH': path}


def bash(text, folder):
    """Run a block as a shell would; returns what it printed."""
    done = subprocess.run(['bash', '-e', '-c', text], cwd=folder, text=True, capture_output=True,
                          timeout=900, check=False, env=activated())
    assert done.returncode == 0, f'{text}\n{done.stdout}\n{done.stderr}'
    return done.stdout


@pytest.fixture
def clone(tmp_path):
    """A folder with config/ as in the repository, every scenario cut to some seconds."""
    shutil.copytree(ROOT / 'config' / 'scenes', tmp_path / 'config' / 'scenes')
    (tmp_path / 'config' / 'scenarios').mkdir()
    for path in (ROOT / 'config' / 'scenarios').glob('*.yaml'):
        body = yaml.safe_load(path.read_text(encoding='utf-8'))
        body.update(settle_s=0.5, **{key: [{**one, **brief} for one in body[key][:1]]
                                     for key, brief in BRIEF.items() if key in body})
        (tmp_path / 'config' / 'scenarios' / path.name).write_text(yaml.safe_dump(body))
    return tmp_path


@pytest.fixture(scope='module')
def laboratory(tmp_path_factory):
    """The files that the recipe names: a surface, tables of a push, and the YAML of README."""
    folder = tmp_path_factory.mktemp('laboratory')
    for name, text in re.findall(r'```yaml\n# (\S+)\n(.*?)```', TEXT, re.DOTALL):
        (folder / name).write_text(text)
    write_stl(folder / 'phantom.stl')
    push = folder / 'monday' / 'push_1'
    push.mkdir(parents=True)
    write_table(push / 'motors.csv', ('t_ms', 'E_pos_mm', 'W_pos_mm'), 1e3 * T, PUSH, 0 * T)
    write_table(push / 'cells.csv', ('t_ms', 'E_load', 'W_load'), 1e3 * T, 0.8 * PUSH, 0.1 * PUSH)
    camera = [value + 0 * T for value in (0.0, 0.0, 60.0, 58.0, 0.0, 26.0, 70.0, 40.0, 0.0)]
    camera[0], camera[3] = -0.3 * PUSH, 58.0 - PUSH
    write_table(push / 'camera.csv', ('time', *(f'{m}.{a}' for m in ('m1', 'on_east', 'floor_1')
                                                for a in 'XYZ')), T, *camera)
    write_table(push / 'aurora.csv', ('time', 'lump_x', 'lump_y', 'lump_z'), T, 5 - 0.4 * PUSH,
                3 + 0 * T, 28 + 0 * T)
    return folder


def write_stl(path):
    """A block of SIZE about the z axis, as a closed surface [mm]."""
    mesh = box_mesh(SIZE, (5, 4, 3))
    nodes = 1e3 * (mesh.nodes - [SIZE[0] / 2, SIZE[1] / 2, 0.0])
    facets = '\n'.join(
        'facet normal 0 0 0\nouter loop\n'
        + '\n'.join('vertex ' + ' '.join(f'{v:.6f}' for v in nodes[i]) for i in face)
        + '\nendloop\nendfacet' for face in boundary_faces(mesh))
    path.write_text(f'solid block\n{facets}\nendsolid block\n')


def write_table(path, names, *columns):
    np.savetxt(path, np.column_stack(columns), fmt='%.6f', delimiter=',', comments='',
               header=','.join(names))


def test_every_block_is_of_a_kind_that_is_run():
    kinds = {'', 'set-up', 'ROS machine', 'laboratory', 'laboratory, long', 'long', 'node',
             'node, second shell'}
    assert {name for name, lang, _ in BLOCKS if lang == 'bash'} == kinds
    assert {lang for _, lang, _ in BLOCKS} == {'bash', 'python', 'yaml'}
    assert not re.search(r'\n\n    \S', re.sub(r'```.*?```', '', TEXT, flags=re.DOTALL))


@pytest.mark.parametrize('text', blocks('set-up'))
def test_set_up_is_known_to_make(text):
    for line in text.splitlines():
        words = line.split()
        if words[0] == 'make':
            done = subprocess.run(['make', '--dry-run', *words[1:]], cwd=ROOT, text=True,
                                  capture_output=True, check=False)
            assert done.returncode == 0 and done.stdout
            said = 'source .venv/bin/activate' in done.stdout
            assert said == (words[1:] == ['setup'])     # it ends by saying how to go on
        else:
            assert line == 'source .venv/bin/activate'


@pytest.mark.parametrize('text', blocks('ROS machine'))
def test_what_a_ros_machine_types_names_what_is_there(text):
    assert subprocess.run(['bash', '-n', '-c', text], check=False).returncode == 0
    named = re.findall(r'config/\S+\.yaml|(?<=arm_brachy )\S+\.launch\.py', text)
    assert named and all((ROOT / n).is_file() or (ROOT / 'launch_scripts' / n).is_file()
                         for n in named)


@pytest.mark.parametrize('text', blocks(''))
def test_a_block_runs_in_a_clone(text, clone):
    printed = bash(text, clone)
    assert printed.count('report  ') >= text.count('arm-brachy')


def test_the_recipe_runs_from_files_to_a_replay(laboratory):
    for text in blocks('laboratory'):
        printed = bash(text, laboratory)
    assert (laboratory / 'phantom.png').stat().st_size > 10_000
    for stream in ('optical', 'em', 'force'):
        assert (laboratory / 'runs/push_1_replayed' / f'report_{stream}.html').is_file()
        assert f'report_{stream}.html' in printed


@pytest.mark.parametrize('text', [*blocks('laboratory, long'), *blocks('long')])
def test_words_of_a_long_command_are_those_it_knows(text):
    for line in text.replace('\\\n', ' ').splitlines():
        program, name, *rest = shlex.split(line, comments=True)
        command = main.get_command(None, name)
        if isinstance(command, click.Group):
            command, rest = command.commands[rest[0]], rest[1:]
        assert program == 'arm-brachy' and command.make_context(name, rest).params
        assert all((ROOT / word).is_file() for word in rest if word.startswith('config/'))


def test_one_node_in_one_shell_moves_for_another(clone, ros_domain_id):
    """Whatever domain README has, here it is that of the test."""
    first, second = (blocks(kind)[0] for kind in ('node', 'node, second shell'))
    (script,) = blocks('', 'python')
    (clone / re.match(r'# (\S+?):', script)[1]).write_text(script)
    own = f'ROS_DOMAIN_ID={os.environ["ROS_DOMAIN_ID"]}'
    first, second = (re.sub(r'ROS_DOMAIN_ID=\d+', own, text) for text in (first, second))
    driver = subprocess.Popen(['bash', '-c', first], cwd=clone, env=activated(),
                              start_new_session=True, stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL)
    try:
        printed = bash(second, clone)
    finally:
        os.killpg(driver.pid, signal.SIGINT)
        driver.wait(20)
    ends = [float(line.split()[0]) for line in printed.splitlines() if line.endswith('mm')]
    assert ends[-1] > 4.9 and ends[0] < 1.0
