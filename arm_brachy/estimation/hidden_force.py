"""A soft body pushed by forces that nobody measures: a cloud of its surface in, its inside out.

As `map`, with other unknowns and another measurement: theta are tractions of overlapping bumps on
the surface, each vector with a Student prior, since a hidden force acts in few places and is large
there; a point of the cloud says how far the surface is from it along the surface's normal, at the
nearest place (no correspondence is given). Gauss-Newton with the weights of both from the last
iterate, begun where the last frame ended; the equilibrium is linear, or Neo-Hookean.
"""

from dataclasses import dataclass
from typing import Literal

import igl
import numpy as np
from scipy.spatial.distance import cdist

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.quantity import quantity, word
from arm_brachy.estimation.gaussian import student_weights
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

FAR, SHRINK = 20e-3, 0.6   # m, noise with which the first frame begins, and its factor
TOLERANCE = 1e-5  # m, open correction of an equilibrium: a hundredth of the cloud's noise


@dataclass(frozen=True)
class HiddenForceParams:
    """What is believed of force and cloud, and how often the model is linearised."""

    law: Literal['linear', 'neo_hookean'] = word('of the body', default='neo_hookean')
    traction: float = quantity(0.1, 'kPa', 'scale of the Student prior of the traction of a bump',
                               low=1e-6, source='own choice: most bumps bear nothing')
    prior_dof: float = quantity(1.0, '', 'its degrees of freedom', low=0.01,
                                source='own choice: few bumps bear all')
    width: float = quantity(8.0, 'mm', 'sd of the Gaussian bumps', low=0.1,
                            source='own choice: the size of an instrument or a finger')
    centres: int = 220              # of bumps, spread over what can be seen
    noise: float = quantity(0.3, 'mm', 'sd of the distance of a point from the surface', low=1e-4,
                            source='residual of the cloud of the liver data')
    dof: float = quantity(4.0, '', 'degrees of freedom of the Student noise', low=1.0,
                          source='as MapParams')
    iterations: int = 3             # of Gauss-Newton in a frame
    first: int = 20                 # in the first frame, whose force is there at once
    refresh: int = 5                # frames between two linearisations, Neo-Hookean only


@dataclass(frozen=True)
class Frame:
    """What one cloud came to.

    x : (n, 3) [m] nodes;  force : (3,) [N] resultant of the estimated traction
    residual : [m] rms distance of the cloud from the surface
    """

    x: np.ndarray
    force: np.ndarray
    residual: float


