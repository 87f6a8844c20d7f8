"""Quasi-static steps of a soft body in frictional contact with rigid bodies that are moved."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.contact import ContactAssembler
from arm_brachy.tissue.contact_newton import ContactNewton, OutOfBalance
from arm_brachy.tissue.contact_poses import between, carried, checked_poses, moved
from arm_brachy.tissue.contact_state import ContactState, NodalContact, Touch
from arm_brachy.tissue.dynamics import pad_loads
from arm_brachy.tissue.newton import NewtonOptions

# [m] A body that grazes the tissue advances by this where the gap alone would take for ever.
SMALLEST_ADVANCE = 1e-5


@dataclass(frozen=True)
class ContactOptions:
    """How corrections are found, when the factor is renewed, when a step is given up.

    max_iterations : Newton corrections per part of a step
    forcing : part of the residual's norm that the Krylov space of a correction may leave
    max_krylov : its largest dimension, here 25 back-solves or two factorisations
    patience : back-solves in one correction beyond which the next has a new factor; 0.2 mm of a
        quadratic breast cost 0.39 s with 5, 0.46 s with 8, 0.58 s with 12
    contraction : the tissue's own tangent is kept while corrections shrink by this
    max_lags : minimisations with friction lagged where these corrections fail
    max_bisections : smallest part of a step 2^-max_bisections of the motion
    """

    max_iterations: int = 40
    forcing: float = 0.1
    max_krylov: int = 25
    patience: int = 5
    contraction: float = 0.5
    max_lags: int = 3
    max_bisections: int = 6


class ContactSolver:
    """Finds where a SoftBody rests when rigid bodies are moved against it.

    body : SoftBody; its pads, if any, stay bonded;  pairs : ContactPair, one per rigid body
    law : contact.ContactLaw;  options : ContactOptions;  newton : NewtonOptions
    `step` depends on its arguments alone, `follow` also on earlier calls. With friction a state
    depends on the path: the way between two calls is taken to be straight, and points that begin
    to touch count their slip from the start of the step, so what friction does converges with the
    length of the step.
    Valid where the equilibrium is stable, which is not checked (`ContactNewton`): a frictionless
    or soft body under a pad may have several, and which is found depends on the step.
    """

    def __init__(self, body, pairs, *, law=None, options=None, newton=None):
        self.body = body
        self.options = ContactOptions() if options is None else options
        self.assembler = ContactAssembler(Assembler(body), pairs, law)
        # Steps are cut here, with the poses, not there.
        newton = dataclasses.replace(newton or NewtonOptions(), max_bisections=0)
        self.statics = ContactNewton(body, options=newton, assembler=self.assembler,
                                     contact=self.options)
        self.pairs = self.assembler.pairs
        self._rough = any(pair.friction > 0.0 for pair in self.pairs)

    def initial(self, X_WB, x=None):
        """Return the ContactState at poses X_WB (b, 4, 4) with the tissue at x, not yet at rest.

        x : (n, 3) [m], None = rest positions. Points that touch there bear no friction yet.
        """
        x = self.body.mesh.nodes.copy() if x is None else np.array(x, dtype=float)
        X_WB = checked_poses(X_WB, self.pairs)
        self.assembler.place(X_WB, self.assembler.points)
        points = tuple(dataclasses.replace(p, anchor=p.position, limit=np.zeros_like(p.gap))
                       for p in self.assembler.seen(x))
        self.assembler.place(X_WB, points)
        return self._state(x, self.assembler.forces(x), X_WB, points, np.zeros(len(self.pairs)))

    def touching(self, X_WB, x=None):
        """Return the poses X_WB (b, 4, 4) moved along each body's own z to where it first touches.

        x : (n, 3) [m], None = rest positions. A flat pad whose centre lies on a curved surface
        begins inside it (4 to 7 mm on the breast). Raises InputError for a body that touches
        nothing along its z.
        """
        x = self.body.mesh.nodes if x is None else np.asarray(x, dtype=float)
        X = checked_poses(X_WB, self.pairs)
        reach = 2.0 * np.linalg.norm(np.ptp(x, axis=0))
        inside = np.array([self._first_touch(b, x, X, reach) for b in range(len(X))])
        lost = np.flatnonzero(inside > reach)
        if len(lost):
            raise InputError(f'contact {self.pairs[lost[0]].name}: touches nothing along its '
                             'direction; point it at the tissue')
        return moved(X, inside[:, None] * X[:, :3, 2])

    def _first_touch(self, b, x, X, reach):
        """Advance from -reach along z by the gap, which is always safe, then halve the last step.

        [m] along z from X, the last place found clear.
        """
        def gap(way):
            self.assembler.place(moved(X, way * X[:, :3, 2]), self.assembler.points)
            return self.assembler.least_gap(b, x)

        clear, step = -reach, 0.0
        while clear <= reach:
            step = max(gap(clear), SMALLEST_ADVANCE)
            if gap(clear + step) <= 0.0:
                break
            clear += step
        for _ in range(40):  # to below a picometre
            step /= 2.0
            if gap(clear + step) > 0.0:
                clear += step
        return clear

    def step(self, state, X_WB, held_at=None, fields=None):
        """Return the ContactState with the bodies moved to X_WB and the tissue at rest there.

        state : ContactState to start from;  X_WB : (b, 4, 4) rigid poses
        held_at : (n, 3) [m] where held nodes go (`StaticSolver.held_positions`), None = they stay
        fields : StepFields, None = the body's own
        If no equilibrium is found, returns `state` with the outcome INVERTED_ELEMENT or
        NOT_CONVERGED. Raises InputError for poses of the wrong shape or not rigid.
        """
        X_WB = checked_poses(X_WB, self.pairs)
        held_at = state.x if held_at is None else np.asarray(held_at, dtype=float)
        fields = StepFields.of(self.body) if fields is None else fields
        counts = {'iterations': 0, 'factorisations': 0, 'solves': 0, 'steps': 0}
        now, t, size, spent = state, 0.0, 1.0, np.zeros(len(self.pairs))
        while t < 1.0:
            ahead = min(1.0, t + size)
            goal = state.x + ahead * (held_at - state.x)
            try:
                now = self._part(now, between(state.X_WB, X_WB, ahead), goal, fields, counts)
            except OutOfBalance as failure:
                size /= 2.0
                if size < 0.5 ** self.options.max_bisections:
                    return dataclasses.replace(state, outcome=failure.outcome, **counts)
                continue
            t, size, spent = ahead, 2.0 * size, spent + now.dissipation
            counts['steps'] += 1
        return dataclasses.replace(now, dissipation=spent, **counts)

    def follow(self, state, X_WB, trend, held_at=None, fields=None):
        """The same as `step`, faster where states succeed each other in small steps.

        trend : (n, 3) [m] expected way of the nodes
        Starts from there with the last factor, however old; where that leads nowhere, `step`
        takes over. The state depends on earlier calls within the tolerance.
        """
        if self.statics.ready:
            X, there = checked_poses(X_WB, self.pairs), state.x + trend
            goal = state.x if held_at is None else np.asarray(held_at, dtype=float)
            loads = StepFields.of(self.body) if fields is None else fields
            counts = {'iterations': 0, 'factorisations': 0, 'solves': 0, 'steps': 1}
            try:
                self._refuse_depth(state, there, X)
                found = self._settle(state, there, X, goal, loads, counts)
                return dataclasses.replace(found, **counts)
            except OutOfBalance:  # not from here; `step` counts anew
                pass
        return self.step(state, X_WB, held_at, fields)

    def nodal(self, state):
        """Return the NodalContact of a ContactState."""
        self.assembler.place(state.X_WB, state.points)
        rows = [self._nodal(b, state.x, seen) for b, seen in enumerate(state.points)]
        return NodalContact(*(np.array(column) for column in zip(*rows, strict=True)))

    def _nodal(self, b, x, points):
        surface = self.assembler.surfaces[b]
        weights = np.einsum('fq,qa->fqa', surface.weights, surface.shape ** 2)
        where = np.repeat(surface.faces[:, None, :], surface.shape.shape[0], axis=1).ravel()

        def gathered(values):
            shares = (values[..., None] * weights).ravel()
            return np.bincount(where, shares, minlength=self.assembler.n)

        k_t = self.assembler.law.constants(self.body)[2]
        slides = k_t * np.linalg.norm(points.slip, axis=-1) >= (1.0 - 1e-9) * points.limit
        total, area = gathered(points.pressure), gathered(1.0 * (points.pressure > 0.0))
        touch = np.where(gathered(points.pressure * slides) > 0.5 * total, Touch.SLIPS,
                         Touch.STICKS)
        return (np.divide(total, area, out=np.zeros_like(total), where=area > 0.0),
                self.assembler.node_gaps(b, x), np.where(total > 0.0, touch, Touch.FREE))

    def sensitivity(self, state, fields=None):
        """Return d x / d translation of each body, (n, 3, b, 3) [m/m], at a ContactState.

        fields : StepFields of its step. Exact without friction and where points stick or are
        free; where they slip, the change of the friction limit with pressure is left out.
        Raises NotConverged where the tangent is not positive definite.
        """
        n, motion = self.assembler.n, np.tile(np.eye(3), (self.assembler.n, 1))
        self.assembler.place(state.X_WB, state.points)
        _, factor = self.statics.linearise(state.x, fields)
        out = np.zeros((3 * n, len(self.pairs), 3))
        for b in range(len(self.pairs)):
            pull = self.assembler.contact_tangent(b, state.x) @ motion
            out[self.statics.free.dofs, b] = factor.solve(pull[self.statics.free.dofs])
        return out.reshape(n, 3, len(self.pairs), 3)

    def _part(self, state, X_WB, held_at, fields, counts):
        """One part of a step: predicted by the tangent, then brought into balance.

        Where Newton ends in no balance, it starts again from a minimum of the potential with
        friction lagged: that always exists; more than one such minimum only helps with friction.
        """
        x = self._predict(state, X_WB, held_at, fields, counts)
        try:
            return self._settle(state, x, X_WB, held_at, fields, counts)
        except OutOfBalance as failure:
            if failure.outcome is Outcome.INVERTED_ELEMENT or not self.options.max_lags:
                raise
        self.assembler.place(X_WB, state.points)
        for lag in range(self.options.max_lags):
            x = self.statics.minimise(x, held_at, fields, counts)
            lagged = self.assembler.points
            try:
                return self._settle(state, x, X_WB, held_at, fields, counts)
            except OutOfBalance:
                if lag + 1 == self.options.max_lags or not self._rough:
                    raise
            self.assembler.place(X_WB, lagged)
            self.assembler.renew(x)

    def _settle(self, state, x, X_WB, held_at, fields, counts):
        """The ContactState found from x, friction remembered from `state`; or OutOfBalance."""
        x = x.copy()
        x[self.statics.free.held] = held_at[self.statics.free.held]
        self.assembler.place(X_WB, state.points)
        x, found = self.statics.balance(x, fields, counts)
        return self._finish(x, found.forces, X_WB)

    def _predict(self, state, X_WB, held_at, fields, counts):
        """Let the tissue follow the tangent, lest a body be pushed through what it touches."""
        self.assembler.place(state.X_WB, state.points)
        free, way = self.statics.free, np.zeros_like(state.x)
        way[free.held] = (held_at - state.x)[free.held]
        pull = np.zeros(3 * self.assembler.n)
        for b, (start, goal) in enumerate(zip(state.X_WB, X_WB, strict=True)):
            if state.points[b].pressure.any() and not np.array_equal(start, goal):
                motion = carried(state.x, start, goal) - state.x
                pull += self.assembler.contact_tangent(b, state.x) @ motion.ravel()
        if not pull.any() and not way.any():  # before anything is factorised
            self._refuse_depth(state, state.x, X_WB)
            self.assembler.place(state.X_WB, state.points)
        self.statics.prepare(state.x, fields, counts)
        if way.any():
            pull -= self.assembler.tangent(state.x, fields) @ way.ravel()
        x = state.x + way
        x[free.free] += self.statics.solve_free(pull[free.dofs])
        before, ahead = (self.assembler.inner.evaluate(at, fields).min_J for at in (state.x, x))
        if not ahead > self.statics.options.crushing * before:
            raise OutOfBalance(Outcome.INVERTED_ELEMENT)
        self._refuse_depth(state, x, X_WB)
        return x

    def _refuse_depth(self, state, x, X_WB):
        """Raise OutOfBalance if a point lies where the distance to its body is not smooth."""
        self.assembler.place(X_WB, state.points)
        if any(-points.gap.min() >= pair.shape.depth
               for pair, points in zip(self.pairs, self.assembler.seen(x), strict=True)):
            raise OutOfBalance(Outcome.NOT_CONVERGED)

    def _finish(self, x, forces, X_WB):
        """The state at an equilibrium; anchors are drawn along to where the points slid."""
        points, work = [], np.zeros(len(self.pairs))
        k_t = self.assembler.law.constants(self.body)[2]
        seen = self.assembler.seen(x)
        for b, (surface, lagged, new) in enumerate(zip(self.assembler.surfaces,
                                                       self.assembler.points, seen, strict=True)):
            slip = dataclasses.replace(new, normal=lagged.normal).slip
            size = np.linalg.norm(slip, axis=-1)
            elastic = np.minimum(size, lagged.limit / k_t)
            work[b] = np.sum(surface.weights * k_t * elastic * (size - elastic))
            share = np.divide(elastic, size, out=np.zeros_like(size), where=size > 0.0)
            points.append(dataclasses.replace(new, anchor=new.position - share[..., None] * slip))
        return self._state(x, forces, X_WB, tuple(points), work)

    def _state(self, x, forces, X_WB, points, work):
        shares = self.assembler.contact_forces(x)
        moment = np.cross(x - X_WB[:, None, :3, 3], shares).sum(axis=1)
        depth = np.array([max(0.0, -seen.gap.min()) for seen in points])
        residual = float(np.abs(forces[self.statics.free.free]).max(initial=0.0))
        return ContactState(x, X_WB, shares.sum(axis=1), moment, depth, work,
                            *pad_loads(self.body, forces), points, residual)
