"""One push by every solver a user might choose: same mesh, energy, held nodes, tolerance and run.

The body is the comparison dome, its apex pad pushed 10 mm from rest. CPU seconds cover the whole
solve, analysis and factorisations included; loading the mesh, compiling and starting a process are
not counted. A peer's number of load steps and corrections is found beforehand, untimed, so that it
does no work beyond what the tolerance needs (peers.harness).
"""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments.bench_figures import solver_times
from arm_brachy.experiments.bench_tasks import task_rows, task_targets
from arm_brachy.experiments.peers.harness import TOLERANCE
from arm_brachy.experiments.peers.own import solve
from arm_brachy.experiments.peers.problem import Problem
from arm_brachy.experiments.peers.registry import FELUPE, MUJOCO, OWN, SKFEM, ask
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import quadratic_mesh, with_midside

NAME = 'bench-solvers'
SEED = 0  # nothing here is random; the form of a result has a seed
# Not large and quadratic: 80 k unknowns take the peers tens of minutes and gigabytes.
CASES = (('small', 'linear'), ('small', 'quadratic'), ('large', 'linear'))
PUSH = 10e-3          # m
FAR = 20e-3           # m from the pad's nodes, at rest: where targets lie
LARGEST_SHARE = {'small': 1 / 5, 'large': 1 / 4}   # of FElupe's CPU time
MIB = 2.0 ** 20
MICRO = 1e6


def bench(out_dir, cases=CASES, *, judge=True, tasks=True):
    """Run every solver on every mesh and element, then our own warm step, Jacobian and ADMM.

    out_dir : folder; receives bench-solvers.png;  cases : (size of the dome, element) each
    judge : False leaves out the comparison with quadratic elements, whose reference is the dearest
        solve of all;  tasks : False leaves out what only we are measured on
    Returns Result. A peer that is not installed, or fails, has a row that says so. Raises
    NotConverged if our own solver fails.
    """
    rows = []
    sizes = dict.fromkeys(size for size, _ in cases)
    truth = {size: reference(size) if judge else None for size in sizes}
    for size, element in cases:
        with TemporaryDirectory() as folder:
            rows += _compare(problem_of(size, element), size, element, truth[size], Path(folder))
    solver_times(rows).save(Path(out_dir) / f'{NAME}.png')
    own = task_rows() if tasks else []
    return Result(NAME, SEED, commit_of(share_dir()), machine_description(), (*rows, *own),
                  (*_targets(rows, cases), *task_targets(own)))


def problem_of(size, element):
    """The Problem of a dome scene: `size` small or large, `element` linear or quadratic."""
    scene = load_scene(config_dir() / 'scenes' / f'dome_{size}.yaml')
    body = build_body(replace(scene, element=element))
    pad = body.pads[0]
    return Problem(body.mesh.nodes, body.mesh.connectivity, body.fixed, pad.nodes,
                   PUSH * pad.direction, scene.material.E, scene.material.nu)


def reference(size):
    """(corner positions (n, 3) [m], pad force (3,) [N]) by quadratic elements, finer than both.

    The small mesh is cut into eight first. The large one is not, which would take gigabytes: its
    elements are as small as those of the small one so refined.
    """
    problem = problem_of(size, 'quadratic')
    n = 1 + problem.elements[:, :4].max()
    found = solve(refined(problem) if size == 'small' else problem)
    return found.x[:n], found.pad_force[0]


def refined(problem):
    """The quadratic Problem with every tetrahedron cut into eight; all nodes keep their numbers.

    What was held stays held: the same faces, now with the middles of their new edges.
    """
    e = problem.elements.T
    corners = [(0, 4, 5, 6), (4, 1, 7, 8), (5, 7, 2, 9), (6, 8, 9, 3)]
    # the octahedron between the middles, cut along the diagonal 02-13
    inner = [(5, 8, 4, 6), (5, 8, 6, 9), (5, 8, 9, 7), (5, 8, 7, 4)]
    tets = np.concatenate([e[list(nodes)].T for nodes in corners + inner])
    flip = np.linalg.det(problem.nodes[tets[:, 1:]] - problem.nodes[tets[:, :1]]) < 0.0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    mesh = quadratic_mesh(TetMesh(problem.nodes, tets))
    return replace(problem, nodes=mesh.nodes, elements=mesh.connectivity,
                   fixed=with_midside(mesh, problem.fixed), pad=with_midside(mesh, problem.pad))


