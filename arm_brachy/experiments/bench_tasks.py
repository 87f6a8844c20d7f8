"""What the controller asks of our solver again and again: a warm step, a Jacobian, ADMM."""

from contextlib import contextmanager
from dataclasses import replace

import numba
import numpy as np

from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.result import Target
from arm_brachy.experiments.peers.harness import timed
from arm_brachy.experiments.peers.own import STOP
from arm_brachy.tissue.admm import AdmmOptions, AdmmSolver
from arm_brachy.tissue.build import build_body, target_points
from arm_brachy.tissue.jacobian import directed_jacobian
from arm_brachy.tissue.mesh import embed
from arm_brachy.tissue.newton import StaticSolver

PUSH, STEP = 10e-3, 1e-3   # m
NEAR = 1e-4                # m: a tenth of a millimetre
MS, MICRO = 1e3, 1e6
# task -> (column, unit, limit) of its target; set for the thesis' linear elements, asked of both
GOALS = {'warm 1 mm step': ('cpu_ms', 'ms', 20.0), 'Jacobian, 4 pads': ('cpu_ms', 'ms', 10.0),
         'ADMM, one iteration': ('wall_ms', 'ms', 1.0), 'ADMM to 0.1 mm': ('wall_ms', 'ms', 100.0)}


def task_rows():
    """A row for each task and element; the dome is the small one."""
    rows = []
    for element in ('linear', 'quadratic'):
        dome, breast = _body('dome_small', element), _body('breast', element)
        with _threads(1):
            rows += [warm_step(dome, element), jacobian(breast, element)]
    return rows + admm(_body('dome_small', 'linear'))


def task_targets(rows):
    """A Target of every row."""
    goals = []
    for row in rows:
        column, unit, limit = GOALS[row['task']]
        clock = column.split('_')[0]
        goals.append(Target(f'{row["task"]}, {row["element"]}: {clock} time', row[column], unit,
                            f'<= {limit:g}', bool(row[column] <= limit)))
    return goals


def warm_step(body, element):
    """One more millimetre on a dome that stands in equilibrium under 10 mm."""
    solver, direction = StaticSolver(body, options=STOP), body.pads[0].direction
    x = solver.solve(body.mesh.nodes, [PUSH * direction]).x
    found, cpu, wall = _timed(lambda: solver.solve(x, [(PUSH + STEP) * direction]))
    return _row('warm 1 mm step', element, 'dome_small', cpu, wall, found.iterations)


def jacobian(body, element):
    """Derivative of the five targets with respect to the pads of the breast scene, at rest."""
    scene = load_scene(config_dir() / 'scenes' / 'breast.yaml')
    riders, solver = embed(body.mesh, target_points(scene)[1]), StaticSolver(body)
    _, cpu, wall = _timed(lambda: directed_jacobian(solver, body.mesh.nodes, riders))
    return _row(f'Jacobian, {len(body.pads)} pads', element, 'breast', cpu, wall, None)


def admm(body):
    """Rows of the thesis' solver: one iteration, and all of them until 0.1 mm is left."""
    rest, push = body.mesh.nodes, [PUSH * body.pads[0].direction]
    reference = StaticSolver(body).solve(rest, push).x
    solver, once = AdmmSolver(body), AdmmSolver(body, AdmmOptions(max_iterations=1))
    _, cpu_once, wall_once = _timed(lambda: once.solve(rest, push))
    found, cpu, wall = _timed(lambda: solver.solve(rest, push))
    seen = solver.solve(rest, push, reference=reference)
    # from then on no iterate is farther off; the solve is repeated with just so many iterations
    enough = int(seen.accepted[np.flatnonzero(seen.errors > NEAR)[-1] + 1])
    options = AdmmOptions(max_iterations=enough)
    near, near_cpu, near_wall = _timed(lambda: AdmmSolver(body, options).solve(rest, push))
    more = found.iterations - 1   # an iteration's cost without what is done once per solve
    return [_row('ADMM, one iteration', 'linear', 'dome_small', (cpu - cpu_once) / more,
                 (wall - wall_once) / more, found.iterations, _largest(found.x - reference)),
            _row('ADMM to 0.1 mm', 'linear', 'dome_small', near_cpu, near_wall, enough,
                 _largest(near.x - reference))]


def _timed(call):
    """As harness.timed, after a call that compiles."""
    call()
    return timed(call)


def _largest(difference):
    return float(np.linalg.norm(difference, axis=1).max())


def _row(task, element, scene, cpu, wall, iterations, error=None):
    return {'task': task, 'element': element, 'scene': scene, 'cpu_ms': MS * cpu,
            'wall_ms': MS * wall, 'iterations': iterations,
            'error_um': None if error is None else MICRO * error,
            'threads': numba.get_num_threads()}


def _body(scene, element):
    scene = load_scene(config_dir() / 'scenes' / f'{scene}.yaml')
    return build_body(replace(scene, element=element))


@contextmanager
def _threads(number):
    before = numba.get_num_threads()
    numba.set_num_threads(number)
    try:
        yield
    finally:
        numba.set_num_threads(before)
