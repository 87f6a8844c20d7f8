"""What the block may be, and its states as the pads go in.

A ray is a direction of pad travel. Along each the block is solved at six depths; between them
every marker, target and force follows the cubic spline through these and rest. Fine bricks carry
the plain body; what an effect changes is the difference of two solutions on coarser bricks.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.experiments.diagnosis_cases import hasty_pool, save
from arm_brachy.experiments.gel_block.elements import Block
from arm_brachy.experiments.gel_block.equilibrium import Solver
from arm_brachy.experiments.gel_block.law import Law
from arm_brachy.experiments.gel_block.layout import (
    DIRECTIONS,
    MARKERS,
    MM,
    NU,
    PADS,
    SIZE,
    TARGETS,
    E,
)
from arm_brachy.experiments.ray import PLAIN, Ray

SHORT = 0.92        # of pad_b's travel, where its actuator falls short
# Travel of both pads [m] at the end of a ray.
RAYS = {'A': (10 * MM, 0.0), 'B': (0.0, 9 * MM), 'AB': (9 * MM, 8 * MM),
        'AB_short': (9 * MM, SHORT * 8 * MM)}
# Of a ray, solved besides rest: longer steps fail at the pads' edges and are taken in halves.
SHARES = tuple(np.arange(1, 7) / 6)
FINE = 'fine'           # on fine bricks; PLAIN is on coarse ones


def _planes(*lines_mm):
    return tuple(MM * np.array(one, dtype=float) for one in lines_mm)


# Planes between bricks along x, y, z; the edges of the pads are among them.
FINE_LINES = _planes((-60, -48, -36, -28, -24, -20, -10, 0, 4, 8, 22, 42, 52, 57, 60),
                     (-45, -25, -12, -8, -4, 6, 16, 20, 24, 36, 42, 45),
                     (0, 9, 13, 16, 20, 30, 40, 44, 48, 60))
COARSE_LINES = _planes((-60, -53, -43, -33, -24, -10, 4, 20, 33, 46, 54, 60),
                       (-45, -34, -22, -15, -8, -1, 6, 13, 20, 32, 45),
                       (0, 8, 16, 30, 44, 52, 60))
SLOPE, STIFFENING, EDGE = 1.0, 1.5, 20 * MM     # of the effects below


def stiffer_above(points):
    """Factor (n,) on the modulus at points (n, 3) [m]: twice as stiff on top, 1 half way up."""
    height = SIZE[2]
    return (1.0 + SLOPE * points[:, 2] / height) / (1.0 + 0.5 * SLOPE)


def beyond_the_edge(points):
    """Which points (n, 3) [m] of the base are loose: the third under pad_a's end."""
    return points[:, 0] > EDGE


@dataclass(frozen=True)
class Body:
    """What elements.Block and law.Law are made with, lines in m."""

    lines: tuple = COARSE_LINES
    stiffening: float = 0.0
    stiffness: object = None
    loose: object = None

    def block(self):
        """The elements.Block."""
        return Block(self.lines, Law.of(E, NU, self.stiffening), stiffness=self.stiffness,
                     loose=self.loose)


BODIES = {FINE: Body(FINE_LINES), PLAIN: Body(),
          'gradient': Body(stiffness=stiffer_above),
          'stiffening': Body(stiffening=STIFFENING),
          'debond': Body(loose=beyond_the_edge)}


def solve_ray(body, full):
    """The Ray to pad travel `full` (p,) [m] of a Body. Raises NotConverged."""
    block = body.block()
    points = np.array([*MARKERS.values(), *TARGETS.values()])
    patches = [np.flatnonzero(pad.carries(block.nodes)) for pad in PADS]
    held = np.unique((3 * np.concatenate([block.glued, *patches])[:, None]
                      + np.arange(3)).ravel())
    solver, probe = Solver(block, held), block.probe(points)

    def prescribed(share):
        out = np.zeros((len(block.nodes), 3))
        for patch, direction, depth in zip(patches, DIRECTIONS, full, strict=True):
            out[patch] = share * depth * direction
        return out.ravel()[held]

    shares, u = np.array((0.0, *SHARES)), np.zeros(block.size)
    moved, forces = [np.zeros_like(points)], [np.zeros((len(PADS), 3))]
    for before, share in zip(shares[:-1], shares[1:], strict=True):
        u = solver.along(prescribed(before), prescribed(share), u)
        moved.append(probe @ u.reshape(-1, 3))
        nodal = block.forces(u).reshape(-1, 3)
        forces.append(np.array([-nodal[patch].sum(axis=0) for patch in patches]))
    return Ray(np.array(full), shares, np.array(moved), np.array(forces))


def solve_all(folder, effects):
    """Solve what `folder` lacks, a process per core, for these effects (names of BODIES).

    Files are BODY_RAY.npz; delete them after a change of the bodies. Raises NotConverged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    coarse = sorted({PLAIN, *effects}) if set(effects) - {PLAIN} else []
    wanted = [*((FINE, ray) for ray in RAYS),
              *((name, ray) for name in coarse for ray in ('A', 'B', 'AB'))]
    lacking = [one for one in wanted if not _file(folder, *one).is_file()]
    with hasty_pool(len(lacking)) as pool:
        for future in [pool.submit(_solve, folder, *one) for one in lacking]:
            future.result()


def _solve(folder, name, ray):
    save(_file(folder, name, ray), vars(solve_ray(BODIES[name], RAYS[ray])))


def _file(folder, name, ray):
    return folder / f'{name}_{ray}.npz'


def _load(folder, name, ray):
    with np.load(_file(folder, name, ray)) as file:
        return Ray(**file)


def load_rays(folder, effect=PLAIN):
    """Rays of the block with an effect, name -> Ray, from what `solve_all` left in `folder`.

    With PLAIN all RAYS, else those without 'AB_short'.
    """
    rays = {name: _load(folder, FINE, name) for name in RAYS}
    if effect == PLAIN:
        return rays
    return {name: rays[name].changed(_load(folder, effect, name), _load(folder, PLAIN, name))
            for name in ('A', 'B', 'AB')}
