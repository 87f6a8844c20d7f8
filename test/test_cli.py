"""The command line: help that works as printed, exit status, results as JSON."""

import json
import re
import shlex
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console
from ruamel.yaml import YAML

from arm_brachy import __version__, registry
from arm_brachy.cli import COMMANDS, bags, main, output
from arm_brachy.cli import run as cli_run
from arm_brachy.cli.term_sheet import term_sheet
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import share_dir
from arm_brachy.core.quantity import quantities
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.model.hypothesis import strengths
from arm_brachy.evaluation.result import Result, Target
from arm_brachy.experiments.catalogue import EXPERIMENTS
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import load_mesh
from arm_brachy.tissue.outlines import crossing
from arm_brachy.tissue.rims import outline

RESULT_KEYS = {'name', 'seed', 'commit', 'machine', 'rows', 'targets'}
ENCODERS = 't_s,q0\n0.00,0.000\n0.01,0.001\n0.02,0.002\n'
MAP = """\
name: rig
encoders:
- csv: {path: enc.csv, time: t_s}
  columns: 'q{key}'
"""


def run(*args):
    return CliRunner().invoke(main, [str(a) for a in args])


def shell(command, **options):
    program = f'{shlex.quote(sys.executable)} -m arm_brachy'
    return subprocess.run(command.replace('arm-brachy', program), shell=True, text=True,
                          capture_output=True, timeout=60, **options)


def commands():
    """Every command with its full name, those inside groups too."""
    for name in COMMANDS:
        command = main.get_command(None, name)
        yield name, command
        if isinstance(command, click.Group):
            yield from ((f'{name} {inner}', one) for inner, one in command.commands.items())


ALL = dict(commands())
each_command = pytest.mark.parametrize('name', ALL)


@pytest.fixture
def rig(tmp_path):
    """A laboratory's folder: one CSV file and its column map."""
    (tmp_path / 'enc.csv').write_text(ENCODERS)
    (tmp_path / 'map.yaml').write_text(MAP)
    return tmp_path


@pytest.fixture
def bag(rig):
    assert run('import', 'csv', rig / 'map.yaml', '--out', rig / 'bag').exit_code == 0
    return rig / 'bag'


@each_command
def test_help_is_shown_and_fits_80_columns(name):
    answer = CliRunner().invoke(main, [*name.split(), '--help'], terminal_width=80)
    assert answer.exit_code == 0
    assert max(map(len, answer.output.splitlines())) <= 80
    assert 'Example:' in answer.output


@each_command
def test_an_example_works_as_printed(name, tmp_path, monkeypatch):
    """It parses, and what it names of config/ exists."""
    _, _, example = ALL[name].help.partition('Example:')
    words = shlex.split(example.replace('\\\n', ' '))
    assert words[:1 + len(name.split())] == ['arm-brachy', *name.split()]
    named = [w for w in words if w.startswith('config/')]
    assert all((share_dir() / w).is_file() for w in named)
    (tmp_path / 'runs').mkdir()
    monkeypatch.chdir(tmp_path)
    rest = words[1 + len(name.split()):]
    if not isinstance(ALL[name], click.Group):
        ALL[name].make_context(name, rest)


def test_the_list_of_commands_says_what_each_says_of_itself():
    for name, (_, text) in COMMANDS.items():
        assert ALL[name].help.split('\n\n')[0] == text


def test_help_and_version_load_no_physics():
    loaded = shell('arm-brachy --help').stdout
    assert all(f'  {name} ' in loaded for name in COMMANDS)
    check = ('import sys, arm_brachy.cli; '
             'print(sorted({"numpy", "numba", "scipy", "rich"} & set(sys.modules)))')
    answer = subprocess.run([sys.executable, '-c', check], text=True, capture_output=True)
    assert answer.stdout.strip() == '[]'
    assert run('--version').output.strip().endswith(__version__)


def test_without_arguments_the_help_is_shown():
    answer = run()
    assert answer.exit_code == 2 and 'Commands:' in answer.stderr


