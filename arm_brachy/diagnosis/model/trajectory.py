"""What a body does while its pads follow a path: the states at given instants.

Test: diagnosis/forward/test_forward.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.diagnosis.signals.motion import FINENESS, corners_of
from arm_brachy.tissue.body import StepFields, Steps
from arm_brachy.tissue.contact_pads import touches
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator

LEAD = 0.02         # s before every instant that a body with memory is stepped to
APART = 1e-6        # s: times closer than that are one
ALIKE = 1e-7        # m: pads closer than that are in one place
PASSING = 4e-4      # m: what is remembered of a push of millimetres changes by less than a tenth


@dataclass(frozen=True)
class Trajectory:
    """States of a body at m instants.

    t : (m,) [s];  pads : (m, p, 3) [m] displacements from rest;  x : (m, n, 3) [m] nodes
    force : (m, p, 3) [N] of the tissue on each pad;  base : (m, 3) [m] displacement of the base
    outcomes : m core.outcome.Outcome. Where one is not OK, `x` and `force` are NaN.
    """

    t: np.ndarray
    pads: np.ndarray
    x: np.ndarray
    force: np.ndarray
    base: np.ndarray
    outcomes: tuple

    @property
    def valid(self):
        """(m,) True where the state was found."""
        return np.array([outcome.ok for outcome in self.outcomes], dtype=bool)

    def take(self, index):
        """The Trajectory at some of its instants."""
        return Trajectory(self.t[index], self.pads[index], self.x[index], self.force[index],
                          self.base[index], tuple(self.outcomes[i] for i in index))


def remembers(body, terms):
    """True if a state of `body`, as `terms` prepared it, depends on the path to it."""
    return bool(touches(body).any()) or any(t.memory(body) is not None and not t.spec.timed
                                            for t in terms)


def timed(terms):
    """True if a state depends on when it is."""
    return any(term.spec.timed for term in terms)


def grid(path, t):
    """Return the times (m,) [s] to step a body with memory to, for its states at t (n,).

    path : transmission.Path of the pads
    The start, the instants, the corners of the path, lest a short reversal is stepped over, and
    20 ms before every instant: what a term notes at the end of a step acts from the next one on.
    """
    travel = float(np.ptp(path.q, axis=0).max(initial=0.0))
    corners = path.t[corners_of(path.t, path.q, max(FINENESS * travel, ALIKE))]
    wanted = np.unique(np.append(t, path.t[0]))
    between = np.unique(np.concatenate([corners, wanted - LEAD]))
    between = between[(between > wanted[0]) & (between < wanted[-1])]
    after = np.searchsorted(wanted, between)
    gap = np.minimum(between - wanted[after - 1], wanted[after] - between)
    between = between[gap > APART]
    return np.union1d(wanted, between[np.diff(between, prepend=-np.inf) > APART])


class Equilibria:
    """Equilibria of a body without memory, each found from the nearest one known.

    body : SoftBody as its terms prepared it;  options : NewtonOptions or None
    """

    def __init__(self, body, options=None):
        self.body, self.solver = body, StaticSolver(body, options=options)
        self._pads, self._x = np.zeros((1, 3 * len(body.pads))), [body.mesh.nodes]
        self._solved = {}

    def begin_from(self, other):
        """Begin from the states that another Equilibria of a mesh alike has found."""
        shift = self.body.mesh.nodes - other.body.mesh.nodes
        self._pads, self._x = other._pads.copy(), [x + shift for x in other._x]

    def trajectory(self, t, pads, partner=None):
        """Return the Trajectory at t (m,) [s] with the pads at `pads` (m, p, 3) [m].

        partner : (m,) number of the instant whose state is taken (`partners`), None = its own
        Instants with pads in one place share a solve; places are visited nearest first.
        """
        flat = pads.reshape(len(t), -1)
        if partner is not None:
            flat = flat[partner]
        _, first, back = np.unique(np.round(flat / ALIKE), axis=0, return_index=True,
                                   return_inverse=True)
        found = [None] * len(first)
        for k in _chain(flat[first], self._pads[-1]):
            found[k] = self._solve(flat[first[k]].reshape(pads.shape[1:]))
        x = np.stack([s.x if s.outcome.ok else np.full_like(s.x, np.nan) for s in found])
        force = np.stack([s.pad_force if s.outcome.ok else np.full_like(s.pad_force, np.nan)
                          for s in found])
        back = back.ravel()
        return Trajectory(np.asarray(t), pads, x[back], force[back], np.zeros((len(t), 3)),
                          tuple(found[k].outcome for k in back))

    def _solve(self, pads):
        """The StaticSolution with pads (p, 3) [m]: each is found once."""
        key = pads.tobytes()
        if key in self._solved:
            return self._solved[key]
        near = int(np.abs(self._pads - pads.ravel()).max(axis=1).argmin())
        solution = self.solver.follow(self._x[near], self.solver.held_positions(pads))
        if solution.outcome.ok:
            self._solved[key] = solution
            if np.array_equal(self._pads[near], pads.ravel()):
                self._x[near] = solution.x
            else:
                self._pads = np.vstack([self._pads, pads.ravel()])
                self._x.append(solution.x)
        return solution


class TimedEquilibria:
    """Equilibria of a body whose terms have no memory but the clock.

    body : SoftBody as `terms` prepared it;  options : NewtonOptions or None
    """

    def __init__(self, body, terms, options=None):
        self.body, self.terms = body, terms
        self.solver, self._x = StaticSolver(body, options=options), {}      # by their instant
        self._memories = tuple(term.memory(body) for term in terms)

    def begin_from(self, other):
        """Begin from the states that another TimedEquilibria of a mesh alike has found."""
        shift = self.body.mesh.nodes - other.body.mesh.nodes
        self._x = {t: x + shift for t, x in other._x.items()}

    def trajectory(self, t, pads, partner=None):
        """Return the Trajectory at t (m,) [s] with the pads at `pads` (m, p, 3) [m].

        partner : (m,) number of the instant whose state is taken (`partners`), None = its own
        Each is found from what is known of its instant, else from the one found before whose pads
        are nearest.
        """
        flat, found = pads.reshape(len(t), -1), {}
        partner = np.arange(len(t)) if partner is None else partner
        wanted = np.unique(partner)
        for i in wanted[_chain(flat[wanted], np.zeros(flat.shape[1]))]:
            near = min((k for k in found if found[k][0].outcome.ok), default=None,
                       key=lambda k: np.abs(flat[k] - flat[i]).max())
            fields = self._fields(t[i])
            start = self._x.get(t[i], self.body.mesh.nodes if near is None else found[near][0].x)
            state = self.solver.follow(start, self.solver.held_positions(pads[i], fields.base),
                                       fields)
            found[i] = state, fields.base
            if state.outcome.ok:
                self._x[t[i]] = state.x
        states, base = zip(*(found[i] for i in partner), strict=True)
        x, force = np.stack([s.x for s in states]), np.stack([s.pad_force for s in states])
        lost = np.array([not s.outcome.ok for s in states])
        x[lost], force[lost] = np.nan, np.nan
        return Trajectory(np.asarray(t), pads, x, force, np.stack(base),
                          tuple(s.outcome for s in states))

    def _fields(self, t):
        fields = StepFields.of(self.body)
        for term, memory in zip(self.terms, self._memories, strict=True):
            term.before_step(self.body, memory, t, np.inf, fields)
        return fields


def partners(pads, passing):
    """Return (m,) the instant of the nearest pads, where that is near, for instants in passing.

    pads : (m, p) [m];  passing : (m,) True for instants that matter for memories alone
    Others, and those that have no near one, are their own.
    """
    out, kept = np.arange(len(pads)), list(np.flatnonzero(~passing))
    for i in np.flatnonzero(passing):
        off = np.abs(pads[kept] - pads[i]).max(axis=1)
        if off.min(initial=np.inf) <= PASSING:
            out[i] = kept[int(off.argmin())]
        else:
            kept.append(i)
    return out


def _chain(places, here):
    """Order of places (k, d): always on to the nearest one not visited yet, from `here` (d,)."""
    left, order = list(range(len(places))), []
    while left:
        k = left.pop(int(np.abs(places[left] - here).max(axis=1).argmin()))
        order.append(k)
        here = places[k]
    return order


def stepped(body, terms, t, pads, options=None):
    """Return the Trajectory of a body with memory, stepped from t[0], where it has always rested.

    body : SoftBody without terms;  terms : body terms, order of the registry
    t : (m,) [s], increasing;  pads : (m, p, 3) [m], straight between the instants
    """
    simulator = TissueSimulator(body, terms, options=options)
    simulator.reset(t[0])
    states = [simulator.settle(pads[0])]
    states += [simulator.step(now, there) for now, there in zip(t[1:], pads[1:], strict=True)]
    # A step after a failure starts from further back, which friction and damage notice.
    lost = np.array([s.outcome is not Outcome.OK for s in states])
    x, force = np.stack([s.x for s in states]), np.stack([s.pad_force for s in states])
    x[lost], force[lost] = np.nan, np.nan
    return Trajectory(np.asarray(t), pads, x, force, np.stack([s.base for s in states]),
                      tuple(s.outcome for s in states))


def evolve(body, terms, trajectory, at=None, *, lasting=False):
    """Return the StepFields in force at instants of a Trajectory, memory following its x.

    Where nothing is remembered all instants share one.

    body : SoftBody as `terms` prepared it;  terms : body terms
    at : (k,) numbers of the instants, increasing; None = all
    lasting : those of a step without end instead, by which small loads answer that never change
    Each memory is carried along positions that are given, not solved for: to first order in an
    effect this is what it does, and exact for the terms that the trajectory was found with. The
    first instant has lasted for ever. Raises InvertedElement as the terms do.
    """
    dt = np.diff(trajectory.t, prepend=-np.inf)
    acting = np.full(len(dt), np.inf) if lasting else dt
    at = np.arange(len(dt)) if at is None else np.asarray(at)
    terms = [term for term in terms if term.memory(body) is not None]
    if not terms:
        return [StepFields.of(body)] * len(at)
    fields = [StepFields.of(body) for _ in at]
    steps = Steps(trajectory.t, dt, acting, trajectory.x,
                  _swelling(body, terms, trajectory.t, acting), at)
    for term in terms:
        term.carried(body, steps, fields)
    return fields


def _swelling(body, terms, t, acting):
    """(m,) stretch of the stress-free shape at t (m,), which only the clock changes."""
    terms, out = [(term, term.memory(body)) for term in terms if term.spec.timed], np.ones(len(t))
    for k, now in enumerate(t if terms else ()):
        fields = StepFields.of(body)
        for term, memory in terms:
            term.before_step(body, memory, now, acting[k], fields)
        out[k] = fields.swelling
    return out
