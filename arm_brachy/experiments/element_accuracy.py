"""Which element, on which mesh, is accurate enough for its cost: a bonded disc pushed 10 mm.

Two bodies, nu = 0.49: the dome with a disc on its apex and the breast with four discs, one of them
pushed. Each is solved with four elements on meshes of the thesis' size and beyond, and compared
with a reference: locking-free elements on the same body, refined towards the discs' rims until
the mesh no longer matters (two sizes and Richardson's extrapolation; the last step is a row of its
own). Errors of displacement are taken more than 2 cm from every pad, as distances.
The elements: `element_candidates`.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from arm_brachy.core.errors import NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.evaluation.style import GOAL, MM, Plate, colour, new_figure, styled
from arm_brachy.experiments.element_candidates import (
    ELEMENTS,
    IN_FULL,
    LINEAR,
    QUADRATIC,
    SMOOTHED,
    with_element,
)
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.build import build_body, target_points
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.mesh import embed, interpolate, load_mesh, quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.refinement import grade, near_rims
from arm_brachy.tissue.surface import read_surface

NAME = 'element-accuracy'
PUSH = 0.010
FAR = 0.020          # m from every pad: where an element is answerable for what it says
FAR_ERROR, REACTION_ERROR = 0.2e-3, 0.05   # goals, at the thesis' mesh size
NU, OTHER_NUS = 0.49, (0.45, 0.499)  # of the scenes; besides
OTHER_FINE = (8e-3, 4e-3)   # m, of the references for them
WINNER = QUADRATIC
GROWTH, AWAY = 1.5, 12e-3  # of the reference's elements; their size at the pads held still
BEYOND = 0.012       # m; nodes of another mesh of the same body lie at most this far outside


@dataclass(frozen=True)
class Case:
    """One body: its scene, the mesh of the thesis' size with rims, its surface.

    plain : mesh of the same size that does not follow the rims
    fine : longest edge at the pushed rim in the two reference meshes [m];  largest : elsewhere [m]
    closer : longest edge at all rims in the graded candidate [m]
    """

    name: str
    scene: str
    rims: str
    surface: str
    plain: str
    fine: tuple = (8e-3, 4e-3)
    largest: float = 14e-3
    closer: float = 15e-3


CASES = (Case('dome', 'dome_small.yaml', 'dome/small_rims.msh', 'dome/dome.stl',
              'dome/small.msh', fine=(6e-3, 3e-3), closer=8e-3),
         Case('breast', 'breast.yaml', 'breast/breast_rims.msh', 'breast/breast.stl',
              'breast/breast_2331.msh'))


# ---- solving

@dataclass(frozen=True)
class Pushed:
    """A body pushed: positions x (n, 3) [m] of its nodes, force (3,) [N] of tissue on the pad.

    cpu : [s] of the process;  free : unknowns
    """

    body: SoftBody
    x: np.ndarray
    force: np.ndarray
    cpu: float
    free: int

    def moved(self, points):
        """Displacements (k, 3) [m] of points (k, 3) of the body."""
        riders = embed(self.body.mesh, points, standoff=BEYOND)
        return interpolate(riders, self.x) - interpolate(riders, self.body.mesh.nodes)


def push(scene, mesh, element, *, depth=PUSH, nu=None):
    """Push the scene's first pad by `depth` [m] from rest; returns Pushed.

    mesh : TetMesh of linear elements;  element : see the module;  nu : None = the scene's
    CPU seconds are those of the process from the first assembly to the solution, body and mesh
    being made before. Raises NotConverged.
    """
    if nu is not None:
        scene = replace(scene, material=replace(scene.material, nu=nu))
    mesh = mesh if element in (LINEAR, SMOOTHED) else quadratic_mesh(mesh)
    body = with_element(build_body(scene, mesh), element)
    way = np.zeros((len(body.pads), 3))
    way[0] = depth * body.pads[0].direction
    start = time.process_time()
    solver = StaticSolver(body)
    solution = solver.solve(mesh.nodes, way)
    cpu = time.process_time() - start
    if solution.outcome is not Outcome.OK:
        raise NotConverged(f'{NAME}: {element} on {len(mesh.tets)} tetrahedra, nu '
                           f'{scene.material.nu}: {solution.outcome.advice}')
    return Pushed(body, solution.x, solution.pad_force[0], cpu, len(solver.free.dofs))


@dataclass(frozen=True)
class Reference:
    """The answer at some points of a body, from two meshes: errors fall with the size at the rim.

    points : (k, 3) [m], of which the last `targets` are the scene's targets
    coarse, fine : (k, 3) [m] their displacements;  forces : (2, 3) [N] of tissue on pad, likewise
    far : (k,) True for points more than FAR from every pad
    """

    points: np.ndarray
    targets: int
    coarse: np.ndarray
    fine: np.ndarray
    forces: np.ndarray
    far: np.ndarray

    @property
    def moved(self):
        """Displacements (k, 3) [m], extrapolated."""
        return 2.0 * self.fine - self.coarse

    @property
    def force(self):
        """Force (3,) [N], extrapolated."""
        return 2.0 * self.forces[1] - self.forces[0]

    def errors(self, moved, force):
        """Return the errors of displacements (k, 3) [m] and a force (3,) [N], for the table."""
        off = MM * np.linalg.norm(moved - self.moved, axis=1)
        ratio = np.linalg.norm(force) / np.linalg.norm(self.force)
        body, targets = off[:len(off) - self.targets], off[len(off) - self.targets:]
        far = body[self.far[:len(body)]]
        return {'far_max_mm': far.max(), 'far_mean_mm': far.mean(),
                'target_max_mm': targets.max(), 'reaction_percent': 100.0 * (ratio - 1.0)}


def reference(case, scene, mesh, *, points=None, depth=PUSH, nu=None):
    """Return the Reference of a Case at some points and the scene's targets.

    mesh : TetMesh with rims, refined towards the pushed one, twice
    points : (k, 3) [m], None = the nodes of `mesh` and the middles of its edges
    scene, depth, nu : as in `push`
    """
    targets = target_points(scene)[1]
    points = np.vstack([quadratic_mesh(mesh).nodes if points is None else points, targets])
    coarse, fine = (push(scene, reference_mesh(case, scene, mesh, edge), WINNER, depth=depth,
                         nu=nu) for edge in case.fine)
    pads = np.concatenate([fine.body.mesh.nodes[pad.nodes] for pad in fine.body.pads])
    return Reference(points, len(targets), coarse.moved(points), fine.moved(points),
                     np.array([coarse.force, fine.force]), cKDTree(pads).query(points)[0] > FAR)


def reference_mesh(case, scene, mesh, edge_length):
    """Return the graded TetMesh: `edge_length` [m] at the first pad, AWAY at the others'."""
    surface, _ = read_surface(config_dir() / 'scenes' / case.surface)
    near = near_rims(mesh, scene.pads[:1], edge_length, growth=GROWTH, largest=case.largest)
    others = near_rims(mesh, scene.pads, AWAY, growth=GROWTH, largest=case.largest)
    return grade(mesh, lambda points: np.minimum(near(points), others(points)),
                 patches=scene.pads, surface=surface)