@pytest.mark.parametrize('args,says', [
    (['evaluat'], "No command 'evaluat'; must be one of run, replay, evaluate"),
    (['evaluate'], "Missing argument 'BAG'"),
    (['terms', '--colour'], "No such option '--colour'"),
    (['--colour'], "No such option '--colour'"),
    (['import', 'xls', 'a'], "No such command 'xls'"),
    (['run', 'a.yaml', '--speed-limit', '-1'], '--speed-limit'),
    (['mesh', 'a.stl', 'b.msh', '--edge-length-mm', 'x'], "'x' is not a valid float"),
    (['diagnose', 'bag', '--scene', 's.yaml', '--jobs', '0'], '0 is not in the range x>=1'),
    (['diagnose', 'bag', '--scene', 's.yaml', '--jobs', 'all'], "'all' is not a valid integer"),
    (['replay', 'bag', '--node', 'tissue'], "'tissue' is not one of 'actuator_driver'"),
    (['reproduce', 'table-9.9'], "'table-9.9' is not one of"),
    (['evaluate', 'bag', '--json', '/nowhere/a.json'], '/nowhere: no such folder'),
    (['evaluate', 'bag', '--json', '/'], '/ is a folder; name a file'),
])
def test_a_wrong_command_line_is_one_line_and_a_hint(args, says):
    answer = run(*args)
    assert answer.exit_code == 2 and answer.stdout == ''
    assert answer.stderr.count('\n') == 1
    assert says in answer.stderr and re.search(r'See: arm-brachy.* --help$', answer.stderr.strip())


def test_an_unknown_experiment_lists_the_known_ones():
    answer = run('reproduce', 'table-9.9')
    assert all(name in answer.stderr for name in EXPERIMENTS)
    assert all(name in run('reproduce', '--help').stdout for name in EXPERIMENTS)


def test_tables_are_markdown():
    for name in ('terms', 'nodes'):
        lines = run(name).stdout.splitlines()
        assert re.fullmatch(r'\|(---\|)+', lines[1]) and all(x.startswith('|') for x in lines)


def test_an_import_that_no_diagnosis_could_use_is_refused_with_the_scene_at_hand(rig):
    answer = run('import', 'csv', rig / 'map.yaml', '--out', rig / 'bag', '--scene',
                 share_dir() / 'config/scenes/breast.yaml')
    assert answer.exit_code == 2 and answer.stderr.count('\n') == 1
    assert 'actuators' in answer.stderr and not (rig / 'bag').exists()


@pytest.mark.parametrize('name', [term.spec.name for term in registry.TERMS])
def test_a_term_has_a_sheet_whose_lines_switch_it_on(name):
    sheet, term = term_sheet(name), registry.by_name(name)
    assert max(map(len, sheet.splitlines())) <= 99
    assert all(info.key(field) in sheet for field, info in quantities(term).items())
    entries = YAML(typ='safe').load(sheet[sheet.index('    terms:'):])['terms']
    one, = registry.parse_terms(entries, 'terms')
    assert isinstance(one, term)
    assert any(np.ravel(getattr(one, s.name))[s.component or 0] != s.neutral
               for s in strengths(term))


def test_one_term_is_printed_with_its_typical_size():
    answer = run('terms', 'inclusion').stdout
    assert 'typical     5; none of it: 1' in answer and 'allowed     0.1 to 100' in answer
    assert "did you mean 'inclusion'" in run('terms', 'inclusoin').stderr


def test_long_work_is_told_of_once_in_a_log_and_quick_work_is_not(monkeypatch, capfd):
    monkeypatch.setattr(output, 'QUICK', 0.05)
    with output.working('slow'):
        time.sleep(0.3)
    with output.working('quick'):
        pass
    time.sleep(0.1)
    assert capfd.readouterr().err == 'slow ...\n'


def test_a_closed_pipe_is_quiet():
    answer = shell('arm-brachy terms | head -c 10')
    assert answer.stdout == '| term | w' and answer.stderr == ''


def test_ctrl_c_is_one_line_and_130(monkeypatch):
    def interrupted(path):
        raise KeyboardInterrupt
    monkeypatch.setattr(bags, 'payload_hashes', interrupted)
    answer = run('hashes', 'bag')
    assert answer.exit_code == 130 and answer.stderr.split() == ['interrupted']


