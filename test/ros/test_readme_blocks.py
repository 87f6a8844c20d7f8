"""Every block of README and docs/ is run as it stands, in a folder that has what it asks for.

The comment before a block says of which kind it is:
    set-up              make; only a dry run, as a test runs inside what it makes
    ROS machine         an Ubuntu with ROS 2; the build is test_colcon_build.py's
    laboratory          on a laboratory's files, those of the sample; blocks of one page together
    long, and laboratory, long      of minutes and hours, or until Ctrl-C: the words are parsed,
                        scenarios are run by test_shipped_scenarios.py
    node, node, second shell    together, with the script of the Python block between them
    new term            the tutorial's files and line of the registry, in a copy of the tree
    driver              the tutorial's package, installed beside the environment
    driver, node        its node, which is started and heard
All others run in a folder like a clone's, its scenarios cut short; `after the run` in the folder
of the block before it. What starts whole graphs `make validate` runs, and the words are parsed.
YAML blocks of docs/reference are excerpts.
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
import pytest
import yaml

from arm_brachy.cli import main

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
PAGES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding='utf-8')
         for path in (ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md')))}
TUTORIAL = 'docs/tutorials/{}.md'.format
BLOCK = re.compile(r'(?:<!-- ([a-zA-Z, -]+) -->\n)?```(\w+)\n(.*?)```', re.DOTALL)
BLOCKS = [(page, m[1] or '', m[2], m[3]) for page, text in PAGES.items()
          for m in BLOCK.finditer(text)]
NAMED = re.compile(r'# (\S+?)(?::[^\n]*)?\n')      # the first line of a block that is a file
KINDS = {'', 'set-up', 'ROS machine', 'laboratory', 'laboratory, long', 'long', 'node',
         'node, second shell', 'node, script', 'after the run', 'new term', 'driver',
         'driver, node'}
BRIEF = {'tasks': {'duration_s': 4.0, 'displacement_mm': [-1, 0, 0]},
         'moves': {'hold_s': 0.2, 'cycles': 0}}


def blocks(kind, language='bash', page=None):
    found = [text for where, name, lang, text in BLOCKS
             if (name, lang) == (kind, language) and page in (None, where)]
    assert found
    return found


RECIPE = blocks('laboratory', page=TUTORIAL('own_phantom'))


def write_files(folder, *, kind, page):
    """Write the blocks of a kind that begin with `# path`; returns the paths."""
    paths = []
    for where, name, lang, text in BLOCKS:
        if (where, name) == (page, kind) and lang != 'bash' and NAMED.match(text):
            path = folder / NAMED.match(text)[1]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            paths.append(path)
    assert paths
    return paths


def activated(**more):
    """The environment of a shell after `source .venv/bin/activate`."""
    path = f'{Path(sys.prefix) / "bin"}{os.pathsep}{os.environ["PATH"]}'
    return {**os.environ, 'PATH': path, **more}


def bash(text, folder, **more):
    """Run a block as a shell would; returns what it printed."""
    done = subprocess.run(['bash', '-e', '-c', text], cwd=folder, text=True, capture_output=True,
                          timeout=900, check=False, env=activated(**more))
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


@pytest.fixture
def laboratory(tmp_path):
    """The folder that the first block of the recipe writes, as a reader has it."""
    bash(RECIPE[0], tmp_path)
    return tmp_path / 'lab'


def test_every_block_is_of_a_kind_that_is_run():
    assert {name for _, name, lang, _ in BLOCKS if lang == 'bash'} == KINDS - {'node, script'}
    assert {lang for _, _, lang, _ in BLOCKS} == {'bash', 'python', 'yaml', 'toml', 'text'}
    for text in PAGES.values():
        assert not re.search(r'\n\n    \S', re.sub(r'```.*?```', '', text, flags=re.DOTALL))
        assert text.count('```') == 2 * len(BLOCK.findall(text))


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
    named = re.findall(r'config/\S+\.(?:yaml|xml)|(?<=arm_brachy )\S+\.launch\.py', text)
    assert named and all((ROOT / n).is_file() or (ROOT / 'launch_scripts' / n).is_file()
                         for n in named)


def runs():
    """(page, blocks that run one after the other in one clone)."""
    found = []
    for page, name, lang, text in BLOCKS:
        if (name, lang) == ('', 'bash'):
            found.append((page, [text]))
        elif name == 'after the run':
            assert found[-1][0] == page
            found[-1][1].append(text)
    once = {}       # a first run stands in README and in its tutorial
    for page, texts in found:
        once[texts[0]] = max(once.get(texts[0], (page, [])), (page, texts),
                             key=lambda one: len(one[1]))
    return list(once.values())


@pytest.mark.validate
@pytest.mark.parametrize(('page', 'texts'), runs())
def test_a_block_runs_in_a_clone(page, texts, clone):
    for text in texts:
        printed = bash(text, clone)
        assert printed.count('report  ') >= text.count('arm-brachy'), page


def test_the_recipe_makes_a_recording_of_files(laboratory):
    printed = bash(RECIPE[1], laboratory)
    assert (laboratory / 'phantom.png').stat().st_size > 10_000
    assert list((laboratory / 'bags/push_1').glob('*.mcap'))
    assert 'from_mm' in printed and 'begin or end' not in printed


@pytest.mark.validate
def test_the_recipe_runs_from_files_to_a_replay(laboratory):
    for path in (laboratory / 'monday/push_1').glob('*.csv'):   # to the end of the first push
        head, *rows = path.read_text().splitlines(keepends=True)
        path.write_text(head + ''.join(rows[:len(rows) // 5]))
    for text in RECIPE[1:]:
        printed = bash(text, laboratory)
    for stream in ('optical', 'em', 'force'):
        assert (laboratory / 'runs/push_1_replayed' / f'report_{stream}.html').is_file()
        assert f'report_{stream}.html' in printed


def test_the_two_commands_of_the_readme_are_those_of_the_recipe():
    """README's import and diagnosis are run, or parsed, as lines of the tutorial."""
    recipe = ''.join(text for kind in ('laboratory', 'laboratory, long')
                     for text in blocks(kind, page=TUTORIAL('own_phantom')))
    for kind in ('laboratory', 'laboratory, long'):
        (text,) = blocks(kind, page='README.md')
        assert text in recipe


