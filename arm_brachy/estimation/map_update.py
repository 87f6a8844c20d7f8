"""The closed-form half of MAP: what one frame of markers says once the model is linearised."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.estimation.gaussian import registration_jacobian, student_weights

SWEEPS = 4   # of the markers' weights within one linearisation
# Kinds of unknowns that may be wrong by much while the others are not; pads are one kind, however
# they err.
SUSPECTS = (('modulus',), ('bulk',), ('fibres',), ('base',), ('slides', 'pads'), ('force',))
ALWAYS = ('faces', 'give')      # wrong by their sd under every hypothesis
LOADS = (0.3, 1.0)   # sds of the unknown load, of its own, under two further hypotheses


@dataclass(frozen=True)
class Point:
    """The model linearised at one travel and one theta.

    theta : (k,);  q : (p,) [m];  points : (w, 3) [m] expected markers, then targets
    response : (3w, k) d points / d theta;  strain : (w,) |F - I| to the power of map.STRAINED
    markers : how many of the points are markers;  x : (n, 3) [m] nodes
    by_pads : (3w + 3n, p) d (points, x) / d travel [1];  loads : how many unknowns, the last
        ones, are local loads;  stale : response and by_pads are of a travel near q
    known : (n, 3) [N] of the known loads;  pressed : (w, 3) [m] by which these move the points
    """

    theta: np.ndarray
    q: np.ndarray
    points: np.ndarray
    response: np.ndarray
    strain: np.ndarray
    markers: int
    x: np.ndarray | None = None
    by_pads: np.ndarray | None = None
    loads: int = 0
    stale: bool = False
    known: np.ndarray | None = None
    pressed: np.ndarray | None = None

    @property
    def by_loads(self):
        """Which unknowns are local loads, a slice."""
        return slice(len(self.theta) - self.loads, len(self.theta))

    def moved(self, q):
        """The Point at a travel nearby, to first order; `q` stays where it was linearised."""
        if np.array_equal(q, self.q):
            return self
        step = self.by_pads @ (q - self.q)
        w = self.points.size
        return replace(self, points=self.points + step[:w].reshape(-1, 3),
                       x=self.x + step[w:].reshape(-1, 3))

    def loaded(self, known, moved, points):
        """The Point under other known loads, to first order.

        known : (n, 3) [N];  moved : (n, 3) [m] of the nodes by the change;  points : (w, 3) [m]
        """
        return replace(self, known=known, x=self.x + moved, points=self.points + points,
                       pressed=self.pressed + points)


def hypotheses(unknowns, others):
    """Return the sd of every unknown (h, k) under each hypothesis, in units of PriorParams.

    unknowns : unknowns.Unknowns;  others : share that a kind keeps while another is suspected
    The first: nothing is wrong by much. Then one of SUSPECTS is. The last ones: something else
    than the pads loads the skin, which under the others nothing does. One row for others = 1.
    """
    row = np.full(unknowns.count, others)
    row = _with(row, unknowns, ALWAYS, 1.0)
    row[unknowns.part('load')] = 0.0
    if others == 1.0:
        return row[None]
    rows = [row] + [_with(row, unknowns, kinds, 1.0) for kinds in SUSPECTS]
    rows += [_with(row, unknowns, ('load',), share) for share in LOADS]
    return np.array(list(dict.fromkeys(map(tuple, rows))))


def _with(row, unknowns, kinds, share):
    row = row.copy()
    for kind in kinds:
        row[unknowns.part(kind)] = share
    return row


def loaded(at, state):
    """Probability of the hypotheses under which something else than the pads loads the skin.

    at : Point;  state : Mixture
    """
    return float(state.weights[state.scale[:, at.by_loads].any(axis=1)].sum())


def in_all(scale, markers):
    """Return (h, k + 6 + 3 m): sds of unknowns, registration and marker offsets."""
    return np.hstack([scale, np.ones((len(scale), 6 + 3 * markers))])


def update(at, surface, state, params):
    """(Mixture after a Surface, weights (seen,) of the markers), the model linearised at `at`.

    at : Point;  state : Mixture before;  params : map.MapParams
    Weights are those of Student noise, by iterated reweighting; all hypotheses share them.
    """
    seen, k = surface.seen, len(at.theta)
    rows, own = np.repeat(seen, 3), np.repeat(own_variance(at, params), 3)
    H = _measurement(at, surface, own)[rows]
    structural = H.copy()
    structural[:, k + 6:] = 0.0
    z = (surface.markers - at.points[:at.markers]).ravel()[rows] + H[:, :k] @ at.theta
    known = (H - structural) @ state.average()   # by offsets from before
    measured, own = state.measured(H), own[rows]

    def weighed(average):
        left = z - known - structural @ average
        squared = (left**2 / (own + params.noise**2)).reshape(-1, 3).sum(axis=1)
        return student_weights(squared, params.dof)

    def noise(weights):
        return params.noise**2 + own * np.repeat(1.0 / weights - 1.0, 3)

    weights = np.ones(seen.sum())
    for _ in range(SWEEPS - 1):
        weights = weighed(measured.average(z, noise(weights), params.trust))
    found = measured.conditioned(z, noise(weights), params.trust)
    return found, weighed(found.average())


def _measurement(at, surface, own):
    """(3m, s) d markers / d state; rows of markers that are not seen mean nothing."""
    m, k, seen = at.markers, len(at.theta), surface.seen
    H = np.zeros((3 * m, k + 6 + 3 * m))
    H[:, :k] = at.response[:3 * m]
    H[np.repeat(seen, 3), k:k + 6] = registration_jacobian(
        at.points[:m][seen]) @ _root(surface.frame_covariance)
    H[:, k + 6:] = np.diag(np.sqrt(own))
    return H


def own_variance(at, params):
    """(m,) [m^2] per coordinate of what each marker is off by for good."""
    return (params.offset**2 + (params.marker_local * at.strain[:at.markers])**2
            + by_known(at, params)[:at.markers])


def by_known(at, params):
    """(w,) [m^2] per coordinate of what the model gets wrong of what known loads do to a point."""
    if at.pressed is None:
        return np.zeros(len(at.points))
    return (params.known_error * np.linalg.norm(at.pressed, axis=1))**2


def target_state(at, state, params):
    """Return the points (t, 3) [m] of the targets and their covariance (3t, 3t) [m^2].

    at : Point;  state : Mixture;  params : map.MapParams
    """
    k, rows = len(at.theta), slice(3 * at.markers, None)
    B = np.zeros((at.response[rows].shape[0], state.mean.shape[1]))
    B[:, :k] = at.response[rows]
    points = at.points[at.markers:] + (B @ state.average() - B[:, :k] @ at.theta).reshape(-1, 3)
    local = params.floor**2 + (params.target_local * np.repeat(at.strain[at.markers:], 3))**2
    # A load acts where the model was not linearised: what it moves is known to a share only.
    pressed = (B[:, at.by_loads] @ state.average()[at.by_loads]).reshape(-1, 3)
    local += np.repeat((params.load_error * np.linalg.norm(pressed, axis=1))**2, 3)
    local += np.repeat(by_known(at, params)[at.markers:], 3)
    return points, params.inflation * (state.covariance(B) + np.diag(local))


def _root(covariance):
    """L (6, 6) with L L' the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
