"""Markers to targets through the network: ES-MDA (5.5), (5.6) on its latent variables.

Prior: as in the thesis, the finite-element state of the moment, encoded (`prior: model`), or what
the travel of the pads said of the latent variables in the training (`prior: travel`, no solve).
Its covariance is what the travel leaves open in the training states (`weights.Forecast`): the
thesis draws with the encoder's, which knows of the reconstruction only and nothing of a model that
is wrong. Forward map: the decoder at the nodes around the markers.
"""

import copy
import warnings
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.random import stream
from arm_brachy.estimation.es_mda import RankDeficient, equal_alphas, es_mda
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.gaussian import registration_jacobian
from arm_brachy.estimation.graph_vae import weights
from arm_brachy.estimation.graph_vae.decoder import PartialDecoder
from arm_brachy.estimation.graph_vae.params import GraphVaeParams
from arm_brachy.estimation.model_body import ModelBody
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import embed
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

FEWEST = 3                  # markers that fix a rigid motion
TOLERANCE = 1e-6            # m, between the scene's pads and those of the training
STATICS = NewtonOptions(tolerance=1e-6)     # a hundredth of what the network leaves
KEPT = 1000                 # travels whose equilibrium is kept, as latent means


class Encoded:
    """The model's equilibrium on the network's mesh, in latent variables."""

    def __init__(self, scene, trained):
        """scene : core.scene.Scene;  trained : weights.Trained."""
        self._trained, self._rest = trained, trained.mesh.nodes
        self._body = build_body(scene, trained.mesh)
        self._directions = np.array([pad.direction for pad in self._body.pads])
        self.reset()

    def reset(self):
        """Forget every solution: the next solve starts from rest."""
        self._known = {}        # bytes of q -> latent means, oldest first
        self._solver = StaticSolver(self._body, options=STATICS)
        self._x = self._rest

    def mean(self, q):
        """Latent means (k,) at travel q (p,) [m]. Raises NotConverged."""
        key = np.asarray(q, dtype=float).tobytes()
        if key not in self._known:
            found = self._solved(q)
            while len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[key] = found
        return self._known[key]

    def _solved(self, q):
        held = self._solver.held_positions(q[:, None] * self._directions)
        found = self._solver.follow(self._x, held)
        if not found.outcome.ok:
            raise NotConverged(f'graph_vae: model at {np.round(1e3 * q, 2).tolist()} mm: '
                               f'{found.outcome.advice}')
        self._x = found.x
        return self._trained.encode((self._x - self._rest)[None])[0]


