"""Scenario files: what they name, what is refused, and that a recorded one is complete."""

import dataclasses
import re
from pathlib import Path

import pytest
import yaml

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import Scene, load_scene
from arm_brachy.scenario import Scenario, bundle, load_cell, resolve, unbundle

SCENARIOS = sorted((config_dir() / 'scenarios').glob('*.yaml'))
SCENES = sorted((config_dir() / 'scenes').glob('*.yaml'))
BREAST = config_dir() / 'scenes' / 'breast.yaml'


def names(paths):
    return [p.stem for p in paths]


@pytest.fixture
def files(tmp_path):
    """Writes a scenario, and beside it a scene, changed from working ones; returns its path."""
    def write(scenario=None, scene=None):
        body = yaml.safe_load(BREAST.read_text())
        body['mesh']['file'] = str((BREAST.parent / body['mesh']['file']).resolve())
        for change in [scene] if scene else []:
            change(body)
        (tmp_path / 'scene.yaml').write_text(yaml.safe_dump(body, sort_keys=False))
        given = {'name': 'trial', 'seed': 3, 'scene': 'scene.yaml', **(scenario or {})}
        path = tmp_path / 'trial.yaml'
        path.write_text(yaml.safe_dump(given, sort_keys=False))
        return path
    return write


def refusal(path):
    with pytest.raises(ConfigError) as caught:
        load_cell(path)
    assert '\n' not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize('path', SCENARIOS, ids=names(SCENARIOS))
def test_every_scenario_of_the_project_loads(path):
    cell = load_cell(path)
    assert cell.scenario.name == path.stem
    assert Path(cell.plant.mesh.file).is_file() and Path(cell.model.mesh.file).is_file()


@pytest.mark.parametrize('path', SCENES, ids=names(SCENES))
def test_every_scene_of_the_project_loads_and_comes_back(path):
    scene = load_scene(path)
    assert scene.name == path.stem
    assert Path(scene.mesh.file).is_absolute() and Path(scene.mesh.file).is_file()
    assert config.from_mapping(Scene, config.to_mapping(scene), 'x') == scene


@pytest.mark.parametrize('path', SCENARIOS, ids=names(SCENARIOS))
def test_every_scenario_comes_back_from_its_mapping(path):
    scenario = config.load(Scenario, path)
    assert config.from_mapping(Scenario, config.to_mapping(scenario), 'x') == scenario


@pytest.mark.parametrize('path', SCENARIOS, ids=names(SCENARIOS))
def test_a_bundle_unpacked_elsewhere_gives_the_same_cell(path, tmp_path):
    cell = load_cell(path)
    copy = load_cell(unbundle(bundle(cell), tmp_path / 'elsewhere'))
    for side in ('scene', 'plant', 'model'):
        ours, theirs = getattr(cell, side), getattr(copy, side)
        assert Path(ours.mesh.file).read_bytes() == Path(theirs.mesh.file).read_bytes()
        assert Path(theirs.mesh.file).parent == tmp_path / 'elsewhere'
        assert dataclasses.replace(theirs, mesh=ours.mesh) == ours
    assert (copy.plant_terms, copy.model_terms) == (cell.plant_terms, cell.model_terms)
    assert (copy.em_tools, copy.tick_ns) == (cell.em_tools, cell.tick_ns)
    assert dataclasses.replace(
        copy.scenario, scene=cell.scenario.scene, plant=cell.scenario.plant,
        model=cell.scenario.model) == cell.scenario


def test_a_bundle_of_a_bundle_is_the_same_bundle(tmp_path):
    first = bundle(load_cell(SCENARIOS[-1]))
    assert bundle(load_cell(unbundle(first, tmp_path))) == first


def test_a_bundle_without_scenario_is_refused(tmp_path):
    with pytest.raises(ConfigError, match='arm-brachy replay BAG --scenario FILE'):
        unbundle({'columns.yaml': 'x'}, tmp_path / 'new')
    assert not (tmp_path / 'new').exists()


