"""Scenes of one body: what they may differ in, and where a weight hangs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import Marker, MeshFile, PointLoad, Region, Scene
from arm_brachy.diagnosis.free_vibration.conclusions import in_one_scene
from arm_brachy.diagnosis.free_vibration.problem import Aside, _joined
from arm_brachy.diagnosis.free_vibration.scenes import (
    InScene,
    acting,
    along,
    at_loads,
    hung,
    refuse_exchanged,
    refuse_other_bodies,
)
from arm_brachy.diagnosis.signals.loading import Evidence
from arm_brachy.diagnosis.signals.stream import OPTICAL, Stream
from arm_brachy.tissue.terms.damping import Damping
from arm_brachy.tissue.terms.point_mass import PointMass

TIP = (0.1, 0.0, 0.0)
BARE = Scene('bare', MeshFile('none.msh'), Region('half_space'), dynamics='implicit',
             markers=(Marker('tip', TIP),))
HUNG = replace(BARE, name='hung', loads=(PointLoad('weight', TIP, 0.02),))
TURNED = replace(BARE, name='turned', gravity=(0.0, -9.81, 0.0))


def let_go(name, scene, sag):
    """Evidence of a tip that sinks by `sag` [m] in 2 s, seen by a tracker that stands aside."""
    base = np.array([[0.0, 0.05, 0.0], [0.0, -0.05, 0.0], [0.0, 0.0, 0.05]])
    rest = np.vstack([TIP, base])
    scene = replace(scene, markers=(*scene.markers, *(
        Marker(f'base_{i}', tuple(p), 'base') for i, p in enumerate(base))))
    t = np.arange(400) * 0.01
    values = np.repeat(rest[None], len(t), axis=0)
    values[:, 0, 2] -= sag * np.minimum(t / 2.0, 1.0)
    optical = Stream(OPTICAL, t, tuple(m.name for m in scene.markers), values + [0.3, 0.0, 0.1],
                     np.ones(values.shape[:2], dtype=bool), ('tissue', *['base'] * 3), rest)
    return Evidence(name, scene, np.zeros((0, 3)), {OPTICAL: optical})


def test_scenes_exchanged_between_two_recordings_are_found_by_how_deep_they_hang():
    refuse_exchanged([let_go('a', BARE, 0.01), let_go('b', HUNG, 0.03)])
    refuse_exchanged([let_go('a', BARE, 0.030), let_go('b', HUNG, 0.029)])      # nearly alike
    refuse_exchanged([let_go('a', TURNED, 0.03), let_go('b', HUNG, 0.01)])      # another way down
    with pytest.raises(InputError, match='a hangs 10 mm .* in scene hung, b 30 mm in bare, which'):
        refuse_exchanged([let_go('b', BARE, 0.03), let_go('a', HUNG, 0.01)])


def test_one_body_hangs_and_is_loaded_in_any_way():
    refuse_other_bodies([BARE, HUNG, TURNED, BARE])
    assert at_loads([BARE, HUNG, replace(HUNG, name='more'), HUNG]) == {TIP: ('hung', 'more')}


def test_a_name_of_two_loads_is_refused_wherever_it_comes():
    heavier = replace(HUNG, loads=(PointLoad('weight', TIP, 0.05),))
    with pytest.raises(InputError, match='scenes of the name hung that differ'):
        refuse_other_bodies([BARE, HUNG, heavier])


@pytest.mark.parametrize('other, said', [
    (replace(HUNG, name='bare'), 'scenes of the name bare'),
    (replace(HUNG, markers=()), 'differ in markers'),
    (replace(HUNG, mesh=MeshFile('finer.msh')), 'differ in mesh')])
def test_other_bodies_are_refused(other, said):
    with pytest.raises(InputError, match=said):
        refuse_other_bodies([BARE, other])


def test_more_at_a_load_hangs_where_the_load_does():
    more, damping = PointMass(mass=0.01, centre=TIP), Damping(alpha_factor=2.0)
    scenes = [BARE, HUNG]
    assert acting((more, damping), 'hung', scenes) == (more, damping)
    assert acting((more, damping), 'bare', scenes) == (damping,)


def test_a_weight_may_be_another_in_one_of_two_scenes():
    more = PointMass(mass=0.01, centre=TIP)
    scenes = [BARE, HUNG, replace(HUNG, name='heavier')]
    for name, there in (('bare', ()), ('hung', ()), ('heavier', (more,))):
        assert acting((InScene(more, 'heavier'),), name, scenes) == there


def test_a_load_that_hangs_aside_takes_what_hangs_with_it_along():
    moved = hung(HUNG, np.array([[1e-3, 0.0, -2e-3]]))
    assert moved.loads[0].position == pytest.approx((0.101, 0.0, -0.002))
    more, other = PointMass(mass=0.01, centre=TIP), PointMass(mass=0.01, centre=(0.05, 0.0, 0.0))
    there, same = along((more, other), HUNG, moved)
    assert there.centre == moved.loads[0].position and there.mass == 0.01 and same == other


def test_a_weight_where_no_scene_has_one_hangs_in_all():
    elsewhere = PointMass(mass=0.01, centre=(0.05, 0.0, 0.0))
    for name in ('bare', 'hung'):
        assert acting((elsewhere,), name, [BARE, HUNG]) == (elsewhere,)


def test_all_weights_of_one_hook_go_aside_together():
    """Two in one scene, one in another."""
    way, none = np.array([1e-3, 0.0, 0.0]), np.zeros(3)
    parts = [Aside({'two': np.stack([way, none])}, np.array([1.0, 0.0])),
             Aside({'two': np.stack([none, way])}, np.array([2.0, 0.0])),
             Aside({'one': way[None]}, np.array([0.0, 4.0]))]
    hook = _joined(parts)
    np.testing.assert_array_equal(hook.shifts['two'], [way, way])
    np.testing.assert_array_equal(hook.shifts['one'], [way])
    np.testing.assert_array_equal(hook.does, [3.0, 4.0])
    np.testing.assert_array_equal(hook.times(0.5).does, [1.5, 2.0])


@pytest.mark.parametrize('other, said', [
    ([0.0, 1.0], 'Point mass: in scene heavy alone.'),
    ([1.0, 0.0], 'Point mass: likeliest in scene heavy alone (50 %), else in another or in all.')])
def test_in_which_scene_is_said_as_surely_as_it_is_known(other, said):
    """Two variants whose columns tell them apart, or not."""
    frees = [SimpleNamespace(hypothesis=SimpleNamespace(name='point_mass'), scene=scene,
                             key=('point_mass', scene)) for scene in ('heavy', 'light')]
    answers = [SimpleNamespace(free=free, columns=np.array(column)[:, None])
               for free, column in zip(frees, ([1.0, 0.0], other), strict=True)]
    problem = SimpleNamespace(U=np.zeros((2, 1)), r=np.array([6.0, 0.0]))
    line, = in_one_scene(problem, answers, [None, SimpleNamespace(frees=frees[:1])])
    assert line == said
