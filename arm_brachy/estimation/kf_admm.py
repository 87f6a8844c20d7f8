"""KF-ADMM (thesis ch. 4): a Kalman filter inside the iteration that solves the finite elements.

State (4.2): this iterate's node positions and the last one's, 2 f numbers an axis. With scalar
weights, whole nodes held and isotropic noise the filter of 6 f states is exactly three equal ones
of 2 f. Model (4.3): X <- S X + input, S = [[2 P, -P], [I, 0]], P = (M + dt^2 L)^-1 M. The gain is
the steady one of (4.6)-(4.7), made once. It stands outside the inverse, as in (4.8); Algorithm 2
prints it inside, where it would be a force and not a position.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity, word
from arm_brachy.estimation.admm_points import AdmmPoints
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.model_body import ModelBody
from arm_brachy.estimation.steady_gain import steady_covariance, symmetric
from arm_brachy.tissue.mesh import interpolate
from arm_brachy.tissue.newton import StaticSolver

THESIS = 'thesis sec. 4.4, by trial and error there, unit not printed; mm^2'


@dataclass(frozen=True)
class KfAdmmParams:
    """Noise of the filter, and how much of the iteration a tick does."""

    process: Literal['white', 'correlated'] = word(
        'covariance Q of the model error: white, of every node on its own (thesis), or '
        'proportional to the inverse square of the graph Laplacian', default='correlated')
    process_variance: float = quantity(3.0, 'mm2', 'Q of one iteration: variance of a coordinate, '
                                       'of the mean node if correlated', low=1e-9, high=1e9,
                                       source=THESIS)
    measurement_variance: float = quantity(0.01, 'mm2', 'R: variance of a marker coordinate; '
                                           'infinite = plain ADMM', low=1e-9, source=THESIS)
    step: float = quantity(10.0, 'ms', 'dt of (4.1), the time that one iteration stands for',
                           low=0.1, high=1e4, source='own choice: the five iterations of a tick '
                                                     'last a tick. Thesis: none printed')
    weight: float = quantity(4.0, '', 'c of the weights w^2 = c (kappa + 4/3 mu) V',
                             low=1e-3, high=1e3, source='of 1 to 8 the first without two-cycles '
                                                        'at 20 mm by two pads')
    volume_weight: float = quantity(0.4, '', 'the same over kappa V, where only volume change '
                                    'counts', low=1e-3, high=1e3,
                                    source='likewise, of 0.2 to 1 the quickest')
    iterations: int = 5   # of every tick, whatever they come to: equal ticks give equal bits
    fewest_markers: int = 3   # seen; with fewer no estimate is given

    def __post_init__(self):
        for name in ('iterations', 'fewest_markers'):
            if getattr(self, name) < 1:
                raise ConfigError(f'kf_admm: {name} = {getattr(self, name)}; must be at least 1')


class KfAdmm:
    """Node positions and their covariance from pads and markers.

    `step` makes a fixed number of iterations, so that its time and its bits are known. The
    covariance is the filter's own: what Q and R claim of the model, not what the model deserves.
    Markers that are not seen are left out of the gain, whose covariance before the measurement
    stays that of the whole set. Pad encoders are taken as exact.
    Test: estimation/test_kf_admm.py
    """

    def __init__(self, scene, terms, targets, markers, params):
        """Arguments as `ModelBody`, and KfAdmmParams. Raises NotConverged, ConfigError."""
        self.params, self._model = params, ModelBody(scene, terms, targets, markers)
        self.targets, body = self._model.targets, self._model.body
        self._admm = AdmmPoints(body, params.step, params.weight, params.volume_weight)
        start = StaticSolver(body).solve(body.mesh.nodes, np.zeros((len(body.pads), 3)))
        if not start.outcome.ok:
            raise NotConverged(f'kf_admm: model of scene {scene.name} at rest: '
                               f'{start.outcome.advice}')
        self._start = start.x
        n, free = len(body.mesh.nodes), self._admm.free
        self._C, self._T = (rider.matrix(n).toarray()[:, free] for rider in
                            (self._model.marker_rider, self._model.target_rider))
        self._filter()
        self.reset()

    def _filter(self):
        """The steady covariance before a measurement, as far as nodes, markers, targets see it."""
        f, p = len(self._admm.free), self.params
        if np.isinf(p.measurement_variance):
            self._XC, X = np.zeros((2 * f, len(self._C))), np.zeros((f, f))
        else:
            X = steady_covariance(*filter_matrices(self._admm, self._C, p))
            self._XC, X = X[:, :f] @ self._C.T, X[:f, :f]
        self._CXC, self._TXC = symmetric(self._C @ self._XC[:f]), self._T @ self._XC[:f]
        self._TXT = np.einsum('kf,fg,kg->k', self._T, X, self._T, optimize=True)
        self._seen = None

    def reset(self):
        """Back to the body at rest."""
        self._admm.start(self._start)

    def step(self, surface):
        """Make the tick's iterations with this Surface; return the Estimate."""
        seen = surface.seen
        if seen.sum() < self.params.fewest_markers:
            return Estimate.failed(surface.t, self.targets, Outcome.REJECTED,
                                   f'{seen.sum()} of {len(seen)} markers seen; kf_admm needs '
                                   f'{self.params.fewest_markers}')
        self._choose(seen)
        pads = self._model.pad_displacement(surface.q)
        for _ in range(self.params.iterations):
            self._admm.local_step()
            self._admm.predict(pads)
            # after the prediction, at once: (4.8)
            expected = interpolate(self._model.marker_rider, self._admm.x)[seen]
            self._admm.correct(self._gain @ (surface.markers[seen] - expected))
        return self._estimate(surface)

    def _choose(self, seen):
        """Gain (2 f, m) and variances (k,) of the targets for the markers seen."""
        if self._seen is not None and np.array_equal(seen, self._seen):
            return
        if np.isinf(self.params.measurement_variance):
            self._gain, self._variance = self._XC[:, seen], np.full(len(self.targets), np.nan)
        else:
            S = self._CXC[np.ix_(seen, seen)] + self.params.measurement_variance * np.eye(
                seen.sum())
            self._gain = np.linalg.solve(S, self._XC[:, seen].T).T
            drop = np.linalg.solve(S, self._TXC[:, seen].T)
            self._variance = self._TXT - np.einsum('km,mk->k', self._TXC[:, seen], drop)
        self._seen = seen.copy()

    def _estimate(self, surface):
        x = self._admm.x
        points = interpolate(self._model.target_rider, x)
        covariance = self._variance[:, None, None] * np.eye(3) + frame_part(surface, points)
        bad = np.flatnonzero(~(self._variance > 0.0) & ~np.isnan(self._variance))
        if not np.isfinite(x).all() or len(bad):
            said = ('positions are not finite' if not len(bad) else
                    f'covariance of {self.targets[bad[0]]} is not positive: '
                    f'{self._variance[bad[0]]:.3g} m^2')
            return Estimate.failed(surface.t, self.targets, Outcome.NOT_CONVERGED,
                                   f'kf_admm: {said}')
        return Estimate(surface.t, self.targets, points, covariance, x.copy())