def test_a_bug_shows_its_traceback(monkeypatch):
    monkeypatch.setattr(bags, 'payload_hashes', lambda path: 1 / 0)
    assert isinstance(run('hashes', 'bag').exception, ZeroDivisionError)


def test_bad_news_is_status_1(monkeypatch):
    def bad_news(path):
        raise ArmBrachyError('it does not converge')
    monkeypatch.setattr(bags, 'payload_hashes', bad_news)
    answer = run('hashes', 'bag')
    assert (answer.exit_code, answer.stderr) == (1, 'error: it does not converge\n')


def test_files_of_another_folder_than_the_map(rig, tmp_path):
    (tmp_path / 'maps').mkdir()
    (rig / 'map.yaml').rename(tmp_path / 'maps' / 'map.yaml')
    answer = run('import', 'csv', tmp_path / 'maps' / 'map.yaml', '--folder', rig,
                 '--out', rig / 'bag', '--json', rig / 'result.json')
    assert answer.exit_code == 0 and '3 messages' in answer.stdout
    found = json.loads((rig / 'result.json').read_text())
    assert set(found) == RESULT_KEYS
    assert [row['rows'] for row in found['rows']] == [3]


def test_what_is_recovered_and_concealed_has_the_same_payloads(bag, tmp_path):
    assert run('recover', bag, '--out', tmp_path / 'mended', '--json',
               tmp_path / 'r.json').exit_code == 0
    assert run('conceal', bag, '--out', tmp_path / 'hidden').exit_code == 0
    answer = run('hashes', bag, tmp_path / 'mended', tmp_path / 'hidden')
    assert answer.exit_code == 0 and answer.stdout.startswith('equal   /actuators/state')
    row = json.loads((tmp_path / 'r.json').read_text())['rows'][0]
    assert (row['messages'], row['damaged_chunks'], row['unread_bytes']) == (3, 0, 0)


def test_bags_that_differ_are_bad_news(bag, rig):
    (rig / 'enc.csv').write_text(ENCODERS.replace('0.002', '0.003'))
    assert run('import', 'csv', rig / 'map.yaml', '--out', rig / 'other').exit_code == 0
    answer = run('hashes', bag, rig / 'other', '--json', rig / 'h.json')
    assert answer.exit_code == 1 and answer.stdout.startswith('DIFFER  /actuators/state')
    assert 'topics that differ' in answer.stderr
    found = json.loads((rig / 'h.json').read_text())
    assert found['targets'][0]['met'] is False and found['rows'][0]['equal'] is False


def test_a_mesh_is_made_with_its_figures_and_never_overwritten(tmp_path):
    surface = share_dir() / 'config/scenes/silicone_beam/beam.stl'
    args = ('mesh', surface, tmp_path / 'beam.msh', '--edge-length-mm', 25)
    answer = run(*args, '--json', tmp_path / 'mesh.json')
    assert answer.exit_code == 0
    row = json.loads((tmp_path / 'mesh.json').read_text())['rows'][0]
    assert re.search(rf"^tetrahedra +{row['tetrahedra']}$", answer.stdout, re.M)
    before = (tmp_path / 'beam.msh').read_bytes()
    again = run(*args)
    assert again.exit_code == 2 and 'beam.msh: exists; name another file' in again.stderr
    assert (tmp_path / 'beam.msh').read_bytes() == before


def test_a_mesh_for_a_scene_has_the_rims_of_its_pads_among_its_edges(tmp_path):
    """Closed outlines on the cylinders of all pads, which a mesh of the surface alone lacks."""
    scenes = share_dir() / 'config/scenes'
    made = {}
    for name, wish in (('rims', ('--scene', scenes / 'breast.yaml')), ('plain', ())):
        args = ('mesh', scenes / 'breast/breast.stl', tmp_path / f'{name}.msh',
                '--edge-length-mm', 20, *wish)
        assert run(*args).exit_code == 0
        made[name] = load_mesh(tmp_path / f'{name}.msh')
    for patch in load_scene(scenes / 'breast.yaml').pads:
        edges = outline(made['rims'], patch)
        assert len(edges) >= 8 and np.all(np.unique(edges, return_counts=True)[1] == 2)
        assert len(crossing(made['rims'], patch)) == 0 < len(crossing(made['plain'], patch))


