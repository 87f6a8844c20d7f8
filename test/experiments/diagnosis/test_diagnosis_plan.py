"""What is planted for the study covers the registry, at sizes and places that can be seen."""

import numpy as np
import pytest

from arm_brachy.core.quantity import quantities
from arm_brachy.experiments.diagnosis_plan import base_cell, plan
from arm_brachy.registry import TERMS
from arm_brachy.tissue.mesh import boundary_faces, load_mesh

MM = 1e-3
PLAN = plan()
FAULTS = [case for case in PLAN if case.planted is not None]


def test_every_term_is_planted_at_both_sizes_and_sixty_times_nothing():
    for size in (1.0, 0.1):
        planted = [type(c.planted.term) for c in FAULTS if c.planted.size == size]
        assert sorted(t.spec.name for t in planted) == sorted(t.spec.name for t in TERMS)
    nulls = [c for c in PLAN if c.planted is None]
    assert len(nulls) >= 60 and len({c.plant.name for c in nulls}) >= 10
    assert len({c.name for c in PLAN}) == len(PLAN) == len({c.seed for c in PLAN})


def test_nothing_but_what_moves_the_body_has_a_plant_of_its_own():
    for case in FAULTS:
        own = case.plant.planted is case.planted
        assert own != (case.planted.term.spec.kind.value == 'sensing'
                       or case.planted.term.spec.name in ('damping', 'point_mass')), case.name
        assert own or case.plant.planted is None


@pytest.mark.parametrize('cls', TERMS, ids=lambda cls: cls.spec.name)
def test_sizes_are_the_registrys(named, cls):
    """A departure from 'off' as declared, or a tenth; where off is infinite, ten times as much."""
    infos = quantities(cls)
    for size in (1.0, 0.1):
        one = named(cls.spec.name, size).planted
        assert one.strengths and not set(one.strengths) & set(one.place)
        for name in one.strengths:
            info, value = infos[name], np.array(getattr(one.term, name))
            if np.isinf(info.neutral):
                assert value == pytest.approx(info.scale * info.typical / size)
                continue
            away = np.linalg.norm(value / info.scale - info.neutral)
            typical = info.typical if info.typical is not None else info.to_edge(
                getattr(named(cls.spec.name).planted.term, name))
            assert away == pytest.approx(size * abs(typical - info.neutral))


def test_places_are_seen_by_the_protocol(named):
    scene = base_cell().scene
    mesh = load_mesh(scene.mesh.file, scene.mesh.unit)
    outer = mesh.nodes[boundary_faces(mesh)].mean(axis=1)
    pads = np.array([p.centre for p in scene.pads])

    def depth(p):
        return np.linalg.norm(outer - p, axis=1).min()

    for size in (1.0, 0.1):
        lump = np.array(named('inclusion', size).planted.term.centre)
        assert lump[2] >= 20 * MM and depth(lump) > 8 * MM
        for name, clear in (('obstacle', 35), ('external_force', 30), ('point_mass', 30)):
            centre = np.array(named(name, size).planted.term.centre)
            assert depth(centre) < 0.01 * MM
            assert np.linalg.norm(pads - centre, axis=1).min() > clear * MM
        assert {named(n, size).planted.term.pads[0] for n in ('pad_slip', 'force_gain')} <= {
            'pad_1', 'pad_2', 'pad_3'}
        assert 12.0 <= named('lost_steps', size).planted.term.onset <= 70.0


def test_a_touch_presses_in(named):
    term = named('external_force').planted.term
    assert np.dot(term.force, np.array(term.centre) - [0.0, 0.0, 25 * MM]) < 0.0


def test_one_seed_gives_one_plan():
    assert plan() == PLAN
    other = plan(7)
    assert [c.name for c in other] == [c.name for c in PLAN]
    assert not any(a.seed == b.seed for a, b in zip(other, PLAN, strict=True))