def filter_matrices(admm, C, params):
    """S (2f, 2f), C (m, 2f), Q (2f, 2f), R (m, m) of (4.5), one axis. SI.

    admm : AdmmPoints;  C : (m, f) markers from free nodes;  params : KfAdmmParams
    """
    P, f = admm.transition(), len(admm.free)
    S = np.block([[2.0 * P, -P], [np.eye(f), np.zeros((f, f))]])
    Q = np.zeros((2 * f, 2 * f))
    if params.process == 'white':
        Q[np.diag_indices(2 * f)] = params.process_variance   # 3 I of all states, as printed
    else:
        # of M^-1 L, whose white noise has covariance M^-1: what comes out does not depend on how
        # fine the mesh is (Lindgren, Rue & Lindstrom 2011, J R Stat Soc B 73:423)
        root = np.sqrt(admm.mass)[:, None] * admm.smooth(np.eye(f))
        square = root.T @ root
        Q[:f, :f] = params.process_variance * square / np.mean(np.diag(square))
    wide = np.hstack([C, np.zeros_like(C)])
    return S, wide, Q, params.measurement_variance * np.eye(len(C))


def frame_part(surface, points):
    """Covariance (k, 3, 3) [m^2] that the registration of the frame adds to points (k, 3)."""
    if not surface.seen.any():
        return np.zeros((len(points), 3, 3))
    arm = points - surface.markers[surface.seen].mean(axis=0)
    J = np.zeros((len(points), 3, 6))
    J[:, :, 3:] = np.eye(3)
    J[:, 0, 1], J[:, 0, 2] = arm[:, 2], -arm[:, 1]
    J[:, 1, 0], J[:, 1, 2] = -arm[:, 2], arm[:, 0]
    J[:, 2, 0], J[:, 2, 1] = arm[:, 1], -arm[:, 0]
    return J @ surface.frame_covariance @ np.swapaxes(J, 1, 2)


def build(scene, terms, targets, markers, params=None):
    """The estimator; params : KfAdmmParams, None = defaults."""
    return KfAdmm(scene, terms, targets, markers, params or KfAdmmParams())
