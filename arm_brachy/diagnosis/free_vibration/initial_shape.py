"""How a hand bends a body that it holds: shapes besides the stress-free one to be let go from.

A hand lifts a tip and the middle sags, or holds it some millimetres too high. What it can do with
a force it does in the shapes that resist least, which are those of the lowest vibrations about the
stress-free shape; a force that moves the first by some length moves others by less.
Test: diagnosis/test_free_hold.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from arm_brachy.diagnosis.model.specimen import attach
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.modes import modes_of
from arm_brachy.tissue.newton import StaticSolver

SHAPES = 8      # two bends each way, a twist, and as many again that are hardly ever needed
SEEN = 0.1          # of the largest motion of a node, that a point has to show
FARTHEST = 100.0    # times its usual error: a marker there is no marker of the scene


@dataclass(frozen=True)
class Hold:
    """One shape, 1 standard deviation of it: nodes (n, 3), points (k, 3) [m], 0 off the tissue."""

    nodes: np.ndarray
    points: np.ndarray


def hold_shapes(specimen, size):
    """Return the Holds of a specimen.Specimen, slowest first.

    Shapes that the points hardly show, as a twist those on its axis, are left out.
    size : standard deviation of the first over the length of the body, from what holds it to the
        point farthest away that is seen. The j-th has that of the first by their frequencies.
    Raises NotConverged where the stress-free shape is not stable.
    """
    body = specimen.body
    nodes = body.mesh.nodes
    solver = StaticSolver(body)
    modes = modes_of(solver, nodes, StepFields.of(body), SHAPES)
    attached = attach(specimen, body)
    matrix, length = attached.matrix(len(nodes)), _length(specimen, attached.inside)
    out = []
    for square, shape in zip(modes.square, modes.shapes.T, strict=True):
        full = np.zeros(nodes.size)
        full[modes.dofs] = shape
        full = full.reshape(-1, 3)
        points = matrix @ full
        largest = np.linalg.norm(points, axis=1).max()
        if largest > SEEN * np.linalg.norm(full, axis=1).max():
            sd = size * length * np.sqrt(modes.square[0] / square) / largest
            out.append(Hold(sd * full, sd * points))
    return tuple(out)


@dataclass(frozen=True)
class Held:
    """How a body was held, as far as where it was seen tells.

    bent : Hold, the likeliest;  doubt : (m, k, 3) [m] at the points, 1 standard deviation each
    placement : [m] per axis by which markers are off their places
    """

    bent: Hold
    doubt: np.ndarray
    placement: float


def seen_held(release, specimen, priors, usual):
    """Return the Held of a release.

    release : release.Release of a body of the Specimen;  priors : observation.FreePriors
    usual : [m] standard deviation of places at least. Both are the likeliest, with frame and
        places, all errors being normal.
    """
    index = [(*specimen.markers, *specimen.tools).index(name) for name in release.names]
    off = np.vstack([release.held, release.base_held])
    points = np.vstack([specimen.rest[index], release.base_rest])
    arms = points - (release.base_rest if len(release.base_rest) else points).mean(axis=0)
    own = np.zeros((len(release.base_rest), 3))
    holds = hold_shapes(specimen, priors.hold)
    ways = [np.vstack([hold.points[index], own]) for hold in holds]
    ways += [np.broadcast_to(priors.frame * axis, points.shape) for axis in np.eye(3)]
    ways += [np.cross(priors.turn * axis, arms) for axis in np.eye(3)]
    A = np.column_stack([way.ravel() for way in ways])
    w, V = np.linalg.eigh(A @ A.T)
    along = (V.T @ off.ravel()) ** 2

    def unlikely(log_sd):
        variance = np.maximum(w, 0.0) + np.exp(2.0 * log_sd)
        return float(np.sum(along / variance + np.log(variance)))

    found = minimize_scalar(unlikely, bounds=np.log([usual, FARTHEST * usual]), method='bounded')
    sd = float(np.exp(found.x))
    told = A.T @ np.linalg.inv(A @ A.T + sd ** 2 * np.eye(len(A)))
    share, count = told @ off.ravel(), len(holds)
    left = np.linalg.cholesky((np.eye(A.shape[1]) - told @ A)[:count, :count])
    nodes, points = (np.array([getattr(hold, name) for hold in holds])
                     for name in ('nodes', 'points'))
    bent = Hold(*(np.tensordot(share[:count], part, 1) for part in (nodes, points)))
    return Held(bent, np.tensordot(left.T, points, 1), sd)


def _length(specimen, inside):
    """[m] from the nodes that are held to the point on the tissue that is farthest from them."""
    fixed = specimen.body.mesh.nodes[specimen.body.fixed]
    apart = np.linalg.norm(specimen.rest[inside][:, None] - fixed[None], axis=2)
    return float(apart.min(axis=1).max())