@pytest.mark.parametrize('text', [
    *blocks('laboratory, long'), *blocks('long'), *(text for _, texts in runs() for text in texts),
    *blocks('laboratory')])
def test_words_of_a_long_command_are_those_it_knows(text):
    for line in text.replace('\\\n', ' ').splitlines():
        program, name, *rest = shlex.split(line, comments=True)
        if program == 'cd':
            continue
        command = main.get_command(None, name)
        if isinstance(command, click.Group):
            command, rest = command.commands[rest[0]], rest[1:]
        assert program == 'arm-brachy' and command.make_context(name, rest).params
        assert all((ROOT / word).is_file() for word in rest if word.startswith('config/'))


def test_one_node_in_one_shell_moves_for_another(clone, ros_domain_id):
    """Whatever domain the tutorial has, here it is that of the test."""
    first, second = (blocks(kind)[0] for kind in ('node', 'node, second shell'))
    write_files(clone, kind='node, script', page=TUTORIAL('first_scenario'))
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


@pytest.fixture
def new_term(tmp_path):
    """A copy of the tree with the files of the tutorial on terms and its lines in the registry."""
    for name in ('arm_brachy', 'config', 'docs', 'msg_defs', 'results', 'test'):
        shutil.copytree(ROOT / name, tmp_path / name)
    for name in ('README.md', 'pyproject.toml', 'package.xml'):
        shutil.copy(ROOT / name, tmp_path)
    registry = tmp_path / 'arm_brachy' / 'registry.py'
    before = registry.read_text(encoding='utf-8')
    write_files(tmp_path, kind='new term', page=TUTORIAL('adding_a_term'))
    _, line, *order = registry.read_text(encoding='utf-8').splitlines(keepends=True)
    start = before.index('    MarkerSlip, OpticalScale')
    registry.write_text(line + before[:start] + ''.join(order) + before[before.index(')', start):])
    return tmp_path


@pytest.mark.validate
def test_a_new_term_is_one_file_its_test_and_a_line(new_term):
    (text,) = blocks('new term')
    printed = bash(text, new_term, PYTHONPATH=str(new_term))
    assert 'EM positions drift' in printed and 'rate_mm_s' in printed
    assert '`em_drift`' in (new_term / 'docs/reference/terms.md').read_text(encoding='utf-8')


@pytest.fixture
def driver(clone):
    """(folder, environment): the driver's package written and installed beside the environment."""
    page = TUTORIAL('hardware_driver')
    write_files(clone, kind='driver', page=page)
    write_files(clone, kind='', page=page)
    beside = clone / 'beside'
    more = {'PIP_TARGET': str(beside), 'PYTHONPATH': f'{beside}{os.pathsep}{ROOT}'}
    return clone, more


def test_a_driver_from_a_package_moves_refuses_and_serves_its_node(driver, ros_domain_id):
    folder, more = driver
    printed = [bash(text, folder, **more) for text in blocks('driver')]
    (expected,) = blocks('', 'text', page=TUTORIAL('hardware_driver'))
    assert printed[-1] == expected
    (text,) = blocks('driver, node')
    node = subprocess.Popen(['bash', '-c', text], cwd=folder, env=activated(**more),
                            start_new_session=True)
    try:
        assert bash(HEARD, folder, **more).split() == ['12.0'] * 4      # homes only when asked
    finally:
        os.killpg(node.pid, signal.SIGINT)
        node.wait(20)


HEARD = """python -c "
import rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node, heard = rclpy.create_node('listener'), []
node.create_subscription(JointState, 'actuators/state', heard.append, 10)
while not heard:
    rclpy.spin_once(node, timeout_sec=0.1)
print(*(round(1e3 * q, 3) for q in heard[0].position))
rclpy.shutdown()
"
"""
