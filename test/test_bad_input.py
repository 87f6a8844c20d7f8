"""Bad input: one line on stderr, exit status 2 or a refused command, and nothing lost."""

import re
import subprocess
import sys

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from arm_brachy import cell as cells
from arm_brachy.cli import main
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.paths import config_dir
from arm_brachy.recording.reader import BagReader
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.mesh import load_mesh

BREAST = config_dir() / 'scenes' / 'breast.yaml'
LONG = 20_000  # samples that fill more than one compressed block
MAP = """\
name: rig
encoders:
- csv: {path: enc.csv, time: t_s}
  columns: 'q{key}'
"""


def everything(folder):
    """Every file and folder below, with what is in it."""
    return {p: p.read_bytes() if p.is_file() else None for p in sorted(folder.rglob('*'))}


@pytest.fixture
def refuse(tmp_path, monkeypatch):
    """Runs a command that must be refused; returns its one line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('ARM_BRACHY_RUNS', raising=False)

    def call(*args):
        before = everything(tmp_path)
        answer = CliRunner().invoke(main, [str(a) for a in args])
        assert answer.exit_code == 2, answer.output
        assert answer.stdout == ''
        assert answer.stderr.startswith('error: ') and answer.stderr.count('\n') == 1
        assert everything(tmp_path) == before
        return answer.stderr
    return call


@pytest.fixture
def files(tmp_path):
    """Writes a scene and a scenario changed from working ones; returns the scenario."""
    def write(scenario=None, scene=None):
        body = yaml.safe_load(BREAST.read_text())
        body['mesh']['file'] = str((BREAST.parent / body['mesh']['file']).resolve())
        for change in [scene] if scene else []:
            change(body)
        (tmp_path / 'scene.yaml').write_text(yaml.safe_dump(body, sort_keys=False))
        given = {'name': 'trial', 'seed': 3, 'scene': 'scene.yaml', **(scenario or {})}
        (tmp_path / 'trial.yaml').write_text(yaml.safe_dump(given, sort_keys=False))
        return tmp_path / 'trial.yaml'
    return write


@pytest.fixture
def rig(tmp_path):
    (tmp_path / 'map.yaml').write_text(MAP)
    return record(tmp_path, 100)


def record(folder, n):
    positions = np.random.default_rng(0).uniform(0.0, 0.03, n)  # noise does not compress
    rows = [f'{k * 0.01:.2f},{q!r}' for k, q in enumerate(positions.tolist())]
    (folder / 'enc.csv').write_text('\n'.join(['t_s,q0', *rows, '']))
    return folder


def imported(rig):
    answer = CliRunner().invoke(main, ['import', 'csv', str(rig / 'map.yaml'), '--out',
                                       str(rig / 'bag')])
    assert answer.exit_code == 0, answer.output
    return rig / 'bag'


@pytest.fixture
def bag(rig):
    return imported(rig)


def cut(bag):
    """Leave the first half of a bag's file, as a power cut does."""
    file = next(bag.glob('*.mcap'))
    file.write_bytes(file.read_bytes()[:file.stat().st_size // 2])
    return bag


def test_a_wrong_yaml_key(files, refuse):
    line = refuse('run', files({'colour': 'red'}))
    assert re.search(r"trial\.yaml:4: unknown key 'colour'; allowed: name, seed", line)


def test_a_negative_stroke(files, refuse):
    path = files(scene=lambda scene: scene['pads'][1].update(stroke_mm=-30))
    assert re.search(r'scene\.yaml:\d+: pads\.1\.stroke_mm = -30; must be 0 to 200 mm',
                     refuse('run', path))


def test_a_mesh_with_inverted_elements(files, refuse, tmp_path):
    mesh = load_mesh(config_dir() / 'scenes' / 'breast' / 'breast_2331.msh')
    tets = mesh.tets.copy()
    tets[[17, 900]] = tets[[17, 900]][:, [1, 0, 2, 3]]
    np.savez(tmp_path / 'wrong.npz', nodes=mesh.nodes, tets=tets)
    path = files({'plant': {'mesh': {'file': 'wrong.npz'}}})
    line = refuse('run', path)
    assert re.search(rf'wrong\.npz: element 17 is inverted.*\(2 of {len(tets)}\)', line)


def test_a_pad_off_the_body(files, refuse):
    path = files(scene=lambda scene: scene['pads'][0].update(centre_mm=[0, 0, 500]))
    assert 'pad pad_1: 0 surface nodes' in refuse('run', path)


def test_a_csv_with_a_text_cell(rig, refuse):
    lines = (rig / 'enc.csv').read_text().splitlines()
    lines[41] = '0.40,jammed'
    (rig / 'enc.csv').write_text('\n'.join(lines))
    assert "enc.csv:42:q0: 'jammed' is no number" in refuse('import', 'csv', rig / 'map.yaml',
                                                            '--out', rig / 'bag')


@pytest.mark.parametrize('command', ['evaluate', 'hashes', 'replay', 'conceal'])
def test_a_truncated_bag_is_refused_naming_what_mends_it(bag, refuse, command):
    out = [] if command == 'hashes' else ['--out', bag.parent / 'new']
    line = refuse(command, cut(bag), *out)
    assert 'truncated, the recorder did not finish; run `arm-brachy recover' in line


def test_of_a_truncated_bag_everything_complete_is_recovered(rig, refuse):
    truncated = cut(imported(record(rig, LONG)))
    damaged = re.search('`arm-brachy recover (.*?mcap) ', refuse('evaluate', truncated))[1]
    before = everything(truncated)
    answer = CliRunner().invoke(main, ['recover', damaged, '--out',
                                       str(truncated.parent / 'mended')])
    assert answer.exit_code == 0, answer.output
    assert everything(truncated) == before
    with BagReader(truncated.parent / 'mended') as bag:
        kept = [r.sequence for r in bag.records()]
    assert 0 < len(kept) < LONG and kept == list(range(len(kept)))


def test_a_damaged_chunk_leaves_no_half_copy(bag, refuse):
    """The damage is met after the copy has begun."""
    file = next(bag.glob('*.mcap'))
    data = bytearray(file.read_bytes())
    middle = data.index(b'\x28\xb5\x2f\xfd') + 200  # within the compressed messages
    data[middle] ^= 0xFF
    file.write_bytes(bytes(data))
    assert 'damaged' in refuse('conceal', bag, '--out', bag.parent / 'new')


def test_an_unknown_topic(bag, refuse):
    line = refuse('conceal', bag, '--out', bag.parent / 'new', '--also', '/actuators/states')
    assert "no topic '/actuators/states' to leave out; recorded: /actuators/state" in line


def test_a_bag_without_scenario_cannot_be_replayed(bag, refuse):
    line = refuse('replay', bag)
    assert 'holds no scenario' in line and 'arm-brachy replay BAG --scenario FILE' in line


@pytest.mark.parametrize('args,says', [
    (['run', 'none.yaml'], 'none.yaml: no such file'),
    (['run', '.'], 'cannot be read: Is a directory'),
    (['evaluate', 'no/ne'], 'no/ne: no such bag'),
    (['evaluate', 'none'], 'none: no such bag; must be a bag directory or an .mcap file'),
    (['replay', 'none'], 'none: no such bag'),
    (['hashes', 'none'], 'none: no such bag'),
    (['recover', '.', '--out', 'new'], 'holds 0 .mcap files; must hold one'),
    (['import', 'csv', 'none.yaml', '--out', 'new'], 'none.yaml: no such file'),
    (['import', 'c3d', 'none.c3d', '--out', 'new'], 'none.c3d: no such file'),
    (['import', 'scene', 'none.yaml', '--out', 'new'], 'none.yaml: no such file'),
    (['mesh', 'none.stl', 'a.msh', '--edge-length-mm', '5'], 'none.stl'),
])
def test_what_is_not_there(refuse, args, says):
    assert says in refuse(*args)


@pytest.mark.parametrize('content', [b'', b'not a bag', b'\x89MCAP0\r\n'])
def test_a_file_that_is_no_bag(refuse, tmp_path, content):
    (tmp_path / 'a.mcap').write_bytes(content)
    for command in ('evaluate', 'hashes', 'replay'):
        assert 'a.mcap: ' in refuse(command, 'a.mcap')
    assert 'a.mcap: ' in refuse('recover', 'a.mcap', '--out', 'new')


def test_a_folder_that_holds_something_is_never_written_to(bag, files, refuse, tmp_path):
    busy = tmp_path / 'busy'
    busy.mkdir()
    (busy / 'thesis.txt').write_text('the only copy')
    for args in (['run', files()], ['replay', bag], ['evaluate', bag], ['recover', bag],
                 ['conceal', bag], ['import', 'csv', tmp_path / 'map.yaml'],
                 ['reproduce', 'figure-3.2']):
        line = refuse(*args, '--out', busy)
        assert 'busy: exists and is not empty; name another folder with --out' in line


def test_a_folder_that_cannot_be_made(bag, files, refuse, tmp_path):
    (tmp_path / 'file').touch()
    for args in (['recover', bag], ['run', files()]):
        line = refuse(*args, '--out', tmp_path / 'file' / 'new')
        assert 'cannot be made: Not a directory' in line


def test_exit_status_and_line_reach_the_shell(files):
    program = 'from arm_brachy.cli import main; main()'
    answer = subprocess.run([sys.executable, '-c', program, 'run', files({'seed': 'x'})],
                            text=True, capture_output=True, timeout=60)
    assert answer.returncode == 2 and answer.stdout == ''
    assert re.fullmatch(r"error: .*trial\.yaml:2: seed = 'x'; must be a whole number\n",
                        answer.stderr)


@pytest.mark.parametrize('position,says', [
    ([0.005, float('nan'), 0.0, 0.0], 'pad_2: position = nan mm; must be 0 to 30'),
    ([0.005, 0.0, 0.031, 0.0], 'pad_3: position = 31 mm; must be 0 to 30'),
    ([0.005, 0.0, 0.0, -0.001], 'pad_4: position = -1 mm; must be 0 to 30'),
    ([0.005, 0.0, 0.0, float('inf')], 'pad_4: position = inf mm; must be 0 to 30'),
    ([0.005, 0.0], 'with 2 positions; must name each of pad_1, pad_2, pad_3, pad_4 once'),
])
def test_a_command_that_cannot_be_carried_out_moves_nothing(files, position, says):
    """As nodes.actuator_driver obeys; the last good command stays in force, for every pad."""
    cell = load_cell(files())
    driver = cells.build_actuators(cell, cell.scenario.actuators)
    names = [p.name for p in cell.scene.pads]
    driver.connect()
    driver.home()
    driver.read(0.1)
    good = np.array([0.004, 0.003, 0.002, 0.001])
    driver.move(cells.in_driver_order(names, good, names))
    with pytest.raises(CommandRefused) as caught:
        driver.move(cells.in_driver_order(names, position, names))
    assert says in str(caught.value) and '\n' not in str(caught.value)
    np.testing.assert_allclose(driver.read(5.0).pad, good, atol=1e-6)


@pytest.mark.parametrize('names', [['pad_1', 'pad_2', 'pad_3', 'pad_5'],
                                   ['pad_1', 'pad_1', 'pad_3', 'pad_4']])
def test_a_command_for_other_actuators_is_refused(names):
    order = ['pad_1', 'pad_2', 'pad_3', 'pad_4']
    with pytest.raises(CommandRefused, match='must name each of pad_1, pad_2, pad_3, pad_4 once'):
        cells.in_driver_order(names, [0.0] * 4, order)


def test_check_of_a_mesh_that_cannot_be_read_is_bad_input(tmp_path, files):
    (tmp_path / 'cut.msh').write_text('$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 9 1 9\n')
    files(scene=lambda scene: scene.update(mesh={'file': 'cut.msh', 'unit': 'mm'}))
    answer = CliRunner().invoke(main, ['check', str(tmp_path / 'scene.yaml')])
    assert answer.exit_code == 2 and isinstance(answer.exception, SystemExit), answer.output
    assert 'not a readable Gmsh file' in ' '.join((answer.stdout + answer.stderr).split())
