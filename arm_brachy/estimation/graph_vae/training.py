"""Training of the network: resumable, the same for the same seed, one thread.

Loss: mean squared displacement error plus beta times the Kullback-Leibler divergence from N(0, I);
beta = 2 s^2 / (3 n), which makes it the evidence bound of a Gaussian error of s a coordinate.
Weights of the epoch that reconstructs the validation states best are kept, the start included, so
that training longer never gives worse ones. Test: estimation/graph_vae/test_training.py
"""

import csv
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.random import stream
from arm_brachy.estimation.graph_vae import weights
from arm_brachy.estimation.graph_vae.modes import error, modes_of
from arm_brachy.estimation.graph_vae.network import LATENT, NetworkOptions
from arm_brachy.estimation.graph_vae.start import start_scaled
from arm_brachy.tissue.build import load_scene_mesh

BLOCK = 32              # states reconstructed at a time when nothing is learned
FORECAST = 1000         # states that the forecast is fitted to, about


@dataclass(frozen=True)
class TrainingOptions:
    """How to train; the thesis names none of these."""

    seed: int = 20260505
    epochs: int = 13
    batch: int = 16
    latent: int = LATENT
    rate: float = 2e-3          # of Adam, after the warm-up; falls to 0 as a cosine
    warm_up: float = 0.05       # share of the steps in which the rate and beta rise
    clip: float = 20.0          # largest norm of the gradient
    tolerance: float = quantity(0.1, 'mm', 's of the loss', low=1e-6,
                                source='half the error of a coordinate that is aimed at')
    hours: float = 6.0          # of processor time, all calls together


