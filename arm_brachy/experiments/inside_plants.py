"""Plants of chapter 4's experiments: bodies that no estimator has, pushed as in Table 4.1.

Every plant differs from the model in mesh, element and modulus and has one hidden term besides.
None of its numbers was chosen by what an estimator makes of it: terms have the `typical` size that
the registry declares, the inclusion is that of scenario target_1.
"""

import hashlib
import sys
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy import registry
from arm_brachy.cell import Body
from arm_brachy.core import config
from arm_brachy.core.errors import NotConverged
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.core.term import BodyTerm
from arm_brachy.experiments.parallel import process_pool

SCENE = 'breast.yaml'
MODEL_MESH, PLANT_MESH = 'breast_600.msh', 'breast_2331.msh'
PLANT_E = 9e3   # Pa, half as much again as the model's: it moves nothing where pads are driven
# name -> entry of a scenario's `terms`
PLANTS = {
    'inclusion': {'name': 'inclusion', 'centre_mm': [20, -12, 30], 'radius_mm': 9, 'ratio': 5},
    'compressibility': {'name': 'compressibility', 'factor': 0.3},
    'fibres': {'name': 'anisotropy', 'ratio': 0.5, 'azimuth_deg': 30},
    'pad_misplacement': {'name': 'pad_misplacement', 'up_mm': 3},
    'base_compliance': {'name': 'base_compliance', 'normal_kPa_mm': 1, 'tangential_kPa_mm': 1},
}
GROUPS = (('pad_1',), ('pad_2',), ('pad_1', 'pad_2'), ('pad_3', 'pad_4'))
DEPTHS = (5e-3, 10e-3, 15e-3, 20e-3)   # m
WALK = 2.5e-3     # m, longest step of the solver between two depths
SHORTEST = WALK / 32   # m, step that is not halved any more where it fails


@dataclass(frozen=True)
class Experiment:
    """A row of Table 4.1: number, pads that push, and how far [m]."""

    number: int
    pads: tuple
    depth: float


EXPERIMENTS = tuple(Experiment(1 + len(DEPTHS) * g + d, pads, depth)
                    for g, pads in enumerate(GROUPS) for d, depth in enumerate(DEPTHS))


@dataclass(frozen=True)
class Push:
    """One plant, one group of pads: rest, then every depth.

    pads : names;  q : (d + 1, p) [m] travel of all pads
    markers : (d + 1, m, 3) [m] true places of the tissue's markers, in the scene's order
    targets : (d + 1, k, 3) [m] true places of the targets
    """

    pads: tuple
    q: np.ndarray
    markers: np.ndarray
    targets: np.ndarray


class FullIntegration(BodyTerm):
    """Makes a body's quadratic elements carry volume change at all points: another element."""

    def prepare(self, body):
        """Return `body` with in_full."""
        return replace(body, in_full=True)

    def memory(self, body):
        """None."""

    def before_step(self, body, memory, t, dt, fields):
        """Nothing."""

    def after_step(self, body, memory, x, t, dt):
        """None."""


def model_scene():
    """The scene as estimators get it: the mesh that the cell's controller uses."""
    return _scene(MODEL_MESH)


def plant_scene():
    """The scene as the plants have it."""
    scene = _scene(PLANT_MESH)
    return replace(scene, material=replace(scene.material, E=PLANT_E))


def _scene(mesh):
    folder = config_dir() / 'scenes'
    return with_mesh(load_scene(folder / SCENE), folder / 'breast' / mesh)


def tissue_markers(scene):
    """Names of the markers that are on the tissue, in the scene's order."""
    return tuple(m.name for m in scene.markers if m.body == 'tissue')


def target_names(scene):
    """Names of the targets, in the scene's order."""
    return tuple(target.name for target in scene.targets)


