"""The variational auto-encoder of Table 5.1 (corrected): a deformed mesh to 26 numbers and back.

Encoder: three times convolution and pooling, features 32, 64, 128, then one linear layer with
2 x 26 outputs, mean and log-variance, where the table has 26. Decoder: one linear layer, then
three times un-pooling and convolution, features 64, 32, 3. Displacements are normalised by one
mean field and one length.

With `linear` the layers of the table add to a linear map (departure from Table 5.1): the latent
mean is that of the linear modes plus the encoder's output, the displacement the sum of the linear
modes plus the decoder's. Test: estimation/graph_vae/test_network.py
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from arm_brachy.estimation.graph_vae.layers import Convolution, Pooling, Upsampling
from arm_brachy.estimation.graph_vae.modes import Modes

FEATURES = (3, 32, 64, 128)     # Table 5.1
LATENT = 26                     # Table 5.1
MOST_SPREAD, LEAST_SPREAD = 4.0, -16.0  # of the log-variance


@dataclass(frozen=True)
class NetworkOptions:
    """What Table 5.1 leaves open: M of (5.3) at each convolution, in order of the data's way.

    linear : add the layers to the linear modes; False is Table 5.1 as it stands
    """

    encoder_basis: tuple = (6, 6, 8)
    decoder_basis: tuple = (16, 8, 6)
    linear: bool = True


class GraphVae(nn.Module):
    """Encoder and decoder on one body's graphs.

    levels : graph.hierarchy of the body;  positions : (n, 3) [m] of its nodes
    generator : torch.Generator of the first weights
    Displacements go in and come out in metres: (batch, n, 3).
    """

    def __init__(self, levels, positions, options, generator, *, latent=LATENT, features=FEATURES):
        super().__init__()
        self.positions = np.asarray(positions)
        self.latent, self.coarsest, self.widest = latent, len(levels[-1].centres), features[-1]
        pairs = list(zip(features[:-1], features[1:], strict=True))
        self.convolutions = nn.ModuleList(
            Convolution(level.edges, basis, pair, generator)
            for level, basis, pair in zip(levels, options.encoder_basis, pairs, strict=True))
        self.poolings = nn.ModuleList(Pooling(level.pool, generator) for level in levels)
        flat = self.coarsest * self.widest
        self.to_latent = _linear(flat, 2 * latent, generator)
        self.from_latent = _linear(latent, flat, generator)
        self.upsamplings = nn.ModuleList(
            Upsampling(level, basis, pair[::-1], generator, active=level is not levels[0])
            for level, basis, pair in zip(levels[::-1], options.decoder_basis, pairs[::-1],
                                          strict=True))
        self.places = [np.arange(levels[0].size)]   # nodes where each graph's vertices lie
        for level in levels[:-1]:
            self.places.append(self.places[-1][level.centres])
        self.linear = options.linear
        self.register_buffer('mean', torch.zeros(levels[0].size, 3))
        self.register_buffer('length', torch.ones(()))
        self.register_buffer('shapes', torch.zeros(latent, levels[0].size, 3))
        self.register_buffer('spread', torch.ones(latent))

    @property
    def modes(self):
        """The linear modes.Modes of the states it was trained on, as many as latent variables."""
        return Modes(*(field.double().numpy() for field in (self.mean, self.shapes, self.spread)))

    def normalise(self, modes, length):
        """Set mean field and linear modes from Modes, and the length [m] of a displacement."""
        for buffer, value in ((self.mean, modes.mean), (self.shapes, modes.shapes),
                              (self.spread, modes.spread)):
            buffer.copy_(torch.from_numpy(value))
        self.length.fill_(length)

    def encode(self, u):
        """Return mean and log-variance of the latent variables, each (batch, latent)."""
        off = u - self.mean
        x = (off / self.length).transpose(0, 1)
        for convolution, pooling in zip(self.convolutions, self.poolings, strict=True):
            x = pooling(convolution(x))
        mean, spread = self.to_latent(x.transpose(0, 1).flatten(1)).chunk(2, dim=1)
        if self.linear:
            mean = mean + off.flatten(1) @ self.shapes.flatten(1).T / self.spread
        return mean, spread.clamp(LEAST_SPREAD, MOST_SPREAD)

    def decode(self, z):
        """Return displacements (batch, n, 3) [m] of latent variables (batch, latent)."""
        x = self.coarse(z)
        for upsampling in self.upsamplings:
            x = upsampling(x)
        return self.displacement(x, z)

    def displacement(self, x, z, nodes=slice(None)):
        """(batch, k, 3) [m] at `nodes`: output x (k, batch, 3) of the layers for z, in metres."""
        u = x.transpose(0, 1) * self.length + self.mean[nodes]
        if self.linear:
            u = u + torch.tensordot(z * self.spread, self.shapes[:, nodes], 1)
        return u

    def coarse(self, z):
        """Features (coarsest, batch, widest) of latent variables."""
        x = nn.functional.elu(self.from_latent(z))
        return x.unflatten(1, (self.coarsest, self.widest)).transpose(0, 1)

    def forward(self, u, noise=None):
        """Reconstruction, mean and log-variance; noise (batch, latent) standard normal or None."""
        mean, spread = self.encode(u)
        z = mean if noise is None else mean + noise * torch.exp(0.5 * spread)
        return self.decode(z), mean, spread


def _linear(inputs, outputs, generator):
    layer = nn.Linear(inputs, outputs)
    with torch.no_grad():
        layer.weight.copy_(torch.randn(outputs, inputs, generator=generator) / inputs ** 0.5)
        layer.bias.zero_()
    return layer
