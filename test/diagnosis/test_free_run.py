"""A released body's corrected scenario: it runs, is let go as recorded, and rings as it did."""

from dataclasses import replace

import numpy as np
import pytest
from ruamel.yaml import YAML

from arm_brachy import inprocess
from arm_brachy.core.config import to_mapping
from arm_brachy.core.scene import Marker, Material, MeshFile, Region, Scene, load_scene
from arm_brachy.diagnosis.free_vibration.corrected_run import TICK, as_let_go
from arm_brachy.diagnosis.free_vibration.look import Look
from arm_brachy.diagnosis.report.answer import Diagnosis, Provenance
from arm_brachy.diagnosis.report.corrected_scenario import base_scenario, write_corrected
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.box import box_mesh

SIZE = (0.08, 0.024, 0.024)     # m, glued at x = 0
MARKERS = (Marker('tip', (0.08, 0.012, 0.024)), Marker('edge', (0.08, 0.024, 0.012)),
           Marker('half', (0.045, 0.012, 0.024)),
           *(Marker(f'base_{i}', p, 'base') for i, p in enumerate((
               (-0.01, -0.02, 0.0), (-0.01, 0.04, 0.0), (-0.01, 0.0, 0.04)))))
RELEASE, LASTS = 0.405, 2.5     # s
RELAXES = Cause('viscoelasticity', {'g1': Estimate(0.1, 0.08, 0.12),
                                    'tau1': Estimate(0.5, 0.3, 0.8)})


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """bare.yaml, without damping, and damped.yaml on one mesh of linear elements."""
    folder = tmp_path_factory.mktemp('block')
    mesh = box_mesh(SIZE, (6, 2, 2))
    np.savez(folder / 'block.npz', nodes=mesh.nodes, tets=mesh.tets)
    scene = Scene('block', MeshFile('block.npz'),
                  Region('half_space', point=(1e-6, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)), 'linear',
                  Material(60e3, 0.45, 1000.0), 'implicit', (0.0, 0.0, -9.81), markers=MARKERS)
    for name, damping in (('bare', {}), ('damped', {'rayleigh_alpha': 3.0,
                                                    'rayleigh_beta': 1e-3})):
        with (folder / f'{name}.yaml').open('w') as file:
            YAML(typ='safe').dump(to_mapping(replace(scene, **damping)), file)
    return folder


def run(path, until=np.inf):
    loop = inprocess.InProcess(load_cell(path), ('optical',))
    while not loop.finished and loop.t < until:
        loop.tick()
    return loop.data()


@pytest.fixture(scope='module')
def recorded(folder):
    """Evidence of the damped block, its scene said to have no damping."""
    path = folder / 'scenario.yaml'
    path.write_text(f'name: block\nseed: 3\nscene: damped.yaml\ntick_ms: 10\nsettle_s: {LASTS}\n'
                    f'release_s: {RELEASE}\n')
    return evidence_of(run(path), load_scene(folder / 'bare.yaml'))


def corrected(folder, evidence, causes, name):
    verdict = 'named' if causes else 'nothing_missing'
    found = Diagnosis(verdict, Provenance('block', 0, 'none', 'none', 'bare.yaml', ()), causes,
                      recalibrated={'E': Estimate(60e3, 59e3, 61e3)})
    base = as_let_go(base_scenario(folder / 'bare.yaml', 'block', 0), (evidence,), 0)
    return write_corrected(found, base, folder / name)


def test_it_is_let_go_when_the_recording_was_and_lasts_as_long(folder, recorded):
    scenario = load_cell(corrected(folder, recorded, (), 'times.yaml')).scenario
    start, end = recorded.span
    assert scenario.release == pytest.approx(RELEASE - start, abs=0.02)
    assert scenario.release + scenario.settle == pytest.approx(end - start, abs=1e-9)
    assert scenario.tick == TICK


def test_it_rings_as_long_as_the_recording(folder, recorded):
    """Another run of what was read off gives frequency and damping ratio again."""
    again = evidence_of(run(corrected(folder, recorded, (), 'rings.yaml')), recorded.scene)
    before, after = (Look(prepare(one)).release.ring for one in (recorded, again))
    assert after.frequency == pytest.approx(before.frequency, rel=0.01)
    assert after.damping == pytest.approx(before.damping, rel=0.1)


def test_a_body_that_relaxes_runs(folder, recorded):
    path = corrected(folder, recorded, (RELAXES,), 'relaxes.yaml')
    assert [t.spec.name for t in load_cell(path).plant_terms] == ['viscoelasticity']
    found = run(path, until=RELEASE + 0.2)
    tip = found.optical.points[:, found.optical.ids.index('tip'), 2]
    assert tip[0] - tip.min() > 1e-3 and not found.outcomes


def test_damping_of_the_scene_is_kept(folder, recorded):
    known = replace(recorded, scene=load_scene(folder / 'damped.yaml'))
    base = as_let_go(base_scenario(folder / 'damped.yaml', 'block', 0), (known,), 0)
    assert base.plant.rayleigh_alpha is None and base.model.rayleigh_beta is None
