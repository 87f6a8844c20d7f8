"""Simulated bodies to fit estimators on: drawn at random, none of them a plant of Table 4.1.

Mesh, hidden term, its size and place, pads and depth are drawn by a seed. A term's size is a
share of the `typical` one that the registry declares: none was chosen by an estimator's error.
"""

import sys
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy import registry
from arm_brachy.cell import Body
from arm_brachy.core.errors import NotConverged
from arm_brachy.core.paths import config_dir
from arm_brachy.core.random import stream
from arm_brachy.core.scene import with_mesh
from arm_brachy.experiments import inside_plants
from arm_brachy.experiments.inside_plants import FullIntegration, Push
from arm_brachy.experiments.parallel import process_pool

SEED = 4410
COUNT = 24
# Neither the model's nor that of Table 4.1; on the last two, as on that one, no edge follows the
# rim of a pad, so that every pad has another outline than the model's.
MESHES = ('breast_rims.msh', 'breast_plant.msh', 'breast_1900.msh', 'breast_3000.msh')
KINDS = ('none', 'inclusion', 'compressibility', 'anisotropy', 'pad_misplacement',
         'base_compliance')
SHARE = (0.2, 1.5)             # of the typical size
PUSHES = 2                     # of every plant
DEPTH = (8e-3, 20e-3)          # m, of a push; read at half of it as well
MODULUS = (4e3, 12e3)          # Pa
# m, box in which the centre of an inclusion lies, and its radius
INCLUSION = ((-0.035, 0.035), (-0.035, 0.035), (0.015, 0.042))
RADIUS = (6e-3, 12e-3)


@dataclass(frozen=True)
class Fresh:
    """One drawn body. mesh : file;  E : [Pa];  kind : of KINDS;  term : entry of a scenario's
    `terms`, None = none;  pads, depths : names and [m] of each push."""

    number: int
    mesh: str
    E: float
    kind: str
    term: dict | None
    pads: tuple
    depths: tuple


def drawn(number, seed=SEED):
    """The Fresh of this number, which cycles through KINDS; same seed, same body."""
    rng = stream(seed, f'fresh_plants/{number}')
    kind = KINDS[number % len(KINDS)]
    mesh = MESHES[(number // len(KINDS)) % len(MESHES)]
    E = float(np.exp(rng.uniform(*np.log(MODULUS))))
    groups = rng.permutation(len(inside_plants.GROUPS))[:PUSHES]
    depths = tuple(float(d) for d in rng.uniform(*DEPTH, PUSHES))
    return Fresh(number, mesh, E, kind, _TERMS[kind](rng),
                 tuple(inside_plants.GROUPS[g] for g in groups), depths)


def _share(rng):
    return float(rng.uniform(*SHARE))


def _typical(name, parameter):
    return registry.by_name(name).__dataclass_fields__[parameter].metadata['quantity'].typical


def _inclusion(rng):
    return {'name': 'inclusion', 'centre_mm': [1e3 * float(rng.uniform(*i)) for i in INCLUSION],
            'radius_mm': 1e3 * float(rng.uniform(*RADIUS)),
            'ratio': _typical('inclusion', 'ratio')**_share(rng)}


def _compressibility(rng):
    return {'name': 'compressibility',
            'factor': _typical('compressibility', 'factor')**_share(rng)}


def _anisotropy(rng):
    return {'name': 'anisotropy', 'ratio': _typical('anisotropy', 'ratio') * _share(rng),
            'azimuth_deg': float(rng.uniform(-90.0, 90.0)),
            'elevation_deg': float(np.degrees(np.arcsin(rng.uniform(-1.0, 1.0))))}


def _pad_misplacement(rng):
    angle = rng.uniform(0.0, 2.0 * np.pi)
    size = _typical('pad_misplacement', 'up') * _share(rng)
    return {'name': 'pad_misplacement', 'up_mm': float(size * np.cos(angle)),
            'side_mm': float(size * np.sin(angle))}


def _base_compliance(rng):
    return {'name': 'base_compliance'} | {
        f'{axis}_kPa_mm': _typical('base_compliance', axis) / _share(rng)
        for axis in ('normal', 'tangential')}


_TERMS = {'none': lambda rng: None, 'inclusion': _inclusion, 'compressibility': _compressibility,
          'anisotropy': _anisotropy, 'pad_misplacement': _pad_misplacement,
          'base_compliance': _base_compliance}


def scene(fresh):
    """The Scene that a Fresh lives in."""
    base = with_mesh(inside_plants.model_scene(), config_dir() / 'scenes' / 'breast' / fresh.mesh)
    return replace(base, material=replace(base.material, E=fresh.E))


def terms(fresh):
    """Body terms of a Fresh, one or none."""
    return registry.parse_terms([fresh.term] if fresh.term else [],
                                f'fresh plant {fresh.number}')


def solve(number, seed=SEED):
    """(Fresh, tuple of Push) of a number; a push that has no equilibrium is left out by name."""
    fresh = drawn(number, seed)
    pushes = []
    for pads, depth in zip(fresh.pads, fresh.depths, strict=True):
        body = Body(scene(fresh), (*terms(fresh), FullIntegration()))
        try:
            pushes.append(inside_plants.pushed(body, f'fresh {number}', pads,
                                               (0.5 * depth, depth), scene(fresh)))
        except NotConverged as error:
            print(f'left out: {error}', file=sys.stderr)
    return fresh, tuple(pushes)


def plants(cache, count=COUNT, seed=SEED):
    """Solve so many, or read what an earlier run solved: list of (Fresh, tuple of Push).

    cache : folder, created where absent
    """
    cache = Path(cache)
    cache.mkdir(parents=True, exist_ok=True)
    files = [cache / f'fresh-{seed}-{i}-{Path(drawn(i, seed).mesh).stem}.npz'
             for i in range(count)]
    missing = [i for i, file in enumerate(files) if not file.is_file()]
    if missing:
        with process_pool(len(missing)) as pool:
            futures = [pool.submit(solve, i, seed) for i in missing]
            for k, future in enumerate(as_completed(futures)):
                fresh, pushes = future.result()
                _write(files[fresh.number], pushes)
                print(f'fresh plants: {k + 1} of {len(missing)}', file=sys.stderr)
    return [(drawn(i, seed), _read(file)) for i, file in enumerate(files)]


def _write(file, pushes):
    np.savez(file, count=len(pushes), **{
        f'{name}_{i}': np.array(getattr(push, name)) for i, push in enumerate(pushes)
        for name in ('pads', 'q', 'markers', 'targets')})


def _read(file):
    with np.load(file) as data:
        return tuple(Push(tuple(str(p) for p in data[f'pads_{i}']), *(
            data[f'{name}_{i}'] for name in ('q', 'markers', 'targets')))
            for i in range(int(data['count'])))
