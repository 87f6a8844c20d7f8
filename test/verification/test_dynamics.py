"""Dynamics against a generalised eigenproblem, exact solutions, energy and order of accuracy."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.sparse.linalg import eigsh

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions, DynamicSolver, weights
from arm_brachy.tissue.free_dofs import FreeDofs
from arm_brachy.tissue.mass import mass_matrix
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver

NO_PADS = np.zeros((0, 3))


def beam(nu=0.3, damping=(0.0, 0.0), gravity=0.0, fixed=True, mass=None, divisions=(8, 2, 2),
         quadratic=False):
    """Cantilever of 264 kPa silicone, 100 x 15 x 15 mm."""
    mesh = box_mesh((0.1, 0.015, 0.015), divisions)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    mu, kappa = moduli(264e3, nu)
    m = len(mesh.tets)
    held = mesh.node_sets['x0'] if fixed else np.zeros(0, dtype=np.int64)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1070.0), held,
                    gravity=np.array([0.0, 0.0, -gravity]), nodal_mass=mass, damping=damping)


def modes(body, kind='consistent', count=1):
    """Lowest angular frequencies [rad/s] and shapes (count, n, 3) of the body at rest."""
    assembler = Assembler(body)
    dofs = FreeDofs(assembler, body.fixed).dofs
    K = assembler.tangent(body.mesh.nodes)[dofs][:, dofs]
    M = mass_matrix(assembler, kind)[dofs][:, dofs]
    values, vectors = eigsh(K.tocsc(), k=count, M=M.tocsc(), sigma=0.0, v0=np.ones(len(dofs)))
    shapes = np.zeros((count, 3 * assembler.n))
    shapes[:, dofs] = vectors.T
    return np.sqrt(values), shapes.reshape(count, -1, 3)


def ring(body, shape, duration, options, amplitude=1e-6):
    """Amplitude of one mode (k,) at the steps of a free vibration from a deflection in it.

    amplitude : [m] at first
    """
    solver = DynamicSolver(body, options)
    state = solver.initial(body.mesh.nodes + amplitude * shape / np.abs(shape).max())
    weight = shape * np.abs(shape).max() / np.sum(shape * shape) / amplitude
    q, states = [1.0], [state]
    for _ in range(round(duration / options.max_step)):
        state = solver.step(state, NO_PADS, options.max_step)
        assert state.outcome is Outcome.OK
        q.append(np.sum((state.x - body.mesh.nodes) * weight))
        states.append(state)
    return np.array(q), states


def crossings(q, dt):
    """Times at which q changes sign, by linear interpolation."""
    i = np.flatnonzero(q[:-1] * q[1:] < 0.0)
    return (i + q[i] / (q[i] - q[i + 1])) * dt


def timoshenko_frequency(E, nu, rho, length, side):
    """First angular frequency [rad/s] of a clamped beam of square section, with shear (5/6).

    Source: Huang 1961, J Appl Mech 28:579, clamped-free frequency equation (both roots real).
    """
    area, inertia, G = side**2, side**4 / 12.0, E / (2.0 * (1.0 + nu))
    r2, s2 = inertia / (area * length**2), E * inertia / (5.0 / 6.0 * area * G * length**2)

    def equation(w):
        b = w * np.sqrt(rho * area * length**4 / (E * inertia))
        root = np.sqrt((r2 - s2)**2 + 4.0 / b**2)
        alpha, beta = (b * np.sqrt((sign * (r2 + s2) + root) / 2.0) for sign in (-1.0, 1.0))
        return (2.0 + (b**2 * (r2 - s2)**2 + 2.0) * np.cosh(alpha) * np.cos(beta)
                - b * (r2 + s2) / np.sqrt(1.0 - b**2 * r2 * s2) * np.sinh(alpha) * np.sin(beta))

    slender = 1.875104**2 * np.sqrt(E * inertia / (rho * area * length**4))
    return brentq(equation, 0.5 * slender, slender)


@pytest.mark.parametrize('kind', ['lumped', 'consistent'])
def test_quadratic_cantilever_rings_as_timoshenko_says(kind):
    """At nu = 0, where the clamp does not keep the section from narrowing, as theory has it."""
    omega, _ = modes(beam(nu=0.0, quadratic=True), kind)
    exact = timoshenko_frequency(264e3, 0.0, 1070.0, 0.1, 0.015)
    assert omega[0] == pytest.approx(exact, rel=3e-3)


def bar_error(quadratic, kind, n):
    """Relative error of the first longitudinal frequency of a clamped bar, sides held, nu = 0.

    Exact: pi / (2 L) sqrt(E / rho), with no motion across.
    """
    body = beam(nu=0.0, divisions=(n, 1, 1), quadratic=quadratic)
    assembler = Assembler(body)
    along = 3 * np.setdiff1d(np.arange(assembler.n), body.fixed)
    K = assembler.tangent(body.mesh.nodes)[along][:, along]
    M = mass_matrix(assembler, kind)[along][:, along]
    value = eigsh(K.tocsc(), k=1, M=M.tocsc(), sigma=0.0, v0=np.ones(len(along)),
                  return_eigenvectors=False)
    return np.sqrt(value[0]) / (np.pi / 0.2 * np.sqrt(264e3 / 1070.0)) - 1.0


def test_mass_keeps_the_order_of_the_element():
    """Consistent: above, by h^2 or h^4. Lumped: below; what errs most with quadratic elements."""
    errors = {(q, kind): np.array([bar_error(q, kind, n) for n in (2, 4, 8)])
              for q in (False, True) for kind in ('lumped', 'consistent')}
    rates = {key: np.log2(np.abs(e[:-1] / e[1:])) for key, e in errors.items()}
    for (_, kind), error in errors.items():
        assert np.all(error > 0.0 if kind == 'consistent' else error < 0.0)
    np.testing.assert_allclose(rates[False, 'consistent'], 2.0, atol=0.3)
    np.testing.assert_allclose(rates[False, 'lumped'], 2.0, atol=0.3)
    np.testing.assert_allclose(rates[True, 'consistent'], 4.0, atol=0.4)
    assert np.all(np.abs(errors[True, 'lumped']) > 10.0 * errors[True, 'consistent'])
    assert np.all(np.abs(errors[True, 'lumped']) < 5e-3)


@pytest.mark.parametrize('quadratic', [False, True])
@pytest.mark.parametrize('kind', ['lumped', 'consistent'])
@pytest.mark.parametrize('nu', [0.3, 0.499])
def test_cantilever_rings_at_the_frequency_of_the_eigenproblem(nu, kind, quadratic):
    body = beam(nu, divisions=(4, 1, 1) if quadratic else (8, 2, 2), quadratic=quadratic)
    omega, shapes = modes(body, kind)
    period = 2.0 * np.pi / omega[0]
    options = DynamicOptions(rho_inf=1.0, max_step=period / 100, mass=kind)
    # 1e4 times what the solver leaves open at each step
    q, _ = ring(body, shapes[0], 2.3 * period, options, amplitude=1e-5)
    zeros = crossings(q, options.max_step)
    assert 2.0 * np.diff(zeros).mean() == pytest.approx(period, rel=1e-3)


@pytest.mark.parametrize('damping', [(2.0, 0.0), (0.0, 2e-3), (1.0, 1e-3)])
def test_rayleigh_damping_ratio(damping):
    """Modal decay exp(-zeta w t) with zeta = alpha / (2 w) + beta w / 2."""
    body = beam(damping=damping)
    omega, shapes = modes(body)
    zeta = damping[0] / (2.0 * omega[0]) + damping[1] * omega[0] / 2.0
    period = 2.0 * np.pi / omega[0]
    dt = period / 100
    q, _ = ring(body, shapes[0], 1.5 * period, DynamicOptions(rho_inf=1.0, max_step=dt))
    t = dt * np.arange(len(q))
    w_d = omega[0] * np.sqrt(1.0 - zeta**2)
    exact = np.exp(-zeta * omega[0] * t) * (
        np.cos(w_d * t) + zeta / np.sqrt(1.0 - zeta**2) * np.sin(w_d * t))
    np.testing.assert_allclose(q, exact, rtol=0.0, atol=2e-3)


@pytest.mark.parametrize('steps', [40, pytest.param(80, marks=pytest.mark.validate)])
def test_damping_ratio_at_large_deflection_is_that_of_the_mode(steps):
    """Let go from a fifth of its length, nu = 0.499: decay by beta w / 2, whatever the step.

    A viscosity beta K(rest) would damp the beam's turning with kappa: no period would be seen.
    """
    body = beam(0.499, damping=(0.0, 2e-3), quadratic=True)
    omega, _ = modes(body)
    period, tip = 2.0 * np.pi / omega[0], body.mesh.node_sets['x1']
    load = np.zeros_like(body.mesh.nodes)
    load[tip, 2] = 0.08 / len(tip)
    bent = StaticSolver(dataclasses.replace(body, nodal_force=load)).solve(
        body.mesh.nodes, NO_PADS)
    solver = DynamicSolver(body, DynamicOptions(max_step=period / steps))
    state, z = solver.initial(bent.x), []
    for _ in range(round(1.6 * steps)):
        state = solver.step(state, NO_PADS, period / steps)
        assert state.outcome.ok
        z.append((state.x - body.mesh.nodes)[tip, 2].mean())
    assert np.ptp(z) > 0.03
    peaks = [np.abs(z[k * steps // 4: (k + 2) * steps // 4]).max() for k in (1, 3, 5)]
    decrement = np.log(peaks[0] / peaks[2]) / 2.0     # per half period
    assert decrement / np.hypot(np.pi, decrement) == pytest.approx(1e-3 * omega[0], rel=0.05)


@pytest.mark.parametrize('rho_inf', [
    1.0, 0.8, pytest.param(0.0, marks=pytest.mark.validate)])
def test_second_order_in_the_time_step(rho_inf):
    """A beam bent by 4 mm and let go; stiffness damping ends what coarse steps cannot follow."""
    body = beam(divisions=(4, 1, 1), damping=(0.0, 1e-3))
    load = np.zeros_like(body.mesh.nodes)
    load[body.mesh.node_sets['x1'], 2] = 0.02
    loaded = dataclasses.replace(body, nodal_force=load)
    bent = StaticSolver(loaded).solve(body.mesh.nodes, NO_PADS)
    assert np.abs(bent.x - body.mesh.nodes).max() > 3e-3
    ends = {}
    for n in (25, 50, 100, 400):
        solver = DynamicSolver(body, DynamicOptions(rho_inf=rho_inf, max_step=0.1 / n))
        ends[n] = solver.step(solver.initial(bent.x), NO_PADS, 0.1).x
    errors = [np.linalg.norm(ends[n] - ends[400]) for n in (25, 50, 100)]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.2)


def test_energy_is_kept_or_decays():
    """rho_inf = 1 keeps the energy of a vibration within 1 %; less never lets it grow by more."""
    body = beam()
    omega, shapes = modes(body, count=4)
    mixed = shapes[0] / np.abs(shapes[0]).max() + 0.3 * shapes[3] / np.abs(shapes[3]).max()
    dt = 2.0 * np.pi / omega[0] / 60
    energies = {}
    for rho_inf in (1.0, 0.5):
        options = DynamicOptions(rho_inf=rho_inf, max_step=dt)
        _, states = ring(body, mixed, 120 * dt, options, amplitude=1e-3)
        solver = DynamicSolver(body, options)
        energies[rho_inf] = np.array([solver.energy(s) for s in states])
    kept, damped = energies[1.0], energies[0.5]
    assert np.ptp(kept) < 0.01 * kept[0]
    assert damped[-1] < 0.99 * damped[0]
    averaged = damped[:120].reshape(-1, 10).mean(axis=1)  # it breathes within a fast period
    assert np.all(np.diff(averaged) < 0.0)


def amplification(rho_inf, phase):
    """Eigenvalues of one step of an undamped oscillator with w dt = phase, written out."""
    w, stiff = weights(rho_inf), phase**2
    implicit = np.array([[1.0, 0.0, -w.beta], [0.0, 1.0, -w.gamma],
                         [(1.0 - w.alpha_f) * stiff, 0.0, 1.0 - w.alpha_m]])
    explicit = np.array([[1.0, 1.0, 0.5 - w.beta], [0.0, 1.0, 1.0 - w.gamma],
                         [-w.alpha_f * stiff, 0.0, -w.alpha_m]])
    return np.linalg.eigvals(np.linalg.solve(implicit, explicit))


@pytest.mark.parametrize('rho_inf', [1.0, 0.8, 0.5, 0.0])
def test_spectral_radius_at_infinite_frequency(rho_inf):
    """The largest root tends to rho_inf."""
    assert np.abs(amplification(rho_inf, 1e5)).max() == pytest.approx(rho_inf, abs=2e-2)


def test_default_adds_little_damping_to_resolved_modes():
    """rho_inf = 0.8, 40 samples per period: numerical damping ratio below 1e-5."""
    phase = 2.0 * np.pi / 40
    root = max(amplification(DynamicOptions().rho_inf, phase), key=np.abs)
    assert 0.0 < -np.log(np.abs(root)) / np.abs(np.angle(root)) < 1e-5
    assert np.abs(np.angle(root)) == pytest.approx(phase, rel=5e-3)


@pytest.mark.parametrize(('kind', 'quadratic'), [
    ('lumped', False), ('consistent', False), ('consistent', True)])
def test_free_fall_is_exact(kind, quadratic):
    """Unheld, under gravity, with uneven carried masses: x = v t - g t^2 / 2, unstrained.

    Not with quadratic elements and lumped mass: gravity keeps to the shape functions.
    """
    mass = np.random.default_rng(3).uniform(0.0, 1e-3, 9 * 3 * 3)
    body = beam(gravity=9.81, fixed=False, mass=mass, quadratic=quadratic,
                divisions=(4, 1, 1) if quadratic else (8, 2, 2))
    solver = DynamicSolver(body, DynamicOptions(mass=kind))
    v = np.broadcast_to([0.3, -0.2, 1.0], body.mesh.nodes.shape)
    state = solver.step(solver.initial(v=v), NO_PADS, 0.2)
    fall = np.array([0.3, -0.2, 1.0]) * 0.2 + 0.5 * np.array([0.0, 0.0, -9.81]) * 0.2**2
    np.testing.assert_allclose(state.x - body.mesh.nodes, np.tile(fall, (len(v), 1)), atol=1e-8)
    assert state.t == pytest.approx(0.2)


@pytest.mark.parametrize('kind', ['lumped', 'consistent'])
def test_mass_matrix_has_the_mass_and_the_inertia(kind):
    """Rigid translation gives the mass, rigid rotation the block's moment of inertia."""
    body = beam()
    M = mass_matrix(Assembler(body), kind)
    mass = 1070.0 * 0.1 * 0.015**2
    e = np.tile([0.0, 1.0, 0.0], len(body.mesh.nodes))
    assert e @ (M @ e) == pytest.approx(mass, rel=1e-12)
    arm = body.mesh.nodes - [0.05, 0.0075, 0.0075]
    spin = np.cross([0.0, 0.0, 1.0], arm).ravel()
    exact = mass * (0.1**2 + 0.015**2) / 12.0
    rel = 1e-10 if kind == 'consistent' else 0.05
    assert spin @ (M @ spin) == pytest.approx(exact, rel=rel)


def test_damped_motion_ends_in_the_static_equilibrium():
    """Gravity switched on, heavy damping: the sag and pad force that the static solver finds."""
    body = beam(damping=(60.0, 0.0), gravity=9.81)
    tip = Pad('tip', body.mesh.node_sets['x1'], np.array([0.0, 0.0, -1.0]),
              np.array([0.1, 0.0075, 0.0075]), 0.05)
    body = dataclasses.replace(body, pads=(tip,))
    push = np.array([[0.0, 0.0, -5e-3]])
    solver = DynamicSolver(body, DynamicOptions(max_step=5e-3))
    state = solver.step(solver.initial(), push, 0.1)
    for _ in range(10):
        state = solver.step(state, push, 0.1)
    static = StaticSolver(body).solve(body.mesh.nodes, push)
    np.testing.assert_allclose(state.x, static.x, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(state.pad_force, static.pad_force, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(state.pad_moment, static.pad_moment, rtol=1e-3, atol=1e-6)
