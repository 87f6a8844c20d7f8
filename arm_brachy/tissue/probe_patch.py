"""The part of the surface that a probe can touch now: its forces as a function of few nodes.

With H the flexibility between those nodes and y0 where they would be if nothing touched them, the
forces q of the tissue's potential there solve

    h(q) = f(y0 - H q) - q = 0,      (I + K_c H) dq = h

f is the gradient of the contact potential of `contact`, friction renewed at each y, and K_c its
derivative, unsymmetric where points slip. Steps are halved until h' H h falls.
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue import contact_kernels as kernels
from arm_brachy.tissue import dense
from arm_brachy.tissue.contact_newton import OutOfBalance
from arm_brachy.tissue.contact_surface import PointStates
from arm_brachy.tissue.secants import dot

MOST_CORRECTIONS, MOST_HALVINGS = 40, 12
ENOUGH = 0.2    # part of the promised fall that a step must bring
FLAT = 1e-26    # J; h' H h of a force of 1e-11 N where a newton moves the skin by 1e-4 m


@dataclass(frozen=True)
class ProbePatch:
    """Faces near the probe, numbered by themselves.

    chosen : (g,) faces of the whole quadrature;  nodes : (k,) of the mesh
    faces : (g, a) into `nodes`;  shape (q, a), weights (g, q) : as SurfaceQuadrature
    R, c : pose of the core;  core : as AbstractShape.core;  depth : [m] as AbstractShape.depth
    law : (k, s, k_t);  friction : coefficient;  points : PointStates with the anchors of the step
    """

    chosen: np.ndarray
    nodes: np.ndarray
    faces: np.ndarray
    shape: np.ndarray
    weights: np.ndarray
    R: np.ndarray
    c: np.ndarray
    core: tuple
    depth: float
    law: tuple
    friction: float
    points: PointStates

    def seen(self, y):
        """Return the patch with pressure, normal and friction limit as of nodes y (k, 3) [m]."""
        p = self.points
        new = replace(p, position=np.empty_like(p.position), gap=np.empty_like(p.gap),
                      pressure=np.empty_like(p.pressure), normal=np.empty_like(p.normal))
        kernels.contact_points(y, self._all, self.faces, self.shape, self.R, self.c, *self.core,
                               self.law, new.position, new.gap, new.pressure, new.normal)
        return replace(self, points=replace(new, limit=self.friction * new.pressure))

    def forces(self, y):
        """Return (k, 3) [N]: the gradient of the contact potential, points as they are."""
        out = np.zeros_like(y)
        kernels.contact_forces(y, self._all, self.faces, self.shape, self.weights, *self._body,
                               out)
        return out

    def derivative(self, y):
        """Return d forces / d y (3k, 3k) [N/m], friction limits following the pressure."""
        size = 3 * len(self.nodes)
        data = np.zeros(size * size)
        columns = np.repeat(3 * self.faces[:, None, :], self.faces.shape[1], axis=1)
        kernels.contact_tangent(y, self._all, self.faces, self.shape, self.weights, *self._body,
                                False, self.friction, size * np.arange(size + 1), columns, data)
        return data.reshape(size, size)

    @property
    def _all(self):
        return np.arange(len(self.faces))

    @property
    def _body(self):
        p = self.points
        return self.R, self.c, *self.core, self.law, p.limit, p.normal, p.anchor

    def balanced(self, y0, H, q, tolerance):
        """Return (the patch as of y, y (k, 3), q (k, 3) [N]) with h(q) = 0.

        y0 : (k, 3) [m] nodes without the probe;  H : (3k, 3k) [m/N];  q : (k, 3) [N] start
        tolerance : [m] largest correction of y left open. Raises OutOfBalance.
        """
        now = _Trial(self, y0, H, q.ravel())
        if -now.patch.points.gap.min() >= self.depth:
            raise OutOfBalance(Outcome.NOT_CONVERGED)
        for _ in range(MOST_CORRECTIONS):
            dq = self._correction(now, H)
            if not np.isfinite(dq).all():
                break
            size = np.abs(dense.products(H, dq)).max(initial=0.0)
            if size <= tolerance:
                return now.patch, now.y, now.q.reshape(-1, 3)
            now = self._search(now, y0, H, dq)
            if now is None:
                break
        raise OutOfBalance(Outcome.NOT_CONVERGED)

    def _correction(self, now, H):
        """dq (3k,): exact where nothing touches, (I + K_c H) dq = h among the others."""
        K = now.patch.derivative(now.y)
        touch = np.flatnonzero(K.any(axis=1))
        dq = now.h.copy()
        if not len(touch):
            return dq
        away = dq.copy()
        away[touch] = 0.0
        K = np.ascontiguousarray(K[touch])
        KH = dense.product(K, H)
        rhs = now.h[touch] - dense.products(KH, away)
        dq[touch] = dense.solve(np.eye(len(touch)) + KH[:, touch], rhs[:, None])[:, 0]
        return dq

    def _search(self, now, y0, H, dq):
        """The next trial, dq halved until the merit falls; None if it never does."""
        length = 1.0
        for _ in range(MOST_HALVINGS):
            new = _Trial(self, y0, H, now.q + length * dq)
            if new.merit <= max((1.0 - ENOUGH * length) * now.merit, FLAT):
                return new
            length /= 2.0
        return None


class _Trial:
    """Forces q (3k,) tried: where the nodes are, what the probe says to that, the merit."""

    def __init__(self, patch, y0, H, q):
        self.q = q
        self.y = y0 - dense.products(H, q).reshape(-1, 3)
        self.patch = patch.seen(self.y)
        self.h = self.patch.forces(self.y).ravel() - q
        self.merit = dot(self.h, dense.products(H, self.h))
