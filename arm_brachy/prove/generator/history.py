"""Time integration of tissue that remembers, along the pads' travel in one recording."""
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import interp1d

from arm_brachy.prove.generator.forms import act_of
from arm_brachy.prove.generator.grid import nodes_to_dofs
from arm_brachy.prove.generator.memory import Law, Memory, advance, prestress, soften
from arm_brachy.prove.generator.response import PAIR_LEVEL
from arm_brachy.prove.generator.solver import NotSolved
from arm_brachy.prove.generator.sparse import Factor


def viscoelasticity(v):
    """Two relaxing branches."""
    return Law((v['g1'], v['g2']), (v['tau1_s'], v['tau2_s']))


def stress_softening(v):
    """Damage that saturates."""
    return Law(damage=v['damage'], energy=v['energy_Pa'])


MEMORY = {f.__name__: f for f in (viscoelasticity, stress_softening)}


def law_of(effects, modulus):
    """`Law` of the effects that have memory, or None; energies over the true modulus."""
    laws = {e.name: act_of(e, MEMORY)(e.values) for e in effects if e.name in MEMORY}
    if not laws:
        return None
    relaxing = laws.get('viscoelasticity', Law())
    softening = laws.get('stress_softening', Law())
    return replace(softening, shares=relaxing.shares, times=relaxing.times,
                   energy=softening.energy / modulus)


class Field:
    """Displacements and pressures of the model without memory at any travel, from its states.

    states : as `solve_response` returns them.  Cubic in the travel of every pad alone, and the
    product of travels for pairs, as in `Response`.
    """

    def __init__(self, states, pairs):
        flat = [[np.r_[s.u.ravel(), s.p] for s in row] for row in states]
        self.rest = flat[0][0]
        self._alone = []
        for row, pad in zip(states[:-1], range(len(states) - 1), strict=True):
            y = np.array([s.y[pad] for s in row[1:]])
            powers = np.linalg.inv(y[:, None] ** np.arange(1, 4))
            self._alone.append(powers @ (np.array(flat[pad][1:]) - self.rest))
        self._pairs = [
            (i, j, (x - flat[i][PAIR_LEVEL] - flat[j][PAIR_LEVEL] + self.rest)
             / (s.y[i] * s.y[j]))
            for (i, j), x, s in zip(pairs, flat[-1], states[-1], strict=True)]

    def at(self, y):
        """Displacements, then pressures, flattened, at travel y (p,)."""
        x = self.rest.copy()
        for yi, powers in zip(y, self._alone, strict=True):
            if yi:
                x += np.array([yi, yi**2, yi**3]) @ powers
        for i, j, excess in self._pairs:
            if y[i] * y[j]:
                x += y[i] * y[j] * excess
        return x


@dataclass(frozen=True)
class Trace:
    """Change of the outputs over one recording: times (t,), outputs (t, o)."""

    times: np.ndarray
    change: np.ndarray

    def read(self, t, y):
        """Change of outputs (t, o), linear between the steps; y is that of the recording."""
        return interp1d(self.times, self.change, axis=0, bounds_error=False,
                        fill_value=(self.change[0], self.change[-1]))(t)


def steps_of(t, y, travel=4.5e-4, time=0.6, least=0.02):
    """Numbers of the instants of the fine clock t (t,) at which to integrate.

    A step ends when any pad has moved by `travel` [m] or after `time` [s], not before `least`
    [s], and where a pad starts, stops or turns.
    """
    speed = np.sign(np.round(np.diff(y, axis=0, prepend=y[:1]) * 1e7))
    turns = np.flatnonzero((np.diff(speed, axis=0) != 0).any(1))
    turns = set(turns.tolist())
    chosen = [0]
    for k in range(1, len(t)):
        gone = t[k] - t[chosen[-1]]
        if gone >= least and (gone >= time or k in turns
                              or np.abs(y[k] - y[chosen[-1]]).max() >= travel):
            chosen.append(k)
    return np.array(chosen)


