"""States along rays, on a mesh of a few tetrahedra: the layout's points, the effects, memory."""

import numpy as np
import pytest

from arm_brachy.experiments.half_cylinder import bodies, memory, protocol
from arm_brachy.experiments.half_cylinder.bodies import BODIES, PLAIN, Beyond, solve_ray
from arm_brachy.experiments.half_cylinder.layout import DIRECTIONS, MM, POINTS, RADIUS
from arm_brachy.experiments.half_cylinder.mesh import load_mesh


def test_the_cubic_through_earlier_states_leads_on():
    states = [np.array([s + s ** 2 - s ** 3]) for s in range(6)]
    assert bodies._ahead(states[:4], 1) == pytest.approx(states[4])
    assert bodies._ahead([], 1) == pytest.approx([0.0])
    assert bodies._ahead(states[:2], 1) == pytest.approx(2.0 * states[1])


def test_memory_is_interpolated_in_time():
    t = np.array([0.0, 1.0, 3.0])
    beyond = Beyond(t, np.outer(t, np.arange(6)).reshape(3, 2, 3), np.zeros((3, 3, 3)))
    np.testing.assert_allclose(beyond.at(np.array([0.5, 2.0]), 'u').reshape(2, -1),
                               np.outer([0.5, 2.0], np.arange(6)))


def test_pads_go_where_the_protocol_says():
    t = np.linspace(0.0, protocol.END, 20001)
    gone = protocol.travel(t)
    assert gone.min() == 0.0 and not gone[t < 4.9].any() and not gone[-1].any()
    for push, start in zip(protocol.PUSHES, protocol.STARTS, strict=False):
        held = (t > start + push.way + 0.1) & (t < start + push.way + push.hold - 0.1)
        np.testing.assert_allclose(gone[held], np.tile(push.travel, (held.sum(), 1)), atol=1e-12)
        speed = np.abs(np.gradient(gone[:, push.travel.argmax()], t))
        on = (t > start - 0.1) & (t < start + push.way + 0.1)
        assert speed[on].max() == pytest.approx(push.speed, rel=1e-3)


def test_instants_hold_every_corner_and_no_step_is_long():
    t = protocol.instants()
    assert np.all(np.diff(t) > 0.05) and t[0] == 0.0 and t[-1] < protocol.END
    gone = protocol.travel(t)
    assert np.abs(np.diff(gone, axis=0)).max() < 1.2 * MM
    for push, start in zip(protocol.PUSHES, protocol.STARTS, strict=False):
        for corner in (start - 0.1, start + push.way + 0.1):
            assert np.abs(t - corner).min() < 1e-9


@pytest.fixture(scope='module')
def rays():
    """A third of a millimetre on the laboratory's mesh, in one step of the six: near linear."""
    mesh = load_mesh()
    few = pytest.MonkeyPatch()
    few.setattr(bodies, 'SHARES', (1.0,))
    out = {name: solve_ray(BODIES[name], (MM / 3, 0.0, 0.0), mesh) for name in (PLAIN, 'lump')}
    few.undo()
    return out


def test_the_half_cylinder_resists_and_gives_way_along_the_push(rays):
    ray = rays[PLAIN]
    assert ray.share == pytest.approx([0.0, 1.0])
    assert not ray.u[0].any() and not ray.force[0].any()
    back = -ray.force[-1, 0] @ DIRECTIONS[0]
    # a bonded disc on a half-space, nu = 1/2, pushes back with 32/3 mu a = 0.29 N/mm; the body
    # behind it is 36 mm deep, glued below and free at the sides
    assert 0.7 < back / (1e3 / 3 * MM) / 0.29 < 1.4
    inside = ray.u[-1, -2:] @ DIRECTIONS[0]
    assert np.all(inside > 0.0) and np.all(inside < MM / 3)
    assert np.hypot(*POINTS[:9, 1:].T) == pytest.approx(RADIUS)


def test_a_lump_below_the_pad_pushes_back_more(rays):
    back = {name: -ray.force[-1, 0] @ DIRECTIONS[0] for name, ray in rays.items()}
    assert 1.05 < back['lump'] / back[PLAIN] < 1.5


def test_a_hold_relaxes(monkeypatch):
    """A third of a millimetre within a millisecond, then 8 s: the force goes as the shape's
    stress does, but for what the volume bears by itself, and nothing moves."""
    def at_rest(rays, t, what):
        return 0.0

    monkeypatch.setattr(bodies, 'travel', lambda t: np.outer(t > 0.0, (MM / 3, 0.0, 0.0)))
    monkeypatch.setattr(bodies, 'response', at_rest)
    t = np.array([0.0, 1e-3, 8.0])
    beyond = bodies.solve_memory(BODIES[PLAIN], {}, t, load_mesh())
    back = -beyond.force[:, 0] @ DIRECTIONS[0]
    left = 1.0 - memory.SHARE * (1.0 - np.exp(-8.0 / memory.TAU))
    assert left < back[2] / back[1] < left + 0.1 * (1.0 - left)
    np.testing.assert_allclose(beyond.u[2], beyond.u[1], atol=0.01 * MM / 3)


def test_what_is_there_is_not_solved_again(tmp_path, rays, monkeypatch):
    solved = []

    def solve(kind, full, mesh):
        solved.append(kind)
        return rays[PLAIN]

    monkeypatch.setattr(bodies, 'solve_ray', solve)
    for name in (PLAIN, 'loose'):
        for ray in protocol.RAYS:
            bodies._solve(tmp_path, name, ray)
    count = len(solved)
    bodies.solve_all(tmp_path, {PLAIN, 'loose'})
    assert len(solved) == count == 2 * len(protocol.RAYS)
    assert set(bodies.load_rays(tmp_path, 'loose')) == set(protocol.RAYS)
    assert bodies.load_beyond(tmp_path, 'loose') is None
