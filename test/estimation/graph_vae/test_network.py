"""Graphs, layers and the network: rules of the thesis, independent forms, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from arm_brachy.core.errors import MeshError
from arm_brachy.core.random import stream
from arm_brachy.estimation.graph_vae.decoder import PartialDecoder
from arm_brachy.estimation.graph_vae.graph import Level, hierarchy, mesh_graph
from arm_brachy.estimation.graph_vae.layers import Convolution, Pooling, Upsampling
from arm_brachy.estimation.graph_vae.network import GraphVae, NetworkOptions
from arm_brachy.estimation.graph_vae.sparse import Pattern
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import quadratic_mesh

MESH = quadratic_mesh(box_mesh((0.06, 0.05, 0.04), (3, 3, 2)))
LEVELS = hierarchy(mesh_graph(MESH))
OPTIONS = NetworkOptions((2, 3, 2), (3, 2, 2))
FEATURES = (3, 5, 6, 7)


def network(seed=0, levels=LEVELS, positions=MESH.nodes):
    made = GraphVae(levels, positions, OPTIONS, torch.Generator().manual_seed(seed), latent=4,
                    features=FEATURES).double()
    made.length.fill_(2e-3)
    fields = stream(seed, 'mean').standard_normal((5, len(positions), 3))
    made.mean.copy_(torch.from_numpy(1e-3 * fields[0]))
    made.shapes.copy_(torch.from_numpy(fields[1:] / np.sqrt(fields[0].size)))
    made.spread.copy_(torch.tensor([4e-2, 3e-2, 2e-2, 1e-2]))
    return made


def states(count=3, seed=1):
    return torch.from_numpy(2e-3 * stream(seed, 'u').standard_normal((count, len(MESH.nodes), 3)))


def test_edges_are_those_of_small_tetrahedra_and_join_only_near_nodes():
    graph = mesh_graph(MESH).tocoo()
    a, b = graph.coords
    length = np.linalg.norm(MESH.nodes[a] - MESH.nodes[b], axis=1)
    whole = np.linalg.norm(np.ptp(MESH.nodes[MESH.tets[0]], axis=0))
    assert length.max() <= 0.5 * whole + 1e-12
    corners = np.unique(MESH.tets)
    assert not np.any(np.isin(a, corners) & np.isin(b, corners))
    assert np.abs(mesh_graph(MESH) - mesh_graph(MESH).T).sum() == 0


def test_centres_keep_the_stride_and_pooling_reaches_every_vertex():
    sizes = [level.size for level in LEVELS] + [len(LEVELS[-1].centres)]
    assert sizes == sorted(sizes, reverse=True) and sizes[-1] <= 6
    joined = mesh_graph(MESH).toarray()[np.ix_(LEVELS[0].centres, LEVELS[0].centres)]
    assert not joined.any()     # stride 2: no centre next to another
    for level in LEVELS:
        assert set(level.pool[1].tolist()) == set(range(level.size))


def test_a_mesh_in_two_pieces_is_refused():
    graph = mesh_graph(MESH).tolil()
    graph[0, :] = 0
    graph[:, 0] = 0
    with pytest.raises(MeshError, match='2 pieces'):
        hierarchy(graph.tocsr())


def test_sparse_product_and_its_derivatives():
    rng = stream(0, 'sparse')
    dense = rng.random((6, 5)) < 0.5
    dense[-1, -1] = True
    rows, columns = rng.permutation(np.argwhere(dense)).T
    pattern = Pattern(rows, columns, (6, 5))
    values = torch.from_numpy(rng.standard_normal(len(rows))).requires_grad_()
    x = torch.from_numpy(rng.standard_normal((5, 3))).requires_grad_()
    full = torch.zeros(6, 5, dtype=torch.float64).index_put(
        (torch.from_numpy(rows), torch.from_numpy(columns)), values)
    assert torch.allclose(pattern.product(values, x), full @ x)
    assert torch.autograd.gradcheck(lambda v, y: pattern.product(v, y), (values, x))


def naive_convolution(edges, layer, x):
    """(5.2), (5.3) as they are written."""
    y = layer.b.repeat(int(edges[0].max()) + 1, x.shape[1], 1)
    for e, (i, j) in enumerate(edges.T):
        W = torch.einsum('k,kio->io', layer.a[e], layer.B)
        y[i] = y[i] + x[j] @ W
    return torch.nn.functional.elu(y) if layer.active else y


def test_convolution_equals_the_formula():
    level = LEVELS[1]
    layer = Convolution(level.edges, 3, (4, 5), torch.Generator().manual_seed(0)).double()
    x = torch.from_numpy(stream(2, 'x').standard_normal((level.size, 2, 4)))
    assert torch.allclose(layer(x), naive_convolution(level.edges, layer, x), atol=1e-12)


def test_pooling_is_a_weighted_mean_whatever_the_sign_of_rho():
    layer = Pooling(LEVELS[1].pool, torch.Generator().manual_seed(0)).double()
    with torch.no_grad():
        layer.rho[::2] *= -3.0
    coarse, fine = LEVELS[1].pool
    weight = layer.rho.abs().detach().numpy()
    x = stream(2, 'x').standard_normal((LEVELS[1].size, 2, 4))
    own = [np.average(x[fine[coarse == i]], axis=0, weights=weight[coarse == i])
           for i in range(coarse.max() + 1)]
    assert np.allclose(layer(torch.from_numpy(x)).detach().numpy(), own, atol=1e-12)
    same = layer(torch.ones(LEVELS[1].size, 1, 1, dtype=torch.float64))
    assert torch.allclose(same, torch.ones_like(same))


def test_unpooling_and_convolution_fold_into_one():
    level = LEVELS[1]
    layer = Upsampling(level, 3, (6, 5), torch.Generator().manual_seed(0)).double()
    x = torch.from_numpy(stream(2, 'x').standard_normal((len(level.centres), 2, 6)))
    apart = naive_convolution(level.edges, layer, layer.unpool(x))
    assert torch.allclose(layer(x), apart, atol=1e-12)


def test_shapes_and_the_variational_head():
    net = network()
    mean, spread = net.encode(states())
    assert mean.shape == spread.shape == (3, 4)
    assert net.decode(mean).shape == (3, len(MESH.nodes), 3)
    assert net.to_latent.out_features == 8 and net.from_latent.in_features == 4


@pytest.mark.parametrize('way', ['encode', 'decode'])
def test_derivatives_with_respect_to_input_and_every_weight_match_central_differences(way):
    net = network()
    x = states(2) if way == 'encode' else torch.from_numpy(stream(3, 'z').standard_normal((2, 4)))
    unit = 1e-3 if way == 'encode' else 1.0

    def value():
        out = net.encode(x)[0] if way == 'encode' else net.decode(x)[:, ::7] / 1e-3
        return (out * torch.linspace(0.5, 1.5, out.numel()).view(out.shape)).sum()

    x.requires_grad_()
    value().backward()
    used = [(name, p) for name, p in net.named_parameters() if p.grad is not None]
    assert len(used) == 14
    for name, p in [('input', x), *used]:
        step = (1e-5 * unit if name == 'input' else 1e-5) * torch.randn(
            p.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
        with torch.no_grad():
            p += step
            ahead = value()
            p -= 2.0 * step
            behind = value()
            p += step
        expected = float((p.grad * step).sum())
        assert float(ahead - behind) / 2.0 == pytest.approx(expected, rel=1e-5, abs=1e-9), name


def relabelled(levels, order):
    """Levels with the finest graph's vertices renumbered: new number of old vertex v: order[v]."""
    first = levels[0]
    edges = np.array([order[first.edges[0]], order[first.edges[1]]])
    by = np.lexsort((edges[1], edges[0]))
    pool = np.array([first.pool[0], order[first.pool[1]]])
    by_pool = np.lexsort((pool[1], pool[0]))
    level = Level(edges[:, by], order[first.centres], pool[:, by_pool])
    return (level, *levels[1:]), by, by_pool


