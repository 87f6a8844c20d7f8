"""ADMM on linear tetrahedra: cost of an iteration, iterations and time to Newton's answer.

    NUMBA_NUM_THREADS=2 OMP_NUM_THREADS=1 python test/benchmark/admm_iterations.py [--json]

Every case is a push from rest. `to 0.1 mm` counts up to the first iterate within 0.1 mm of
the Newton solution at every node, `to tolerance` up to the default tolerance on the out-of-balance
force. Time per iteration is that of a whole solve, factorisations and looks at
the residual included, divided by its iterations; the least of REPEATS. Wall time means something
on an idle machine only.
"""

import argparse
import json
import time
from dataclasses import replace

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.tissue.admm import AdmmOptions, AdmmSolver
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.newton import StaticSolver

YOUNG = 6e3   # Pa
REPEATS = 5
NEAR = 1e-4   # m
# scene, pushes in mm along the pads' directions, Poisson's ratio
CASES = (('dome_small', (10,), 0.49), ('dome_small', (15,), 0.49), ('dome_small', (15,), 0.45),
         ('breast', (10, 0, 0, 0), 0.49), ('breast', (15, 0, 0, 0), 0.49),
         ('breast', (15, 0, 0, 0), 0.45), ('breast', (15, 15, 0, 0), 0.49),
         ('breast', (15, 15, 0, 0), 0.45),
         ('breast', (15, 0, 15, 0), 0.49), ('breast', (15, 0, 15, 0), 0.45),
         ('breast', (15, 15, 15, 15), 0.49), ('breast', (15, 15, 15, 15), 0.45),
         ('breast', (20, 0, 20, 0), 0.49), ('breast', (20, 0, 20, 0), 0.45),
         ('dome_small', (10,), 0.499), ('breast', (15, 0, 15, 0), 0.499))
SCHEMES = {'published': AdmmOptions(scheme='published', max_iterations=800),
           'accelerated': AdmmOptions()}


def body_of(scene, nu):
    """The scene's body of linear tetrahedra with one material."""
    loaded = load_scene(config_dir() / 'scenes' / f'{scene}.yaml')
    body = build_body(replace(loaded, element='linear'))
    mu, kappa = moduli(YOUNG, nu)
    return replace(body, mu=np.full_like(body.mu, mu), kappa=np.full_like(body.mu, kappa))


def first_near(result):
    """Iterations to the first accepted iterate within NEAR, None if there is none."""
    near = np.flatnonzero(result.errors < NEAR)
    return int(result.accepted[near[0]]) if len(near) else None


def least_times(solve, repeats):
    """Least CPU and wall time [ms] of a call."""
    times = []
    for _ in range(repeats):
        cpu, wall = time.process_time(), time.perf_counter()
        solve()
        times.append((time.process_time() - cpu, time.perf_counter() - wall))
    return 1e3 * np.min(times, axis=0)


def measured(scene, pushes, nu, scheme):
    """One row of the table as a dict."""
    body, options = body_of(scene, nu), SCHEMES[scheme]
    shift = 1e-3 * np.array([[push] for push in pushes]) * [p.direction for p in body.pads]
    rest = body.mesh.nodes
    newton = StaticSolver(body).solve(rest, shift)
    assert newton.outcome is Outcome.OK
    solver = AdmmSolver(body, options)
    result = solver.solve(rest, shift, reference=newton.x)
    near = first_near(result)
    repeats = 1 if scheme == 'published' else REPEATS
    cpu, wall = least_times(lambda: solver.solve(rest, shift), repeats)
    row = {'scene': scene, 'tets': len(body.mu), 'push_mm': pushes, 'nu': nu, 'scheme': scheme,
           'outcome': result.outcome.name, 'iterations': result.iterations,
           'iterations_to_0p1_mm': near, 'error_um': 1e6 * float(result.errors[-1]),
           'cpu_ms_per_iteration': cpu / result.iterations,
           'wall_ms_per_iteration': wall / result.iterations, 'cpu_ms': cpu, 'wall_ms': wall}
    if near is not None:
        short = AdmmSolver(body, replace(options, max_iterations=near))
        cpu, wall = least_times(lambda: short.solve(rest, shift), repeats)
        row |= {'cpu_ms_to_0p1_mm': cpu, 'wall_ms_to_0p1_mm': wall}
    return row


def line(row):
    """A row of the table."""
    def number(key, form):
        return format(row[key], form) if row.get(key) is not None else '-'
    return (f'{row["scene"]:10} {"+".join(map(str, row["push_mm"])):12} {row["nu"]:<6}'
            f'{row["scheme"]:12}{row["cpu_ms_per_iteration"]:7.2f}'
            f'{row["wall_ms_per_iteration"]:7.2f}{number("iterations_to_0p1_mm", "d"):>8}'
            f'{number("cpu_ms_to_0p1_mm", ".0f"):>7}{number("wall_ms_to_0p1_mm", ".0f"):>7}'
            f'{row["iterations"]:>8}{row["cpu_ms"]:7.0f}{row["wall_ms"]:7.0f}'
            f'{row["error_um"]:10.2g}  {row["outcome"]}')


def main():
    """Print the table, or one line of JSON per row."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--json', action='store_true', help='JSON lines instead of a table')
    parser.add_argument('--scheme', choices=sorted(SCHEMES), help='only this one')
    arguments = parser.parse_args()
    origin = {'commit': commit_of(share_dir()), 'machine': machine_description()}
    if not arguments.json:
        print(json.dumps(origin))
        print('                                           ms/iteration      to 0.1 mm         '
              '     to tolerance        error')
        print(f'{"scene":10} {"push mm":12} {"nu":6}{"scheme":12}{"CPU":>7}{"wall":>7}'
              f'{"iter":>8}{"CPU":>7}{"wall":>7}{"iter":>8}{"CPU":>7}{"wall":>7}{"um":>10}')
    for case in CASES:
        for scheme in (arguments.scheme,) if arguments.scheme else SCHEMES:
            row = measured(*case, scheme)
            print(json.dumps(row | origin) if arguments.json else line(row), flush=True)


if __name__ == '__main__':
    main()
