"""The first equilibrium of a body: its dead loads put on at once or, where that fails, in steps.

A slender body that its weight bends by more than its own thickness is beyond Newton's reach from
the stress-free shape: every portion of the weight bends it a little more, which Newton follows.
Test: verification/test_slender.py (the elastica under its own weight)
"""

import dataclasses

import numpy as np

from arm_brachy.tissue.body import StepFields

# A strip of 150 x 10 x 10 mm of 300 kPa (q L^3 / E I = 14) takes 5, one of 100 kPa 20.
PORTIONS = (5, 20, 60)


def rest(solver, x0, pad_displacement, fields=None):
    """Return the newton.StaticSolution that `solver.solve` would, also where that fails at once.

    solver : newton.StaticSolver;  x0, pad_displacement, fields : as its `solve`
    Bodies that `solve` brings to rest get its very bits. Otherwise what is out of balance at x0 is
    let go in equal portions, pads moving along, until one number of them leads all the way.
    iterations, factorisations, load_steps : of the way that led there
    If none does, returns what `solve` had: x = x0, its outcome.
    """
    found = solver.solve(x0, pad_displacement, fields)
    if found.outcome.ok or not found.residual < np.inf:
        return found
    for count in PORTIONS:
        led = _in_portions(solver, x0, pad_displacement, fields, count)
        if led is not None:
            return led
    return found


def _in_portions(solver, x0, pad_displacement, fields, count):
    """The StaticSolution after `count` equal portions, None where one fails."""
    fields = StepFields.of(solver.body) if fields is None else fields
    goal = solver.held_positions(pad_displacement, fields.base)
    excess = np.zeros_like(goal)
    free = solver.free.free
    excess[free] = solver.assembler.forces(x0, fields)[free]
    x, spent = np.array(x0, dtype=float), np.zeros(3, dtype=int)
    for k in range(1, count + 1):
        part = k / count
        force = fields.nodal_force + (1.0 - part) * excess
        found = solver.solve_held(x, x0 + part * (goal - x0),
                                  dataclasses.replace(fields, nodal_force=force))
        if not found.outcome.ok:
            return None
        x = found.x
        spent += (found.iterations, found.factorisations, found.load_steps)
    return dataclasses.replace(found, **dict(zip(
        ('iterations', 'factorisations', 'load_steps'), spent.tolist(), strict=True)))
