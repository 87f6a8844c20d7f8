"""The decoder where it is wanted only: at nodes around markers and targets.

Test: estimation/graph_vae/test_network.py
"""

import numpy as np
import torch

from arm_brachy.estimation.graph_vae.sparse import Pattern


class PartialDecoder:
    """Decodes to some nodes: every layer, folded once, keeps the vertices that they depend on.

    network : GraphVae, whose weights do not change any more;  nodes : (k,)
    """

    def __init__(self, network, nodes):
        self._network, self._nodes = network, np.asarray(nodes)
        self._layers, needed = [], self._nodes
        for layer in reversed(network.upsamplings):
            values, pattern, needed = _rows(layer, needed)
            self._layers.insert(0, (layer, values, pattern))
        self._coarse = needed

    def __call__(self, z):
        """Displacements (batch, k, 3) [m] of latent variables (batch, latent), both float64."""
        network = self._network
        with torch.no_grad():
            z = torch.from_numpy(np.asarray(z)).float()
            x = network.coarse(z)[self._coarse]
            for layer, values, pattern in self._layers:
                x = layer.applied(x, values, pattern)
            return network.displacement(x, z, self._nodes).double().numpy()


def _rows(layer, vertices):
    """Entries and Pattern of an Upsampling's rows for `vertices`; the coarse vertices needed."""
    with torch.no_grad():
        values = layer.folded().flatten()[layer.near.order].numpy()
    begin, column = layer.near.begin.numpy(), layer.near.column.numpy()
    spans = [np.arange(begin[v], begin[v + 1]) for v in vertices]
    rows, kept = np.repeat(np.arange(len(spans)), [len(s) for s in spans]), np.concatenate(spans)
    basis = layer.B.shape[0]
    coarse, place = np.unique(column[kept] // basis, return_inverse=True)
    pattern = Pattern(rows, place * basis + column[kept] % basis,
                      (len(spans), len(coarse) * basis))
    return torch.from_numpy(values[kept]), pattern, coarse
