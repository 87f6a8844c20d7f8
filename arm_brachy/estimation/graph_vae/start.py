"""First weights: random, each layer scaled on training states so that its output has variance 1.

Layer-sequential unit variance (Mishkin & Matas 2016, ICLR, "All you need is a good init",
arXiv:1511.06422): the features before the activation have mean 0 and variance 1 over vertices and
states, from the displacement to the latent variables and back. Where the layers add to the linear
modes their output is scaled down, so that training begins at the linear modes.
Test: estimation/graph_vae/test_training.py
"""

import numpy as np
import torch

STATES = 128            # whose features are looked at
CERTAIN = -8.0          # log-variance of the latent variables at the start
# Coefficients are made smaller by it and matrices larger: their product alone counts, but Adam
# moves both by the same step, so that small ones learn faster. On 64 states of breast.yaml, 100
# steps brought 0.250 mm to 0.182, 0.166 and 0.183 mm with 1, 0.3 and 0.1.
BALANCE = 0.3
SHARE = 0.01            # of the layers' output beside the linear modes at the start


def start_scaled(network, modes, u):
    """Set normalisation and first weights of a GraphVae.

    modes : modes.Modes, as many as `network.latent`;  u : (s, n, 3) [m] training states
    """
    share = SHARE if network.linear else 1.0
    with torch.no_grad():
        network.normalise(modes, float(np.sqrt(((u - modes.mean) ** 2).mean())))
        some = torch.from_numpy(u[:: max(1, len(u) // STATES)]).float()
        x = ((some - network.mean) / network.length).transpose(0, 1)
        for convolution, pooling in zip(network.convolutions, network.poolings, strict=True):
            unit_variance(convolution, x)
            x = pooling(convolution(x))
        _start_head(network, x.transpose(0, 1).flatten(1), share)
        x = network.coarse(network.encode(some)[0])
        for upsampling in network.upsamplings:
            unit_variance(upsampling, x)
            x = upsampling(x)
        # of the last layer the coefficients, not the matrices: they are free at every vertex
        upsampling.a *= share / BALANCE
        upsampling.B *= BALANCE
        upsampling.b *= share


def unit_variance(layer, x):
    """Scale and shift a layer's output before its activation to mean 0 and variance 1."""
    layer.b.zero_()
    active, layer.active = layer.active, False
    y = layer(x).flatten(0, 1)
    layer.active = active
    scale = 1.0 / y.std(dim=0)
    layer.B *= scale / BALANCE
    layer.a *= BALANCE
    layer.b.copy_(-y.mean(dim=0) * scale)


def _start_head(network, flat, share):
    """Latent means of deviation `share` over the states, log-variances CERTAIN."""
    layer, k = network.to_latent, network.latent
    layer.weight[k:], layer.bias[k:] = 0.0, CERTAIN
    y = flat @ layer.weight[:k].T
    scale = share / y.std(dim=0)
    layer.weight[:k] *= scale[:, None]
    layer.bias[:k] = -y.mean(dim=0) * scale
