"""What the half-cylinder may be, and its states as the pads go in.

Along each ray of the protocol it is solved at six depths; between them every marker, target and
force follows the cubic spline through these and rest. All bodies have one mesh, so that what an
effect changes is not mixed with what meshes differ by. One that remembers is solved in time; what
it is off the elastic body is kept.
"""

from dataclasses import dataclass
from math import comb

import numpy as np

from arm_brachy.experiments.diagnosis_cases import hasty_pool, save
from arm_brachy.experiments.half_cylinder.elements import NONE, Body
from arm_brachy.experiments.half_cylinder.equilibrium import Solver
from arm_brachy.experiments.half_cylinder.law import Law
from arm_brachy.experiments.half_cylinder.layout import DIRECTIONS, MM, NU, PADS, POINTS, E
from arm_brachy.experiments.half_cylinder.memory import Memory
from arm_brachy.experiments.half_cylinder.mesh import aside, load_mesh
from arm_brachy.experiments.half_cylinder.protocol import RAYS, instants, response, travel
from arm_brachy.experiments.ray import PLAIN, Ray

SHARES = tuple(np.arange(1, 7) / 6)     # of a ray, solved besides rest
RATIO = 3.0                             # of the lump's modulus to the gel's
ASIDE = ('right', 2.5 * MM)             # a pad, and how far along x it sits from its place
REMEMBERING = 'remembering'


def under_the_edge(points):
    """Which points (n, 3) [m] of the base are loose: a strip along the edge, below pad left."""
    x, y = points[:, 0], points[:, 1]
    return (y > 18 * MM) & (x > -48 * MM) & (x < 0.0)


@dataclass(frozen=True)
class Kind:
    """How a body differs: ratio of the lump's modulus, loose base, a pad aside; see above."""

    ratio: float = 1.0
    loose: object = None
    aside: tuple | None = None

    def pushed(self, mesh):
        """The Pushed body, on a mesh.Mesh."""
        mesh = mesh if self.aside is None else aside(mesh, *self.aside)
        law, factor = Law.of(E, NU), np.where(mesh.lump, self.ratio, 1.0)[:, None]
        return Pushed(mesh, Body(mesh, Law(factor * law.shear, factor * law.bulk),
                                 loose=self.loose))


BODIES = {PLAIN: Kind(), 'lump': Kind(ratio=RATIO), 'loose': Kind(loose=under_the_edge),
          'aside': Kind(aside=ASIDE)}


class Pushed:
    """An elements.Body on its mesh.Mesh with the pads bonded to it.

    Test: experiments/half_cylinder/test_bodies.py
    """

    def __init__(self, mesh, body):
        self.body = body
        self._patches = [mesh.patch(pad.name) for pad in PADS]
        held = np.concatenate([body.glued, *self._patches])
        self._held = (3 * np.unique(held)[:, None] + np.arange(3)).ravel()
        self._solver, self._probe = Solver(body, self._held), body.probe(POINTS)

    def settled(self, travel, u, past=NONE):
        """Equilibrium (3 n,) near u with pad travel (p,) [m].  Raises NotConverged."""
        moved = np.zeros((len(self.body.nodes), 3))
        for patch, direction, depth in zip(self._patches, DIRECTIONS, travel, strict=True):
            moved[patch] = depth * direction
        return self._solver.solve(moved.ravel()[self._held], u, past)

    def seen(self, u):
        """Displacements (points, 3) of POINTS [m]."""
        return self._probe @ u.reshape(-1, 3)

    def pressed(self, u, past=NONE):
        """Forces on the pads (p, 3) [N]."""
        nodal = self.body.forces(u, past).reshape(-1, 3)
        return np.array([-nodal[patch].sum(axis=0) for patch in self._patches])


def solve_ray(kind, full, mesh):
    """The ray.Ray to pad travel `full` (p,) [m] of a Kind on a mesh.  Raises NotConverged."""
    pushed, states = kind.pushed(mesh), []
    shares = np.array((0.0, *SHARES))
    for share in shares:
        states.append(pushed.settled(share * np.array(full), _ahead(states, pushed.body.size)))
    return Ray(np.array(full), shares, np.array([pushed.seen(u) for u in states]),
               np.array([pushed.pressed(u) for u in states]))


def _ahead(states, size):
    """Where the cubic (at first less) through the last states leads; at rest if there is none."""
    last = states[:-5:-1]
    return sum(((-1) ** j * comb(len(last), j + 1) * u for j, u in enumerate(last)),
               np.zeros(size))


@dataclass(frozen=True)
class Beyond:
    """What memory adds to an elastic body at instants t (k,) [s].

    u : (k, points, 3) [m];  force : (k, p, 3) [N]
    """

    t: np.ndarray
    u: np.ndarray
    force: np.ndarray

    def at(self, t, what):
        """Values (t, ..., 3) of 'u' or 'force' at times t (t,)."""
        values = getattr(self, what)
        return np.apply_along_axis(lambda one: np.interp(t, self.t, one), 0, values)


def solve_memory(kind, rays, t, mesh):
    """Beyond of a Kind that remembers, solved at instants t (k,) [s] from rest.

    rays : the same body's, elastic, name -> ray.Ray.  Raises NotConverged.
    """
    pushed = kind.pushed(mesh)
    u = np.zeros(pushed.body.size)
    memory = Memory(*np.zeros((2, *pushed.body.weights.shape, 3, 3)))
    moved, forces = [pushed.seen(u)], [pushed.pressed(u)]
    for before, now in zip(t[:-1], t[1:], strict=True):
        past = memory.ahead(now - before)
        u = pushed.settled(travel(np.array([now]))[0], u, past)
        moved.append(pushed.seen(u))
        forces.append(pushed.pressed(u, past))
        memory = memory.after(now - before, pushed.body.shape_stress(u))
    return Beyond(t, np.array(moved) - response(rays, t, 'u'),
                  np.array(forces) - response(rays, t, 'force'))


def solve_all(folder, names):
    """Solve what `folder` lacks, a process per core, for these bodies (of BODIES, REMEMBERING).

    Files are BODY_RAY.npz and REMEMBERING.npz; delete them after a change of the bodies.
    Raises NotConverged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [(name, ray) for name in sorted({PLAIN, *names} - {REMEMBERING}) for ray in RAYS]
    lacking = [one for one in wanted if not _file(folder, *one).is_file()]
    with hasty_pool(len(lacking)) as pool:
        for future in [pool.submit(_solve, folder, *one) for one in lacking]:
            future.result()
    if REMEMBERING in names and not (folder / f'{REMEMBERING}.npz').is_file():
        beyond = solve_memory(BODIES[PLAIN], load_rays(folder), instants(), load_mesh())
        save(folder / f'{REMEMBERING}.npz', vars(beyond))


def _solve(folder, name, ray):
    save(_file(folder, name, ray), vars(solve_ray(BODIES[name], RAYS[ray], load_mesh())))


def _file(folder, name, ray):
    return folder / f'{name}_{ray}.npz'


def load_rays(folder, name=PLAIN):
    """Rays of the body of a name, ray -> ray.Ray; those of one that remembers are PLAIN's."""
    out = {}
    for ray in RAYS:
        with np.load(_file(folder, PLAIN if name == REMEMBERING else name, ray)) as file:
            out[ray] = Ray(**file)
    return out


def load_beyond(folder, name):
    """Beyond of the body that remembers, None of another."""
    if name != REMEMBERING:
        return None
    with np.load(folder / f'{REMEMBERING}.npz') as file:
        return Beyond(**file)
