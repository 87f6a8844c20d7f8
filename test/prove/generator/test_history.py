"""Newton's method for tissue that remembers: its stiffness, and the factor that it takes."""
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.prove.generator.grid import Grid
from arm_brachy.prove.generator.history import Chords
from arm_brachy.prove.generator.memory import Law, Memory, advance
from arm_brachy.prove.generator.mesh import make_mesh
from arm_brachy.prove.generator.shape import Dome
from arm_brachy.prove.generator.solver import Model, uniform

DT = 0.1
SOFTENING = Law(damage=0.4, energy=40.0)
BOTH = replace(SOFTENING, shares=(0.2, 0.1), times=(0.5, 8.0))
NOWHERE = np.zeros(1)       # travel of a pad that is not there


@pytest.fixture(scope='module')
def model():
    dome = Dome((0.06, 0.055), 0.05, (0.004, 0.0), (0.02, 0.03, 0.0, 0.01, 0.0))
    grid = Grid(make_mesh(dome, (), levels=2), 'nodal')
    return Model(grid, (), uniform(grid, 10e3, 0.47))


def strained(model):
    """Unknowns (n,): the dome sheared and stretched by some 10 %, more towards its top."""
    x, y, z = model.grid.nodes.T
    u = np.column_stack([0.12 * z, 0.03 * z * y / 0.05, 0.08 * z])
    return np.r_[u.ravel(), np.zeros(model.grid.pressures)]


def forces(model, law, memory, x):
    """(residual (n,) with memory, the Memory after it)."""
    cut = 3 * len(model.grid.nodes)
    u = x[:cut].reshape(-1, 3)
    f, g = model.residual(u, x[cut:])
    extra, after = advance(model, law, memory, u, DT)
    return np.r_[(f + extra).ravel(), g], after


@pytest.mark.parametrize('part', ['all of it softens further', 'none of it does'])
def test_a_step_undoes_what_a_small_displacement_does_to_the_forces(model, part):
    """From twice the strain softened before, nothing softens; from none, every point does."""
    x, rng = strained(model), np.random.default_rng(5)
    memory = Memory.fresh(model.grid.slopes[1].shape)
    if part == 'none of it does':
        memory = forces(model, SOFTENING, memory, 2.0 * x)[1]
    chords = Chords(model)
    _, after = forces(model, SOFTENING, memory, x)
    grows = after.energy > memory.energy
    assert grows.mean() > 0.99 if part.startswith('all') else not grows.any()
    chords.add(NOWHERE, x, SOFTENING.sudden(after, DT), SOFTENING.standing(after, DT),
               SOFTENING.loss(memory, after))
    d = np.where(chords.fixed, 0.0, 1e-3 * rng.normal(size=len(x)))
    h = 1e-4
    change = (forces(model, SOFTENING, memory, x + h * d)[0]
              - forces(model, SOFTENING, memory, x - h * d)[0]) / (2.0 * h)
    cut = 3 * len(model.grid.nodes)
    off = (chords.step(NOWHERE, change) + d)[:cut]
    assert np.abs(off).max() < 1e-3 * np.abs(d[:cut]).max()


def test_of_factors_at_one_travel_the_latest_counts(model):
    """One made there again is made because the one before no longer served."""
    x = strained(model)
    again, once = Chords(model), Chords(model)
    again.add(NOWHERE, 0.0 * x)
    for chords in (again, once):
        chords.add(NOWHERE, x)
    residual = np.random.default_rng(6).normal(size=len(x))
    np.testing.assert_array_equal(again.step(NOWHERE, residual), once.step(NOWHERE, residual))


@pytest.mark.parametrize('law', [SOFTENING, BOTH])
def test_memory_of_a_step_that_goes_back_keeps_its_largest_energy(model, law):
    x, fresh = strained(model), Memory.fresh(model.grid.slopes[1].shape)
    there = forces(model, law, fresh, x)[1]
    back = forces(model, law, there, 0.5 * x)[1]
    np.testing.assert_array_equal(back.energy, there.energy)
    assert not law.loss(there, back).any()