def test_a_mesh_for_the_pads_of_a_scene_without_any_is_refused(tmp_path):
    scene = share_dir() / 'config/scenes/silicone_beam.yaml'
    answer = run('mesh', scene.parent / 'silicone_beam/beam.stl', tmp_path / 'beam.msh',
                 '--edge-length-mm', 25, '--scene', scene)
    assert answer.exit_code == 2 and 'pads = none; must be one at least' in answer.stderr
    assert not (tmp_path / 'beam.msh').exists()


def test_a_scene_is_checked_and_drawn(tmp_path):
    scene = share_dir() / 'config/scenes/breast.yaml'
    picture = tmp_path / 'breast.png'
    answer = run('check', scene, '--picture', picture, '--json', tmp_path / 'check.json')
    assert answer.exit_code == 0 and 'covers_percent' in answer.stdout
    assert picture.read_bytes().startswith(b'\x89PNG')
    rows = json.loads((tmp_path / 'check.json').read_text())['rows']
    pads = [row for row in rows if 'pad' in row]
    assert all(row['rim'] == 'followed' and 95.0 < row['covers_percent'] < 100.0 for row in pads)
    refused = run('check', scene, '--picture', tmp_path / 'breast.jpg')
    assert refused.exit_code == 2 and 'name a file that ends on .png' in refused.stderr
    refused = run('check', scene, '--picture', tmp_path / 'nowhere' / 'breast.png')
    assert refused.exit_code == 2 and 'no such folder; make it first' in refused.stderr


@pytest.fixture
def block(tmp_path):
    """Callable: writes a block of 60 x 40 x 30 mm with a pad as a scene; returns its path."""
    mesh = box_mesh((0.06, 0.04, 0.03), (6, 4, 3))
    np.savez(tmp_path / 'block.npz', nodes=mesh.nodes, tets=mesh.tets)

    def write(marker=(30, 20, 30.5), unit='m'):
        path = tmp_path / 'block.yaml'
        path.write_text(
            f'name: block\nmesh: {{file: block.npz, unit: {unit}}}\n'
            'fixed: {kind: half_space, point_mm: [0, 0, 0.1], normal: [0, 0, -1]}\n'
            'pads: [{name: east, centre_mm: [60, 20, 15], direction: [-1, 0, 0], radius_mm: 12, '
            f'stroke_mm: 10}}]\nmarkers: [{{name: top, position_mm: {list(marker)}}}]\n')
        return path
    return write


def test_check_ends_with_1_where_something_cannot_be_meant(block, tmp_path):
    assert run('check', block()).exit_code == 0
    wrong = run('check', block((30, 20, 55)), '--picture', tmp_path / 'wrong.png',
                '--json', tmp_path / 'wrong.json')
    assert wrong.exit_code == 1 and 'wrong    marker top: 25 mm off the surface' in wrong.stdout
    assert wrong.stderr.count('\n') == 1 and '1 of its values cannot be meant' in wrong.stderr
    assert (tmp_path / 'wrong.png').stat().st_size > 10_000
    assert json.loads((tmp_path / 'wrong.json').read_text())['rows'][-1]['name'] == 'top'
    small = run('check', block(unit='mm'))
    assert small.exit_code == 1 and 'is the file in m? then set mesh unit: m' in small.stdout


def test_check_sets_strokes_beside_a_recording(block, tmp_path):
    (tmp_path / 'enc.csv').write_text('t_s,east\n0.0,0.0\n0.1,9.0\n0.2,14.0\n0.3,0.0\n')
    (tmp_path / 'map.yaml').write_text("name: rig\nencoders:\n- csv: {path: enc.csv, time: t_s}\n"
                                       "  columns: '{key}'\n  unit: mm\n")
    assert run('import', 'csv', tmp_path / 'map.yaml', '--out', tmp_path / 'bag').exit_code == 0
    short = run('check', block(), '--bag', tmp_path / 'bag')
    assert short.exit_code == 1
    assert 'stroke_mm = 10; must be at least the 14 mm that were recorded' in short.stdout


