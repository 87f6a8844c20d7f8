"""States of a body on the way into it: each rests where the pads have gone a step further."""

import numpy as np

from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

# A network that is to be right to 0.1 mm learns from states right to a hundredth of that; a walk
# that needs more than so many tangents for a step is past where the model can follow.
STATICS = NewtonOptions(tolerance=1e-6, max_factorisations=8, max_bisections=1)


def walk_states(walk, steps, options=STATICS):
    """Return (displacements (k, n, 3) [m] float32, fraction (k,)) of the states that converge.

    walk : loads.Walk;  steps : states, at 1/steps .. 1 of the walk's travel. A body that weighs
    rests first. The walk ends where a state does not converge, so that k <= steps.
    """
    solver = StaticSolver(walk.body, options=options)
    rest = walk.body.mesh.nodes
    directions = np.array([pad.direction for pad in walk.body.pads])
    before, found = [rest], []
    for k in range(0 if walk.body.gravity.any() else 1, steps + 1):
        way = directions * (walk.travel * k / steps)[:, None]
        held = solver.held_positions(way)
        solution = solver.follow(_ahead(before), held)
        if not solution.outcome.ok:
            # what was extrapolated may lie further from equilibrium than the last state
            solution = solver.solve_held(before[-1], held)
        if not solution.outcome.ok:
            break
        before = [*before[-2:], solution.x]
        if k:
            found.append((solution.x - rest).astype(np.float32))
    shape = (len(found), *rest.shape)
    # of no state the type would be float64, and that of the whole shard with it
    return np.array(found, dtype=np.float32).reshape(shape), np.arange(1, len(found) + 1) / steps


def _ahead(states):
    """The state that follows if the last, at most three, lie on a parabola, equally far apart."""
    if len(states) == 3:
        return 3.0 * (states[2] - states[1]) + states[0]
    if len(states) == 2:
        return 2.0 * states[1] - states[0]
    return states[0]
