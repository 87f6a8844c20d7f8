"""The corrected scenario: read back, run, carried elsewhere."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.control.moves import Move, PadTarget
from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import MeshFile
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.diagnosis.report.corrected_scenario import (
    base_scenario,
    with_absolute_paths,
    write_corrected,
)
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.registry import to_entries
from arm_brachy.scenario import Overlay, bundle, load_cell, unbundle

SCENES = config_dir() / 'scenes'
PUSH = Move('push', 20e-3, (PadTarget('pad_1', 2e-3),), hold=0.3)
COARSE = Overlay(mesh=MeshFile(str(SCENES / 'breast' / 'breast_600.msh')), element='linear')
LUMP = [{'name': 'inclusion', 'centre_mm': [18.2, 8.1, 28.4], 'radius_mm': 9.3, 'ratio': 5.6}]


@pytest.fixture
def base():
    return replace(base_scenario(SCENES / 'breast.yaml', 'lump', 7, (PUSH,)), settle=0.1,
                   model=COARSE)


@pytest.fixture
def written(answers, base, tmp_path):
    return write_corrected(answers['named'], base, tmp_path / 'corrected.yaml')


def test_both_sides_carry_what_was_found(written):
    cell = load_cell(written)
    assert to_entries(cell.model_terms) == to_entries(cell.plant_terms) == LUMP
    assert cell.plant.material.E == cell.model.material.E == pytest.approx(6.31e3)
    assert cell.scene.material.E == pytest.approx(6.0e3)   # the scene itself is as it was
    assert cell.plant.mesh == cell.model.mesh and cell.plant.element == 'linear'
    assert cell.scenario.moves == (PUSH,) and cell.scenario.seed == 7


def test_every_value_has_its_interval_beside_it(written):
    text = written.read_text(encoding='utf-8')
    assert text.startswith('# Missing from the model: inclusion')
    assert text.count('E_kPa: 6.31  # 90 % interval 6.18 to 6.44 kPa') == 2
    assert 'radius_mm: 9.3 # 90 % interval 7.1 to 11.8 mm' in text
    assert 'seed 20260211, commit 3ccca86' in text


def test_only_departures_are_written(written):
    text = written.read_text(encoding='utf-8')
    assert 'control' not in text and 'limits' not in text and 'null' not in text


def test_the_bundle_stands_alone(written, tmp_path):
    away = unbundle(bundle(load_cell(written)), tmp_path / 'away')
    written.unlink()
    cell = load_cell(away)
    assert to_entries(cell.model_terms) == LUMP and cell.plant.material.E == pytest.approx(6.31e3)


def test_it_moves_with_its_scenes(answers, base, tmp_path):
    shutil.copytree(SCENES, tmp_path / 'here' / 'scenes')
    scenes = tmp_path / 'here' / 'scenes'
    own = replace(base, scene=str(scenes / 'breast.yaml'),
                  model=replace(COARSE, mesh=MeshFile(str(scenes / 'breast' / 'breast_600.msh'))))
    write_corrected(answers['named'], own, tmp_path / 'here' / 'corrected.yaml')
    (tmp_path / 'here').rename(tmp_path / 'there')
    moved = load_cell(tmp_path / 'there' / 'corrected.yaml')
    assert to_entries(moved.model_terms) == LUMP


def test_a_recordings_own_plant_is_not_taken_over(answers, tmp_path):
    cell = load_cell(config_dir() / 'scenarios' / 'probe_rich.yaml')
    path = write_corrected(answers['structural'], with_absolute_paths(cell),
                           tmp_path / 'corrected.yaml')
    new = load_cell(path)
    assert len(cell.plant_terms) == 5
    assert new.plant_terms == (Backlash(0.31e-3, (0,)),)
    assert new.plant.mesh == cell.model.mesh
    assert new.scenario.moves == cell.scenario.moves
    assert new.scenario.force == cell.scenario.force


def test_a_term_that_the_model_had_is_replaced(answers, base, tmp_path):
    had = replace(base, model=replace(COARSE, terms=(
        {'name': 'backlash', 'width_mm': 0.1}, {'name': 'stiffness_scale', 'factor': 1.1})))
    cell = load_cell(write_corrected(answers['structural'], had, tmp_path / 'c.yaml'))
    assert [term.spec.name for term in cell.model_terms] == ['stiffness_scale', 'backlash']
    assert cell.model_terms[1].width == pytest.approx(0.31e-3)


def test_of_options_the_likeliest_is_written(answers, base, tmp_path):
    path = write_corrected(answers['equivalent'], base, tmp_path / 'c.yaml')
    assert [term.spec.name for term in load_cell(path).model_terms] == ['actuator_gain']
    assert '# Written for the most probable: actuator gain.' in path.read_text(encoding='utf-8')


def push_force(path):
    """(force of pad 1 along its push [N], travel of its pad [m]) at the end of a run."""
    cell = load_cell(path)
    quiet = replace(cell.scenario.force, noise=0.0, resolution=1e-6)
    run = inprocess.run(replace(cell, scenario=replace(cell.scenario, force=quiet)),
                        sensors=('force',), go_home=False)
    return abs(run.force.values[-1, 0, 0]), run.pad_displacement.values[-1, 0]


def test_a_run_shows_the_corrected_physics(answers, base, tmp_path):
    """Force is proportional to E where pads are driven by displacements; play shortens a push."""
    def run(name, E, causes):
        d = replace(answers['structural'], causes=causes,
                    recalibrated={'E': Estimate(E, 0.9 * E, 1.1 * E)})
        return push_force(write_corrected(d, base, tmp_path / name))

    none = (Cause('backlash', {'width': Estimate(0.0, 0.0, 0.0)}),)
    soft, full = run('soft.yaml', 6e3, none)
    stiff, _ = run('stiff.yaml', 12e3, none)
    assert full == pytest.approx(2e-3, rel=1e-3)
    assert stiff / soft == pytest.approx(2.0, rel=1e-4)
    _, short = run('play.yaml', 6e3, answers['structural'].causes)
    assert full - short == pytest.approx(0.31e-3, rel=1e-3)


def test_nothing_found_is_nothing_to_write(answers, base, tmp_path):
    empty = replace(answers['nothing_missing'], recalibrated={})
    with pytest.raises(InputError, match='as given is the best'):
        write_corrected(empty, base, tmp_path / 'c.yaml')
    mesh = replace(answers['structural'], causes=(Cause('discretisation'),))
    with pytest.raises(InputError, match='as given is the best'):
        write_corrected(mesh, base, tmp_path / 'c.yaml')


def test_a_value_that_its_term_forbids_is_refused_with_its_line(answers, base, tmp_path):
    wild = (Cause('inclusion', {'radius': Estimate(0.2, 0.1, 0.3)}),)
    place = r'c\.yaml: .*inclusion:\d+: radius_mm = 200\.0; must be'
    with pytest.raises(ConfigError, match=place):
        write_corrected(replace(answers['named'], causes=wild), base, tmp_path / 'c.yaml')
    assert not (tmp_path / 'c.yaml').exists()


def test_recalibration_alone_is_written(answers, base, tmp_path):
    cell = load_cell(write_corrected(answers['nothing_missing'], base, tmp_path / 'c.yaml'))
    assert cell.model_terms == () and np.isclose(cell.plant.material.E, 5.96e3)