def test_an_overlay_changes_its_side_only(files):
    cell = load_cell(files({'plant': {'E_kPa': 9, 'terms': [{'name': 'backlash'}]},
                            'model': {'nu': 0.3}}))
    assert cell.scene.material.E == cell.model.material.E == 6e3
    assert cell.plant.material.E == 9e3
    assert (cell.plant.material.nu, cell.model.material.nu) == (cell.scene.material.nu, 0.3)
    assert [t.spec.name for t in cell.plant_terms] == ['backlash'] and cell.model_terms == ()
    assert cell.plant.mesh == cell.model.mesh == cell.scene.mesh


def test_an_overlay_names_its_mesh_relative_to_the_scenario(files, tmp_path):
    mesh = Path(load_scene(BREAST).mesh.file)
    (tmp_path / 'other.msh').write_bytes(mesh.read_bytes())
    cell = load_cell(files({'plant': {'mesh': {'file': 'other.msh'}}}))
    assert cell.plant.mesh.file == str(tmp_path / 'other.msh')
    assert cell.model.mesh.file == str(mesh)


def test_em_tools_are_those_listed_else_those_of_the_tasks_else_all(files):
    task = {'target': 'target_2', 'axes': ['x'], 'displacement_mm': [1, 0, 0]}
    assert load_cell(files()).em_tools == tuple(f'target_{i}' for i in range(1, 6))
    tasks = [{'name': 'a', **task}, {'name': 'b', **task}]
    assert load_cell(files({'tasks': tasks})).em_tools == ('target_2',)
    listed = ['target_5', 'target_2']
    assert load_cell(files({'tasks': tasks, 'em_tools': listed})).em_tools == tuple(listed)


def task(**changes):
    return {'tasks': [{'name': 'a', 'target': 'target_1', 'axes': ['x'],
                       'displacement_mm': [1, 0, 0], **changes}]}


def move(pads=({'name': 'pad_2', 'position_mm': 6},), **changes):
    return {'moves': [{'name': 'a', 'speed_mm_s': 5, 'pads': list(pads), **changes}]}


def test_moves_are_read_in_si(files):
    given = move(hold_s=3, cycles=2, others='home')
    found, = load_cell(files(given)).scenario.moves
    assert (found.speed, found.hold, found.cycles, found.others) == (5e-3, 3.0, 2, 'home')
    assert [(p.name, p.position) for p in found.pads] == [('pad_2', 6e-3)]
    assert load_cell(files(move())).scenario.moves[0].cycles == 0


def test_a_hold_of_two_ticks_and_the_braking_time_is_enough(files):
    fine = {'tick_ms': 40, **move(speed_mm_s=10, hold_s=0.13)}
    assert load_cell(files(fine)).scenario.moves[0].hold == 0.13


def procedure(**given):
    return {'feedback': 'pod', 'procedure': {'target': 'target_1'}, **given}