class HiddenForce:
    """Follows a body by clouds of its surface.

    body : SoftBody, held at its fixed nodes;  triangles : (f, 3) those that can be seen, outward
    params : HiddenForceParams
    Each frame depends on the frames since `reset`. Valid while a frame moves the surface by less
    than its features, so that the nearest place is nearly the right one.
    Test: estimation/test_hidden_force.py
    """

    def __init__(self, body, triangles, params):
        if not len(body.fixed):
            raise InputError('hidden force: the body is held nowhere; must have fixed nodes')
        self.body, self.params = body, params
        self._triangles = np.ascontiguousarray(triangles, dtype=np.int64)
        self.load = self._loads()
        self._assembler = Assembler(body)
        self._linearisation = Linearisation(self._fresh_solver(), body.mesh.nodes)
        self._at_rest = self._response()
        self.reset()

    def reset(self):
        """Back to rest."""
        self._solver = self._fresh_solver()     # the old one knows what it has solved
        self._theta, self._x = np.zeros(self.load.shape[1]), self.body.mesh.nodes
        self._jacobian, self._age, self._begun = self._at_rest, 0, False

    def _fresh_solver(self):
        return StaticSolver(self.body, options=NewtonOptions(tolerance=TOLERANCE),
                            assembler=self._assembler)

    def _loads(self):
        """(3n, k) [N] nodal forces per unit of theta: three for each bump, traction times area."""
        nodes, faces = self.body.mesh.nodes, self._triangles
        corners = nodes[faces]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0],
                                             corners[:, 2] - corners[:, 0]), axis=1)
        share = np.bincount(faces.ravel(), np.repeat(area / 3.0, 3), minlength=len(nodes))
        seen = np.unique(faces)
        centres = nodes[seen][spread(nodes[seen], self.params.centres)]
        bumps = np.exp(-0.5 * (cdist(nodes[seen], centres) / self.params.width)**2)
        scaled = np.zeros((len(nodes), len(centres)))
        scaled[seen] = self.params.traction * share[seen, None] * bumps
        return np.einsum('nk,ij->nikj', scaled, np.eye(3)).reshape(3 * len(nodes), -1)

    def _response(self):
        """d x / d theta (n, 3, k) at the state of the linearisation."""
        dx = self._linearisation.respond(np.zeros_like(self.load), -self.load)
        return dx.reshape(*self.body.mesh.nodes.shape, -1)

    def step(self, points):
        """Return the Frame of a cloud (c, 3) [m].

        Raises InputError for an empty cloud or one that is not finite, NotConverged where the
        model finds no equilibrium; the state is then that before the frame.
        """
        points = np.ascontiguousarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise InputError(f'cloud of shape {points.shape}; must be (c, 3) with c at least 1')
        if not np.isfinite(points).all():
            raise InputError('cloud has numbers that are not finite; drop those points')
        theta, x, p = self._theta, self._x, self.params
        for k in range(p.iterations if self._begun else p.first):
            noise = p.noise if self._begun else max(p.noise, FAR * SHRINK**k)
            theta = self._updated(points, theta, x, noise)
            x = self._equilibrium(theta, x)
        self._begun = True
        self._theta, self._x = theta, x
        self._linearise()
        distance = _nearest(points, x, self._triangles)[0]
        return Frame(x, (self.load @ theta).reshape(-1, 3).sum(axis=0),
                     float(np.sqrt(np.mean(distance**2))))

    def _updated(self, points, theta, x, noise):
        """theta after one Gauss-Newton step, weights of noise and prior from where it is."""
        distance, normal, corners, shares = _nearest(points, x, self._triangles)
        H = np.einsum('ca,ci,caik->ck', shares, normal, self._jacobian[corners], optimize=True)
        dof, own = self.params.prior_dof, (theta.reshape(-1, 3)**2).sum(axis=1)
        prior = np.repeat((dof + own) / (dof + 3.0), 3) if self._begun or theta.any() else 1.0
        weights = student_weights((distance / noise)**2, self.params.dof, 1)
        S = (H * prior) @ H.T + np.diag(noise**2 / weights)
        return (H * prior).T @ np.linalg.solve(S, distance + H @ theta)

    def _equilibrium(self, theta, x):
        if self.params.law == 'linear':
            return self.body.mesh.nodes + self._at_rest @ theta
        fields = StepFields.of(self.body)
        fields.nodal_force += (self.load @ theta).reshape(-1, 3)
        found = self._solver.follow(x, self.body.mesh.nodes, fields)
        if not found.outcome.ok:
            raise NotConverged(f'hidden force: {found.outcome.advice}')
        return found.x

    def _linearise(self):
        """Take the derivative anew where the law asks for it and it is old."""
        self._age += 1
        if self.params.law == 'linear' or self._age % self.params.refresh:
            return
        self._linearisation.move_to(self._x)
        self._jacobian = self._response()


def _nearest(points, x, triangles):
    """Signed distance (c,) of points along the normal (c, 3) of the nearest triangle.

    Returns also its corners (c, 3) and the barycentric shares (c, 3) of the nearest place.
    """
    _, face, place = igl.point_mesh_squared_distance(points, x, triangles)[:3]
    corners = triangles[face]
    a, b, c = (x[corners[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    double = np.linalg.norm(normal, axis=1, keepdims=True)
    shares = np.stack([np.linalg.norm(np.cross(q - place, r - place), axis=1)
                       for q, r in ((b, c), (c, a), (a, b))], axis=1) / double
    normal = normal / double
    return np.einsum('ci,ci->c', normal, points - place), normal, corners, shares


def spread(points, count):
    """Return indices (k,), k <= count, of points (n, 3) far from each other: farthest point first.

    Begins with the first point. Gonzalez 1985, Theor Comput Sci 38:293.
    """
    chosen, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)
