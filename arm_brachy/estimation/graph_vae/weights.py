"""A trained network as one .npz: mesh, options, weights, linear modes, where it comes from.

Test: estimation/graph_vae/test_training.py
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from arm_brachy.core.errors import InputError
from arm_brachy.estimation.graph_vae.graph import hierarchy, mesh_graph
from arm_brachy.estimation.graph_vae.network import GraphVae, NetworkOptions
from arm_brachy.tissue.body import TetMesh

FORMAT = 2
SHIPPED = Path(__file__).parent / 'weights'


@dataclass(frozen=True)
class Trained:
    """network : GraphVae;  mesh : TetMesh of its nodes;  forecast : Forecast
    about : dict, how it was made
    """

    network: GraphVae
    mesh: TetMesh
    forecast: object
    about: dict

    @property
    def modes(self):
        """The linear baseline: modes.Modes of the training states."""
        return self.network.modes

    def encode(self, u):
        """Latent means (s, k) of displacements (s, n, 3) [m], numpy."""
        with torch.no_grad():
            return self.network.encode(torch.from_numpy(u).float())[0].double().numpy()

    def decode(self, z):
        """Displacements (s, n, 3) [m] of latent variables (s, k), numpy."""
        with torch.no_grad():
            return self.network.decode(torch.from_numpy(z).float()).double().numpy()


@dataclass(frozen=True)
class Forecast:
    """What the travel of the scene's own pads says of the latent variables, before any marker.

    z is about features(q) @ map (of 1 row: whatever q), give or take `covariance` (k, k): over the
    training states, whose inclusions, compressibility, fibres, base and weight no travel tells.
    """

    map: np.ndarray
    covariance: np.ndarray
    stroke: float

    def mean(self, q):
        """(k,) for the travel q (p,) [m]."""
        return features(np.asarray(q)[None], self.stroke)[0, :len(self.map)] @ self.map


def features(q, stroke):
    """(s, f) products of travels q (s, p), up to the third degree, in units of `stroke` [m]."""
    x = q / stroke
    p = q.shape[1]
    pairs = [(i, j) for i in range(p) for j in range(i, p)]
    triples = [(i, j, k) for i, j in pairs for k in range(j, p)]
    return np.concatenate([np.ones((len(x), 1)), x,
                           np.stack([x[:, i] * x[:, j] for i, j in pairs], axis=1),
                           np.stack([x[:, i] * x[:, j] * x[:, k] for i, j, k in triples], axis=1)],
                          axis=1)


def fit_forecast(z, q, stroke, ridge=1e-3):
    """Return the Forecast of latent variables z (s, k) at travels q (s, p) [m]."""
    F = features(q, stroke)
    found = np.linalg.solve(F.T @ F + ridge * len(F) * np.eye(F.shape[1]) / F.shape[1], F.T @ z)
    left = z - F @ found
    covariance = left.T @ left / max(1, len(z) - F.shape[1]) if len(z) > F.shape[1] else np.eye(
        z.shape[1])
    return Forecast(found, covariance + 1e-6 * np.eye(z.shape[1]), stroke)


def new_network(mesh, options, seed, latent):
    """Return a GraphVae with its first, random weights on the nodes of a TetMesh."""
    middle = np.linalg.norm(mesh.nodes - mesh.nodes.mean(axis=0), axis=1).argmin()
    levels = hierarchy(mesh_graph(mesh), int(middle))
    generator = torch.Generator().manual_seed(seed)
    return GraphVae(levels, mesh.nodes, options, generator, latent=latent)


def save(trained, options, file):
    """Write a Trained to `file` (.npz); whole or not at all."""
    mesh, forecast = trained.mesh, trained.forecast
    arrays = {f'weight/{k}': v.numpy() for k, v in trained.network.state_dict().items()}
    arrays |= {'nodes': mesh.nodes, 'tets': mesh.tets,
               'forecast_map': forecast.map, 'forecast_covariance': forecast.covariance,
               'about': np.array(json.dumps({**trained.about, 'format': FORMAT,
                                             'latent': trained.network.latent,
                                             'stroke': forecast.stroke,
                                             'network': asdict(options)}))}
    if mesh.midside is not None:
        arrays['midside'] = mesh.midside
    part = Path(file).with_suffix('.part')
    with open(part, 'wb') as handle:
        np.savez_compressed(handle, **arrays)
    part.replace(file)


def load(file):
    """Return the Trained of a file. Raises InputError if it is none."""
    try:
        with np.load(file) as found:
            arrays = {key: found[key] for key in found.files}
        about = json.loads(str(arrays['about']))
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f'{file}: {error}; must be weights that `arm-brachy train` wrote'
                         ) from None
    if about['format'] != FORMAT:
        raise InputError(f'{file}: format {about["format"]}; must be {FORMAT}; train again')
    mesh = TetMesh(arrays['nodes'], arrays['tets'], {}, arrays.get('midside'))
    options = NetworkOptions(**{k: tuple(v) if isinstance(v, list) else v
                                for k, v in about['network'].items()})
    network = new_network(mesh, options, 0, about['latent'])
    network.load_state_dict({key[7:]: torch.from_numpy(np.array(value)) for key, value
                             in arrays.items() if key.startswith('weight/')})
    forecast = Forecast(arrays['forecast_map'], arrays['forecast_covariance'], about['stroke'])
    return Trained(network, mesh, forecast, about)