PAD_2, PAD_9 = ({'name': name, 'position_mm': 6} for name in ('pad_2', 'pad_9'))
WRONG_SCENARIOS = [
    ({'scene': 'none.yaml'}, r'none\.yaml: no such file'),
    ({'scene': '.'}, 'cannot be read: Is a directory'),
    ({'seed': -1}, r'trial\.yaml:2: seed = -1; must be at least 0'),
    ({'tick_ms': 16.6666667}, r':4: tick_ms = 16\.6666667; must be a whole number of nanoseconds'),
    ({'tick_ms': 500}, r':4: tick_ms = 500; must be 1 to 250 ms'),
    ({'actuators': {'stroke_mm': 25}},
     r':5: actuators\.stroke_mm = 25; must be at least the 30 mm of pad_1 in scene breast'),
    ({'actuators': {'stroke_mm': -5}}, r'actuators\.stroke_mm = -5; must be 1 to 1000 mm'),
    ({'plant': {'terms': [{'name': 'backlsh'}]}}, r"plant\.terms\[0\].*did you mean 'backlash'"),
    ({'plant': {'terms': [{'name': 'backlash', 'width': 1}]}}, "did you mean 'width_mm'"),
    ({'plant': {'terms': [{'name': 'backlash', 'width_mm': -1}]}}, 'width_mm = -1; must be 0'),
    ({'model': {'terms': [{'width_mm': 1}]}}, r'model\.terms\[0\].*mapping with a name'),
    ({'plant': {'mesh': {'file': 'gone.msh'}}}, r'gone\.msh: no such mesh file.*plant of'),
    ({'plant': {'nu': 0.5}}, r'plant\.nu = 0\.5; must be 0 to 0\.4999'),
    ({'em_tools': ['target_9']}, r':5: em_tools\.0 = .target_9.; must be a target of'),
    ({'em_tools': ['target_1', 'target_1']}, 'em_tools.1 = .target_1. is given twice'),
    (task(target='tumour'), r':6: tasks\.0\.target = .tumour.; must be a target.*target_1'),
    (task(axes=[]), r'tasks\.0\.axes = \[\]; must be one to three of x, y, z'),
    (task(axes=['x', 'x']), 'must be one to three of x, y, z, each once'),
    (task(axes=['w']), r"tasks\.0\.axes\.0 = 'w'; must be 'x', 'y' or 'z'"),
    (task(duration_s=0), r'tasks\.0\.duration_s = 0; must be 0\.1 to 3600 s'),
    ({'tasks': task()['tasks'] * 2}, r'tasks\.1\.name = .a. is given twice; names must differ'),
    ({'limits': {'pad_force_N': 50}, 'force': {'range_N': 50}},
     r':5: limits\.pad_force_N = 50; must be below the 50 N of force\.range_N'),
    ({**task(), **move()}, r':\d+: moves = 1 beside tasks = 1; must be one or the other'),
    ({'moves': move()['moves'] * 2}, r'moves\.1\.name = .a. is given twice; names must differ'),
    (move([PAD_2, PAD_9]), r"trial\.yaml:10: moves\.0\.pads\.1\.name = 'pad_9'; must be a pad of "
                           r'scene breast: pad_1, pad_2, pad_3, pad_4'),
    (move([PAD_2, PAD_2]), r"moves\.0\.pads\.1\.name = 'pad_2' is given twice"),
    (move([{'name': 'pad_2', 'position_mm': 30.1}]),
     r'moves\.0\.pads\.0\.position_mm = 30\.1; must be at most the 30 mm stroke of pad_2 in'),
    (move([{'name': 'pad_2', 'position_mm': -1}]),
     r'moves\.0\.pads\.0\.position_mm = -1; must be 0 to 1000 mm'),
    (move([{'name': 'pad_2', 'position': 1}]), "did you mean 'position_mm'"),
    (move(speed_mm_s=20.1), r'trial\.yaml:6: moves\.0\.speed_mm_s = 20\.1; must be at most the '
                            r'20 mm/s of actuators\.max_speed_mm_s'),
    (move(speed_mm_s=0), r'moves\.0\.speed_mm_s = 0; must be 0\.01 to 1000 mm/s'),
    (move(speed_mm_s=10, hold_s=0.14), r'moves\.0\.hold_s = 0\.14; must be at least 0\.15: two'),
    (move(cycles=-1), r'moves\.0\.cycles = -1; must be at least 0'),
    (move(cycles=1.5), r'moves\.0\.cycles = 1\.5; must be a whole number'),
    (move(others='back'), r"moves\.0\.others = 'back'; must be 'stay' or 'home'"),
    ({'pace': 'fast'}, "pace = 'fast'; must be 'lockstep' or 'wall'"),
    ({'feedback': 'eyes'}, "feedback = 'eyes'; must be 'em', 'kf_admm', 'graph_vae', 'map' or"),
    ({'feedback': 'pod', 'estimation': {'fewest': 20}},
     r":4: feedback = 'pod'; needs a target and 20 markers on tissue in scene breast, .*5 and 19"),
    ({'estimators': ['map'], 'estimation': {'fewest': 20}}, r":4: estimators = \['map'\]; needs"),
    ({'needle': {'points': 0}}, r':5: needle\.points = 0; must be a whole number, 2 to 1000'),
    ({'needle': {'row': -1}}, r':5: needle\.row = -1; must be a whole number, at least 0'),
    ({'ultrasound': {'cavity': {'planes': 0}}},
     r':6: ultrasound\.cavity\.planes = 0; must be a whole number, 2 to 1000'),
    ({'probe': {'scan': {'neighbours': 0}}},
     r':6: probe\.scan\.neighbours = 0; must be a whole number, 4 to 10000'),
    ({'map': {'iterations': 0}}, r':5: map\.iterations = 0; must be a whole number, 1 to 1000'),
    ({'map': {'iterations': 1.5}}, r'map\.iterations = 1\.5; must be a whole number, 1 to 1000'),
    ({'pod': {'modes': 0}}, r'pod\.modes = 0; must be a whole number, 1 to 1000'),
    (procedure(template={'columns': -3}),
     r':8: template\.columns = -3; must be a whole number, 1 to 100'),
    (procedure(template={'columns': 5}), r'needle\.column = 6; must be 0 to 4, a hole of'),
    ({'probe': {'release_N': 0.3}}, r'probe: release_N = 0\.3 with touch_N = 0\.3; must be less'),
    ({'probe': {'home_mm': [0, 0, 300]}}, r'home_mm = \(0, 0, 300\), 300 mm from the or'),
    ({'probe': {'home_mm': [0, 0, 2]}}, r'home_mm .* not below floor_mm = 5'),
    ({'probe': {'touch_N': 3}}, r'probe: touch_N = 3 with force_N = 3; must be less: release_N <'),
    ({'probe': {'force_N': 9}}, r'probe: force_N = 9 with force_most_N = 8; must be less'),
    (procedure(probe={'force_N': 10, 'force_most_N': 12}),
     r':8: probe\.force_N = 10; must be below the 10 N of limits\.probe_force_N'),
    (procedure(tick_ms=12.5), r':7: tick_ms = 12\.5; must be a multiple of 1 ms, the period'),
]


