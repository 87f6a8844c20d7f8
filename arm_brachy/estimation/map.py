"""MAP: the most probable state of a model that may be wrong, iterated Gauss-Newton.

State s = (theta, r, b), standardised, prior N(0, I): the unknowns of `unknowns`, the rigid
registration of the tracker, and what each marker is off by for good (glue, calibration, the mesh
around it). The measurement of marker i is
    y_i = h_i(theta; q) + J_i L r + sigma_i b_i + e_i
with h the nonlinear finite elements, L L' the covariance of the registration and e Student noise.
Every estimate minimises |s - s_prior|^2 + |e|^2 by Gauss-Newton: solve at theta, differentiate by
the adjoint, update in closed form, again until theta stays. The posterior covariance is that of
the linearisation there (Laplace), times one inflation factor. Between measurements the state
forgets: s <- rho s, P <- rho^2 P + (1 - rho^2) I, which leaves the prior as it is (README).
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity, word
from arm_brachy.core.scene import with_mesh
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.forward import Forward
from arm_brachy.estimation.gaussian import condition, registration_jacobian, student_weights
from arm_brachy.estimation.unknowns import PriorParams

LEAST_WEIGHT = 0.1   # of a marker that is named as an outlier
HALVINGS = 3         # of a step of theta at which the model finds no equilibrium
SWEEPS = 4           # of the weights within one linearisation

_FITTED = 'fitted to plants outside the tables, README.md, section 4'
STRAINED = 1.3       # power of |F - I| with which what a mesh misses grows, fitted likewise


@dataclass(frozen=True)
class MapParams:
    """What is believed before a measurement, and when to stop."""

    mesh: str = word('file beside the mesh of the model, to use in its place; best one with the '
                     'rims of the pads among its edges', default='')
    noise: float = quantity(0.02, 'mm', 'sd of a marker coordinate from frame to frame',
                            low=1e-4, high=50.0, source='optical tracker: 0.025 mm rms length')
    offset: float = quantity(0.09, 'mm', 'sd of the constant error of a marker coordinate',
                             low=1e-4, high=50.0, source='optical tracker: 0.15 mm rms length')
    marker_local: float = quantity(0.55, 'mm', 'sd of what the mesh misses about a marker, times '
                                   'the norm of F - I there to the power 1.3', low=0.0,
                                   high=50.0, source=_FITTED)
    target_local: float = quantity(0.45, 'mm', 'the same about a target', low=0.0, high=50.0,
                                   source=_FITTED)
    floor: float = quantity(0.03, 'mm', 'sd of the place of a target at rest', low=1e-4, high=10.0,
                            source='tools and embedding')
    dof: float = quantity(4.0, '', 'degrees of freedom of the Student noise', low=1.0, high=100.0,
                          source='Lange, Little & Taylor 1989, sec. 5: 4 where little is known')
    memory: float = quantity(0.001, 's', 'time in which the state forgets', low=1e-3, high=1e6,
                             source='measured, README section 5: what is remembered of a smaller '
                             'push does harm')
    iterations: int = 1                 # of Gauss-Newton in one estimate: README, section 5
    settled: float = quantity(0.02, 'mm', 'largest change of an expected point that ends them',
                              low=1e-6, high=1.0, source='the noise of a marker')
    inflation: float = quantity(0.9, '', 'factor on the covariance', low=0.1, high=100.0,
                                source=_FITTED)
    prior: PriorParams = field(default_factory=PriorParams)


@dataclass(frozen=True)
class _Point:
    """Linearisation: theta (k,), expected points (w, 3) [m], response (3w, k), strain (w,)
    |F - I|^1.3, x (n, 3) [m]."""

    theta: np.ndarray
    q: np.ndarray
    points: np.ndarray
    response: np.ndarray
    strain: np.ndarray
    x: np.ndarray


class Map:
    """Iterated maximum a posteriori estimator; see the module.

    Attributes: targets (names), mesh (TetMesh of Estimate.x)
    Quasi-static: valid while the tissue is in equilibrium. Deterministic; depends on what was
    given since `reset` only.
    Test: estimation/test_map.py
    """

    def __init__(self, scene, terms, targets, markers, params):
        """Arguments as `build`."""
        self.params = params
        if params.mesh:
            scene = replace(with_mesh(scene, own_mesh(scene, params)), element='quadratic')
        self._forward = Forward(scene, terms, targets, markers, params.prior)
        self.targets, self.mesh = self._forward.model.targets, self._forward.mesh
        self._k, self._m = self._forward.unknowns.count, self._forward.n_markers
        self._rest = self._forward.rest()
        self.reset()

    def reset(self):
        """Forget everything that was measured."""
        size = self._k + 6 + 3 * self._m
        self._forward.forget()
        self._mean, self._covariance, self._t = np.zeros(size), np.eye(size), None
        self._x, self._at = self._rest, None

    def step(self, surface):
        """Return the Estimate of a Surface; what could not be taken in leaves the state."""
        if not surface.seen.any():
            return self._failed(surface, Outcome.REJECTED, 'no marker seen; must be one at least')
        mean, covariance = self._predicted(surface.t)
        try:
            found, at, weights = self._iterate(surface, mean, covariance)
        except NotConverged as error:
            self._at = None
            return self._failed(surface, Outcome.NOT_CONVERGED, str(error))
        outliers = self._outliers(surface, weights)
        if 2 * len(outliers) > surface.seen.sum():
            return self._failed(surface, Outcome.DEPARTED, f'{len(outliers)} of '
                                f'{surface.seen.sum()} markers do not fit the model: '
                                f'{", ".join(outliers)}')
        self._mean, self._covariance, self._t = found.mean, found.covariance, surface.t
        return self._estimate(surface, at, outliers)

    def _failed(self, surface, outcome, message):
        return Estimate.failed(surface.t, self.targets, outcome, f'map: {message}')

    def _predicted(self, t):
        """Mean and covariance of the state at t, after forgetting."""
        if self._t is None:
            return self._mean, self._covariance
        rho = np.exp(-max(t - self._t, 0.0) / self.params.memory)
        return (rho * self._mean,
                rho**2 * self._covariance + (1.0 - rho**2) * np.eye(len(self._mean)))

    def _iterate(self, surface, mean, covariance):
        """(Posterior, last _Point, weights) by Gauss-Newton from the state before."""
        at = self._start(surface.q, mean[:self._k])
        for i in range(self.params.iterations):
            found, weights = self._update(surface, at, mean, covariance)
            change = at.response @ (found.mean[:self._k] - at.theta)
            if i + 1 == self.params.iterations or np.abs(change).max() < self.params.settled:
                return found, at, weights
            at = self._linearised(surface.q, found.mean[:self._k], at)

    def _start(self, q, theta):
        """The last _Point while the pads stand still, else one at q."""
        if self._at is not None and np.array_equal(q, self._at.q):
            return self._at
        return self._linearised(q, theta, self._at)

    def _linearised(self, q, theta, before):
        """_Point at theta, or on the way to it from `before` as far as there is an equilibrium."""
        start = np.zeros(self._k) if before is None else before.theta
        for _ in range(HALVINGS):
            try:
                return self._solved(q, theta)
            except NotConverged:
                theta = start + 0.5 * (theta - start)
        return self._solved(q, theta)

    def _solved(self, q, theta):
        forward = self._forward
        fields, offset, shift = forward.unknowns.applied(theta, q, self._x, forward.derivatives)
        x = forward.solve(self._x, q, fields, offset)
        response = forward.response(x, q, fields)
        self._x = x
        self._at = _Point(theta, np.array(q, dtype=float), forward.points(x) + shift, response,
                          forward.strain(x)**STRAINED, x)
        return self._at

    def _update(self, surface, at, mean, covariance):
        """(Posterior of the state, weights (seen,)) with the model linearised at `at`."""
        seen = surface.seen
        rows = np.repeat(seen, 3)
        H, structural = self._measurement(surface, at, rows)
        residual = (surface.markers - at.points[:self._m]).ravel()[rows]
        residual = residual + H[:, :self._k] @ at.theta - H @ mean
        own = np.repeat(self._own_variance(at)[seen], 3)
        weights = np.ones(seen.sum())
        for _ in range(SWEEPS):
            white = self.params.noise**2 + own * np.repeat(1.0 / weights - 1.0, 3)
            found = condition(mean, covariance, residual, H, np.diag(white))
            left = residual - structural @ (found.mean - mean)
            squared = (left**2 / (own + self.params.noise**2)).reshape(-1, 3).sum(axis=1)
            weights = student_weights(squared, self.params.dof)
        return found, weights

    def _measurement(self, surface, at, rows):
        """d markers seen / d state, and the same without the markers' own errors."""
        points, seen = at.points[:self._m], surface.seen
        H = np.zeros((3 * self._m, len(self._mean)))
        H[:, :self._k] = at.response[:3 * self._m]
        root = _root(surface.frame_covariance)
        H[rows, self._k:self._k + 6] = registration_jacobian(points[seen]) @ root
        structural = H[rows].copy()
        own = np.repeat(np.sqrt(self._own_variance(at)), 3)
        H[:, self._k + 6:] = np.diag(own)
        return H[rows], structural

    def _own_variance(self, at):
        """(m,) [m^2] per coordinate of what each marker is off by for good."""
        p = self.params
        return p.offset**2 + (p.marker_local * at.strain[:self._m])**2

    def _outliers(self, surface, weights):
        names = np.array(self._forward.model.markers)[surface.seen]
        return tuple(names[weights < LEAST_WEIGHT])

    def _estimate(self, surface, at, outliers):
        p, rows = self.params, slice(3 * self._m, None)
        change = self._mean[:self._k] - at.theta
        points = at.points[self._m:] + (at.response[rows] @ change).reshape(-1, 3)
        B = at.response[rows]
        local = p.floor**2 + (p.target_local * np.repeat(at.strain[self._m:], 3))**2
        spread = p.inflation * (B @ self._covariance[:self._k, :self._k] @ B.T + np.diag(local))
        k = len(self.targets)
        message = f'markers that do not fit: {", ".join(outliers)}' if outliers else ''
        return Estimate(surface.t, self.targets, points,
                        spread.reshape(k, 3, k, 3)[range(k), :, range(k)],
                        at.x + self._forward.nodal_change(change), message=message)


def _root(covariance):
    """L (6, 6) with L L' the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def own_mesh(scene, params):
    """Return the Path of the mesh that MapParams name. Raises ConfigError if there is none.

    scene : core.scene.Scene, in whose mesh's folder it is
    """
    file = Path(scene.mesh.file).parent / params.mesh
    if not file.is_file():
        raise ConfigError(f'map: mesh = {params.mesh!r}; no such file beside the mesh of scene '
                          f'{scene.name} in {file.parent}')
    return file


def build(scene, terms, targets, markers, params=None):
    """Return the Map of a scene's model side.

    scene : core.scene.Scene;  terms : body terms without memory;  targets, markers : names,
    markers on the tissue;  params : MapParams, None = the defaults
    Raises ConfigError, MeshError as `ModelBody`, NotConverged where the model finds no rest.
    """
    return Map(scene, terms, targets, markers, MapParams() if params is None else params)
