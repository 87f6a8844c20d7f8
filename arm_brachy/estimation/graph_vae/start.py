"""First weights: those with which the network of Table 5.1 is the linear baseline.

ELU is the identity above zero, so that features with a bias above their largest value pass through
the layers unchanged. With free coefficients a_ijk that leaves each layer linear in them: solved in
least squares, layer by layer, they make the encoder project on the modes of the training states
and the decoder sum them up. Training then has only to learn what is not linear. Features that are
not needed for it start at random. Test: estimation/graph_vae/test_training.py
"""

import numpy as np
import torch

ROOM = 1.3              # bias over largest feature of the training states, that others fit too
RIDGE = 1e-12           # of the trace, in the least squares of the decoder
BLIND = 1e-3            # the same of the encoder, of the mean eigenvalue
DEGREE = 3              # of the moments of the displacement that the encoder starts with
STATES = 300            # whose features are looked at
SMALL = -6.0            # log-variance of the latent variables at the start
LINEAR = 0.7            # share of the coarsest graph's features that start as linear ones


def start_linear(network, modes, u):
    """Set the weights of a GraphVae so that it encodes and decodes as Modes do, more or less.

    modes : modes.Modes, at least `network.latent`;  u : (s, n, 3) [m] training states
    """
    with torch.no_grad():
        network.mean.copy_(torch.from_numpy(modes.mean))
        network.length.fill_(float(np.sqrt(((u - modes.mean) ** 2).mean())))
        some = u[:: max(1, len(u) // STATES)]
        _start_encoder(network, modes, some)
        _start_decoder(network, modes, torch.from_numpy(modes.encode(some)).float())


def _start_encoder(network, modes, u):
    """Moments of the displacement go through to the coarsest graph; the last layer weighs them."""
    first, second, third = network.convolutions
    x = torch.from_numpy((u - modes.mean) / float(network.length)).float().transpose(0, 1)
    # The displacement and its negative, so that the bias of the one cancels that of the other.
    _pass_on(first, 3)
    first.B[:, :, 3:6] = -first.B[:, :, :3]
    _above_zero(first, x, 6)
    x = network.poolings[0](first(x))
    moments = _take_moments(second, network.positions[network.places[1]])
    _above_zero(second, x, moments)
    x = network.poolings[1](second(x))
    _pass_on(third, moments)
    _above_zero(third, x, moments)
    x = network.poolings[2](third(x)).transpose(0, 1)[:, :, :moments]
    _weigh(network, x, modes.encode(u)[:, :network.latent])


def _take_moments(convolution, positions):
    """Features p, q become displacement p times the q-th product of coordinates; their number.

    positions : (v, 3) [m] of the vertices
    """
    receiver, sender = convolution.ends
    basis, _, out = convolution.B.shape
    scaled = 2.0 * (positions - positions.min(axis=0)) / np.ptp(positions, axis=0) - 1.0
    powers = [(a, b, c) for total in range(DEGREE + 1) for a in range(total + 1)
              for b in range(total + 1 - a) for c in [total - a - b]]
    powers = powers[:min(basis, out // 3)]
    products = np.stack([np.prod(scaled ** p, axis=1) for p in powers], axis=1)
    share = 1.0 / np.bincount(receiver)[receiver]
    count = 3 * len(powers)
    convolution.B[:, :, :count] = 0.0
    for q in range(len(powers)):
        convolution.a[:, q] = torch.from_numpy(products[sender, q] * share)
        for p in range(3):
            convolution.B[q, p, 3 * q + p], convolution.B[q, 3 + p, 3 * q + p] = 0.5, -0.5
    return count


def _weigh(network, x, z):
    """Last layer of the encoder by ridge regression; x : (s, coarsest, moments), z : (s, k)."""
    flat = x.flatten(1).double().numpy()
    mean, middle = flat.mean(axis=0), z.mean(axis=0)
    gram = (flat - mean) @ (flat - mean).T
    gram[np.diag_indices_from(gram)] += BLIND * np.trace(gram) / len(gram)
    found = (flat - mean).T @ np.linalg.solve(gram, z - middle)
    layer, k = network.to_latent, network.latent
    layer.weight.zero_()
    share = layer.weight[:k].view(k, network.coarsest, network.widest)
    share[:, :, :x.shape[2]] = torch.from_numpy(found.T).view(k, *x.shape[1:])
    layer.bias[:k] = torch.from_numpy(middle - mean @ found)
    layer.bias[k:] = SMALL


def _pass_on(convolution, count):
    """Features 0 .. count - 1 go through as their mean over the neighbours; no other enters."""
    receiver = torch.from_numpy(convolution.ends[0])
    convolution.a[:, 0] = 1.0 / torch.bincount(receiver)[receiver].float()
    convolution.B[:, :, :count] = 0.0
    convolution.B[0, :count, :count] = torch.eye(count)


def _above_zero(layer, x, count):
    """Bias the first features above zero for inputs x; give the others mean 0 and spread 1."""
    layer.active, active = False, layer.active
    layer.b.zero_()
    y = layer(x).flatten(0, 1)
    layer.active = active
    layer.b[:count] = -y[:, :count].amin() + (ROOM - 1.0) * y[:, :count].abs().amax()
    spread = y[:, count:].std(dim=0).clamp_min(1e-6)
    layer.B[:, :, count:] /= spread
    layer.b[count:] = -y[:, count:].mean(dim=0) / spread


def _start_decoder(network, modes, z):
    """z : (s, all) coordinates of states in all the modes."""
    k = network.latent
    z = z[:, :k]
    linear = int(LINEAR * network.widest)
    weight = network.from_latent.weight.view(network.coarsest, network.widest, k)
    bias = network.from_latent.bias.view(network.coarsest, network.widest)
    weight[:, :k] = torch.eye(k)
    bias.zero_()
    bias[:, :linear] = ROOM * (weight[:, :linear] @ z.T).abs().max()
    affine = torch.cat([weight, bias[..., None]], dim=2)[:, :linear].double().numpy()
    shapes = modes.shapes[:k] * (modes.spread[:k, None, None] / float(network.length))
    x = network.coarse(z)
    for upsampling, where in zip(network.upsamplings, network.places[::-1], strict=True):
        target = np.zeros((len(where), 3, k + 1))
        target[:, :, :k] = shapes[:, where].transpose(1, 2, 0)
        affine = _start_upsampling(upsampling, x, affine, target, upsampling is
                                   network.upsamplings[0])
        x = upsampling(x)


def _start_upsampling(upsampling, x, affine, target, coarsest):
    """Make outgoing features 0 to 2 the displacement, those after it the latent variables.

    x : incoming features of some states;  affine : (v, f, k + 1) what the first f of them are of
    the latent variables and 1;  target : (w, 3, k + 1) the displacement;  coarsest : nothing that
    enters is a displacement. Returns `affine` of what goes out.
    """
    k, linear, out = target.shape[2] - 1, affine.shape[1], upsampling.B.shape[2]
    passes, begin = out > 3, int(out > 3)
    z_in = 0 if coarsest else 3
    B = upsampling.B
    B[:, linear:, :3] = 0.0
    if not coarsest:
        for number in range(9):
            B[begin + number, :, :3] = 0.0
            B[begin + number, number // 3, number % 3] = 1.0
    if passes:
        receiver = torch.from_numpy(upsampling.ends[0])
        upsampling.a[:, 0] = 1.0 / torch.bincount(receiver)[receiver].float()
        B[0, :, :3] = 0.0
        B[:, :, 3:3 + k] = 0.0
        B[0, z_in:z_in + k, 3:3 + k] = torch.eye(k)
        B[1:, :, 3 + k:] = 0.0
    made = _fitted(upsampling, affine, target, begin)
    if not passes:
        upsampling.b.zero_()
        return made
    _above_zero(upsampling, x, 3 + k)
    passed = np.repeat(affine[:1, z_in:z_in + k], len(made), axis=0)
    result = np.concatenate([made, passed], axis=1)
    result[:, :, k] += upsampling.b[:3 + k].double().numpy()
    return result


def _fitted(upsampling, affine, target, begin):
    """Solve for the coefficients of B_begin .. at every receiver; returns what they make of it."""
    coarse = torch.from_numpy(affine).flatten(1).float()
    rho = upsampling.unpool.weights()
    fine = upsampling.unpool.near.product(rho, coarse).double().numpy().reshape(
        -1, *affine.shape[1:])
    B = upsampling.B[begin:, :affine.shape[1], :3].double().numpy()
    receiver, sender = upsampling.ends
    bounds = np.searchsorted(receiver, np.arange(len(target) + 1))
    made = np.zeros_like(target)
    for i in range(len(target)):
        span = slice(bounds[i], bounds[i + 1])
        near = np.einsum('jfz,kfo->jkoz', fine[sender[span]], B, optimize=True)
        near = near.reshape(-1, target[i].size)
        gram = near.T @ near
        gram[np.diag_indices_from(gram)] += RIDGE * np.trace(gram)
        found = near @ np.linalg.solve(gram, target[i].ravel())
        upsampling.a[span, begin:] = torch.from_numpy(found.reshape(-1, len(B))).float()
        made[i] = (found @ near).reshape(target[i].shape)
    return made
