"""Scenes that cannot be meant are told from those that can, by the name of what is wrong."""

import re
from dataclasses import replace

import pytest

from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import (
    Marker,
    Material,
    MeshFile,
    PadPatch,
    PointLoad,
    Region,
    Scene,
    Target,
    load_scene,
)
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import TetMesh, load_mesh
from arm_brachy.tissue.scene_faults import scene_faults, size_faults, stroke_faults

SIZE = (0.06, 0.04, 0.03)   # m, held at z = 0
PAD = PadPatch('east', (0.06, 0.02, 0.015), (-1.0, 0.0, 0.0), radius=0.01, stroke=0.01)
SCENE = Scene(
    'block', MeshFile('none.msh'), Region('set', set='z0'), material=Material(10e3, 0.45, 1000.0),
    pads=(PAD,),
    markers=(Marker('top', (0.03, 0.02, 0.0305)), Marker('floor', (0.07, 0.04, 0.0), 'base')),
    targets=(Target('lump', (0.03, 0.02, 0.02)),))


@pytest.fixture(scope='module')
def mesh():
    return box_mesh(SIZE, (12, 8, 6))


def faults_of(scene, mesh):
    return scene_faults(scene, build_body(scene, mesh))


def marked(*position):
    return replace(SCENE, markers=(Marker('m', tuple(1e-3 * p for p in position)),))


def aimed(*position):
    return replace(SCENE, targets=(Target('t', tuple(1e-3 * p for p in position)),))


def made(**material):
    return replace(SCENE, material=replace(SCENE.material, **material))


def test_nothing_is_wrong_where_nothing_is(mesh):
    assert faults_of(SCENE, mesh) == () == size_faults(SCENE, mesh)


@pytest.mark.parametrize('path', sorted((config_dir() / 'scenes').glob('*.yaml')),
                         ids=lambda path: path.stem)
def test_nothing_is_wrong_in_what_is_shipped(path):
    scene = load_scene(path)
    mesh = load_mesh(scene.mesh.file, scene.mesh.unit)
    assert size_faults(scene, mesh) == () == scene_faults(scene, build_body(scene, mesh))


@pytest.mark.parametrize('scene, name, words', [
    (marked(30, 20, 55), 'm', '25 mm off the surface.*compare it with the rig'),
    (marked(30, 20, 18), 'm', '12 mm inside the body'),
    (marked(30, 20, 0.030), 'm', r'z = 0.03 mm looks like metres: 30 mm\?'),
    (marked(0.030, 0.020, 0.030), 'm', r'looks like metres'),
    (marked(30000, 20000, 30000), 'm', 'looks like micrometres'),
    (aimed(30, 20, 33), 't', '3 mm outside'),
    (aimed(30, 20, 0.020), 't', r'z = 0.02 mm looks like metres: 20 mm\?'),
    (replace(SCENE, markers=(Marker('f', (7e-5, 4e-5, 0.0), 'base'),)), 'f', 'metres'),
    (made(E=10e6 * 10), '', r'is it in Pa\? Then it is 100'),
    (made(E=10e6), 'east', 'takes some 2.5e.03 N'),
    (made(E=10.0), '', r'is it in MPa\? Then it is 10'),
    (made(density=1.0), '', r'density_kg_m3 = 1; must be 200 to 5000; is it in g/cm3'),
    (replace(SCENE, gravity=(0.0, 0.0, -9810.0)), '', '9810 in size; must be at most 20'),
    (replace(made(E=130.0), gravity=(0.0, 0.0, -9.81)), '', 'under its own weight'),
    (replace(SCENE, pads=(replace(PAD, stroke=1e-5),)), 'east', r'is it 10 mm\?'),
    (replace(SCENE, pads=(replace(PAD, stroke=0.08),)), 'east', 'less than the 60 mm'),
    (replace(SCENE, loads=(PointLoad('w', (0.03, 0.02, 0.03), 2e-6),)), 'w', 'in grams'),
])
def test_what_cannot_be_meant_is_told(scene, name, words, mesh):
    fault, = [one for one in faults_of(scene, mesh) if not (
        one.name == 'east' and 'takes some' in one.what and name != 'east')]
    assert fault.name == name and '\n' not in str(fault)
    assert re.search(words, str(fault)), str(fault)


def test_a_body_of_another_unit_is_told_before_it_is_built(mesh):
    """A mesh of 0.06 m said to be in mm, and one in mm said to be in m."""
    small = TetMesh(mesh.nodes * 1e-3, mesh.tets, {})
    large = TetMesh(mesh.nodes * 1e3, mesh.tets, {})
    said = replace(SCENE, mesh=MeshFile('none.msh', 'mm'))
    fault, = size_faults(said, small)
    assert 'mesh: 0.06 mm long with unit: mm' in str(fault) and 'unit: m}' in str(fault)
    fault, = size_faults(SCENE, large)
    assert '6e+04 mm long' in str(fault) and 'unit: mm}' in str(fault)


def test_positions_of_another_unit_than_the_mesh_are_told(mesh):
    tiny = replace(
        SCENE, pads=(replace(PAD, centre=tuple(1e-3 * v for v in PAD.centre)),),
        targets=(), markers=(Marker('top', (3e-5, 2e-5, 3e-5)),))
    fault, = size_faults(tiny, mesh)
    assert 'within 0.06 mm' in str(fault) and 'are in m' in str(fault)


def test_a_stroke_shorter_than_what_was_recorded_is_told():
    assert stroke_faults(SCENE, {'east': 0.0101, 'west': 1.0}) == ()
    fault, = stroke_faults(SCENE, {'east': 0.014})
    assert str(fault) == ('pads east: stroke_mm = 10; must be at least the 14 mm that were '
                          'recorded')


def test_distance_to_what_is_held_counts_over_it_alone(mesh):
    """Just above the rim of the base, on a side: that face does move."""
    assert faults_of(marked(60, 20, 0.3), mesh)     # 0.3 mm above the floor's edge
    assert faults_of(marked(60.2, 20, 2), mesh) == ()
