"""What a probe does to a target by the model: along its axis, to scale with force and modulus."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.cell import foretold_press
from arm_brachy.control.probe_press import pressed
from arm_brachy.core.paths import config_dir
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.build import load_scene_mesh
from arm_brachy.tissue.probe_face import ProbeFace

DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope='module')
def cell():
    return load_cell(config_dir() / 'scenarios/procedure.yaml')


@pytest.fixture(scope='module')
def scene(cell):
    return cell.model


def moved(scene, force=1.0, deepest=0.025, off=0.0):
    top = load_scene_mesh(scene).nodes[:, 2].max() + off
    return pressed(scene, (), 'target_1', DOWN, np.array([0.0, 0.0, top]), force=force,
                   face=ProbeFace(), deepest=deepest)


def test_a_target_under_the_probe_goes_into_the_body_and_less_deep_than_the_skin(scene):
    light, heavy = moved(scene, 0.5), moved(scene, 1.0)
    assert np.linalg.norm(heavy[:2]) < 0.2 * -heavy[2]
    assert 0.4 < light[2] / heavy[2] < 0.6      # nearly linear at small forces
    shallow = moved(scene, 100.0, deepest=3e-3)
    assert -3e-3 < shallow[2] < -1e-4           # no deeper than it may, whatever the force
    aloft = moved(scene, 1.0, deepest=2e-3, off=10e-3)     # it does not touch
    np.testing.assert_allclose(aloft, 0.0, atol=1e-6)      # the contact solver's tolerance


def test_twice_the_force_does_to_twice_the_modulus_what_one_does_to_one(scene):
    """Quasi-static equilibrium and the contact's layer scale with the modulus."""
    stiff = replace(scene, material=replace(scene.material, E=2.0 * scene.material.E))
    np.testing.assert_allclose(moved(stiff, 1.0), moved(scene, 0.5), atol=5e-6)


def test_the_procedure_asks_for_it_where_its_probe_will_stand_and_only_if_it_wants_to(cell):
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    down = foretold_press(cell, along)
    top = load_scene_mesh(cell.model).nodes[:, 2].max()
    target = next(t for t in cell.model.targets if t.name == cell.scenario.procedure.target)
    assert top - target.position[2] == pytest.approx(31e-3, abs=0.5e-3)     # docs/probe.md
    assert cell.scenario.probe.force == 3.0 and down[2] == pytest.approx(-3.1e-3, abs=0.1e-3)
    assert np.linalg.norm(down[:2]) < 0.5e-3
    procedure = replace(cell.scenario.procedure, foresee=False)
    blind = replace(cell, scenario=replace(cell.scenario, procedure=procedure))
    assert not foretold_press(blind, along).any()