@pytest.mark.parametrize('change,says', WRONG_SCENARIOS, ids=[w[1][:30] for w in WRONG_SCENARIOS])
def test_a_scenario_that_cannot_run_is_refused(files, change, says):
    assert re.search(says, refusal(files(change)))


def test_a_wrong_term_is_told_by_its_line(files):
    terms = [{'name': 'backlash'}, {'name': 'backlash', 'width_mm': -1}]
    path = files({'plant': {'terms': terms}})
    line = 1 + path.read_text().splitlines().index('    width_mm: -1')
    assert f':{line}: ' in refusal(path)


def rename(kind, i, name):
    def renamed(scene):
        old = scene[kind][i]['name']
        scene[kind][i]['name'] = name
        for marker in scene['markers']:
            if marker.get('body') == old:
                marker['body'] = name
    return renamed


WRONG_SCENES = [
    (rename('pads', 1, 'pad_1'), r"scene\.yaml:\d+: pads\.1\.name = 'pad_1' is given twice"),
    (rename('markers', 3, 'tissue_1'), r"markers\.3\.name = 'tissue_1' is given twice"),
    (rename('targets', 2, 'target_1'), r"targets\.2\.name = 'target_1' is given twice"),
    (rename('targets', 0, 'tissue_1'), r"targets\.0\.name = 'tissue_1' is given twice"),
    (rename('targets', 0, 'my target'), "'my target'; must be letters, digits and _"),
    (lambda scene: scene['markers'][0].update(body='pad1'),
     r"scene\.yaml:\d+: markers\.0\.body = 'pad1'; must be one of tissue, base, pad_1, pad_2"),
    (rename('pads', 0, '1st'), "'1st'; must be letters, digits and _, a letter first"),
    (lambda scene: scene['pads'][2].update(direction=[0, 0, 0]),
     r'pads\.2\.direction = \[0\.0, 0\.0, 0\.0\]; must not be zero'),
    (lambda scene: scene['pads'][0].update(stroke_mm=-3), r'pads\.0\.stroke_mm = -3; must be 0'),
    (lambda scene: scene['pads'][0].update(stroke_mm=51),
     'actuators.stroke_mm = 50; must be at least the 51 mm of pad_1'),
    (lambda scene: scene['mesh'].update(file='gone.msh'), 'gone.msh: no such mesh file'),
    (lambda scene: scene.pop('fixed'), "key 'fixed' is missing"),
    (lambda scene: scene.update(stifness=3), "unknown key 'stifness'"),
]


@pytest.mark.parametrize('change,says', WRONG_SCENES, ids=[w[1][:30] for w in WRONG_SCENES])
def test_a_scene_that_cannot_serve_is_refused(files, change, says):
    assert re.search(says, refusal(files(scene=change)))


