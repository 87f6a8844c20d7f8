"""States of a body with memory, each solve begun where a motion alike leads.

Test: diagnosis/forward/test_forward.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.diagnosis.model.trajectory import Trajectory
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.newton import StaticSolver


@dataclass(frozen=True)
class Alongside:
    """Motion of the same body without some of its memories.

    states : Trajectory from the start of the recording on, straight between its instants
    rest : (n, 3) [m] its nodes at rest
    """

    states: Trajectory
    rest: np.ndarray

    def trajectory(self, body, terms, t, pads, options=None):
        """Return the Trajectory of a body with memory at t (m,) [s], the first one for ever.

        body : SoftBody of a mesh alike as `terms` prepared it, no pad touching
        pads : (m, p, 3) [m], straight between the instants;  options : NewtonOptions or None
        What `trajectory.stepped` comes to, at two thirds of its cost: a step is begun as far off
        the motion alike as the last one ended. After a state that is not found there is none.
        """
        like = _between(self.states, t) + (body.mesh.nodes - self.rest)
        solver, memories = StaticSolver(body, options=options), tuple(
            term.memory(body) for term in terms)
        x, base = np.full_like(like, np.nan), np.zeros((len(t), 3))
        force, outcomes = np.full(pads.shape, np.nan), [Outcome.NOT_CONVERGED] * len(t)
        off = np.zeros_like(self.rest)
        for k, dt in enumerate(np.diff(t, prepend=-np.inf)):
            fields = StepFields.of(body)
            for term, memory in zip(terms, memories, strict=True):
                term.before_step(body, memory, t[k], dt, fields)
            found = solver.follow(like[k] + off, solver.held_positions(pads[k], fields.base),
                                  fields)
            outcomes[k], base[k] = found.outcome, fields.base
            if not found.outcome.ok:
                break
            x[k], force[k], off = found.x, found.pad_force, found.x - like[k]
            swollen = body.swollen(fields.swelling)
            memories = tuple(term.after_step(swollen, memory, found.x, t[k], dt)
                             for term, memory in zip(terms, memories, strict=True))
        return Trajectory(t, pads, x, force, base, tuple(outcomes))


def _between(states, t):
    """(m, n, 3) [m] positions of a Trajectory at t (m,) [s], straight between its instants."""
    after = np.clip(np.searchsorted(states.t, t), 1, len(states.t) - 1)
    share = (t - states.t[after - 1]) / (states.t[after] - states.t[after - 1])
    share = share[:, None, None]
    return (1.0 - share) * states.x[after - 1] + share * states.x[after]
