"""POD: the model's answer plus few modes of what it may be wrong by, updated in closed form.

The modes are the principal directions of what the unknowns of `unknowns` do to the nodes at
sampled pushes, per metre of push (proper orthogonal decomposition). At travel q
    x = x_model(q) + |q| V a,   a ~ N(0, diag(variance)),   |q| the deepest push
and markers are linear in a: the update is one solve. With `update: es_mda` the same prior and
measurement go through the ensemble smoother (5.5)-(5.6) with 100 members: what an ensemble costs
against the closed form, without a network.
"""

import numpy as np
from scipy.sparse.linalg import svds

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.random import stream
from arm_brachy.estimation.es_mda import equal_alphas, es_mda
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.forward import Forward
from arm_brachy.estimation.gaussian import condition, registration_jacobian
from arm_brachy.estimation.pod_params import PodParams
from arm_brachy.tissue.reduced_basis import PushDomain, sample_pushes, solve_pushes


class Pod:
    """Reduced linear estimator; see the module.

    Attributes: targets (names), mesh (TetMesh of Estimate.x), basis (n, 3, r), variance (r,)
    Each estimate depends on its Surface alone. Valid as far as what the model is wrong by grows
    in proportion to the push.
    Test: estimation/test_pod.py
    """

    def __init__(self, scene, terms, targets, markers, params):
        """Arguments as `build`; takes seconds: `pushes` equilibria and their derivatives."""
        if params.modes < 1 or params.pushes < 1:
            raise InputError(f'pod: modes {params.modes}, pushes {params.pushes}; must be at '
                             'least 1')
        self.params = params
        self._forward = Forward(scene, terms, targets, markers, params.prior)
        self.targets, self.mesh = self._forward.model.targets, self._forward.mesh
        self._rest = self._forward.rest()
        self.basis, self.variance = self._modes()
        flat = self.basis.reshape(-1, self.basis.shape[2])
        self._watch = self._forward.watch.T @ flat
        self.reset()

    def reset(self):
        """Forget the last state; the next solve starts from rest."""
        self._forward.forget()
        self._x, self._q, self._count = self._rest, None, 0

    def _modes(self):
        """Basis (n, 3, r) orthonormal in the nodes, and the variance of each coordinate."""
        body = self._forward.model.body
        domain = PushDomain.of(body, self.params.reach)
        pushes = sample_pushes(domain, self.params.pushes, stream(self.params.seed, 'pod'))
        effects = None      # one array for all pushes: it has a hundred megabytes
        for i, (push, x) in enumerate(zip(pushes, solve_pushes(body, domain, pushes).x,
                                          strict=True)):
            q = np.einsum('pi,pi->p', push, self._forward.model.directions)
            effect = self._forward.nodal_response(x, q) / np.abs(q).max()
            if effects is None:
                effects = np.empty((len(effect), len(pushes), effect.shape[1]))
            effects[:, i] = effect
        effects = effects.reshape(len(effects), -1)
        r = min(self.params.modes, min(effects.shape) - 1)
        start = stream(self.params.seed, 'pod/svd').normal(size=min(effects.shape))
        # of the largest alone: the Gram matrix and its vectors would have two hundred megabytes
        basis, values, _ = svds(effects, k=r, v0=start, return_singular_vectors='u')
        basis = basis.reshape(*body.mesh.nodes.shape, r)
        return basis[:, :, ::-1], values[::-1]**2 / len(pushes)

    def step(self, surface):
        """Return the Estimate of a Surface; a failed solve leaves the last state to start from."""
        seen = surface.seen
        if not seen.any():
            return Estimate.failed(surface.t, self.targets, Outcome.REJECTED,
                                   'pod: no marker seen; must be one at least')
        try:
            x = self._model_at(surface.q)
            mean, covariance = self._update(surface, self._forward.points(x), seen)
        except NotConverged as error:
            return Estimate.failed(surface.t, self.targets, Outcome.NOT_CONVERGED, str(error))
        depth, m = np.abs(surface.q).max(), 3 * self._forward.n_markers
        points = self._forward.points(x).ravel() + depth * self._watch @ mean
        B = depth * self._watch[m:]
        spread = B @ covariance @ B.T + self._left_out(depth) * np.eye(len(B))
        k = len(self.targets)
        blocks = spread.reshape(k, 3, k, 3)[range(k), :, range(k)]
        return Estimate(surface.t, self.targets, points[m:].reshape(-1, 3), blocks,
                        x + depth * self.basis @ mean)

    def _left_out(self, depth):
        """Variance [m^2] per coordinate of what the modes leave of a point."""
        return self.params.floor**2 + (self.params.local * depth)**2

    def _model_at(self, q):
        if self._q is None or not np.array_equal(q, self._q):
            self._x, self._q = self._forward.solve(self._x, q), np.array(q, dtype=float)
        return self._x

    def _update(self, surface, points, seen):
        """Mean (r,) and covariance (r, r) of the coordinates."""
        rows = np.repeat(seen, 3)
        expected = points[:len(seen)]
        residual = (surface.markers - expected).ravel()[rows]
        depth = np.abs(surface.q).max()
        H = depth * self._watch[:len(rows)][rows]
        J = registration_jacobian(expected[seen])
        R = (J @ surface.frame_covariance @ J.T
             + (self.params.noise**2 + self._left_out(depth)) * np.eye(len(H)))
        prior = np.diag(self.variance)
        if self.params.update == 'closed_form':
            found = condition(np.zeros(len(prior)), prior, residual, H, R)
            return found.mean, found.covariance
        return self._smoothed(residual, H, R)

    def _smoothed(self, residual, H, R):
        rng = stream(self.params.seed, f'pod/{self._count}')
        self._count += 1
        z = rng.standard_normal((self.params.members, len(self.variance)))
        found = es_mda(z * np.sqrt(self.variance), lambda a: a @ H.T, residual, R, rng,
                       alphas=equal_alphas(self.params.assimilations))
        return found.mean, found.covariance


def build(scene, terms, targets, markers, params=None):
    """Return the Pod of a scene's model side.

    scene : core.scene.Scene;  terms : body terms without memory;  targets, markers : names,
    markers on the tissue;  params : PodParams, None = the defaults
    Raises ConfigError, MeshError as `ModelBody`, NotConverged where the model finds no rest.
    """
    return Pod(scene, terms, targets, markers, PodParams() if params is None else params)