class GraphVaeEstimator:
    """The network's answer to Surfaces.

    Test: estimation/graph_vae/test_estimator.py
    """

    def __init__(self, scene, targets, markers, params, trained):
        """trained : weights.Trained of this scene's body; the rest as `build`."""
        self.params, self._trained = params, trained
        model = ModelBody(scene, (), targets, markers)
        self.targets, self.mesh = model.targets, trained.mesh
        rest = np.vstack([model.rest_markers, model.rest_targets])
        rider = embed(trained.mesh, rest, names=(*model.markers, *model.targets))
        matrix = rider.matrix(len(trained.mesh.nodes)).tocsc()
        nodes = np.flatnonzero(np.diff(matrix.indptr))
        self._at = matrix[:, nodes].toarray()
        self._m = len(model.markers)
        self._rest = self._at @ trained.mesh.nodes[nodes]
        self._decoder = PartialDecoder(trained.network, nodes)
        self._size = np.linalg.cholesky(trained.forecast.covariance)
        self._model = Encoded(scene, trained) if params.prior == 'model' else trained.forecast
        self._announce(trained.network.latent)
        self.reset()

    def _announce(self, latent):
        if self.params.members <= latent:
            warnings.warn(f'graph_vae: {self.params.members} members span at most '
                          f'{self.params.members - 1} of {latent} latent directions; take more',
                          RankDeficient, stacklevel=3)

    def reset(self):
        """Forget the number of estimates made and the last solution of the model."""
        self._count = 0
        if self.params.prior == 'model':
            self._model.reset()

    def with_params(self, params):
        """The same estimator with other GraphVaeParams of how it measures and samples.

        It shares the model's solutions; weights and prior stay as they are.
        """
        other = copy.copy(self)
        other.params = params
        return other

    def step(self, surface):
        """Return the Estimate of a Surface; Estimate.x is None: all nodes would cost ten times."""
        seen = surface.seen
        if seen.sum() < FEWEST:
            return Estimate.failed(surface.t, self.targets, Outcome.TOO_FEW_MARKERS,
                                   f'graph_vae: {seen.sum()} markers seen; must be {FEWEST} at '
                                   'least')
        rng = stream(self.params.seed, f'graph_vae/{self._count}')
        self._count += 1
        try:
            found = self._smoothed(surface, seen, rng)
        except NotConverged as error:
            return Estimate.failed(surface.t, self.targets, Outcome.NOT_CONVERGED, str(error))
        points = self._points(found.mean[None])[0, self._m:]
        members = self._points(found.z)[:, self._m:]
        off = members - members.mean(axis=0)
        covariance = np.einsum('nki,nkj->kij', off, off) / (len(off) - 1)
        covariance += self._left_out(surface.q) * np.eye(3)
        return Estimate(surface.t, self.targets, points, covariance)

    def _points(self, z):
        """Markers, then targets (batch, k, 3) [m] of latent variables (batch, latent)."""
        return self._rest + np.einsum('kn,bni->bki', self._at, self._decoder(z), optimize=True)

    def _left_out(self, q):
        """Variance [m^2] per coordinate of what the network leaves of a point."""
        return self.params.floor**2 + (self.params.local * np.abs(q).max(initial=0.0))**2

    def _smoothed(self, surface, seen, rng):
        params, mean = self.params, self._model.mean(surface.q)
        z = mean + params.spread * rng.standard_normal((params.members, len(mean))) @ self._size.T
        J = registration_jacobian(surface.markers[seen])
        R = J @ surface.frame_covariance @ J.T + (
            params.noise**2 + self._left_out(surface.q)) * np.eye(len(J))
        rows = np.flatnonzero(seen)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RankDeficient)   # announced when it was built
            return es_mda(z, lambda z: self._points(z)[:, rows].reshape(len(z), -1),
                          surface.markers[seen].ravel(), R, rng,
                          alphas=equal_alphas(params.assimilations), inflation=params.inflation,
                          localised=params.localised)


def build(scene, terms, targets, markers, params=None):
    """Return the GraphVaeEstimator of a scene's model side.

    scene : core.scene.Scene;  terms : body terms, of which the network knows what it was trained
    with: none may be given;  targets, markers : names, markers on the tissue
    params : GraphVaeParams, None = the defaults
    Raises ConfigError for terms and where no weights fit the scene, MeshError for points off it.
    """
    params = GraphVaeParams() if params is None else params
    if terms:
        raise ConfigError(f'graph_vae: model term {terms[0].spec.name}; must be none: the network '
                          'was trained without; leave model.terms out or train one with it')
    trained = weights.load(weight_file(scene, params))
    _refuse_other_body(scene, trained)
    return GraphVaeEstimator(scene, targets, markers, params, trained)


def weight_file(scene, params):
    """Path of the weights for a Scene. Raises ConfigError if there are none."""
    file = Path(params.weights) if params.weights else weights.SHIPPED / f'{scene.name}.npz'
    if not file.is_file():
        raise ConfigError(f'graph_vae: no weights {file}; must be there; run `arm-brachy dataset` '
                          f'and `arm-brachy train` for scene {scene.name}, name the file with '
                          'weights')
    return file


def _refuse_other_body(scene, trained):
    """Weights hold for one body: the same pads, whatever mesh the model has."""
    known = np.array(trained.about['pads'])
    pads = np.array([(*pad.centre, *pad.direction) for pad in scene.pads])
    if known.shape != pads.shape or np.abs(known - pads).max(initial=0.0) > TOLERANCE:
        raise ConfigError(f'graph_vae: scene {scene.name} has other pads than the one that its '
                          'weights are of; must be the same; train a network for this scene')
