"""Rigid faces that are moved against a linear body, with the plant's friction, on few nodes.

The body is known by the compliance C of the nodes under the faces and by y0, where these would be
without contact. With the forces p of the body on them they are at y = y0 - C p, and

    p = g(y),

g the gradient of the contact potential of `tissue.contact`, friction renewed at each y. Newton in
p, which is zero but where a face bears: the systems stay as small as the area of contact. What is
to fall is the energy norm (r' C r)^1/2 of r = g - p.
Test: diagnosis/forward/test_slip.py
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.linalg import inv

ITERATIONS, MINIMISING, HALVINGS, LAGS = 25, 100, 10, 6
KEPT = 8            # blocks of the compliance, and inverses


@dataclass(frozen=True)
class Touching:
    """Faces and body in one state.

    y : (k, 3) [m];  p : (k, 3) [N];  ways : (t, 3) [m] of the faces;  points : PointStates each
    forces : (t, 3) [N] of the body on them;  left : (k, 3) [N] out of balance, norm : (J)^1/2
    energy : [J], to be least while friction is lagged
    """

    y: np.ndarray
    p: np.ndarray
    ways: np.ndarray
    points: tuple
    forces: np.ndarray
    left: np.ndarray
    norm: float
    energy: float


class FaceContact:
    """Faces above k nodes of compliance C (3k, 3k) [m/N], symmetric.

    close : [m] largest of the last Newton step; a point sticks within micrometres
    """

    def __init__(self, faces, compliance, close=1e-8):
        self.faces, self._C, self._close = tuple(faces), compliance, close
        self._blocks, self._inverses = {}, {}   # of C, by their nodes, which are often the same

    def start(self, y0, ways):
        """Return the Touching of faces, displaced by ways (t, 3) [m], that bear nothing yet."""
        points = tuple(face.untouched(y0, way)
                       for face, way in zip(self.faces, ways, strict=True))
        return Touching(y0, np.zeros_like(y0), ways, points, np.zeros_like(ways),
                        np.zeros_like(y0), 0.0, 0.0)

    def untouched(self, state):
        """Return y0 (k, 3) [m] of which `state` is the Touching here, wherever it was found."""
        return state.y + self._bent(state.p)

    def step(self, state, y0, ways):
        """Return the next Touching in balance, anchors drawn along, or None if none is found.

        y0 : (k, 3) [m];  ways : (t, 3) [m]
        Where Newton ends in no balance it starts again from a minimum of the potential with
        friction lagged, as the plant does.
        """
        y, p = self._predicted(state, y0, ways)
        lagged = state.points
        for _ in range(LAGS):
            found = self._balance(self._look(y, p, ways, state.points), False)
            if found is not None:
                return dataclasses.replace(found, points=tuple(
                    face.drawn(one) for face, one in zip(self.faces, found.points, strict=True)))
            found = self._balance(self._look(y, p, ways, lagged, True), True)
            if found is None:
                return None
            y, p = found.y, found.p
            lagged = self._look(y, p, ways, state.points).points
        return None

    def _balance(self, now, lagged):
        """The Touching in balance that is found from one, or None."""
        points = now.points
        for _ in range(MINIMISING if lagged else ITERATIONS):
            dy, dp = self._newton(now, lagged)
            if np.abs(dy).max() <= self._close:
                return now
            for length in 0.5 ** np.arange(HALVINGS):
                ahead = self._look(now.y + length * dy, now.p + length * dp, now.ways, points,
                                   lagged)
                if _lower(now, ahead, length, np.sum(now.left * dy), lagged):
                    break
            else:
                return None
            now = ahead
        return None

    def _predicted(self, state, y0, ways):
        """(y, p) to start from: what bears goes on so, lest faces be pushed through the body."""
        p, y = state.p.copy(), y0 - self._bent(state.p)
        nodes = self._bearing(state.points)
        if len(nodes):
            K, off = np.zeros((2, 3 * len(nodes), 3 * len(nodes))), np.zeros(3 * len(nodes))
            for face, way, was, one in zip(self.faces, ways, state.ways, state.points,
                                           strict=True):
                K[1] = 0.0
                face.add_tangent(state.y, was, one, nodes, K[1])
                off += K[1] @ ((y - state.y)[nodes] - (way - was)).ravel()
                K[0] += K[1]
            dp = np.zeros_like(p)
            dp[nodes] = self._shares(nodes, K[0], off)
            p, y = p + dp, y - self._bent(dp)
        return y, p

    def _look(self, y, p, ways, points, lagged=False):
        seen = tuple(face.seen(y, way, old, lagged)
                     for face, way, old in zip(self.faces, ways, points, strict=True))
        g, stored = zip(*(face.gradient(y, way, one) for face, way, one in zip(
            self.faces, ways, seen, strict=True)), strict=True)
        left = sum(g) - p
        return Touching(y, p, ways, seen, np.array([one.sum(axis=0) for one in g]), left,
                        np.sqrt(max(2.0 * self._energy(left), 0.0)),
                        sum(stored) + self._energy(p))

    def _newton(self, now, lagged):
        """Changes (k, 3) of y [m] and p [N]: solved where faces bear, p gone elsewhere."""
        nodes = self._bearing(now.points)
        for convex in (False, True):
            dp = now.left.copy()
            if len(nodes):
                K = np.zeros((3 * len(nodes), 3 * len(nodes)))
                for face, way, one in zip(self.faces, now.ways, now.points, strict=True):
                    face.add_tangent(now.y, way, one, nodes, K, lagged, convex)
                dp[nodes] = 0.0
                off = now.left[nodes].ravel() - K @ self._bent(dp)[nodes].ravel()
                dp[nodes] = self._shares(nodes, K, off)
            dy = -self._bent(dp)
            if not lagged or np.sum(now.left * dy) <= 0.0:
                break
        return dy, dp

    def _shares(self, nodes, K, off):
        """Solution (a, 3) of (I + K C) p = off on some nodes (a,)."""
        y = np.linalg.solve(self._stiffness(nodes) + K, off)        # C p
        return (off - K @ y).reshape(-1, 3)

    def _bent(self, p):
        """C p (k, 3) [m]."""
        rows = _rows(np.flatnonzero(p.any(axis=1)))
        return (p.ravel()[rows] @ self._C[rows]).reshape(-1, 3)

    def _energy(self, p):
        """p' C p / 2 [J]."""
        nodes = np.flatnonzero(p.any(axis=1))
        part = p[nodes].ravel()
        return 0.5 * part @ self._block(nodes) @ part

    def _block(self, nodes):
        """C of some nodes (a,)."""
        def cut():
            rows = _rows(nodes)
            return self._C[np.ix_(rows, rows)]
        return _kept(self._blocks, nodes, cut)

    def _stiffness(self, nodes):
        """Inverse of C of some nodes (a,), those without contact giving way."""
        return _kept(self._inverses, nodes, lambda: inv(self._block(nodes), check_finite=False))

    def _bearing(self, points):
        return np.unique(np.concatenate([face.bearing(one) for face, one in zip(
            self.faces, points, strict=True)]))


def _lower(now, ahead, length, slope, lagged):
    """True if a step of `length` has lowered what is to fall by enough of what it promised."""
    if lagged:
        return ahead.energy <= now.energy + 1e-4 * length * slope + 1e-9 * abs(now.energy)
    return ahead.norm <= (1.0 - 0.1 * length) * now.norm


def _kept(known, nodes, make):
    """The entry of `known` for some nodes, made if it is not there; the oldest makes room."""
    key = nodes.tobytes()
    if key not in known:
        if len(known) >= KEPT:
            known.pop(next(iter(known)))
        known[key] = make()
    return known[key]


def _rows(nodes):
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