def test_check_lists_from_where_to_where_each_pad_went(block, tmp_path):
    for name, most in (('short', 3.0), ('long', 9.0)):
        (tmp_path / 'enc.csv').write_text(f't_s,east\n0.0,-0.02\n0.1,{most}\n0.2,0.5\n')
        (tmp_path / 'map.yaml').write_text(
            "name: rig\nencoders:\n- csv: {path: enc.csv, time: t_s}\n  columns: '{key}'\n"
            '  unit: mm\n')
        assert run('import', 'csv', tmp_path / 'map.yaml', '--out',
                   tmp_path / name).exit_code == 0
    answer = run('check', block(), '--bag', tmp_path / 'short', '--bag', tmp_path / 'long',
                 '--json', tmp_path / 'check.json')
    assert answer.exit_code == 0 and 'from_mm' in answer.stdout and 'to_mm' in answer.stdout
    rows = [row for row in json.loads((tmp_path / 'check.json').read_text())['rows']
            if 'from_mm' in row]
    assert [(Path(row['bag']).name, row['pad'], round(row['from_mm'], 6), row['to_mm'],
             row['stroke_mm']) for row in rows] == [
        ('short', 'east', -0.02, pytest.approx(3.0), 10.0),
        ('long', 'east', -0.02, pytest.approx(9.0), 10.0)]


@pytest.mark.parametrize(('E_kPa', 'N_mm', 'bent_mm'), [(2e8, 314, 0.01), (2e6, 3.1, 1.0)])
def test_rcm_prints_the_stiffness_that_the_page_of_the_probe_quotes(E_kPa, N_mm, bent_mm):
    words = f'--E-kPa {E_kPa} --polar-deg 60'.split()
    stiffness = float(re.search(r'radial_stiffness_N_m +(\S+)', run('rcm', *words).stdout)[1])
    assert float(f'{1e-3 * stiffness:.3g}') == pytest.approx(N_mm, abs=0.05)
    assert 3.0 / (1e-3 * stiffness) == pytest.approx(bent_mm, rel=0.06)
    page = (Path(__file__).parents[1] / 'docs' / 'probe.md').read_text(encoding='utf-8')
    assert f'{N_mm} N/mm' in page and f'bend it by {bent_mm} mm' in page


def test_a_scene_is_no_scenario_and_a_run_no_bag(block, bag, tmp_path):
    refused = run('run', block())
    assert refused.exit_code == 2 and 'is a scene; must be a scenario' in refused.stderr
    (tmp_path / 'finished').mkdir()
    bag.rename(tmp_path / 'finished' / 'bag')
    refused = run('evaluate', tmp_path / 'finished')
    assert refused.exit_code == 2 and refused.stderr.count('\n') == 1
    assert f'its bag is {tmp_path / "finished" / "bag"}' in refused.stderr


def test_reports_of_bags_side_by_side_are_kept_apart(tmp_path):
    """A run's own bag has its report beside it, recovered and imported ones one each."""
    folder = cli_run._report_folder
    assert folder(tmp_path / 'run' / 'bag') == tmp_path / 'run'
    apart = {folder(tmp_path / name) for name in ('mended_1', 'mended_2', 'cut.mcap')}
    assert apart == {tmp_path / f'{n}_report' for n in ('mended_1', 'mended_2', 'cut')}


def result(rows, targets=()):
    return Result('trial', 7, 'abc', 'here', tuple(rows), tuple(targets))


def test_a_table_wider_than_long_is_turned(capsys):
    rows = [{'task': f'task_{i}', **{f'figure_{k}_mm': 10 * i + k for k in range(12)}}
            for i in (1, 2)]
    output.show_table(result(rows))
    lines = [re.split(r'[|│┃]', line) for line in capsys.readouterr().out.splitlines()]
    cells = [[c.strip() for c in line[1:-1]] for line in lines if len(line) == 5]
    assert cells == [['task', 'task_1', 'task_2'],
                     *([f'figure_{k}_mm', str(10 + k), str(20 + k)] for k in range(12))]