def test_relabelling_the_nodes_relabels_the_output_and_changes_nothing_else():
    order = stream(4, 'order').permutation(len(MESH.nodes))
    levels, by, by_pool = relabelled(LEVELS, order)
    back = np.argsort(order)
    one, other = network(), network(levels=levels, positions=MESH.nodes[back])
    weights = dict(one.state_dict())
    weights['convolutions.0.a'] = weights['convolutions.0.a'][by]
    weights['upsamplings.2.a'] = weights['upsamplings.2.a'][by]
    weights['poolings.0.rho'] = weights['poolings.0.rho'][by_pool]
    fine = np.lexsort(LEVELS[0].pool)
    now = np.lexsort(levels[0].pool)
    weights['upsamplings.2.unpool.rho'] = weights['upsamplings.2.unpool.rho'][
        np.argsort(fine)][by_pool][now]
    weights['mean'] = weights['mean'][back]
    weights['shapes'] = weights['shapes'][:, back]
    other.load_state_dict(weights)
    u = states()
    (m1, s1), (m2, s2) = one.encode(u), other.encode(u[:, back])
    assert torch.allclose(m1, m2, atol=1e-11) and torch.allclose(s1, s2, atol=1e-11)
    assert torch.allclose(one.decode(m1)[:, back], other.decode(m1), atol=1e-13)


def test_without_the_linear_modes_they_add_nothing():
    """Table 5.1 as it stands, and what `linear` adds to it: mean and displacement of the modes."""
    alone = GraphVae(LEVELS, MESH.nodes, replace(OPTIONS, linear=False),
                     torch.Generator().manual_seed(0), latent=4, features=FEATURES).double()
    both, u = network(), states()
    alone.load_state_dict(both.state_dict())
    modes = both.modes
    mean, spread = both.encode(u)
    linear = modes.encode(u.numpy())
    assert np.allclose(mean.detach() - alone.encode(u)[0].detach(), linear, atol=1e-10)
    assert torch.equal(spread, alone.encode(u)[1])
    added = (both.decode(mean) - alone.decode(mean)).detach().numpy()
    assert np.allclose(added, modes.decode(mean.detach().numpy()) - modes.mean, atol=1e-12)


def test_partial_decoder_gives_what_the_whole_one_does():
    net = network().float()
    z = stream(5, 'z').standard_normal((3, 4))
    nodes = np.array([3, 0, 40, 41])
    with torch.no_grad():
        whole = net.decode(torch.from_numpy(z).float())[:, nodes].numpy()
    assert np.abs(PartialDecoder(net, nodes)(z) - whole).max() < 1e-8
