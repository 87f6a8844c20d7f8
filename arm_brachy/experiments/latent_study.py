"""ES-MDA in latent space on states that the network has not seen: figures 5.7 to 5.9.

Ten pairs of test states, as in sec. 5.4: the first is the mesh that the prior is drawn around, the
second the one whose markers are measured. The states are solved for anew from the seed of the data
set and the numbers of its test walks, so that nothing but the shipped weights is needed.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.random import stream
from arm_brachy.core.scene import load_scene
from arm_brachy.estimation.es_mda import RankDeficient, equal_alphas, es_mda
from arm_brachy.estimation.graph_vae import weights
from arm_brachy.estimation.graph_vae.decoder import PartialDecoder
from arm_brachy.estimation.graph_vae.loads import LoadOptions, draw_walk
from arm_brachy.estimation.graph_vae.modes import error
from arm_brachy.estimation.graph_vae.walk import walk_states
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.tissue.build import marker_points
from arm_brachy.tissue.mesh import embed

SCENE = 'breast'
PAIRS = 10              # sec. 5.4
SEEDS = 20              # of markers and members, of one setting
SWEEP_SEEDS = 5         # the same of each of many settings: with ten pairs 50 runs a curve
SEED = 57
NOISE = 0.15e-3 / np.sqrt(3.0)      # m, of a marker's coordinate: OptiTrack, as the cell's tracker
# The thesis gives C_d no unit; its errors are in centimetres, so these are taken as cm^2.
CD_UNIT = 1e-4
LAST = 9                # test walks have numbers that end in it (graph_vae.dataset.SPLITS)
CACHE = 'latent-states'


class Case(NamedTuple):
    """Settings of one curve: N_e, C_d [cm^2] and N_a of the thesis."""

    members: int
    C_d: float
    assimilations: int


@dataclass(frozen=True)
class Bench:
    """Network, markers and pairs of unseen states.

    trained : weights.Trained;  pairs : (PAIRS, 2, n, 3) [m] displacements
    markers : (m, n) weights of the nodes at the scene's tissue markers
    partial : z (s, k) -> displacements of the markers (s, 3 m) [m]
    """

    trained: object
    pairs: np.ndarray
    markers: np.ndarray
    partial: object


def bench(folder):
    """Return the Bench; states are kept beside `folder`, some twenty walks of seconds each."""
    trained = weights.load(weights.SHIPPED / f'{SCENE}.npz')
    scene = load_scene(config_dir() / 'scenes' / f'{SCENE}.yaml')
    seed = trained.about['data_seed']
    cache = Path(folder).parent / CACHE
    cache.mkdir(parents=True, exist_ok=True)
    states = [_state(scene, seed, LAST + 10 * k, cache) for k in range(2 * PAIRS)]
    names, points = marker_points(scene)
    rider = embed(trained.mesh, points, names=names)
    pairs = np.array(states).reshape(PAIRS, 2, *states[0].shape)
    matrix = rider.matrix(len(trained.mesh.nodes)).toarray()
    nodes = np.flatnonzero(matrix.any(axis=0))
    decoder = PartialDecoder(trained.network, nodes)

    def partial(z):
        return np.einsum('mk,ski->smi', matrix[:, nodes], decoder(z)).reshape(len(z), -1)

    return Bench(trained, pairs, matrix, partial)


def _state(scene, seed, number, cache):
    """Last state of one walk."""
    file = cache / f'{SCENE}-{seed}-{number}.npy'
    if not file.is_file():
        walk = draw_walk(scene, seed, number)
        np.save(file, walk_states(walk, LoadOptions().steps)[0][-1])
    return np.load(file)


def assimilate(bench, pair, seed, *, members, assimilations, C_d):
    """Mean distance [m] of mesh and target before and after each assimilation: (Na + 1,).

    pair : number;  seed : of marker noise and members;  C_d : variance as the thesis gives it
    """
    first, target = bench.pairs[pair]
    rng = stream(SEED, f'{pair}/{seed}')
    observed = (bench.markers @ target).ravel()
    observed = observed + NOISE * rng.standard_normal(len(observed))
    mean = bench.trained.encode(first[None])[0]
    z = mean + rng.standard_normal((members, len(mean)))
    found = es_mda(z, bench.partial, observed, np.full(len(observed), C_d * CD_UNIT), rng,
                   alphas=equal_alphas(assimilations))
    return error(bench.trained.decode(found.means), target)


def curves(bench, seeds, **options):
    """(PAIRS, seeds, Na + 1) of `assimilate`."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RankDeficient)   # N_e = 10 is one of the thesis' cases
        return np.array([[assimilate(bench, pair, seed, **options) for seed in range(seeds)]
                         for pair in range(len(bench.pairs))])


def sweep(name, cases, draw, targets, out_dir, seeds=SWEEP_SEEDS):
    """Assimilate the pairs in every Case; NAME.png receives what `draw` makes of the curves.

    draw : {Case: (pairs, seeds, Na + 1) [m]} -> Figure
    targets : {Case: mean error in the end [m]} -> tuple of Target
    out_dir : folder;  seeds : of markers and members. Returns Result, a row for each Case.
    """
    made = bench(out_dir)
    found = {case: curves(made, seeds, **case._asdict()) for case in cases}
    draw(found).savefig(Path(out_dir) / f'{name}.png', dpi=150)
    rows = tuple({'members': case.members, 'C_d_cm2': case.C_d,
                  'assimilations': case.assimilations} | _row(curve)
                 for case, curve in found.items())
    return Result(name, SEED, commit_of(share_dir()), machine_description(), rows,
                  targets({case: float(curve[..., -1].mean()) for case, curve in found.items()}))


def _row(curve):
    """What a table says of curves (pairs, seeds, Na + 1)."""
    ends = style.MM * curve[..., -1]
    return {'before_mm': style.MM * float(curve[..., 0].mean()), 'after_mm': float(ends.mean()),
            'after_sd_over_seeds_mm': float(ends.std(axis=1).mean())}


def reconstruction(bench):
    """(PAIRS, 2) [m] error of the targets by the network and by as many linear modes."""
    modes = bench.trained.modes
    found = []
    for _, target in bench.pairs:
        ours = bench.trained.decode(bench.trained.encode(target[None]))[0]
        linear = modes.decode(modes.encode(target[None]))[0]
        found.append([error(ours[None], target[None])[0], error(linear[None], target[None])[0]])
    return np.array(found)
