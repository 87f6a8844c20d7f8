"""Equilibrium of the body under pads that move it: Newton's method and path following."""
from dataclasses import dataclass

import numpy as np

from arm_brachy.prove.generator.assembly import forces, tangent
from arm_brachy.prove.generator.grid import Grid, nodes_to_dofs
from arm_brachy.prove.generator.sparse import Factor, times


class NotSolved(RuntimeError):
    """Newton's method found no equilibrium within its steps."""


@dataclass(frozen=True)
class Tissue:
    """At the integration points (m, q): moduli [Pa], fibre (m, q, 3) unit vectors, stretch by
    swelling [1].
    """

    mu: np.ndarray
    kappa: np.ndarray
    stiffening: np.ndarray
    cubic: np.ndarray
    fibre_modulus: np.ndarray
    fibre: np.ndarray
    swelling: np.ndarray

    @property
    def arguments(self):
        """In the order the compiled loops take them."""
        return (self.mu, self.kappa, self.stiffening, self.cubic, self.fibre_modulus, self.fibre,
                self.swelling)


def uniform(grid, modulus, poisson):
    """Homogeneous `Tissue` on `grid` of Young's modulus [Pa] and Poisson's ratio."""
    one = np.ones(grid.slopes[1].shape)
    return Tissue(modulus / (2 * (1 + poisson)) * one, modulus / (3 * (1 - 2 * poisson)) * one,
                  0 * one, 0 * one, 0 * one, np.multiply.outer(one, [1.0, 0.0, 0.0]), one)


@dataclass(frozen=True)
class State:
    """Equilibrium at pad travel y (p,) [m]: displacements u (n, 3) [m], pressures (k,) [Pa]."""

    y: np.ndarray
    u: np.ndarray
    p: np.ndarray


@dataclass(frozen=True)
class Model:
    """Body on `grid`, pushed by `pads` along their directions, made of `tissue`.

    loads : objects with `add(u, f)`, which adds what they exert on nodes, with its sign turned,
    to internal forces f (n, 3) and `stiffen(u, data)`, which adds the derivative.
    released (n,) bool : nodes of the base that are not clamped.
    shift (3,) or (b, 3) : displacement of the clamped base, or of each of its nodes [m].
    nudge, turn (p, 3) : what pads move besides, and rotation vectors about their centres, linear.
    """

    grid: Grid
    pads: tuple
    tissue: Tissue
    loads: tuple = ()
    released: np.ndarray | None = None
    shift: tuple = (0.0, 0.0, 0.0)
    nudge: np.ndarray | None = None
    turn: np.ndarray | None = None

    def rest(self):
        """State of no displacement at all, from which to start."""
        return State(np.zeros(len(self.pads)), np.zeros(self.grid.nodes.shape),
                     np.zeros(self.grid.pressures))

    def prescribed(self, y):
        """Which nodes are held (n,), and their displacements (n, 3), at travel y (p,)."""
        n = len(self.grid.nodes)
        held, value = np.zeros(n, bool), np.zeros((n, 3))
        held[self.grid.mesh.base_nodes] = True
        value[self.grid.mesh.base_nodes] = self.shift
        if self.released is not None:
            held &= ~self.released
        for i, pad in enumerate(self.pads):
            nodes = self.grid.mesh.patch_nodes(i)
            held[nodes] = True
            value[nodes] = y[i] * np.asarray(pad.direction)
            if self.nudge is not None:
                value[nodes] += self.nudge[i]
            if self.turn is not None:
                value[nodes] += np.cross(self.turn[i], self.grid.nodes[nodes] - pad.centre)
        return held, value

    def residual(self, u, p):
        """Forces on nodes (n, 3) that hold the state, and volume errors (k,)."""
        f, g = forces(u, p, *self._arguments())
        for load in self.loads:
            load.add(u, f)
        return f, g

    def matrix(self, u, p):
        """Entries of the tangent stiffness on the grid's pattern."""
        pattern = self.grid.pattern
        data = tangent(u, p, *self._arguments(), pattern.where, np.zeros(len(pattern.rows)))
        for load in self.loads:
            load.stiffen(u, data, pattern)
        return data

    def _arguments(self):
        dn, vol = self.grid.slopes
        tissue = self.tissue.arguments
        return (self.grid.mesh.tets, self.grid.cells, dn, vol, self.grid.pressure_shapes, *tissue)

    def newton(self, start, y, tol=1.5e-5, balance=1e-3, most=11):
        """State at travel y from the near state `start`.

        Ends on a step of less than tol [m] that leaves no free node with more than `balance` of
        the largest force on a held one; convergence is quadratic, so the error left is smaller
        by far.  Raises NotSolved after `most` steps, or where an element turns inside out.
        """
        held, value = self.prescribed(y)
        fixed = np.zeros(self.grid.pattern.n, bool)
        fixed[nodes_to_dofs(np.flatnonzero(held))] = True
        u, p, n, before = start.u, start.p, start.u.size, np.inf
        f, g = self.residual(u, p)
        for _ in range(most):
            data = self.matrix(u, p)
            lift = np.r_[np.where(held[:, None], value - u, 0.0).ravel(), np.zeros(len(p))]
            r = np.r_[f.ravel(), g] + times(self.grid.pattern.matrix(data), lift)
            r[fixed] = 0
            if not np.isfinite(r).all():
                break
            upper = self.grid.pattern.matrix(self.grid.pattern.held(data, fixed))
            step = lift - Factor(upper).solve(r)
            # The first step moves the pads; later ones are halved while they unbalance more.
            for share in (1.0, 0.5, 0.25):
                v, q = u + share * step[:n].reshape(-1, 3), p + share * step[n:]
                f, g = self.residual(v, q)
                left, most_held = (np.abs(f[which]).max(initial=0.0) for which in (~held, held))
                if left < before:
                    break
            u, p, before = v, q, left if np.isfinite(left) else np.inf
            if np.abs(step[:n]).max() < tol and left <= balance * most_held + 1e-9:
                return State(np.asarray(y, float), u, p)
        raise NotSolved(f'no equilibrium at travel {y} m within {most} Newton steps')

    def follow(self, start, y, stride=0.00175, least=1e-4):
        """State at travel y, from `start` by steps of at most `stride` [m], halved on failure.

        Raises NotSolved below `least` [m].
        """
        y = np.asarray(y, float)
        state = start
        while True:
            left = y - state.y
            share = min(1.0, stride / max(np.abs(left).max(), 1e-12))
            try:
                state = self.newton(state, y if share == 1 else state.y + share * left)
            except NotSolved:
                stride /= 2
                if stride < least:
                    raise
                continue
            if share == 1:
                return state

    def pad_forces(self, state):
        """Forces of the tissue on the pads (p, 3) [N]."""
        f, _ = self.residual(state.u, state.p)
        return np.array([-f[self.grid.mesh.patch_nodes(i)].sum(0) for i in range(len(self.pads))])
