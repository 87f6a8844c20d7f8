"""arm_brachy's own Newton solver on the push, run and timed as the peers are."""

import numpy as np

from arm_brachy import __version__
from arm_brachy.core.errors import NotConverged
from arm_brachy.experiments.peers.harness import TOLERANCE, main, peak_memory, timed
from arm_brachy.experiments.peers.problem import Answer, Problem
from arm_brachy.tissue.body import Pad, SoftBody, TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

# The solver's tolerance is for the components of a correction, the comparison's for distances;
# half, because corrections by an older tangent leave the rest of a geometric series.
STOP = NewtonOptions(tolerance=0.5 * TOLERANCE / np.sqrt(3.0))


def body_of(problem):
    """The SoftBody of a Problem."""
    midside = problem.elements[:, 4:] if problem.quadratic else None
    mesh = TetMesh(problem.nodes, problem.elements[:, :4], {}, midside)
    m, direction = len(problem.elements), problem.push / np.linalg.norm(problem.push)
    pad = Pad('pad', problem.pad, direction, problem.nodes[problem.pad].mean(axis=0),
              float(np.linalg.norm(problem.push)))
    return SoftBody(mesh=mesh, mu=np.full(m, problem.mu), kappa=np.full(m, problem.kappa),
                    density=np.full(m, 1000.0), fixed=problem.fixed, pads=(pad,))


def solve(problem, options=None, x0=None):
    """Return the StaticSolution of a Problem: analysis, factorisations, everything.

    x0 : (n, 3) [m] to start from, None = rest.  Raises NotConverged.
    """
    solver = StaticSolver(body_of(problem), options=options)
    found = solver.solve(problem.nodes if x0 is None else x0, problem.push[None])
    if not found.outcome.ok:
        raise NotConverged(found.outcome.advice)
    return found


def warm_up(*, quadratic):
    """Compile, or load, everything on a cube of 48 tetrahedra."""
    cube = box_mesh((1.0, 1.0, 1.0), (2, 2, 2))
    cube = quadratic_mesh(cube) if quadratic else cube
    solve(Problem(cube.nodes, cube.connectivity, cube.node_sets['z0'], cube.node_sets['z1'],
                  np.array([0.0, 0.0, -0.01]), 6e3, 0.49))


def answer(problem):
    """The Answer of arm_brachy to a Problem."""
    warm_up(quadratic=problem.quadratic)
    found, cpu, wall = timed(lambda: solve(problem, STOP))
    memory = peak_memory()
    tight = solve(problem, x0=found.x)
    return Answer(found.x, tight.x, tight.pad_force[0], cpu, wall, found.iterations,
                  found.load_steps, memory, __version__)


if __name__ == '__main__':
    main(answer)