# ---- the table

def candidates(case, scene):
    """Yield (mesh name, TetMesh, elements) for the table."""
    plain = load_mesh(config_dir() / 'scenes' / case.plain)
    rims = load_mesh(config_dir() / 'scenes' / case.rims)
    closer = grade(rims, near_rims(rims, scene.pads, case.closer, growth=2.0), patches=scene.pads)
    corners = rims.nodes[rims.tets]
    half = 0.5 * np.linalg.norm(corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]], axis=2).max()
    eighth = grade(rims, lambda points: np.full(len(points), half), patches=scene.pads)
    yield 'nodes within the radius', plain, (LINEAR, IN_FULL, QUADRATIC)
    yield 'rims', rims, ELEMENTS
    yield 'rims, graded', closer, (IN_FULL, QUADRATIC)
    yield 'rims, halved', eighth, (LINEAR, SMOOTHED)


def compare(case):
    """Return the rows of one Case, as mappings; the reference's own last step is the first."""
    scene = load_scene(config_dir() / 'scenes' / case.scene)
    rims = load_mesh(config_dir() / 'scenes' / case.rims)
    truth = reference(case, scene, rims)
    rows = [{'body': case.name, 'quantity': 'last step of the reference'}
            | truth.errors(truth.fine, truth.forces[1])]
    for name, mesh, elements in candidates(case, scene):
        rows += [_row(case, name, element, scene.material.nu, push(scene, mesh, element), truth)
                 for element in elements]
    return rows


