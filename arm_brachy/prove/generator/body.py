"""A body that several cases share: its geometry, markers, tissue as labelled, and meshes."""
import hashlib
import os
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_brachy.prove.generator.grid import Grid
from arm_brachy.prove.generator.mesh import make_mesh
from arm_brachy.prove.generator.probe import locate
from arm_brachy.prove.generator.response import solve_response
from arm_brachy.prove.generator.shape import Dome, Pad, direction_ball
from arm_brachy.prove.generator.solver import Model, uniform

# Size of the elements at the rims in radii of the pad, and kind of pressure, of every solver.
SOLVERS = {
    'taylor_hood': {'size': 0.62, 'pressure': 'nodal', 'turn': 0.3},
    'cell_pressure': {'size': 0.68, 'pressure': 'cell', 'turn': 0.9},
}
# Modules that solutions depend on.
SOLVING = ('shape', 'tets', 'rim', 'mesh', 'elements', 'grid', 'law', 'assembly', 'sparse',
           'solver', 'probe', 'response')
COARSE = {'size': 1.0, 'pressure': 'nodal', 'turn': 0.55}


@dataclass(frozen=True)
class Body:
    """What is known of a body before anything is hidden in it; SI, world frame.

    dome; pads; modulus [Pa], poisson, density [kg/m^3]: of the label, gravity is absent;
    surface_markers, targets (k, 3): in the half-ball; base_markers (3, 3) [m]; pairs: pads that
    a protocol may push together, the last one only in the held-out protocol; solver: of
    `SOLVERS`, the one that makes its recordings.
    """

    name: str
    dome: Dome
    pads: tuple
    modulus: float
    poisson: float
    density: float
    surface_markers: tuple
    targets: tuple
    base_markers: tuple
    pairs: tuple
    solver: str

    @property
    def points(self):
        """Positions (k, 3) [m] of the surface markers, then of the targets."""
        return self.dome.place(np.vstack([self.surface_markers, self.targets]))

    def grid(self, options):
        """Mesh by `options`, as in `SOLVERS`."""
        mesh = make_mesh(self.dome, self.pads, options['size'], turn=options['turn'],
                         levels=options.get('levels', 2))
        return Grid(mesh, options['pressure'])

    def model(self, grid):
        """Unplanted body of the modulus on its label."""
        return Model(grid, self.pads, uniform(grid, self.modulus, self.poisson))

    def response(self, options, cache, *, with_states=False):
        """Response of the unplanted body, and its states if wanted; kept in folder `cache`."""
        path = Path(cache) / f'{solution_key(self, options)}.pickle'
        if not path.exists():
            grid = self.grid(options)
            probes = locate(self.points, grid.nodes, grid.mesh.tets)
            result = solve_response(self.model(grid), probes, self.pairs)
            path.parent.mkdir(parents=True, exist_ok=True)
            # Whole or not at all: another process may look for it.
            part = path.with_suffix(f'.{os.getpid()}')
            part.write_bytes(pickle.dumps(result))
            part.replace(path)
        response, states = pickle.loads(path.read_bytes())
        return (response, states) if with_states else response


def solution_key(body, options):
    """Name of a body's solutions on a mesh by `options`: another for another code of theirs."""
    here = Path(__file__).parent
    code = b''.join((here / f'{name}.py').read_bytes() for name in SOLVING)
    what = repr((body, sorted(options.items()))).encode()
    return hashlib.sha256(code + what).hexdigest()[:20]


def draw_body(rng, name, solver='taylor_hood'):
    """Random `Body`: 3 to 5 pads, 7 to 13 markers on the tissue, 1 to 5 targets."""
    radii = rng.uniform(0.050, 0.070) * np.array([1, rng.uniform(0.85, 1.07)])
    dome = Dome(tuple(map(float, radii)), float(rng.uniform(0.042, 0.062)),
                tuple(map(float, rng.uniform(-0.006, 0.006, 2))),
                tuple(map(float, rng.uniform(-0.04, 0.04, 5))))
    pads = draw_pads(rng, dome, int(rng.integers(3, 6)))
    n = len(pads)
    order = rng.permutation([(i, j) for i in range(n) for j in range(i + 1, n)])
    return Body(
        name, dome, pads, round(float(np.exp(rng.uniform(np.log(6e3), np.log(20e3)))), -2),
        round(float(rng.uniform(0.45, 0.49)), 3), round(float(rng.uniform(960, 1060))),
        draw_markers(rng, dome, pads, int(rng.integers(8, 14))),
        tuple(map(tuple, draw_targets(rng, int(rng.integers(1, 6))).tolist())),
        base_markers(rng, dome), tuple(map(tuple, order[:3].tolist())), solver)


def draw_pads(rng, dome, count):
    """Pads round the body at about half its height, pushing nearly along its normal."""
    pads = []
    first = rng.uniform(0, 2 * np.pi)
    for i in range(count):
        azimuth = first + 2 * np.pi * (i + rng.uniform(-0.12, 0.12)) / count
        at = direction_ball(azimuth, rng.uniform(0.42, 0.56))[None]
        centre, normal = dome.place(at)[0], dome.normal(at)[0]
        radius = min(rng.uniform(0.009, 0.020), 0.62 * centre[2], 0.9 * dome.radii[1] / count)
        direction = -normal + rng.normal(0, 0.08, 3)
        direction /= np.linalg.norm(direction)
        stroke = np.clip(rng.uniform(0.3, 0.42) * radius, 0.003, 0.006)
        pads.append(Pad(f'pad_{i + 1}', tuple(centre.tolist()), tuple(direction.tolist()),
                        round(float(radius), 4), round(float(stroke), 4)))
    return tuple(pads)


def draw_markers(rng, dome, pads, count, clear=0.004):
    """Points (count, 3) of the half-sphere, off the pads by `clear` [m] and 9 mm apart."""
    kept = []
    while len(kept) < count:
        ball = direction_ball(rng.uniform(0, 2 * np.pi), rng.uniform(0.12, 1.0))
        x = dome.place(ball[None])
        free = all(pad.rim_distance(x)[0] > clear or not pad.faces(x)[0] for pad in pads)
        if free and all(np.linalg.norm(x - dome.place(np.array([k]))) > 0.009 for k in kept):
            kept.append(tuple(ball.tolist()))
    return tuple(kept)


def draw_targets(rng, count):
    """Points (count, 3) well inside the half-ball."""
    r = 0.6 * np.sqrt(rng.uniform(0, 1, count))
    azimuth = rng.uniform(0, 2 * np.pi, count)
    return np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth),
                            rng.uniform(0.2, 0.7, count)])


def base_markers(rng, dome):
    """Three points (3, 3) [m] on the base plate beside the body."""
    azimuth = rng.uniform(0, 2 * np.pi) + np.array([0, 2.1, 4.2])
    r = 1.2 * max(dome.radii)
    return tuple(map(tuple, np.column_stack(
        [r * np.cos(azimuth), r * np.sin(azimuth), 0 * azimuth]).tolist()))
