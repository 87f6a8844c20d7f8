"""How targets and pad forces answer to small pad motions (3.19)-(3.24), at an equilibrium."""

import numpy as np


def state_sensitivity(solver, x, fields=None):
    """Return d x / d pad displacement, (n, 3, p, 3), at an equilibrium.

    solver : newton.StaticSolver;  x : (n, 3) [m] an equilibrium of its body
    fields : StepFields the equilibrium was found with, None = the body's own
    A pad translates as a rigid disc. Its nodes' displacements are prescribed, so the tangent
    splits into free (f) and held (c) rows and dx_f = -K_ff^-1 K_fc E d, with E the rigid
    translation of each pad. The force form (3.22) with every pad node a control point gives the
    same: J_c' K^-1 J_c is the inverse of the Schur complement of K on the control points.
    Raises NotConverged where K_ff is not positive definite (x is no stable equilibrium).
    """
    motion = pad_translations(solver.body)
    return _response(solver, x, fields, motion)[1].reshape(
        solver.assembler.n, 3, len(solver.body.pads), 3)


def _response(solver, x, fields, motion):
    """The tangent K, and the motion (3n, 3p) of all degrees of freedom that follows `motion`."""
    K, factor = solver.linearise(x, fields)
    response = motion.copy()
    response[solver.free.dofs] = -factor.solve((K @ motion)[solver.free.dofs])
    return K, response


def pad_translations(body):
    """Return E (3n, 3p): displacement of every degree of freedom per unit pad translation.

    body : SoftBody
    """
    motion = np.zeros((len(body.mesh.nodes), 3, len(body.pads), 3))
    for p, pad in enumerate(body.pads):
        motion[pad.nodes, :, p, :] = np.eye(3)
    return motion.reshape(3 * len(body.mesh.nodes), 3 * len(body.pads))


def target_jacobian(solver, x, embedding, fields=None):
    """Return d target position / d pad displacement, (k, 3, p, 3) [m/m], (3.23).

    solver, x, fields : as in `state_sensitivity`;  embedding : mesh.Embedding of the k targets
    """
    sensitivity = state_sensitivity(solver, x, fields)
    return np.einsum('ka,kaipj->kipj', embedding.weights, sensitivity[embedding.nodes])


def directed_jacobian(solver, x, embedding, fields=None):
    """Return d target position / d push of each pad along its direction, (k, 3, p) [m/m].

    solver, x, embedding, fields : as in `target_jacobian`
    """
    directions = np.array([pad.direction for pad in solver.body.pads]).reshape(-1, 3)
    return np.einsum('kipj,pj->kip', target_jacobian(solver, x, embedding, fields), directions)


def pad_stiffness(solver, x, fields=None):
    """Return d pad force / d pad displacement, (p, 3, p, 3) [N/m].

    solver, x, fields : as in `state_sensitivity`
    Pad force is that of the tissue ON the pad (as in StaticSolution), so the matrix is
    symmetric negative definite: pushing a pad in raises the force that opposes it.
    """
    p = len(solver.body.pads)
    motion = pad_translations(solver.body)
    K, response = _response(solver, x, fields, motion)
    return -(motion.T @ (K @ response)).reshape(p, 3, p, 3)