class Chords:
    """Newton's method with the stiffness of a state nearby, for residuals that are small already.

    Factors are made where the last one no longer contracts, and kept, at most `most` of them.
    """

    def __init__(self, model, most=9):
        held, _ = model.prescribed(np.zeros(len(model.pads)))
        self.fixed = np.zeros(model.grid.pattern.n, bool)
        self.fixed[nodes_to_dofs(np.flatnonzero(held))] = True
        self._model, self._most, self._factors = model, most, []

    def add(self, y, x, sudden=1.0, standing=None, loss=None):
        """Factor the stiffness at unknowns x (n,), travel y (p,); the oldest may be dropped.

        sudden : shear modulus (m, q) of a fast small step over the lasting one;  standing :
        stress (m, q, 3, 3) [Pa] left of the past;  loss : (m, q) [1/Pa] of `Law.loss`. That the
        branches soften in the step as well is left out.
        """
        cut = 3 * len(self._model.grid.nodes)
        tissue = self._model.tissue
        model = replace(self._model, tissue=replace(tissue, mu=sudden * tissue.mu))
        data = model.matrix(x[:cut].reshape(-1, 3), x[cut:])
        grid = self._model.grid
        pattern = grid.pattern
        if standing is not None:
            prestress(standing, grid.mesh.tets, *grid.slopes, pattern.where, data)
        if loss is not None:
            tissue = self._model.tissue
            soften(x[:cut].reshape(-1, 3), grid.mesh.tets, *grid.slopes, tissue.mu,
                   tissue.stiffening, tissue.cubic, loss, pattern.where, data)
        factor = Factor(pattern.matrix(pattern.held(data, self.fixed)))
        self._factors = [*self._factors[1 - self._most:], (y, factor)]

    def step(self, y, residual):
        """Step (n,) against a residual (n,) by the latest factor made nearest to travel y (p,)."""
        _, factor = min(reversed(self._factors), key=lambda made: np.abs(y - made[0]).max())
        return -factor.solve(np.where(self.fixed, 0.0, residual))


@dataclass(frozen=True)
class Instant:
    """One converged time step: memory after it, change of the unknowns (n,), nodal forces."""

    memory: Memory
    guess: np.ndarray
    forces: np.ndarray


def settle(model, law, memory, plain, guess, dt, y, chords, tol=5e-6, most=24):
    """`Instant` at travel y, dt [s] after `memory`, from the unknowns `plain` + `guess` (n,).

    `plain` is the interpolated field without memory, whose own imbalance is no effect of memory
    and is left in.  tol : last step [m].  Raises NotSolved after `most` steps.
    """
    cut = 3 * len(model.grid.nodes)
    base_f, base_g = model.residual(plain[:cut].reshape(-1, 3), plain[cut:])
    before, last = np.inf, 0 * guess
    for _ in range(most):
        x = plain + guess
        f, g = model.residual(x[:cut].reshape(-1, 3), x[cut:])
        extra, after = advance(model, law, memory, x[:cut].reshape(-1, 3), dt)
        forces = f - base_f + extra
        step = chords.step(y, np.r_[forces.ravel(), g - base_g])
        size = np.abs(step[:cut]).max()
        if not np.isfinite(size):
            # The last step turned an element inside out: keep a quarter of it.
            guess, last = guess - 0.75 * last, 0.25 * last
            continue
        if not size < 0.7 * before and size > tol:
            chords.add(y, plain + guess, law.sudden(after, dt), law.standing(after, dt),
                       law.loss(memory, after))
            before = np.inf
            continue
        guess, before, last = guess + step, size, step
        if size < tol:
            return Instant(after, guess, forces)
    raise NotSolved(f'memory: {size} m off at travel {y} m')


def integrate(model, probes, states, pairs, law, t, y):
    """`Trace` of what memory changes in the outputs along travels y (t, p) at times t (t,)."""
    field, chosen = Field(states, pairs), steps_of(t, y)
    chords = Chords(model)
    chords.add(np.zeros(len(model.pads)), field.rest)
    cut = 3 * len(model.grid.nodes)
    memory = Memory.fresh(model.grid.slopes[1].shape, len(law.times))
    change, visited, before = [], [], t[0] - 1.0
    for k in chosen:
        plain = field.at(y[k])
        now = settle(model, law, memory, plain, nearest(visited, y[k], 0 * plain), t[k] - before,
                     y[k], chords)
        memory, before = now.memory, t[k]
        visited = [*visited[-300:], (y[k], now.guess)]
        moved = probes.read(now.guess[:cut].reshape(-1, 3))
        pushed = [-now.forces[model.grid.mesh.patch_nodes(i)].sum(0)
                  for i in range(len(model.pads))]
        change.append(np.r_[moved.ravel(), np.ravel(pushed)])
    return Trace(t[chosen], np.array(change))


def nearest(visited, y, none):
    """Change at the latest of the nearest travels visited, as a guess; `none` without any."""
    if not visited:
        return none
    apart = np.array([np.abs(y - place).max() for place, _ in visited])
    return visited[len(apart) - 1 - int(np.argmin(apart[::-1]))][1]