def _compare(problem, size, element, truth, folder):
    """Rows of every solver on one problem; ours first, as the others are measured against it."""
    rows, ours = [], None
    for peer in (OWN, FELUPE, SKFEM, MUJOCO):
        if element not in peer.elements:
            continue
        for threads in peer.threads():
            answer = ask(peer, problem, threads, folder)
            if peer is OWN and isinstance(answer, str):
                raise NotConverged(f'{size} dome, {element} elements: {answer}')
            ours = answer if ours is None else ours
            head = {'solver': peer.label, 'mesh': size, 'element': element, 'threads': threads}
            rows.append(head | _figures(answer, ours, truth, problem))
            _tell(rows[-1])
            if isinstance(answer, str):
                break
    return rows


def _tell(row):
    said = row['remark'] if row['cpu_s'] is None else f'{row["cpu_s"]:.3g} s'
    print(f'{NAME}: {row["solver"]}, {row["mesh"]}, {row["element"]}, {row["threads"]} thread(s): '
          f'{said}', file=sys.stderr)


def _figures(answer, ours, truth, problem):
    """The row's numbers, or why there are none."""
    names = ('cpu_s', 'wall_s', 'iterations', 'load_steps', 'error_um', 'from_ours_um',
             'peak_memory_MiB', 'quadratic_max_mm', 'quadratic_far_mm', 'reaction_N',
             'reaction_error_percent')
    if isinstance(answer, str):
        return dict.fromkeys(names) | {'remark': answer}
    largest, far, percent = (None,) * 3 if truth is None else _against(answer, truth, problem)
    values = (answer.cpu, answer.wall, answer.iterations, answer.load_steps,
              MICRO * _largest(answer.x - answer.tight),
              MICRO * _largest(answer.tight - ours.tight), answer.memory / MIB,
              largest, far, float(np.linalg.norm(answer.pad_force)), percent)
    return dict(zip(names, values, strict=True)) | {'remark': answer.version}


def _against(answer, truth, problem):
    """Difference from the truth: largest, and beyond FAR of the pad [mm]; of its force [%]."""
    x, force = truth
    n = len(x)
    off = np.linalg.norm(answer.tight[:n] - x, axis=1)
    to_pad = problem.nodes[:n, None] - problem.nodes[problem.pad]
    away = np.linalg.norm(to_pad, axis=2).min(axis=1) > FAR
    size = np.linalg.norm(force)
    return (style.MM * off.max(), style.MM * off[away].max(),
            100.0 * (np.linalg.norm(answer.pad_force) / size - 1.0))


def _largest(difference):
    return float(np.linalg.norm(difference, axis=1).max())


def _targets(rows, cases):
    goals = []
    for size, element in cases:
        here = [r for r in rows if (r['mesh'], r['element']) == (size, element)]
        goals.append(_faster(here, size, element))
        goals += [_agree(here, peer, size, element) for peer in (FELUPE, SKFEM)]
        ours = next(r for r in here if r['solver'] == OWN.label)
        goals.append(_at_most(f'ours, {size}, {element}: error of the timed solve',
                              ours['error_um'], 'um', MICRO * TOLERANCE))
    return goals


def _faster(rows, size, element):
    """CPU time over FElupe's, each at the number of threads that suits it best."""
    least = {peer: min((r['cpu_s'] for r in rows if r['solver'] == peer.label
                        and r['cpu_s'] is not None), default=np.nan) for peer in (OWN, FELUPE)}
    return _at_most(f'CPU time over FElupe + PARDISO, {size}, {element}',
                    least[OWN] / least[FELUPE], '1', LARGEST_SHARE[size])


def _agree(rows, peer, size, element):
    found = [r['from_ours_um'] for r in rows
             if r['solver'] == peer.label and r['from_ours_um'] is not None]
    return _at_most(f'nodes against {peer.label}, {size}, {element}',
                    max(found, default=np.nan), 'um', MICRO * TOLERANCE)


def _at_most(name, value, unit, limit):
    """A Target with an upper limit; what was not measured cannot be judged."""
    met = None if np.isnan(value) else bool(value <= limit)
    return Target(name, float(value), unit, f'<= {limit:g}', met)