def other_nus(case):
    """Return the rows of the winner on the mesh with rims at other Poisson's ratios."""
    case = replace(case, fine=OTHER_FINE)
    scene = load_scene(config_dir() / 'scenes' / case.scene)
    rims = load_mesh(config_dir() / 'scenes' / case.rims)
    return [_row(case, 'rims', element, nu, push(scene, rims, element, nu=nu), truth)
            for nu in OTHER_NUS
            for truth in [reference(case, scene, rims, nu=nu)]
            for element in (IN_FULL, QUADRATIC)]


def _row(case, name, element, nu, pushed, truth):
    return {'body': case.name, 'mesh': name, 'element': element, 'nu': nu,
            'tets': len(pushed.body.mesh.tets), 'unknowns': pushed.free, 'cpu_s': pushed.cpu
            } | truth.errors(pushed.moved(truth.points), pushed.force)


def reproduce(out_dir):
    """Solve both bodies with every element and mesh, and the dome at other Poisson's ratios.

    out_dir : folder (Path, existing) for the figure.  Returns Result.
    """
    rows = [row for case in CASES for row in compare(case)] + other_nus(CASES[0])
    figure(rows).save(Path(out_dir) / f'{NAME}.png')
    return Result(NAME, 0, commit_of(share_dir()), machine_description(), tuple(rows),
                  tuple(goal for case in CASES for goal in goals(case, rows)))


def goals(case, rows):
    """Yield the Target of one Case: the winner on the mesh of the thesis' size.

    rows : of the table, as mappings
    """
    own = next(row for row in rows if 'mesh' in row and NU == row['nu']
               and (row['body'], row['mesh'], row['element']) == (case.name, 'rims', WINNER))
    far, reaction = own['far_max_mm'], abs(own['reaction_percent'])
    words = f'{case.name}, {WINNER}, {own["tets"]} tetrahedra'
    yield Target(f'{words}: largest error beyond 2 cm', far, 'mm', f'<= {MM * FAR_ERROR:g}',
                 far <= MM * FAR_ERROR)
    yield Target(f'{words}: reaction', reaction, '%', f'<= {100 * REACTION_ERROR:g}',
                 reaction <= 100.0 * REACTION_ERROR)


@styled
def figure(rows):
    """Errors over CPU seconds, a column for each body, both axes logarithmic."""
    sheet = new_figure(7.2, 5.4)
    axes = sheet.subplots(2, len(CASES), sharex=True, sharey='row', squeeze=False)
    marks = {'nodes within the radius': 'x', 'rims': 'o', 'rims, graded': '^',
             'rims, halved': 's'}
    for column, case in zip(axes.T, CASES, strict=True):
        column[0].set_title(case.name)
        mine = [r for r in rows if r['body'] == case.name and r.get('nu') == NU]
        for axis, key in zip(column, ('far_max_mm', 'reaction_percent'), strict=True):
            for row in mine:
                axis.loglog(row['cpu_s'], abs(row[key]), marks[row['mesh']], ls='', ms=6,
                            color=colour(ELEMENTS.index(row['element'])), mfc='none')
        column[0].axhline(MM * FAR_ERROR, color=GOAL, lw=1.0, ls='--')
        column[1].axhline(100.0 * REACTION_ERROR, color=GOAL, lw=1.0, ls='--')
    axes[0, 0].set_ylabel('largest error > 2 cm from pads / mm')
    axes[1, 0].set_ylabel('error of the reaction / %')
    sheet.supxlabel('CPU time of the push / s', fontsize=9)
    keys = [axes[0, 0].plot([], [], 's', color=colour(i), label=name)[0]
            for i, name in enumerate(ELEMENTS)]
    keys += [axes[0, 0].plot([], [], mark, color='0.3', mfc='none', label=name)[0]
             for name, mark in marks.items()]
    sheet.legend(handles=keys, loc='outside upper center', ncols=4)
    return Plate(NAME, sheet, 'Accuracy and cost of elements and meshes; dashed: the goals.')
