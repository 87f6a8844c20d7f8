"""A base that has come off: bars and beams that lift, what stays bonded, statics and dynamics."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import Pad, PadFace, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.supports import positions, reactions
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.base_debond import BaseDebond

both_elements = pytest.mark.parametrize('quadratic', [False, True], ids=['linear', 'quadratic'])
ALL = 0.2  # m, more than any base here


def box_body(size, cells, lid, E, nu=0.0, quadratic=True, density=1e3, gravity=9.81, **extra):
    """Box held at z = 0, one of its faces a pad."""
    mesh = box_mesh(size, cells)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    nodes = mesh.node_sets[lid]
    pad = Pad('pad', nodes, np.array([0.0, 0.0, -1.0]), mesh.nodes[nodes].mean(axis=0), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, density),
                    mesh.node_sets['z0'], (pad,), gravity=np.array([0.0, 0.0, -gravity]), **extra)


def ground_force(body, x):
    """Force (3,) [N] of the ground on the tissue, glue apart."""
    _, force = reactions(body.supports, x - body.mesh.nodes, np.zeros(3))
    return force @ body.supports.normal


@both_elements
def test_a_heavy_bar_lifts_off(quadratic):
    """Lid raised by d: ground bears W / 2 - E A d / L, until it is lost at d = W L / (2 E A)."""
    E, L, A, density = 1e5, 0.06, 0.02**2, 5e3
    body = BaseDebond(ALL).prepare(box_body((0.02, 0.02, L), (2, 2, 6), 'z1', E,
                                            quadratic=quadratic, density=density))
    assert len(body.fixed) == 0
    weight, solver = density * 9.81 * L * A, StaticSolver(body)
    off = weight * L / (2.0 * E * A)
    for d in (-2.0 * off, -off, 0.0, 0.5 * off):
        found = solver.solve(body.mesh.nodes, [[0.0, 0.0, d]])
        assert found.outcome.ok
        expected = weight / 2.0 - E * A * d / L
        # E L rho g = 3 % of E: strain of a neo-Hookean bar is linear to about as much
        assert ground_force(body, found.x)[2] == pytest.approx(expected, rel=0.03)
    hung = [solver.solve(body.mesh.nodes, [[0.0, 0.0, d]]) for d in (2.0 * off, 5.0 * off)]
    for found in hung:
        assert found.outcome.ok and not ground_force(body, found.x).any()
        assert found.pad_force[0, 2] == pytest.approx(-weight, rel=1e-9)
    lift = (hung[1].x - hung[0].x) - [0.0, 0.0, 3.0 * off]
    np.testing.assert_allclose(lift, 0.0, atol=1e-9)  # it hangs rigidly


def test_a_heavy_beam_peels_off_as_the_fourth_root_of_its_lift():
    """Clamped end raised by d: F = 2/3 q (72 E I d / q)^(1/4) over the length that is lifted.

    From E I w'' = q (l x / 3 - x^2 / 2): no moment where it leaves the ground, no slope at either
    end of the lifted length l, d = q l^4 / (72 E I), of the weight q l the clamp bears two thirds.
    """
    E, side, density = 2e6, 0.002, 1e3
    size = np.array([0.12, side, side])
    body = BaseDebond(ALL).prepare(box_body(size, (48, 1, 1), 'x1', E, density=density))
    EI, q = E * side**4 / 12.0, density * 9.81 * side**2
    solver, forces, lifts = StaticSolver(body), [], np.array([0.5e-3, 1e-3, 2e-3])
    x = solver.solve(body.mesh.nodes, np.zeros((1, 3))).x
    for d in lifts:
        found = solver.solve(x, [[0.0, 0.0, d]])
        assert found.outcome.ok
        x, length = found.x, (72.0 * EI * d / q) ** 0.25
        forces.append(-found.pad_force[0, 2])
        gap, force = reactions(body.supports, x - body.mesh.nodes, np.zeros(3))
        inward = size[0] - positions(body.supports, body.mesh.nodes)[:, 0]
        assert (gap[inward < 0.9 * length] > 0.0).all()
        np.testing.assert_allclose(gap[inward > 1.1 * length], 0.0, atol=2e-5)
        assert force.sum() + forces[-1] == pytest.approx(q * size[0], rel=1e-3)
    expected = 2.0 / 3.0 * q * (72.0 * EI * lifts / q) ** 0.25
    np.testing.assert_allclose(forces, expected, rtol=0.005)


def tissue(cells=(8, 8, 4), quadratic=False, gravity=0.0, **extra):
    """Block of 60 x 60 x 24 mm, 6 kPa, a disc of 12 mm bonded on its top."""
    mesh = box_mesh((0.06, 0.06, 0.024), cells)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.45)
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.03, axis=1) < 0.0121]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.03, 0.03, 0.024]), 0.02,
              radius=0.0121)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,), gravity=np.array([0.0, 0.0, -gravity]), **extra)


def sector(radius, centre=(0.03, 0.03, 0.0)):
    """The term in the middle of the block."""
    return BaseDebond(radius, centre)


def pulled(body, push=(0.0, 0.0, 3e-3)):
    """StaticSolution of a body with its pad displaced."""
    found = StaticSolver(body).solve(body.mesh.nodes, np.array([push]))
    assert found.outcome.ok
    return found


@both_elements
def test_a_sector_gives_way_to_pull_and_to_shear_and_holds_under_pressure(quadratic):
    whole = tissue((8, 8, 2), quadratic)
    loose = sector(0.02).prepare(whole)
    assert 0 < len(loose.fixed) < len(whole.fixed)
    for push, most in (((0.0, 0.0, 3e-3), 0.97), ((3e-3, 0.0, 0.0), 0.99)):
        axis = np.argmax(push)
        ratio = pulled(loose, push).pad_force[0, axis] / pulled(whole, push).pad_force[0, axis]
        assert 0.3 < ratio < most
    found = pulled(loose, (0.0, 0.0, 3e-3))
    away = np.linalg.norm(whole.mesh.nodes[whole.fixed] - [0.03, 0.03, 0.0], axis=1)
    risen = (found.x - whole.mesh.nodes)[whole.fixed, 2]
    assert risen[away < 0.008].min() > 1e-4  # it lifts off
    assert not risen[away > 0.024 * np.sqrt(2.0) + 0.01].any()
    pressed = (pulled(loose, (0.0, 0.0, -3e-3)).x - whole.mesh.nodes)[whole.fixed, 2]
    assert -5e-5 < pressed.min() < 0.0  # and does not pass through


def test_ground_glue_fixed_nodes_and_pad_bear_the_weight():
    body = sector(0.02).prepare(tissue(gravity=9.81))
    found = pulled(body, (1e-3, 0.0, 1e-3))
    held = StaticSolver(body).assembler.forces(found.x)[body.fixed].sum(axis=0)
    glue = -body.supports.glue @ positions(body.supports, found.x - body.mesh.nodes)
    assert np.abs(glue).max() > 0.01
    borne = ground_force(body, found.x) + glue + held - found.pad_force[0]
    weight = 1e3 * 9.81 * 0.06 * 0.06 * 0.024
    np.testing.assert_allclose(borne, [0.0, 0.0, weight], rtol=0.0,
                               atol=len(found.x) * found.residual)
    assert len(found.x) * found.residual < 1e-4 * weight


@both_elements
def test_force_falls_steadily_with_the_radius(quadratic):
    """No jumps as nodes come off: ten times finer steps in radius have far smaller differences."""
    whole = tissue(cells=(6, 6, 2), quadratic=quadratic)

    def falls(radii):
        forces = [pulled(sector(r).prepare(whole)).pad_force[0, 2] for r in radii]
        return np.diff(np.abs(forces))

    wide, fine = falls(np.arange(0.0, 0.0261, 2e-3)), falls(np.arange(0.018, 0.02001, 2e-4))
    assert (wide <= 1e-9).all() and wide.min() < -1e-3
    assert (fine < 0.0).all() and np.abs(fine).max() < 0.35 * np.abs(wide).max()


def test_a_radius_of_nothing_and_a_place_off_the_base_change_nothing():
    whole = tissue()
    assert sector(0.0).prepare(whole) is whole
    assert sector(0.01, (0.03, 0.03, 0.05)).prepare(whole) is whole


def test_refuses_a_fixed_region_without_a_face():
    body = dataclasses.replace(tissue(), fixed=np.array([0, 1]))
    with pytest.raises(MeshError, match='none of the 2 fixed nodes'):
        sector(0.01).prepare(body)


def test_what_stays_glued_may_be_compliant():
    body = BaseCompliance().prepare(sector(0.015).prepare(tissue()))
    assert len(body.fixed) == 0 and len(body.springs.nodes) and len(body.supports.nodes)
    stiff = pulled(sector(0.015).prepare(tissue())).pad_force[0, 2]
    assert 0.0 > pulled(body).pad_force[0, 2] > stiff


# --- the plant -----------------------------------------------------------------------------

def drive(simulator, depths=(5e-4, 1e-3, 1e-3, 0.0, -1e-3)):
    """Settle, lift the pad, hold, and press it down; the states."""
    states = [simulator.settle()]
    return states + [simulator.step(0.1 * (k + 1), [[0.0, 0.0, d]])
                     for k, d in enumerate(depths)]


@both_elements
def test_every_quasi_static_state_is_the_equilibrium_of_its_command(quadratic):
    simulator = TissueSimulator(tissue((6, 6, 2), quadratic, 9.81), (sector(0.02),))
    states, body = drive(simulator), simulator.body
    again = drive(TissueSimulator(tissue((6, 6, 2), quadratic, 9.81), (sector(0.02),)))
    for state, twin, d in zip(states, again, (0.0, 5e-4, 1e-3, 1e-3, 0.0, -1e-3), strict=True):
        assert state.outcome.ok
        np.testing.assert_array_equal(state.x, twin.x)
        np.testing.assert_allclose(state.x, pulled(body, (0.0, 0.0, d)).x, rtol=0.0, atol=1e-8)


def test_dynamics_ends_in_the_static_state():
    damped = tissue((6, 6, 2), gravity=9.81, damping=(60.0, 0.0))
    dynamic = TissueSimulator(damped, (sector(0.02),), dynamics='implicit',
                              options=DynamicOptions(max_step=5e-3))
    dynamic.settle()
    for k in range(1, 9):
        state = dynamic.step(0.1 * k, [[0.0, 0.0, min(k, 4) * 5e-4]])
        assert state.outcome.ok
    static = pulled(dynamic.body, (0.0, 0.0, 2e-3))
    np.testing.assert_allclose(state.x, static.x, rtol=0.0, atol=5e-6)
    np.testing.assert_allclose(state.pad_force, static.pad_force, rtol=5e-3, atol=1e-3)


def test_a_touching_pad_presses_on_a_loose_base():
    """No glue, no friction: under a pad that only pushes, the block rests on the whole ground."""
    given = tissue((6, 6, 2), gravity=9.81)
    faced = dataclasses.replace(given.pads[0], face=PadFace(0.0121, 0.002, 0.3))
    simulator = TissueSimulator(dataclasses.replace(given, pads=(faced,)), (sector(0.02),))
    simulator.settle()
    state = simulator.step(0.1, [[0.0, 0.0, -1e-3]])
    assert state.outcome.ok and state.pad_force[0, 2] > 0.1
    away = simulator.step(0.2, [[0.0, 0.0, 1e-3]])
    assert away.outcome.ok and not away.pad_force.any()


def test_a_failed_step_holds_the_last_state():
    simulator = TissueSimulator(tissue((6, 6, 2)), (sector(0.02),))
    good = simulator.step(0.1, [[0.0, 0.0, 1e-3]])
    failed = simulator.step(0.2, [[0.0, 0.0, -0.1]])
    assert good.outcome.ok and not failed.outcome.ok
    np.testing.assert_array_equal(failed.x, good.x)
    assert simulator.step(0.3, [[0.0, 0.0, 1.1e-3]]).outcome.ok
