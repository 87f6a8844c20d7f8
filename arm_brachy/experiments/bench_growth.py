"""How the cost of a push grows from 1 k to 200 k tetrahedra: time, memory, one thread and two.

The family is a block of the dome's size cut into equal cells of six tetrahedra each, its base
fixed, a square of its upper face pushed. Each size is solved in a process of its own.
"""

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.experiments.bench_figures import growth_lines
from arm_brachy.experiments.peers.problem import Problem
from arm_brachy.experiments.peers.registry import OWN, ask
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import quadratic_mesh, with_midside

NAME = 'bench-growth'
SEED = 0  # nothing here is random; the form of a result has a seed
BLOCK = (0.12, 0.12, 0.06)   # m
PAD = (0.03, 0.09)           # m, the pushed square along x and along y
PUSH = 5e-3                  # m, a twelfth of the height
E, NU = 6e3, 0.49            # Pa and ratio of the dome scenes
# Cells along the height, twice as many along the sides: 24 n^3 tetrahedra. Even, so that the edge
# of the pushed square lies between cells. The caps are of patience: the next quadratic size, 98 k
# tetrahedra, has 407 k unknowns and would take some ten minutes of CPU time for each solve.
CELLS = {'linear': (4, 6, 8, 12, 16, 20), 'quadratic': (4, 6, 8, 12)}
MIB = 2.0 ** 20


def bench(out_dir, cells=None):
    """Solve the family with both elements, on one thread and on two.

    out_dir : folder; receives bench-growth.png;  cells : element -> numbers, default CELLS
    Returns Result, a row for each solve. Raises NotConverged.
    """
    rows, threads = [], sorted({1, min(2, len(os.sched_getaffinity(0)))})
    with TemporaryDirectory() as folder:
        for element, numbers in (cells or CELLS).items():
            for n in numbers:
                problem = block(n, quadratic=element == 'quadratic')
                rows += [_row(problem, element, k, Path(folder)) for k in threads]
    growth_lines(rows).save(Path(out_dir) / f'{NAME}.png')
    return Result(NAME, SEED, commit_of(share_dir()), machine_description(), tuple(rows))


def block(n, *, quadratic):
    """The Problem of the block with n cells along its height: 24 n^3 tetrahedra."""
    mesh = box_mesh(BLOCK, (2 * n, 2 * n, n))
    x, y, _ = mesh.nodes.T
    top = mesh.node_sets['z1']
    under = (np.minimum(x, y) >= PAD[0] - 1e-9) & (np.maximum(x, y) <= PAD[1] + 1e-9)
    pad, fixed = top[under[top]], mesh.node_sets['z0']
    if quadratic:
        mesh = quadratic_mesh(mesh)
        pad, fixed = with_midside(mesh, pad), with_midside(mesh, fixed)
    return Problem(mesh.nodes, mesh.connectivity, fixed, pad, np.array([0.0, 0.0, -PUSH]), E, NU)


def _row(problem, element, threads, folder):
    answer = ask(OWN, problem, threads, folder)
    if isinstance(answer, str):
        raise NotConverged(f'block of {len(problem.elements)} {element} tetrahedra: {answer}')
    print(f'{NAME}: {len(problem.elements)} {element} tetrahedra, {threads} thread(s), '
          f'{answer.cpu:.2f} s', file=sys.stderr)
    return {'mesh': 'block', 'element': element, 'threads': threads,
            'tets': len(problem.elements),
            'unknowns': 3 * (len(problem.nodes) - len(problem.held)), 'cpu_s': answer.cpu,
            'wall_s': answer.wall, 'iterations': answer.iterations,
            'load_steps': answer.load_steps, 'peak_memory_MiB': answer.memory / MIB}