def plants(cache, names=tuple(PLANTS)):
    """Solve every plant, or read what an earlier run has solved: name -> tuple of Push.

    cache : folder, created where absent; a file is good for one mesh, scene, term and program of
        pushes (a digest of them is its name)
    Raises NotConverged naming the plant and the push.
    """
    cache = Path(cache)
    cache.mkdir(parents=True, exist_ok=True)
    jobs = [(name, pads) for name in names for pads in GROUPS]
    missing = [job for job in jobs if not _file(cache, *job).is_file()]
    if missing:
        with process_pool(len(missing)) as pool:
            futures = {pool.submit(solve, *job): job for job in missing}
            for i, future in enumerate(as_completed(futures)):
                job, push = futures[future], future.result()
                np.savez(_file(cache, *job), q=push.q, markers=push.markers, targets=push.targets)
                print(f'plants: {i + 1} of {len(missing)}: {job[0]}, {"+".join(job[1])}',
                      file=sys.stderr)
    return {name: tuple(_read(cache, name, pads) for pads in GROUPS) for name in names}


def _read(cache, name, pads):
    with np.load(_file(cache, name, pads)) as file:
        return Push(pads, file['q'], file['markers'], file['targets'])


def _file(cache, name, pads):
    scene = plant_scene()
    said = hashlib.sha256(Path(scene.mesh.file).read_bytes())
    plain = config.to_mapping(replace(scene, mesh=replace(scene.mesh, file=PLANT_MESH)))
    said.update(repr((plain, PLANTS[name], pads, DEPTHS, WALK)).encode())
    return cache / f'{name}-{"-".join(pads)}-{said.hexdigest()[:12]}.npz'


def solve(name, pads, scene=None, depths=DEPTHS):
    """Push one plant with some pads to every depth, from rest; returns Push.

    name : of PLANTS;  pads : names;  scene : `plant_scene` by default;  depths : [m], increasing
    Raises NotConverged.
    """
    scene = scene or plant_scene()
    body = Body(scene, (*registry.parse_terms([PLANTS[name]], name), FullIntegration()))
    return pushed(body, name, pads, depths, scene)


def pushed(body, name, pads, depths, scene):
    """Push a body with some pads to every depth, from rest; returns Push.

    body : cell.Body at rest;  name : for messages;  pads : names;  depths : [m], increasing
    scene : whose markers and targets are read. Raises NotConverged.
    """
    pushing = np.array([pad in pads for pad in body.pad_names], dtype=float)
    q = np.outer([0.0, *depths], pushing)
    walk = Walk(body, name)
    readings = [walk.to(travel) for travel in q]
    kinds = [_select(body, readings, names(scene)) for names in (tissue_markers, target_names)]
    return Push(tuple(pads), q, *kinds)


class Walk:
    """A plant pushed step by step; time is but the number of steps."""

    def __init__(self, body, name):
        """body : with `step`, as cell.Body;  name : of the plant, for messages."""
        self._body, self._name, self._t, self._q = body, name, 0.0, None

    def to(self, q):
        """Return the Reading at travel q (p,) [m], by steps of WALK, shorter where one fails.

        Raises NotConverged.
        """
        if self._q is None:
            return self._step(q, SHORTEST)
        while True:
            way = q - self._q
            length = np.abs(way).max()
            reading = self._step(self._q + way * min(1.0, WALK / length), WALK)
            if length <= WALK * (1.0 + 1e-9):
                return reading

    def _step(self, q, length):
        """One step to q of this length [m], or two halves where it fails."""
        self._t += 1.0
        reading = self._body.step(self._t, q)
        if reading.outcome.ok:
            self._q = q
            return reading
        if length <= SHORTEST:
            raise NotConverged(f'plant {self._name} on the way to {1e3 * q.max():.2f} mm: '
                               f'{reading.outcome.advice}')
        self._step(0.5 * (self._q + q), 0.5 * length)
        return self._step(q, 0.5 * length)


def _select(body, readings, names):
    at = [body.point_names.index(name) for name in names]
    return np.array([reading.points[at] for reading in readings])
