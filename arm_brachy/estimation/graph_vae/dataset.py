"""States of a scene's body in a folder: shards of .npz and a manifest of how they were made.

    manifest.json       format, scene (name, SHA256 of its content and mesh), seed, walks, nodes,
                        edges of the graph, options of the draw
    shard_00000.npz     displacement (s, n, 3) float32 [m] of every node from the stress-free mesh,
                        walk (s,) number of the walk, fraction (s,) of its travel,
                        walks : JSON text, per walk what was drawn, states wanted and kept

A shard holds whole walks and follows from scene, seed, options and the numbers of its walks alone:
the same bytes whoever makes it. It is written under another name and renamed, so that a file that
is there is whole. Walks whose number ends in 8 are for validation, in 9 for the test, all others
for training: states of one walk resemble each other and stay together.
Test: estimation/graph_vae/test_dataset.py
"""

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import load_scene
from arm_brachy.estimation.graph_vae.loads import LoadOptions, draw_walk
from arm_brachy.estimation.graph_vae.walk import walk_states

FORMAT = 1
WALKS = 5               # per shard: about a quarter of a minute of one core
SPLITS = {'train': (0, 1, 2, 3, 4, 5, 6, 7), 'validation': (8,), 'test': (9,)}


def scene_hash(scene):
    """SHA256 (hex) of what a Scene says and of its mesh file; where the file lies is left out."""
    said = asdict(scene)
    mesh = Path(said['mesh'].pop('file')).read_bytes()
    text = json.dumps(said, sort_keys=True).encode()
    return hashlib.sha256(text + hashlib.sha256(mesh).digest()).hexdigest()


@dataclass(frozen=True)
class DatasetPlan:
    """What a data set is to hold. Two that are equal give the same bytes.

    scene_file : absolute path;  seed : of all draws;  walks : how many
    """

    scene_file: str
    seed: int
    walks: int
    options: LoadOptions = LoadOptions()

    @property
    def shards(self):
        """Numbers of the walks of each shard, a tuple of ranges."""
        return tuple(range(k, min(k + WALKS, self.walks)) for k in range(0, self.walks, WALKS))

    def manifest(self):
        """The manifest, a dict for JSON, but for the number of walks, which may grow."""
        scene = load_scene(self.scene_file)
        return {'format': FORMAT, 'scene': scene.name, 'scene_sha256': scene_hash(scene),
                'seed': self.seed, 'walks_per_shard': WALKS, 'options': asdict(self.options)}


def begin(plan, folder):
    """Create `folder` with its manifest, or find it begun. Returns shard numbers still to make.

    Raises InputError if the folder holds a data set of another scene, seed or draw.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    file, wanted = folder / 'manifest.json', plan.manifest()
    if file.exists():
        found = json.loads(file.read_text())
        for key, value in wanted.items():
            if found.get(key) != value:
                raise InputError(f'{file}: {key} = {found.get(key)}; must be {value} to go on; '
                                 'give another folder')
    else:
        _replace(file, json.dumps(wanted, indent=1).encode())
    return [k for k in range(len(plan.shards)) if not _complete(folder, k, plan.shards[k])]


def make_shard(plan, folder, number):
    """Compute shard `number` of a DatasetPlan and write it; returns (states, states left out)."""
    scene = load_scene(plan.scene_file)
    displacement, walk, fraction, walks = [], [], [], []
    for k in plan.shards[number]:
        drawn = draw_walk(scene, plan.seed, k, plan.options)
        u, f = walk_states(drawn, plan.options.steps)
        displacement.append(u)
        walk.append(np.full(len(u), k))
        fraction.append(f)
        walks.append({**drawn.drawn, 'wanted': plan.options.steps, 'kept': len(u)})
    file = shard_file(folder, number)
    part = file.with_suffix(f'.{os.getpid()}.part')
    with open(part, 'wb') as handle:
        np.savez(handle, displacement=np.concatenate(displacement), walk=np.concatenate(walk),
                 fraction=np.concatenate(fraction), walks=np.array(json.dumps(walks)))
    part.replace(file)
    kept = sum(w['kept'] for w in walks)
    return kept, sum(w['wanted'] for w in walks) - kept


def shard_file(folder, number):
    """Path of one shard."""
    return Path(folder) / f'shard_{number:05d}.npz'


@dataclass(frozen=True)
class Dataset:
    """A folder's states in memory.

    manifest : dict;  u : (s, n, 3) float32 [m];  walk, fraction : (s,);  walks : list of dicts
    """

    manifest: dict
    u: np.ndarray
    walk: np.ndarray
    fraction: np.ndarray
    walks: list

    def part(self, name):
        """Indices of the states for 'train', 'validation' or 'test'."""
        return np.flatnonzero(np.isin(self.walk % 10, SPLITS[name]))

    def kinds(self):
        """(s,) 'own' or 'random': whose contacts a state has."""
        kind = {w['number']: w['kind'] for w in self.walks}
        return np.array([kind[k] for k in self.walk])


def read(folder):
    """Return the Dataset of a folder, all whole shards that it has so far.

    Raises InputError if there is no manifest, another format, or no shard.
    """
    folder = Path(folder)
    file = folder / 'manifest.json'
    if not file.exists():
        raise InputError(f'{folder}: no manifest.json; must be a folder of `arm-brachy dataset`')
    manifest = json.loads(file.read_text())
    if manifest.get('format') != FORMAT:
        raise InputError(f'{file}: format {manifest.get("format")}; must be {FORMAT}; make the '
                         'data set again')
    shards = [np.load(path) for path in sorted(folder.glob('shard_*.npz'))]
    if not shards:
        raise InputError(f'{folder}: holds no shard yet; run `arm-brachy dataset` first')
    walks = [walk for shard in shards for walk in json.loads(str(shard['walks']))]
    return Dataset(manifest, *(np.concatenate([shard[key] for shard in shards])
                               for key in ('displacement', 'walk', 'fraction')), walks)


def _complete(folder, number, walks):
    """True if the shard is there with all its walks: the last of a smaller set has fewer."""
    file = shard_file(folder, number)
    if not file.exists():
        return False
    with np.load(file) as shard:
        return len(json.loads(str(shard['walks']))) >= len(walks)


def _replace(file, content):
    part = file.with_suffix('.part')
    part.write_bytes(content)
    part.replace(file)