def test_a_table_too_wide_for_the_terminal_is_cut_into_blocks(capsys, monkeypatch):
    monkeypatch.setattr(output, 'console', Console(width=80))
    rows = [{'marker': f'Tip-{i}', 'regime': 'held', **{f'figure_{k}_mm': 100 * i + k
                                                        for k in range(11)}} for i in range(14)]
    output.show_table(result(rows))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80 and not any('…' in line for line in lines)
    shown = [line for line in lines if 'Tip-13 ' in line]
    assert len(shown) > 1 and all('held' in line for line in shown)
    assert re.findall(r'1\d\d\d', ' '.join(shown)) == [str(1300 + k) for k in range(11)]


def test_sentences_are_wrapped_beside_their_row_on_80_columns(capsys, monkeypatch):
    """A sentence that is wider than the terminal was cut off from the number it belongs to."""
    monkeypatch.setattr(output, 'console', Console(width=80, soft_wrap=True))
    said = 'optical tissue_12 is off its prediction by 0.12 mm along x since 12.34 s, and on'
    output.show_table(result([{'found_s': 1.25 + i, 'departure': said} for i in range(3)]))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    first = next(line for line in lines if '1.25' in line)
    assert 'optical tissue_12' in first and sum('found_s' in line for line in lines) == 1


def test_rows_of_one_name_stay_apart_when_turned(capsys):
    output.show_table(result([{'task': 'a', 'x': 1, 'y': 2, 'z': 3},
                              {'task': 'a', 'x': 4, 'y': 5, 'z': 6}]))
    shown = capsys.readouterr().out
    assert 'a (1)' in shown and 'a (2)' in shown and '6' in shown


def test_several_results_are_one_json_that_loses_nothing():
    goal = Target('error', 0.1, 'mm', '< 0.3', True)
    merged = cli_run._merged([result([{'x': 1}], [goal]),
                              replace(result([{'y': 2}]), name='other')])
    assert merged.rows == ({'table': 'trial', 'x': 1}, {'table': 'other', 'y': 2})
    assert merged.targets == (goal,)


def test_missed_goals_are_bad_news():
    missed = Target('error', 0.5, 'mm', '< 0.3', False)
    unknown = Target('drift', float('nan'), 'mm', '< 1', None)
    output.refuse_missed([result([], [unknown])])
    with pytest.raises(ArmBrachyError, match='goals missed: error$') as caught:
        output.refuse_missed([result([], [missed, unknown])])
    assert caught.value.exit_status == 1


def test_a_path_is_printed_whole(bag, tmp_path):
    """A terminal of 80 columns would break a long path in two, and nobody could copy it."""
    deep = tmp_path / ('long_' * 20) / ('path_' * 20)
    answer = run('recover', bag, '--out', deep)
    assert str(Path(deep)) in answer.stdout


@pytest.mark.parametrize(('file', 'key', 'allowed'), [
    ('scene', 'stroke_mm', '0 to 200 mm'), ('scene', 'kind', 'half_space'),
    ('scenario', 'horizon', 'whole number'), ('scenario', 'nu', '0 to 0.4999'),
    ('calibration', 'touch_mm', '0 to 10 mm')])
def test_keys_lists_what_a_file_may_hold(file, key, allowed):
    lines = run('keys', file).stdout.splitlines()
    assert any(line.split()[:1] == [key] and allowed in line for line in lines)


def test_rows_with_other_keys_get_a_table_of_their_own(capsys):
    output.show_table(result([{'x': 1, 'y': 2}, {'x': 3, 'y': 4}, {'name': 'a', 'z': 5},
                              {'name': 'b', 'z': 6}]))
    shown = capsys.readouterr().out
    assert shown.count('trial') == 2
    assert not re.search(r'[│┃]\s+-\s+[│┃]', shown)
