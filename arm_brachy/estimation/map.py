"""MAP: the most probable state of a model that may be wrong, iterated Gauss-Newton.

State s = (theta, r, b), standardised: the unknowns of `unknowns`, the rigid registration of the
tracker, and what each marker is off by for good (glue, calibration, the mesh around it). The
measurement of marker i is
    y_i = h_i(theta; q) + J_i L r + sigma_i b_i + e_i
with h the nonlinear finite elements, L L' the covariance of the registration and e Student noise.
Several priors compete, each with one kind of unknown suspected (`mixture`). Every estimate solves
at theta, differentiates by the adjoint and updates in closed form (`map_update`), again until
theta stays, if more than one iteration is asked for. Between measurements the state forgets: its
covariance returns to that of the prior (README).
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity, whole, word
from arm_brachy.core.scene import with_mesh
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.forward import Forward
from arm_brachy.estimation.known_load import beside, nodal_forces
from arm_brachy.estimation.local_loads import node_volumes
from arm_brachy.estimation.map_update import (
    Point,
    hypotheses,
    in_all,
    loaded,
    target_state,
    update,
)
from arm_brachy.estimation.mixture import Mixture
from arm_brachy.estimation.unknowns import PriorParams

LEAST_WEIGHT = 0.1   # of a marker that is named as an outlier
SUSPECTED = 0.5      # probability from which an unknown load is named
NEAR = 3e-3          # m, travel over which an equilibrium is foretold to first order
HALVINGS = 3         # of a step of theta at which the model finds no equilibrium

_FITTED = 'fitted to plants outside the tables, arm-brachy reproduce fit-estimators'
_KEPT = 'fitted to plants outside the tables, README.md, section 4'
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
                                   high=50.0, source=_KEPT)
    target_local: float = quantity(0.45, 'mm', 'the same about a target', low=0.0, high=50.0,
                                   source=_KEPT)
    load_error: float = quantity(0.4, '', 'sd of the place of a target, as a share of what an '
                                 'unknown load moves it by: the model is linearised without it',
                                 low=0.0, high=10.0, source='plants under a probe, README.md, '
                                 'section 4')
    known_error: float = quantity(0.15, '', 'sd of the place of a target or marker, as a share of '
                                  'what a known load moves it by', low=0.0, high=10.0,
                                  source='plants under a probe, README.md, section 4')
    reload: float = quantity(1.5, 'N', 'change of the known loads over which one linearisation '
                             'serves, summed over the nodes', low=0.0, high=100.0,
                             source='a probe of 3 N that has gone on by some 3 mm: what a load '
                                    'does is followed to first order in between')
    floor: float = quantity(0.03, 'mm', 'sd of the place of a target at rest', low=1e-4, high=10.0,
                            source='tools and embedding')
    dof: float = quantity(4.0, '', 'degrees of freedom of the Student noise', low=1.0, high=100.0,
                          source='Lange, Little & Taylor 1989, sec. 5: 4 where little is known')
    memory: float = quantity(0.001, 's', 'time in which the state forgets', low=1e-3, high=1e6,
                             source='measured, README section 5: what is remembered of a smaller '
                             'push does harm')
    iterations: int = whole(1, 'of Gauss-Newton in one estimate, at most: README, section 5',
                            low=1, high=1000)
    settled: float = quantity(0.02, 'mm', 'largest change of an expected point that ends them',
                              low=1e-6, high=1.0, source='the noise of a marker')
    others: float = quantity(0.25, '', 'share of its sd that each kind of unknown keeps while '
                             'another kind is suspected; 1 = one prior, nothing is suspected',
                             low=0.0, high=1.0, source=_FITTED)
    trust: float = quantity(1.0, '', 'power of the likelihood by which suspicions are weighed',
                            low=0.0, high=1.0, source=_FITTED)
    reuse: float = quantity(1.0, 'mm', 'travel of a pad over which one linearisation serves',
                            low=0.0, high=50.0, source='README, section 5')
    inflation: float = quantity(1.24, '', 'factor on the covariance', low=0.1, high=100.0,
                                source=_FITTED)
    prior: PriorParams = field(default_factory=PriorParams)


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
        self._forward = Forward(scene, terms, targets, markers, params.prior, single=True)
        self.targets, self.mesh = self._forward.model.targets, self._forward.mesh
        self._k, self._m = self._forward.unknowns.count, self._forward.n_markers
        loads = self._forward.unknowns.part('load')
        self._loads = loads.stop - loads.start
        self._suspicions = hypotheses(self._forward.unknowns, params.others)
        self._volume = node_volumes(self._forward.model.body)
        self._rest = self._forward.rest()
        self.reset()

    def reset(self):
        """Forget everything that was measured."""
        self._forward.forget()
        self._state, self._t = Mixture.prior(in_all(self._suspicions, self._m)), None
        self._x, self._at = self._rest, None

    @property
    def unknowns(self):
        """unknowns.Unknowns of its model."""
        return self._forward.unknowns

    def linearised(self, q):
        """map_update.Point of the model as it is, at travel q (p,) [m]. Raises NotConverged."""
        at = self._linearised(np.asarray(q, dtype=float), np.zeros(self._k), self._at,
                              np.zeros_like(self._x))
        return self._renewed() if at.stale else at

    def step(self, surface):
        """Return the Estimate of a Surface; what could not be taken in leaves the state."""
        under = ~beside(surface.loads, surface.markers)
        surface = replace(surface, markers=np.where(under[:, None], np.nan, surface.markers))
        if not surface.seen.any():
            return self._failed(surface, Outcome.REJECTED, 'no marker seen; must be one at least')
        known = nodal_forces(surface.loads, self._x, self._volume)
        try:
            found, at, weights = self._iterate(surface, self._predicted(surface.t), known)
        except NotConverged as error:
            self._at = None
            return self._failed(surface, Outcome.NOT_CONVERGED, str(error))
        outliers = self._outliers(surface, weights)
        if 2 * len(outliers) > surface.seen.sum():
            return self._failed(surface, Outcome.DEPARTED, f'{len(outliers)} of '
                                f'{surface.seen.sum()} markers do not fit the model: '
                                f'{", ".join(outliers)}')
        self._state, self._t = found, surface.t
        return self._estimate(surface, at, outliers)

    def _failed(self, surface, outcome, message):
        return Estimate.failed(surface.t, self.targets, outcome, f'map: {message}')

    def _predicted(self, t):
        """Mixture of the state at t, after forgetting."""
        if self._t is None:
            return self._state
        return self._state.forgotten(np.exp(-max(t - self._t, 0.0) / self.params.memory))

    def _iterate(self, surface, state, known):
        """(Mixture, last Point, weights) by Gauss-Newton from the state before.

        known : (n, 3) [N] of the loads that are known
        """
        at = self._start(surface.q, state.average()[:self._k], known)
        for i in range(self.params.iterations):
            found, weights = update(at, surface, state, self.params)
            theta = found.average()[:self._k]
            change = at.response @ (theta - at.theta)
            if i + 1 == self.params.iterations or np.abs(change).max() < self.params.settled:
                return found, at, weights
            at = self._linearised(surface.q, theta, at, known)

    def _start(self, q, theta, known):
        """The last Point, moved along with pads and loads while these are near, else one there.

        Where pads go on, one frame solves and the next one differentiates.
        """
        if (self._at is not None and np.abs(q - self._at.q).max(initial=0.0) <= self.params.reuse
                and np.abs(known - self._at.known).sum() <= self.params.reload):
            return self._under(self._renewed() if self._at.stale else self._at, known).moved(q)
        return self._linearised(q, theta, self._at, known)

    def _under(self, at, known):
        """A Point of the last linearisation under other known loads."""
        if np.array_equal(known, at.known):
            return at
        moved = self._forward.yield_to(known - at.known)
        return at.loaded(known, moved, self._forward.moves(moved))

    def _renewed(self):
        """The last Point with the response at its own travel."""
        forward, at = self._forward, self._at
        fields, _, _ = forward.unknowns.applied(at.theta, at.q, at.x, forward.derivatives,
                                                at.known)
        self._at = replace(at, response=forward.response(at.x, at.q, fields, at.known),
                           by_pads=forward.pad_response(), stale=False)
        self._at = replace(self._at, pressed=self._pressed(at.known))
        return self._at

    def _pressed(self, known):
        """(w, 3) [m] by which known loads (n, 3) [N] move the points, by the last response."""
        if not known.any():
            return np.zeros((self._m + len(self.targets), 3))
        return self._forward.moves(self._forward.yield_to(known))

    def _linearised(self, q, theta, before, known):
        """Point at theta, or on the way to it from `before` as far as there is an equilibrium."""
        start = np.zeros(self._k) if before is None else before.theta
        for _ in range(HALVINGS):
            try:
                return self._solved(q, theta, known)
            except NotConverged:
                theta = start + 0.5 * (theta - start)
        return self._solved(q, theta, known)

    def _solved(self, q, theta, known):
        forward, near = self._forward, self._at
        if near is not None and np.abs(q - near.q).max(initial=0.0) > NEAR:
            near = None
        if near is not None:
            self._x = near.moved(q).x
        fields, offset, shift = forward.unknowns.applied(theta, q, self._x, forward.derivatives,
                                                         known)
        x = forward.solve(self._x, q, fields, offset)
        self._x = x
        found = Point(theta, np.array(q, dtype=float), forward.points(x) + shift, None,
                      forward.strain(x)**STRAINED, self._m, x, None, self._loads, known=known)
        if near is None or near.stale or self.params.iterations > 1:
            found = replace(found, response=forward.response(x, q, fields, known),
                            by_pads=forward.pad_response())
        else:
            found = replace(found, response=near.response, by_pads=near.by_pads, stale=True)
        found = replace(found, pressed=self._pressed(known))
        self._at = found
        return found

    def _outliers(self, surface, weights):
        names = np.array(self._forward.model.markers)[surface.seen]
        return tuple(names[weights < LEAST_WEIGHT])

    def _estimate(self, surface, at, outliers):
        points, spread = target_state(at, self._state, self.params)
        change = self._state.average()[:self._k] - at.theta
        k = len(self.targets)
        notice, message = self._notice(at, outliers)
        return Estimate(surface.t, self.targets, points,
                        spread.reshape(k, 3, k, 3)[range(k), :, range(k)],
                        at.x + self._forward.nodal_change(change), message=message,
                        notice=notice)

    def _notice(self, at, outliers):
        """(Outcome, message) of what a person should know of an estimate."""
        chance = loaded(at, self._state)
        if chance > SUSPECTED:
            return Outcome.UNKNOWN_LOAD, (f'with probability {chance:.2f} something besides the '
                                          'pads loads the tissue; the ellipses are wide for it')
        if outliers:
            return Outcome.MARKERS_REJECTED, f'do not fit the model: {", ".join(outliers)}'
        return Outcome.OK, ''


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
