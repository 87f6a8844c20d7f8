"""Damping against the logarithmic decrement of a column that rings."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.damping import Damping

ALPHA, BETA, END = 3.0, 0.02, 1.0


def column(alpha=0.0, beta=0.0):
    """Column of 60 mm held below, in weak lateral gravity in which it is not at rest.

    It is twice as wide as deep, or its two bending modes would beat.
    """
    mesh = box_mesh((0.02, 0.04, 0.06), (2, 3, 4))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.3)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], gravity=np.array([0.05, 0.0, 0.0]),
                    damping=(alpha, beta))


def ringing(body, *terms):
    """Times and deflections of the top, from its rest, at the extremes of its first mode."""
    options = DynamicOptions(rho_inf=1.0, max_step=4e-3)
    simulator = TissueSimulator(body, terms, dynamics='implicit', options=options)
    top, none = body.mesh.node_sets['z1'], np.zeros((0, 3))
    rest = simulator.settle().x[top, 0].mean()
    simulator.reset()
    t = np.arange(1, round(END / 4e-3)) * 4e-3
    sway = np.array([simulator.step(now, none).x[top, 0].mean() for now in t]) - rest
    peak = np.flatnonzero((np.abs(sway[1:-1]) >= np.abs(sway[:-2]))
                          & (np.abs(sway[1:-1]) > np.abs(sway[2:]))) + 1
    return t[peak], np.abs(sway[peak])


def decay(body, *terms):
    """(decay rate [1/s], angular frequency [rad/s]) of the first mode."""
    t, size = ringing(body, *terms)
    return -np.polyfit(t, np.log(size), 1)[0], np.pi * (len(t) - 1) / (t[-1] - t[0])


def test_mass_proportional_damping():
    """Amplitude falls as exp(-alpha t / 2), whatever the frequency."""
    rate, _ = decay(column(alpha=ALPHA), Damping(alpha_factor=2.0, beta_factor=7.0))
    assert rate == pytest.approx(0.5 * 2.0 * ALPHA, rel=0.03)


def test_stiffness_proportional_damping():
    """Amplitude falls as exp(-beta w^2 t / 2)."""
    rate, w = decay(column(beta=BETA), Damping(alpha_factor=7.0, beta_factor=0.5))
    assert rate == pytest.approx(0.5 * 0.5 * BETA * w**2, rel=0.03)


def test_a_quasi_static_body_does_not_see_it():
    plain = column(ALPHA, BETA)
    lid = Pad('lid', plain.mesh.node_sets['z1'], np.array([0.0, 0.0, -1.0]),
              np.array([0.01, 0.02, 0.06]), 0.02)
    body = dataclasses.replace(plain, pads=(lid,))
    states = []
    for terms in ((), (Damping(5.0, 5.0),)):
        simulator = TissueSimulator(body, terms)
        simulator.settle()
        states.append(simulator.step(0.1, [[0.0, 0.0, -3e-3]]))
    np.testing.assert_array_equal(states[1].x, states[0].x)
    np.testing.assert_array_equal(states[1].pad_force, states[0].pad_force)
