"""CPU time of Jacobians and parameter sensitivities on the breast scene, beside a full solve.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python test/benchmark/sensitivities.py

Prints one line of JSON per element: CPU milliseconds, least of REPEATS, with machine and commit.
"""

import dataclasses
import json
import time

import numpy as np

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.tissue.build import build_body, target_points
from arm_brachy.tissue.jacobian import Linearisation, directed_jacobian
from arm_brachy.tissue.mesh import embed
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.sensitivity import gradient, log_modulus, respond

PUSH = 5e-3  # m, every pad
PARAMETERS = 10
REPEATS = 15


def cpu_ms(task):
    """Least CPU time [ms] of a call."""
    task()  # compiles, and brings the data into the cache
    spent = []
    for _ in range(REPEATS):
        start = time.process_time()
        task()
        spent.append(time.process_time() - start)
    return round(1e3 * min(spent), 2)


def row(element):
    """The figures of one element, as a dict."""
    scene = dataclasses.replace(load_scene(config_dir() / 'scenes' / 'breast.yaml'),
                                element=element)
    body = build_body(scene)
    solver, embedding = StaticSolver(body), embed(body.mesh, target_points(scene)[1])
    push = PUSH * np.array([pad.direction for pad in body.pads])
    x = solver.solve(body.mesh.nodes, push).x
    lin = Linearisation(solver, x)
    changes = [log_modulus(lin.fields, part)
               for part in np.array_split(np.arange(len(body.mu)), PARAMETERS)]
    x_bar = embedding.matrix(len(x)).T @ np.ones((len(embedding.nodes), 3))
    return {
        'element': element, 'tets': len(body.mu), 'dofs': len(solver.free.dofs),
        'solve_5_mm_from_rest_ms': cpu_ms(lambda: solver.solve(body.mesh.nodes, push)),
        'solve_1_mm_more_ms': cpu_ms(lambda: solver.solve(x, 1.2 * push)),
        'analysis_once_ms': cpu_ms(solver.free.solver),
        'tangent_ms': cpu_ms(lambda: solver.assembler.tangent(x)),
        'tangent_and_factor_ms': cpu_ms(lambda: lin.move_to(x)),
        'jacobian_4_actuators_in_all_ms': cpu_ms(lambda: directed_jacobian(solver, x, embedding)),
        'jacobian_given_factor_ms': cpu_ms(lambda: lin.directed_jacobian(embedding)),
        'pad_stiffness_given_factor_ms': cpu_ms(lin.pad_stiffness),
        '10_parameters_given_factor_ms': cpu_ms(lambda: respond(lin, changes)),
        'gradient_all_elements_given_factor_ms': cpu_ms(lambda: gradient(lin, x_bar)),
    }


def main():
    """Print the table."""
    for element in ('linear', 'quadratic'):
        print(json.dumps(row(element) | {'commit': commit_of(share_dir()),
                                         'machine': machine_description()}))


if __name__ == '__main__':
    main()
