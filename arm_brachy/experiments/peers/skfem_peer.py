"""scikit-fem's forms with a plain Newton's method and PARDISO on the push."""

import pkgutil
from importlib.metadata import version

import numpy as np
from scipy.spatial import cKDTree
from skfem import (
    Basis,
    BilinearForm,
    ElementTetP1,
    ElementTetP2,
    ElementVector,
    LinearForm,
    MeshTet,
    condense,
)
from skfem.element import DiscreteField
from skfem.helpers import ddot, det, grad, identity, inv, mul, trace, transpose

from arm_brachy.experiments.peers.harness import main, newton_answer

SOLVER = 'pypardiso:spsolve'


def state(F, mu, kappa):
    """What `stress` and `power` need of F (3, 3, ...), evaluated once for all pairs of shapes.

    With s = mu J^(-2/3), the coefficients of (3.24): swap = s I1/3 - kappa J (J - 1) and
    outer = 2 s I1/9 + kappa J (2J - 1).
    """
    J, I1 = det(F), ddot(F, F)
    s = mu * J ** (-2 / 3)
    volumetric = kappa * J * (J - 1)
    return {'F': F, 'inv_F': inv(F), 's': s, 'swap': s * I1 / 3 - volumetric,
            'outer': 2 / 9 * s * I1 + kappa * J * (2 * J - 1)}


def stress(w):
    """First Piola-Kirchhoff stress (3, 3, ...) of (3.18) [Pa] at a `state`."""
    return w['s'] * w['F'] - w['swap'] * transpose(w['inv_F'])


def power(w, dF, eF):
    """Second derivative of (3.18) at a `state`, along dF and eF (3, 3, ...) [Pa]."""
    d, e = mul(w['inv_F'], dF), mul(w['inv_F'], eF)
    tr_d, tr_e = trace(d), trace(e)
    mixed = tr_d * ddot(w['F'], eF) + ddot(w['F'], dF) * tr_e
    return (w['s'] * (ddot(dF, eF) - 2 / 3 * mixed) + w['swap'] * trace(mul(d, e))
            + w['outer'] * tr_d * tr_e)


@LinearForm
def _internal(v, w):
    return ddot(w['P'], grad(v))


@BilinearForm
def _tangent(u, v, w):
    return power(w, grad(u), grad(v))


class _Body:
    """The discrete problem: a basis for each rule, dofs in the problem's numbering."""

    def __init__(self, problem):
        element = ElementTetP2() if problem.quadratic else ElementTetP1()
        mesh = MeshTet(*_corner_mesh(problem))
        self.parts = [(Basis(mesh, ElementVector(element), intorder=rule.degree),
                       (rule.mu, rule.kappa)) for rule in problem.rules]
        basis = self.parts[0][0]   # all number their dofs alike
        self.size = basis.N
        dofs = np.vstack([basis.nodal_dofs.T, basis.edge_dofs.T]
                         if problem.quadratic else [basis.nodal_dofs.T])
        at = basis.doflocs[:, dofs[:, 0]].T
        self.dofs = dofs[cKDTree(at).query(problem.nodes)[1]]   # (n, 3)

    def forces_and_tangent(self, u, *, tangent=True):
        """Nodal forces dPi/dx and the tangent (or None) at dof values u."""
        forces, tangents = 0.0, []
        for basis, moduli in self.parts:
            slope = grad(basis.interpolate(u))
            now = state(slope + identity(slope), *moduli)
            forces = forces + _internal.assemble(basis, P=DiscreteField(stress(now)))
            if tangent:
                fields = {name: DiscreteField(value) for name, value in now.items()}
                tangents.append(_tangent.assemble(basis, **fields))
        return forces, sum(tangents[1:], tangents[0]) if tangent else None


def _corner_mesh(problem):
    """Points and elements as MeshTet wants them, without the mid-edge nodes."""
    corners = problem.elements[:, :4]
    n = corners.max() + 1   # corners come first
    return np.ascontiguousarray(problem.nodes[:n].T), np.ascontiguousarray(corners.T)


def solve(problem, plan):
    """Return positions (n, 3) [m] and the pad's force (3,) [N] by Newton's method."""
    body, spsolve = _Body(problem), pkgutil.resolve_name(SOLVER)
    held = body.dofs[problem.held].ravel()
    u = np.zeros(body.size)
    forces, tangent = body.forces_and_tangent(u)
    for step in range(1, plan.load_steps + 1):
        way, count, finished = problem.way(step / plan.load_steps)[problem.held].ravel(), 0, False
        while not finished:
            if tangent is None:
                forces, tangent = body.forces_and_tangent(u)
            rest = np.zeros_like(u)
            rest[held] = way - u[held]
            du = spsolve_condensed(spsolve, tangent, -forces, rest, held)
            u, tangent, count = u + du, None, count + 1
            size = float(np.abs(du).max())
            finished = plan.finished(step, count, size, problem.nodes + u[body.dofs])
    forces, _ = body.forces_and_tangent(u, tangent=False)
    return problem.nodes + u[body.dofs], -forces[body.dofs[problem.pad]].sum(axis=0)


def spsolve_condensed(spsolve, matrix, right, prescribed, held):
    """Increment (N,) with its held entries prescribed, by skfem's own condensation."""
    A, b, x, free = condense(matrix, right, x=prescribed, D=held)
    x[free] = spsolve(A, b)
    return x


def answer(problem):
    """The Answer of scikit-fem to a Problem."""
    # an inverted element gives NaN, which the plan refuses as a correction without a size
    with np.errstate(invalid='ignore', divide='ignore', over='ignore'):
        return newton_answer(solve, problem, (ValueError,), version('scikit-fem'))


if __name__ == '__main__':
    main(answer)
