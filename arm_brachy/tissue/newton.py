"""Quasi-static equilibrium under prescribed pad motion: Newton on the total potential."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.free_dofs import FreeDofs, held_nodes, moved_from_rest
from arm_brachy.tissue.linear_solver import FactorisationFailed
from arm_brachy.tissue.secants import Secants


@dataclass(frozen=True)
class NewtonOptions:
    """When to stop, when to refactorise, when to give up."""

    tolerance: float = quantity(
        1e-7, 'mm', 'largest nodal correction still outstanding at convergence', low=1e-10,
        source='a tenth of 1e-9 m, since the correction is estimated with a tangent that may be '
               'one step old; six decades below the sensors')
    max_iterations: int = 40            # per load step; a healthy step takes 3 to 8
    max_bisections: int = 8             # smallest load step 2^-8 of the command
    # A solve that needs more is lost: a dome pushed by a third of its height takes 50. On 2300
    # quadratic elements the limit is reached in some ten seconds.
    max_factorisations: int = 150
    # Keep the old factor while, at the rate at which corrections have shrunk since it was made, at
    # most so many are still to come, besides those that cost as much as a new factor. They come
    # faster than that rate says, since every one teaches something (dome, 10 mm, linear elements:
    # 12 corrections with 3 factors, 25 ms; with patience 4, 9 with 6, 32 ms).
    patience: float = 12.0
    # The same for `follow`, whose later steps gain by a new factor too (target_1's plant: 0.60 s
    # for a second of small steps; with 12 it takes 0.92 s).
    step_patience: float = 4.0
    # A load step whose linear prediction leaves an element less than this part of its volume is
    # halved: back from there costs more iterations than two steps (dome, 20 mm: 24 against 15).
    crushing: float = 0.3
    sufficient_decrease: float = 1e-4   # Armijo constant, Nocedal & Wright (2006), sec. 3.1
    max_backtracks: int = 12            # halvings of one Newton step
    # First multiple of the diagonal added when the tangent is not positive definite, growing
    # tenfold (Nocedal & Wright, algorithm 3.3).
    first_shift: float = 1e-3
    max_shifts: int = 6


@dataclass(frozen=True)
class StaticSolution:
    """What a solve came to. If `outcome` is not OK, x is the state it started from.

    x : (n, 3) [m];  pad_force : (p, 3) [N] of the tissue ON each pad (NaN if x is inverted)
    pad_moment : (p, 3) [N m] of those forces about the displaced disc centre
    iterations : corrections made;  factorisations : tangents factorised;  load_steps : taken
    residual : [N] largest out-of-balance force component on a free node at x
    """

    x: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    iterations: int
    factorisations: int
    load_steps: int
    residual: float
    outcome: Outcome


# What one correction costs, an evaluation and a back-solve, in operations of a factorisation for
# each entry of the factor. Measured on 2398 tetrahedra: a factor costs as much as 5 corrections
# (linear, 130 operations an entry) or 15 (quadratic, 450).
CORRECTION = 30.0
DEAREST = 10.0  # corrections that a factor is worth at most: large fronts run faster per operation
# Relative error of a back-solve in single precision above which it is done in double: a body of
# tissue has 1e-5, one a million times stiffer than its support has 1.
WORST_SOLVE = 1e-2
NEAR = 1e4  # corrections of so many tolerances belong to a state that is all but converged


class _Failed(NotConverged):
    """One load step did not reach equilibrium; `outcome` says why; `final`: no use in halving."""

    def __init__(self, outcome, *, final=False):
        super().__init__(outcome.advice)
        self.outcome, self.final = outcome, final


class StaticSolver:
    """Finds where a SoftBody rests for given pad displacements.

    body : SoftBody;  options : NewtonOptions
    assembler : what sums its potential, None = Assembler(body); contact adds its own to that
    `solve` depends on its arguments alone, so equal arguments give equal bits; `follow` also on
    the states solved before. Not to be shared between threads.
    """

    def __init__(self, body, *, options=None, assembler=None):
        self.body = body
        self.options = NewtonOptions() if options is None else options
        self.assembler = Assembler(body) if assembler is None else assembler
        self.free = FreeDofs(self.assembler, held_nodes(body))
        # Corrections are found in single precision, with what they teach about the tangent; their
        # residual is double. Where that does not do (`_factorise`), and for derivatives, there is
        # a factor in double, made when first wanted.
        self._single, self._double = self.free.solver(single=True), None
        self._factor, self._secants = self._single, Secants()
        self._tangent, self._shifted = None, False
        self._left = 0.0   # residual [N] of the last state that `follow` found converged

    def held_positions(self, pad_displacement, base=None):
        """Return (n, 3) [m]: the rest positions with every pad moved, and the base.

        pad_displacement : (p, 3) [m] world frame, rows as `body.pads`
        base : (3,) [m] displacement of the fixed nodes (`StepFields.base`), None = they stay
        """
        moved = np.asarray(pad_displacement, dtype=float)
        if moved.shape != (len(self.body.pads), 3) or not np.isfinite(moved).all():
            raise InputError(f'pad_displacement has shape {moved.shape} or is not finite; must be '
                             f'({len(self.body.pads)}, 3) finite numbers in metres')
        return moved_from_rest(self.body, moved, base)

    def solve(self, x0, pad_displacement, fields=None):
        """Return the StaticSolution with the pads displaced from rest by `pad_displacement`.

        x0 : (n, 3) [m] starting state, e.g. the last solution; need not be in equilibrium
        pad_displacement : (p, 3) [m], world frame;  fields : StepFields, None = the body's own
        Raises InputError for arguments of the wrong shape or not finite; trouble on the way to
        equilibrium is reported in `outcome`, with x = x0.
        Valid for stable equilibria reached by a path of stable equilibria (no snap-through).
        """
        base = None if fields is None else fields.base
        return self.solve_held(x0, self.held_positions(pad_displacement, base), fields)

    def solve_held(self, x0, held_at, fields=None):
        """Return the StaticSolution with every held node at its row of `held_at` (n, 3) [m].

        x0, fields : as in `solve`. Pad moments refer to the mean displacement of a pad's nodes.
        """
        fields = StepFields.of(self.body) if fields is None else fields
        x0 = np.array(x0, dtype=float)
        if x0.shape != self.body.mesh.nodes.shape or not np.isfinite(x0).all():
            raise InputError(f'x0 has shape {x0.shape} or is not finite; must be '
                             f'{self.body.mesh.nodes.shape} finite positions in metres')
        counts = {'iterations': 0, 'factorisations': 0, 'load_steps': 0}
        start = self.assembler.evaluate(x0, fields)
        try:
            x, state = self._follow(x0, start, held_at, fields, counts)
        except _Failed as failure:
            return self._solution(x0, start, counts, failure.outcome)
        return self._solution(x, state, counts, Outcome.OK)

    def follow(self, x0, held_at, fields=None):
        """The same as `solve_held`, faster where states succeed each other in small steps.

        Corrections reuse the last factor, however old, and all that was learnt since, as long as
        they shrink fast enough; otherwise `solve_held` takes over. A first correction ends
        nothing, however small, unless no more force is out of balance than the last call left. The
        state returned is that before the last correction: off by about the tolerance.
        test/benchmark/newton_steps.py says what it gains for which step.
        """
        fields = StepFields.of(self.body) if fields is None else fields
        found = None
        if self._factor.factorised and not self._shifted:
            found = self._chord(np.array(x0, dtype=float), held_at, fields)
        if found is None:
            found = self.solve_held(x0, held_at, fields)
        self._left = found.residual if found.outcome.ok else 0.0
        return found

    def open_correction(self, x, fields):
        """Return the largest correction [m] that `follow` would begin with at x (n, 3) [m].

        By the factor at hand, with what was learnt since; inf if there is none, or if an element
        is inverted. fields : StepFields; x has its held nodes in place.
        """
        state = self.assembler.evaluate(x, fields)
        if not (self._factor.factorised and state.min_J > 0.0) or self._shifted:
            return np.inf
        return float(np.abs(self._correction(state)).max(initial=0.0))

    def _chord(self, x, held_at, fields):
        """StaticSolution by the old factor, or None where it does not serve any more."""
        x[self.free.held] = held_at[self.free.held]
        pace, before, direction = _Pace(), None, None
        for iterations in range(self.options.max_iterations):
            state = self.assembler.evaluate(x, fields)
            if not state.min_J > 0.0:
                return None
            if before is not None:
                self._learn(direction, before, state)
            direction = self._correction(state)
            size = np.abs(direction).max(initial=0.0)
            left = pace.outstanding(size, self.options.tolerance)
            if self._impatient(left, self.options.step_patience):
                return None
            residual = np.abs(state.forces[self.free.free]).max(initial=0.0)
            if size <= self.options.tolerance and (iterations or residual <= self._left):
                counts = {'iterations': iterations, 'factorisations': 0, 'load_steps': 1}
                return self._solution(x, state, counts, Outcome.OK)
            x, before = x + direction, state
        return None

    def linearise(self, x, fields=None):
        """Return (K, factor) at x (n, 3) [m]: the full tangent and the solver of its free part.

        fields : as in `solve`. `factor` (a Pardiso) is good until the next call of `linearise`,
            or of a solve that comes upon a tangent which is all but indefinite.
        Raises NotConverged where the free part is not positive definite (no stable equilibrium).
        """
        tangent = self.assembler.tangent(x, fields)
        exact = self._exact()
        if self._factor is exact:  # `follow` will go on from this state's
            self._secants.clear()
        try:
            exact.factor(self.free.upper(tangent))
        except FactorisationFailed as error:
            raise NotConverged(f'no linearisation at this state: {error}') from None
        return tangent, exact

    def _exact(self):
        if self._double is None:
            self._double = self.free.solver()
        return self._double

    def _solution(self, x, state, counts, outcome):
        forces = state.forces if state.min_J > 0.0 else np.full_like(state.forces, np.nan)
        pads = self.body.pads
        force, moment = np.zeros((len(pads), 3)), np.zeros((len(pads), 3))
        for i, pad in enumerate(pads):
            centre = pad.centre + (x[pad.nodes] - self.body.mesh.nodes[pad.nodes]).mean(axis=0)
            force[i] = -forces[pad.nodes].sum(axis=0)
            moment[i] = -np.cross(x[pad.nodes] - centre, forces[pad.nodes]).sum(axis=0)
        residual = float(np.abs(forces[self.free.free]).max(initial=0.0))
        return StaticSolution(x, force, moment, residual=residual, outcome=outcome, **counts)

    def _follow(self, x0, start, held_at, fields, counts):
        """Reach the target in as few load steps as will converge.

        At load factor t the held nodes have made the fraction t of their way and the fraction
        1 - t of the force that was out of balance at x0 is still carried from outside.
        """
        if not start.min_J > 0.0:
            raise _Failed(Outcome.INVERTED_ELEMENT)
        excess = np.zeros_like(x0)
        excess[self.free.free] = start.forces[self.free.free]
        way = np.zeros_like(x0)
        way[self.free.held] = (held_at - x0)[self.free.held]
        self._factor, self._shifted = self._single, False
        x, t, step, state = x0, 0.0, 1.0, start
        while t < 1.0:
            ahead = min(1.0, t + step)
            if ahead < 1.0 or t > 0.0:  # or the loads are those `start` was evaluated with
                loads = _with_force(fields, (1.0 - ahead) * excess)
                before = self.assembler.evaluate(x, loads)
            else:
                loads, before = fields, start
            try:
                x, state = self._load_step(x, before, (ahead - t) * way, loads, counts)
            except _Failed as failure:
                step /= 2.0
                if failure.final or step < 0.5 ** self.options.max_bisections:
                    raise
                continue
            t, step = ahead, 2.0 * step
            counts['load_steps'] += 1
        return x, state

    def _load_step(self, x, state, way, fields, counts):
        """Equilibrium (x, its Evaluation) after the held nodes moved by `way`; raises _Failed."""
        tolerance = self.options.tolerance
        self._factorise(x, fields, counts)
        if way.any():
            x, state = self._predict(x, way, state, fields, counts)
        pace, fresh = _Pace(), not way.any()
        for _ in range(self.options.max_iterations):
            direction = self._correction(state)
            size = np.abs(direction).max(initial=0.0)
            if size <= tolerance and not self._shifted:
                # Made all the same: what single precision has missed of a stiff body's balance.
                return x + direction, self.assembler.evaluate(x + direction, fields)
            left = pace.outstanding(size, tolerance)
            if not fresh and (self._shifted or self._impatient(left, self.options.patience)):
                self._factorise(x, fields, counts, near=size <= NEAR * tolerance)
                direction = self._correction(state)
                pace = _Pace()
                pace.outstanding(np.abs(direction).max(initial=0.0), tolerance)
            before = state
            x, state, step = self._line_search(x, state, direction, fields)
            self._learn(step, before, state)
            counts['iterations'] += 1
            fresh = False
        raise _Failed(Outcome.NOT_CONVERGED)

    def _impatient(self, outstanding, patience):
        """True if a new factor is cheaper than so many corrections still to come."""
        worth = min(self._single.flops_per_entry / CORRECTION, DEAREST)
        return outstanding > patience + worth

    def _correction(self, state):
        """Displacements (n, 3) of the free nodes that cancel the force out of balance."""
        direction = np.zeros_like(state.forces)
        direction[self.free.free] = -self._secants.solve(
            self._factor, state.forces[self.free.free].ravel()).reshape(-1, 3)
        return direction

    def _learn(self, step, before, after):
        """Take in how the forces changed from one Evaluation to the next along `step` (n, 3)."""
        free = self.free.free
        self._secants.learn(step[free].ravel(), (after.forces - before.forces)[free].ravel())

    def _predict(self, x, way, state, fields, counts):
        """Move the held nodes and let the free ones follow the tangent, lest any be crushed."""
        tangent = self._tangent
        pull = (tangent @ way.ravel())[self.free.dofs] + state.forces[self.free.free].ravel()
        move = way.copy()
        move[self.free.free] -= self._factor.solve(pull).reshape(-1, 3)
        ahead = self.assembler.evaluate(x + move, fields)
        if not ahead.min_J > self.options.crushing * state.min_J:
            raise _Failed(Outcome.INVERTED_ELEMENT)
        counts['iterations'] += 1
        return x + move, ahead

    def _factorise(self, x, fields, counts, *, near=False):
        """Factorise the tangent at x; where it is indefinite, the nearest that is not.

        near : x is all but converged; that it is indefinite is then checked in double precision
        """
        self._secants.clear()
        self._tangent = self.assembler.tangent(x, fields)
        upper = self.free.upper(self._tangent)
        self._shifted = not self._factored(upper, counts)
        if self._factor is self._single and (near if self._shifted else self._inaccurate()):
            self._factor = self._exact()
            self._shifted = not self._factored(upper, counts)
        if not self._shifted:
            return
        self._tangent = self.assembler.tangent(x, fields, convex=True)
        upper = self.free.upper(self._tangent)
        diagonal, shift = np.abs(upper[self.free.diagonal]), 0.0
        for _ in range(self.options.max_shifts + 1):
            if self._factored(upper, counts):
                return
            added = 10.0 * shift if shift else self.options.first_shift
            upper[self.free.diagonal] += (added - shift) * diagonal
            shift = added
        raise _Failed(Outcome.NOT_CONVERGED)

    def _inaccurate(self):
        """True if the factor does not know the tangent's softest motions, of which this is one."""
        known = np.zeros(self._tangent.shape[0])
        known[self.free.dofs] = 1.0
        found = self._factor.solve((self._tangent @ known)[self.free.dofs])
        return np.abs(found - 1.0).max(initial=0.0) > WORST_SOLVE

    def _factored(self, upper, counts):
        """True if the matrix is positive definite; then `_factor` holds its factor.

        Raises _Failed for good when there have been too many.
        """
        counts['factorisations'] += 1
        if counts['factorisations'] > self.options.max_factorisations:
            raise _Failed(Outcome.NOT_CONVERGED, final=True)
        try:
            self._factor.factor(upper)
        except FactorisationFailed:
            return False
        return True

    def _line_search(self, x, state, direction, fields):
        """Halve the step until the potential falls enough and no element is inverted.

        Returns (x, its Evaluation, the step made), x and step (n, 3).
        """
        slope = float(np.sum(state.forces * direction))
        length, inverted = 1.0, False
        for _ in range(self.options.max_backtracks):
            ahead = self.assembler.evaluate(x + length * direction, fields)
            inverted = not ahead.min_J > 0.0
            if not inverted and self._acceptable(state, ahead, direction, slope, length):
                return x + length * direction, ahead, length * direction
            length /= 2.0
        raise _Failed(Outcome.INVERTED_ELEMENT if inverted else Outcome.NOT_CONVERGED)

    def _acceptable(self, state, ahead, direction, slope, length):
        """Armijo; near the solution, where the energy only shows rounding, a falling slope."""
        gain = self.options.sufficient_decrease * length * slope
        if ahead.energy <= state.energy + gain:
            return True
        noise = 1e-10 * max(abs(state.energy), abs(ahead.energy))
        new_slope = float(np.sum(ahead.forces * direction))
        return ahead.energy <= state.energy + noise and abs(new_slope) <= 0.5 * abs(slope)


class _Pace:
    """How fast the corrections with one factor shrink, the first being the measure."""

    def __init__(self):
        self._first, self._made = None, 0

    def outstanding(self, size, tolerance):
        """Corrections still to come, `size` being the latest [m]; inf if they do not shrink."""
        if self._first is None:
            self._first = size
            return 0.0
        self._made += 1
        if size <= tolerance:
            return 0.0
        if not size < self._first:
            return np.inf
        return np.log(tolerance / size) * self._made / np.log(size / self._first)


def _with_force(fields, force):
    return replace(fields, nodal_force=fields.nodal_force + force)
