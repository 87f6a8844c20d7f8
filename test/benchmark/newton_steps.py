"""CPU time of one quasi-static step on the breast scene: `follow` against `solve_held`.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python test/benchmark/newton_steps.py

Prints one line of JSON per step size, with machine and commit.
"""

import json
import time

import numpy as np

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.newton import StaticSolver

STEPS_MM = (0.05, 0.1, 0.3, 1.0)
COUNT = 25


def timed(body, step):
    """Median CPU ms of `follow` and of `solve_held` along one push in steps of `step` [m]."""
    directions = np.array([p.direction for p in body.pads])
    spent = {}
    for name in ('follow', 'solve_held'):
        solver = StaticSolver(body)
        before = x = solver.solve(body.mesh.nodes, np.zeros_like(directions)).x
        times = []
        for k in range(1, COUNT + 1):
            held_at = solver.held_positions(k * step * np.array([[1], [0], [0], [0.5]])
                                            * directions)
            start = time.process_time()
            found = getattr(solver, name)(2 * x - before, held_at)
            times.append(time.process_time() - start)
            before, x = x, found.x
        spent[name] = float(np.median(times[3:])) * 1e3
    return spent


def main():
    """Print the table."""
    body = build_body(load_scene(config_dir() / 'scenes' / 'breast.yaml'))
    timed(body, 1e-4)  # compiles
    for step_mm in STEPS_MM:
        spent = timed(body, step_mm * 1e-3)
        print(json.dumps({'step_mm': step_mm, 'tets': len(body.mu),
                          'follow_ms': round(spent['follow'], 2),
                          'solve_held_ms': round(spent['solve_held'], 2),
                          'commit': commit_of(share_dir()), 'machine': machine_description()}))


if __name__ == '__main__':
    main()
