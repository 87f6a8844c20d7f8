"""FElupe's Newton with PARDISO on the push. FElupe is GPL-3.0 and runs in this process alone."""

import os
import pkgutil

import felupe
import numpy as np

from arm_brachy.experiments.peers.harness import main, newton_answer

SOLVER = 'pypardiso:spsolve'   # the one FElupe's documentation recommends for speed
# FElupe has VTK's order of mid-edge nodes: 01, 12, 02, 03, 13, 23.
VTK = [0, 1, 2, 3, 4, 7, 5, 6, 8, 9]


def material(mu, kappa, parallel=False):
    """FElupe's own Neo-Hookean law, which is (3.18): isochoric mu/2 and kappa/2 (J - 1)^2.

    Where mu is 0 FElupe is told so, and spared the isochoric part.
    """
    return felupe.NeoHooke(mu=mu or None, bulk=kappa, parallel=parallel)


def solve(problem, plan):
    """Return positions (n, 3) [m] and the pad's force (3,) [N] by `felupe.newtonraphson`."""
    parallel = int(os.environ.get('OMP_NUM_THREADS', '1')) > 1
    bodies = [felupe.SolidBody(material(rule.mu, rule.kappa, parallel),
                               _field(problem, rule.degree)) for rule in problem.rules]
    field = bodies[0].field   # newtonraphson gives its values to the other's
    dof0 = (3 * problem.held[:, None] + np.arange(3)).ravel()
    dof1 = np.setdiff1d(np.arange(problem.nodes.size), dof0)
    for step in range(1, plan.load_steps + 1):
        way = problem.way(step / plan.load_steps)[problem.held].ravel()
        found = felupe.newtonraphson(
            x0=field, items=bodies, dof0=dof0, dof1=dof1, ext0=way,
            solver=pkgutil.resolve_name(SOLVER), check=_check(problem, plan, step), verbose=0,
            kwargs={'parallel': parallel})
        field = found.x
    force = found.fun.reshape(-1, 3)[problem.pad].sum(axis=0)
    return problem.nodes + field[0].values, -force


def _field(problem, degree):
    """Displacements with a quadrature of this degree."""
    quadrature = felupe.TetrahedronQuadrature(order=degree)
    if problem.quadratic:
        mesh = felupe.Mesh(problem.nodes, problem.elements[:, VTK], 'tetra10')
        region = felupe.RegionQuadraticTetra(mesh, quadrature=quadrature)
    else:
        mesh = felupe.Mesh(problem.nodes, problem.elements, 'tetra')
        region = felupe.RegionTetra(mesh, quadrature=quadrature)
    return felupe.FieldContainer([felupe.Field(region, dim=3)])


def _check(problem, plan, step):
    """The plan's decision in the form newtonraphson asks for it, once after each correction."""
    count = 0

    def check(dx, x, f, xtol, ftol, dof1, dof0, items):
        nonlocal count
        count += 1
        size = float(np.abs(dx).max())
        return size, size, plan.finished(step, count, size, problem.nodes + x[0].values)
    return check


def answer(problem):
    """The Answer of FElupe to a Problem."""
    # an inverted element gives NaN, which newtonraphson refuses with a ValueError
    with np.errstate(invalid='ignore', divide='ignore', over='ignore'):
        return newton_answer(solve, problem, (ValueError,), felupe.__version__)


if __name__ == '__main__':
    main(answer)