class Training:
    """A training in a folder: checkpoint.pt, curve.csv, weights.npz.

    data : dataset.Dataset;  mesh : TetMesh its states are of
    """

    def __init__(self, data, mesh, folder, options, *, scene=None, network=None):
        """scene : core.scene.Scene, whose pads the forecast is of;  network : NetworkOptions."""
        self.data, self.mesh, self.folder, self.options = data, mesh, Path(folder), options
        self.scene = scene
        self.travel = None if scene is None else travels(data, scene)
        self.shape = NetworkOptions() if network is None else network
        self.parts = {name: data.part(name) for name in ('train', 'validation', 'test')}
        for name, part in self.parts.items():
            if not len(part):
                raise InputError(f'data set: no state for {name}; must have one; make it larger')
        self.folder.mkdir(parents=True, exist_ok=True)
        self.network = weights.new_network(mesh, self.shape, options.seed, options.latent)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=options.rate)
        self.epoch, self.spent, self.best = 0, 0.0, np.inf
        if (self.folder / 'checkpoint.pt').exists():
            self._resume()
        else:
            seen = data.u[self.parts['train']]
            start_scaled(self.network, modes_of(seen, options.latent), seen)
            self._record(np.nan)

    def run(self, report=lambda epoch, row: None):
        """Train until the epochs or the hours are used up; returns the error [m] on validation."""
        while self.epoch < self.options.epochs and self.spent < 3600.0 * self.options.hours:
            begun = time.process_time()
            loss = self._pass()
            self.epoch += 1
            self.spent += time.process_time() - begun
            report(self.epoch, self._record(loss))
        return self.best

    def _pass(self):
        """One epoch; the order and the noise follow from the seed and its number."""
        rng = stream(self.options.seed, f'epoch/{self.epoch}')
        order = rng.permutation(self.parts['train'])
        batches = np.split(order, range(self.options.batch, len(order), self.options.batch))
        losses = []
        for k, batch in enumerate(batches):
            share = self._schedule((self.epoch + (k + 1) / len(batches)) / self.options.epochs)
            u = torch.from_numpy(self.data.u[np.sort(batch)])
            noise = torch.from_numpy(rng.standard_normal((len(u), self.options.latent))).float()
            self.optimiser.zero_grad()
            loss = self._loss(u, noise, share)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.options.clip)
            self.optimiser.step()
            losses.append(float(loss.detach()))
        return float(np.mean(losses))

    def _schedule(self, done):
        """Set the rate when a share `done` of all steps is made; returns the share of beta."""
        warm = self.options.warm_up
        share = min(1.0, done / warm) if warm else 1.0
        fall = 0.5 * (1.0 + np.cos(np.pi * max(0.0, done - warm) / (1.0 - warm)))
        for group in self.optimiser.param_groups:
            group['lr'] = float(self.options.rate * min(share, fall))
        return share

    def _loss(self, u, noise, share):
        """Of a batch, in units of the tolerance."""
        found, mean, spread = self.network(u, noise)
        squared = ((found - u) ** 2).mean() / self.options.tolerance ** 2
        divergence = 0.5 * (mean ** 2 + spread.exp() - 1.0 - spread).sum(dim=1).mean()
        return squared + share * 2.0 / (3.0 * u.shape[1]) * divergence

    def _record(self, loss):
        """Validate, keep the weights if they are the best so far, write a checkpoint."""
        row = {'epoch': self.epoch, 'cpu_s': round(self.spent, 1), 'loss': round(float(loss), 4),
               'validation_mm': round(1e3 * float(self.error('validation').mean()), 4)}
        new = not (self.folder / 'curve.csv').exists()
        with open(self.folder / 'curve.csv', 'a', newline='') as handle:
            writer = csv.DictWriter(handle, list(row))
            if new:
                writer.writeheader()
            writer.writerow(row)
        if row['validation_mm'] < self.best:
            self.best = row['validation_mm']
            self._keep()
        part = self.folder / 'checkpoint.part'
        torch.save({'network': self.network.state_dict(), 'epoch': self.epoch,
                    'optimiser': self.optimiser.state_dict(), 'spent': self.spent,
                    'best': self.best, 'options': asdict(self.options)}, part)
        part.replace(self.folder / 'checkpoint.pt')
        return row

    def _resume(self):
        found = torch.load(self.folder / 'checkpoint.pt', weights_only=True)
        for key in ('seed', 'latent', 'batch'):
            if found['options'][key] != getattr(self.options, key):
                raise InputError(f'{self.folder}: {key} = {found["options"][key]}; must be '
                                 f'{getattr(self.options, key)} to go on; give another folder')
        self.network.load_state_dict(found['network'])
        self.optimiser.load_state_dict(found['optimiser'])
        self.epoch, self.spent, self.best = found['epoch'], found['spent'], found['best']

    def error(self, part, network=None):
        """(s,) mean over nodes of the reconstruction's distance [m] for 'train', ..., 'test'."""
        network = self.network if network is None else network
        found, part = [], self.parts[part]
        with torch.no_grad():
            for k in range(0, len(part), BLOCK):
                u = self.data.u[part[k:k + BLOCK]]
                found.append(error(u, network(torch.from_numpy(u))[0].numpy()))
        return np.concatenate(found)

    def linear_error(self, part):
        """The same of the linear modes of the training states, as many as latent variables."""
        modes, found, part = self.network.modes, [], self.parts[part]
        for k in range(0, len(part), BLOCK):
            u = self.data.u[part[k:k + BLOCK]]
            found.append(error(u, modes.decode(modes.encode(u))))
        return np.concatenate(found)

    def _keep(self):
        about = {'seed': self.options.seed, 'epoch': self.epoch, 'cpu_s': round(self.spent, 1),
                 'states': len(self.parts['train']), 'scene': self.data.manifest.get('scene'),
                 'scene_sha256': self.data.manifest.get('scene_sha256'),
                 'data_seed': self.data.manifest.get('seed'),
                 'pads': [] if self.scene is None else
                 [[*pad.centre, *pad.direction] for pad in self.scene.pads],
                 'training': asdict(self.options)}
        trained = weights.Trained(self.network, self.mesh, self._forecast(), about)
        weights.save(trained, self.shape, self.folder / 'weights.npz')

    def _forecast(self):
        """Of training states with the scene's own pads."""
        part = self.parts['train']
        own = part[np.isfinite(self.travel[part]).all(axis=1)] if self.travel is not None else []
        own = own[::max(1, len(own) // FORECAST)]
        if not len(own):
            k = self.options.latent
            return weights.Forecast(np.zeros((1, k)), np.eye(k), 1.0)
        z = []
        with torch.no_grad():
            for k in range(0, len(own), BLOCK):
                z.append(self.network.encode(torch.from_numpy(self.data.u[own[k:k + BLOCK]]))[0])
        return weights.fit_forecast(torch.cat(z).double().numpy(), self.travel[own],
                                    max(pad.stroke for pad in self.scene.pads))

    def rows(self):
        """What the kept weights reconstruct, beside the linear modes, for a table."""
        kept = weights.load(self.folder / 'weights.npz')
        kinds = self.data.kinds()
        rows = []
        for name, part in self.parts.items():
            ours, linear = self.error(name, kept.network), self.linear_error(name)
            chosen = {'all': np.ones(len(part), dtype=bool), 'own': kinds[part] == 'own',
                      'random': kinds[part] == 'random'}
            rows += [{'states': name, 'contacts': kind, 'count': int(mask.sum()),
                      'network_mm': 1e3 * float(ours[mask].mean()),
                      'linear_modes_mm': 1e3 * float(linear[mask].mean()),
                      'epoch': kept.about['epoch'], 'cpu_s': kept.about['cpu_s']}
                     for kind, mask in chosen.items() if mask.any()]
        return rows


def travels(data, scene):
    """(s, p) travel [m] of a Scene's pads in the states of a Dataset, NaN with other contacts.

    Read off the node nearest to each pad's centre, which its disc covers wherever it was put.
    """
    mesh = load_scene_mesh(scene)
    own = data.kinds() == 'own'
    found = np.full((len(data.u), len(scene.pads)), np.nan)
    for i, pad in enumerate(scene.pads):
        node = np.linalg.norm(mesh.nodes - np.array(pad.centre), axis=1).argmin()
        direction = np.array(pad.direction) / np.linalg.norm(pad.direction)
        found[own, i] = data.u[own, node] @ direction
    return found