def test_a_marker_may_share_the_name_of_the_pad_that_carries_it():
    scene = load_scene(BREAST)
    assert {p.name for p in scene.pads} <= {m.name for m in scene.markers}


def test_a_scenario_made_in_python_is_checked_too(tmp_path):
    path = tmp_path / 'never_written.yaml'
    with pytest.raises(ConfigError, match=r'never_written\.yaml: seed = -1'):
        resolve(Scenario('x', -1, str(BREAST)), path)
    cell = resolve(Scenario('x', 1, str(BREAST)), path)
    assert cell.tick_ns == round(cell.scenario.tick * 1e9)


def test_pads_are_named_or_numbered_in_terms(files):
    def actuators(given):
        return load_cell(files({'plant': {'terms': [
            {'name': 'backlash', 'width_mm': 0.3, 'actuators': given}]}})).plant_terms[0].actuators

    assert actuators(['pad_3', 'pad_1']) == actuators([2, 0]) == (2, 0)
    metal = {'name': 'em_distortion', 'pad': 'pad_2'}
    assert load_cell(files({'plant': {'terms': [metal]}})).plant_terms[0].pad == 1
    wrong = refusal(files({'model': {'terms': [{'name': 'backlash', 'actuators': ['pad_9']}]}}))
    assert "model.terms[0] backlash: actuators = 'pad_9'; must be among pad_1, pad_2" in wrong


def test_what_was_recorded_with_names_of_pads_loads_again(files, tmp_path):
    cell = load_cell(files({'plant': {'terms': [{'name': 'lost_steps', 'actuators': ['pad_2']}]}}))
    again = load_cell(unbundle(bundle(cell), tmp_path / 'again'))
    assert again.plant_terms == cell.plant_terms and again.plant_terms[0].actuators == (1,)


def test_damping_of_an_overlay_is_that_of_its_side_alone(files):
    cell = load_cell(files({'plant': {'rayleigh_alpha_per_s': 2.0, 'rayleigh_beta_ms': 1.5}}))
    assert (cell.plant.rayleigh_alpha, cell.plant.rayleigh_beta) == (2.0, 1.5e-3)
    assert cell.model.rayleigh_alpha == cell.scene.rayleigh_alpha == 0.0


PROCEDURE = 'procedure: {target: target_1'


@pytest.mark.parametrize(('text', 'said'), [
    (f'feedback: map\n{PROCEDURE}, hole: [13, 0]}}', r'hole = \[13, 0\]; must be a column from 0 '
                                                     'to 12'),
    (f'feedback: map\n{PROCEDURE}, hole: [13]}}', r'hole = \[13\]; must be a column'),
    (f'feedback: map\n{PROCEDURE}}}\nneedle: {{max_speed_mm_s: 30}}',
     r'withdrawal_mm_s = 40; must be at most 30, needle\.max_speed_mm_s'),
    (f'feedback: map\n{PROCEDURE}}}\nneedle: {{depth_rate_Hz: 1}}',
     r'needle_age_s = 0\.5; must be above 1\.07'),
    (f'feedback: map\n{PROCEDURE}}}\nultrasound: {{image: {{rate_Hz: 1}}}}',
     r'tip_patience_s = 0\.5; must be at least 1, the time from one image'),
    (f'feedback: map\n{PROCEDURE}, hole: [1, 2, 3]}}', r'hole = \[1, 2, 3\]; must be a column'),
    (f'feedback: map\n{PROCEDURE}, axes: [x, x]}}', r"axes = \['x', 'x'\]; must be one to three"),
    (f'{PROCEDURE}}}', "feedback = 'em'; must be an estimator"),
    ('feedback: map\nprocedure: {target: nobody}', "target = 'nobody'; must be a target"),
    (f'feedback: map\n{PROCEDURE}}}\ntasks: [{{name: a, target: target_1, axes: [x], '
     'displacement_mm: [1, 0, 0]}]', 'procedure beside tasks = 1; must be one of them'),
])
def test_a_procedure_that_cannot_be_is_one_line(tmp_path, text, said):
    path = tmp_path / 'x.yaml'
    path.write_text(f'name: x\nseed: 1\nscene: {BREAST}\n{text}\n')
    with pytest.raises(ConfigError, match=said) as why:
        load_cell(path)
    assert '\n' not in str(why.value)
