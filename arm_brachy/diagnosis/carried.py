"""States of a body with memory at a tenth of their cost: memories follow a motion that is given.

Test: diagnosis/forward/test_forward.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.trajectory import Trajectory, evolve
from arm_brachy.tissue.newton import StaticSolver


@dataclass(frozen=True)
class Past:
    """Motion of a body from the start of a recording on.

    states : Trajectory, straight between its instants;  rest : (n, 3) [m] its nodes at rest
    """

    states: Trajectory
    rest: np.ndarray

    def trajectory(self, body, terms, t, pads, options=None):
        """Return the Trajectory of a body with memory at t (k,) [s] and all instants between.

        body : SoftBody of the same mesh as `terms` prepared it, no pad touching
        pads : (k, p, 3) [m];  options : NewtonOptions or None
        States at t are equilibria; only what a memory holds is of the motion given, which is all
        there is between. Where pads hold the body a memory of stress hardly moves it (T3), so that
        this is near `trajectory.stepped`: near enough to search by, not to answer with.
        """
        past = _with_instants(self.states, t)
        start = past.x + (body.mesh.nodes - self.rest)
        past = Trajectory(past.t, past.pads, start, past.force, past.base, past.outcomes)
        solver, number = StaticSolver(body, options=options), np.searchsorted(t, past.t)
        x, force, base = start.copy(), past.force.copy(), past.base.copy()
        where, outcomes = past.pads.copy(), list(past.outcomes)
        for k, fields in enumerate(evolve(body, terms, past)):
            i = number[k]
            if i == len(t) or t[i] != past.t[k]:
                continue
            found = solver.follow(start[k], solver.held_positions(pads[i], fields.base), fields)
            ok = found.outcome.ok
            x[k], force[k] = (found.x, found.pad_force) if ok else (np.nan, np.nan)
            where[k], base[k], outcomes[k] = pads[i], fields.base, found.outcome
        return Trajectory(past.t, where, x, force, base, tuple(outcomes))


def _with_instants(states, t):
    """The Trajectory with instants t (k,) [s] besides its own, straight between those."""
    new = np.setdiff1d(t, states.t)
    if not len(new):
        return states
    after = np.clip(np.searchsorted(states.t, new), 1, len(states.t) - 1)
    share = (new - states.t[after - 1]) / (states.t[after] - states.t[after - 1])
    order = np.argsort(np.concatenate([states.t, new]), kind='stable')

    def mixed(values):
        w = share.reshape(-1, *[1] * (values.ndim - 1))
        between = (1.0 - w) * values[after - 1] + w * values[after]
        return np.concatenate([values, between])[order]

    outcomes = [*states.outcomes, *(states.outcomes[i] for i in after)]
    return Trajectory(mixed(states.t), mixed(states.pads), mixed(states.x), mixed(states.force),
                      mixed(states.base), tuple(outcomes[i] for i in order))
