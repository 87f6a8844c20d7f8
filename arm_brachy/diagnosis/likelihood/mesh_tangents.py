"""What a push of each pad does in a mesh, to second order: its tangent at rest and its curvature.

Second-order perturbation of an equilibrium f(x) = 0 along pads pushed by d (Koiter's expansion):
x = x0 + x1 d + x2 d^2 / 2 with K x2 = -D^2 f [x1, x1], K the tangent that has a factor already.
Test: diagnosis/forward/test_mesh_errors.py
"""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.model.specimen import attach
from arm_brachy.tissue.jacobian import Equations, Linearisation, pad_translations
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.resting import rest

AT_REST = 1e-7      # m that nodes may be off: no load acts but the pushes
STEP = 1e-4         # m of push for the central difference


def pushes(body, specimen):
    """Return (tangent [1/m], curvature [1/m^2]), (k + e + p, 3, p) each, by the push of each pad.

    body : SoftBody;  specimen : Specimen of the points, its mesh that of the body before terms
    Of markers and EM targets [m], then forces on the pads [N]: first and second derivative, each
    pad pushed alone. What rides on a pad, which no mesh changes, is left out. Raises NotConverged
    where there is no stable state at rest.
    """
    linear = _at_rest(body)
    push = np.stack([pad.direction for pad in body.pads])
    motion = np.einsum('dpi,pi->dp', pad_translations(body).reshape(-1, *push.shape), push)
    first = linear.respond(motion)
    rate = _second_forces(linear, first)
    second = linear.respond(np.zeros_like(motion), rate)
    points = attach(specimen, body).matrix(len(body.mesh.nodes))
    return (_observed(points, first, linear.pad_force_change(first)),
            _observed(points, second, linear.pad_force_change(second, rate)))


def _at_rest(body):
    linear = Linearisation(Equations.of(body), body.mesh.nodes, single=True)
    if linear.outstanding() <= AT_REST:
        return linear
    found = rest(StaticSolver(body), body.mesh.nodes, np.zeros((len(body.pads), 3)))
    if not found.outcome.ok:
        raise NotConverged('a companion of the mesh has no state at rest '
                           f'({found.outcome.advice})')
    linear.move_to(found.x)
    return linear


def _second_forces(linear, first):
    """D^2 f [x1, x1] (3n, p) [N/m^2] for displacements x1 (3n, p) per push."""
    forces = linear.solver.assembler.forces
    here, out = forces(linear.x).ravel(), np.empty_like(first)
    for p, column in enumerate(first.T):
        step = STEP * column.reshape(linear.x.shape)
        out[:, p] = (forces(linear.x + step) + forces(linear.x - step)).ravel() - 2.0 * here
    return out / STEP**2


def _observed(points, dx, forces):
    """Changes (k + e + p, 3, p) of points, by their matrix from nodes, and of pad forces."""
    moved = np.stack([points @ column.reshape(-1, 3) for column in dx.T], axis=2)
    return np.concatenate([moved, forces])
