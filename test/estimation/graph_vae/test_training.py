"""Start at the linear modes, training that goes on, weights that come back."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from arm_brachy.core.errors import InputError
from arm_brachy.core.random import stream
from arm_brachy.estimation.graph_vae import weights
from arm_brachy.estimation.graph_vae.dataset import Dataset
from arm_brachy.estimation.graph_vae.modes import error, modes_of
from arm_brachy.estimation.graph_vae.network import NetworkOptions
from arm_brachy.estimation.graph_vae.training import Training, TrainingOptions
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import quadratic_mesh

MESH = quadratic_mesh(box_mesh((0.06, 0.05, 0.04), (4, 4, 3)))
SHAPE = NetworkOptions((2, 3, 2), (4, 3, 3))
ALONE = replace(SHAPE, linear=False)     # Table 5.1 without the linear modes
OPTIONS = TrainingOptions(seed=3, epochs=3, batch=8, latent=4)


def fields(z):
    """Smooth displacements (s, n, 3) [m] that bend with z (s, 4): what 4 linear modes leave."""
    X = MESH.nodes / np.ptp(MESH.nodes, axis=0)
    waves = np.stack([X[:, [0, 1, 2]], X[:, [1, 2, 0]] ** 2, np.sin(3.0 * X[:, [2, 0, 1]]),
                      X[:, [1, 0, 2]] * X[:, [2, 2, 1]]])
    bends = np.cos(4.0 * waves)
    u = np.einsum('sk,kni->sni', z, waves) + 0.2 * np.einsum('sk,kni->sni', z ** 2, bends)
    return (2e-3 * u).astype(np.float32)


def small_set(count=60):
    walk = np.repeat(np.arange(count // 3), 3)
    z = stream(0, 'z').standard_normal((count, 4))
    walks = [{'number': int(k), 'kind': 'random'} for k in np.unique(walk)]
    return Dataset({'scene': 'box'}, fields(z), walk, np.ones(count), walks)


DATA = small_set()


def train(folder, options=OPTIONS, data=DATA, shape=SHAPE):
    return Training(data, MESH, folder, options, network=shape)


@pytest.fixture(scope='module')
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp('trained')
    training = train(folder)
    training.run()
    return training


def test_modes_are_the_best_linear_ones():
    u = DATA.u.astype(float)
    modes = modes_of(u, 3)
    values = np.linalg.svd((u - u.mean(axis=0)).reshape(len(u), -1), compute_uv=False)
    left = ((modes.decode(modes.encode(u)) - u) ** 2).sum()
    assert left == pytest.approx((values[3:] ** 2).sum(), rel=1e-6)
    assert np.allclose(modes.encode(u).std(axis=0), 1.0)
    assert np.allclose(modes.encode(modes.decode(np.eye(3))), np.eye(3), atol=1e-9)


def test_the_start_encodes_and_decodes_as_the_linear_modes_do(tmp_path):
    training = train(tmp_path, replace(OPTIONS, epochs=0))
    u = DATA.u[training.parts['train']]
    modes = modes_of(u, 4)
    z = modes.encode(u)
    with torch.no_grad():
        mean, _ = training.network.encode(torch.from_numpy(u))
        decoded = training.network.decode(torch.from_numpy(z).float()).numpy()
    assert np.abs(mean.numpy() - z).max() < 0.1
    size = error(u, modes.mean).mean()
    assert error(decoded, modes.decode(z)).mean() < 0.02 * size
    linear = training.linear_error('test').mean()
    test = DATA.u[training.parts['test']]
    assert linear == pytest.approx(error(test, modes.decode(modes.encode(test))).mean(), rel=1e-3)
    assert training.error('test').mean() < linear + 0.02 * size


def test_at_the_start_every_layer_has_mean_0_and_variance_1_over_the_training_states(tmp_path):
    training = train(tmp_path, replace(OPTIONS, epochs=0), shape=ALONE)
    network, u = training.network, torch.from_numpy(DATA.u[training.parts['train']])
    with torch.no_grad():
        x = ((u - network.mean) / network.length).transpose(0, 1)
        for convolution, pooling in zip(network.convolutions, network.poolings, strict=True):
            flat = before_activation(convolution, x).flatten(0, 1)
            assert np.allclose(flat.mean(dim=0), 0.0, atol=1e-4)
            assert np.allclose(flat.std(dim=0), 1.0, atol=1e-3)
            x = pooling(convolution(x))
        z = network.encode(u)[0]
        assert np.allclose(z.std(dim=0), 1.0, atol=1e-3)
        x = network.coarse(z)
        for upsampling in network.upsamplings:
            flat = before_activation(upsampling, x).flatten(0, 1)
            assert np.allclose(flat.std(dim=0), 1.0, atol=1e-3)
            x = upsampling(x)


def before_activation(layer, x):
    active, layer.active = layer.active, False
    y = layer(x)
    layer.active = active
    return y


def test_table_5_1_without_the_linear_modes_learns_the_states_from_random_weights(tmp_path):
    """Sanity of start, rate and gradient: few states are reconstructed to a part of their size."""
    training = train(tmp_path, replace(OPTIONS, epochs=20, rate=1e-2), shape=ALONE)
    before = training.error('train').mean()
    training.run()
    size = error(DATA.u[training.parts['train']], training.network.modes.mean).mean()
    assert before > size                    # random: worse than the mean field
    assert training.error('train').mean() < 0.35 * size


def test_layers_beside_the_linear_modes_learn_what_these_leave(tmp_path):
    training = train(tmp_path, replace(OPTIONS, epochs=20, rate=5e-3))
    linear = training.linear_error('train').mean()
    training.run()
    assert training.error('train').mean() < 0.7 * linear


def test_training_lowers_the_loss_and_keeps_the_best_weights(trained):
    with open(trained.folder / 'curve.csv', newline='') as handle:
        rows = list(csv.DictReader(handle))
    assert [row['epoch'] for row in rows] == ['0', '1', '2', '3']
    assert float(rows[3]['loss']) < float(rows[1]['loss'])
    kept = weights.load(trained.folder / 'weights.npz')
    best = min(float(row['validation_mm']) for row in rows)
    assert 1e3 * trained.error('validation', kept.network).mean() == pytest.approx(best, abs=2e-4)


def test_ended_and_begun_again_it_comes_to_the_same_weights(trained, tmp_path):
    options = replace(OPTIONS, epochs=3)
    first = train(tmp_path, options)
    first.run(lambda epoch, row: setattr(first, 'spent', 1e9) if epoch == 1 else None)
    assert first.epoch == 1
    saved = torch.load(tmp_path / 'checkpoint.pt', weights_only=True)
    torch.save(saved | {'spent': 0.0}, tmp_path / 'checkpoint.pt')
    again = train(tmp_path, options)
    assert again.epoch == 1
    again.run()
    for name, value in again.network.state_dict().items():
        assert torch.equal(value, trained.network.state_dict()[name]), name


def test_another_seed_does_not_go_on(trained):
    with pytest.raises(InputError, match='seed = 3; must be 4 to go on'):
        train(trained.folder, replace(OPTIONS, seed=4))


def test_a_set_without_validation_states_is_refused(tmp_path):
    with pytest.raises(InputError, match='no state for validation'):
        train(tmp_path, data=replace(DATA, walk=np.zeros(60, dtype=int)))


def test_table_has_the_linear_modes_beside_the_network(trained):
    rows = trained.rows()
    assert {row['states'] for row in rows} == {'train', 'validation', 'test'}
    assert all(np.isfinite(row['network_mm']) and row['linear_modes_mm'] > 0.0 for row in rows)


def test_weights_come_back_with_mesh_modes_and_their_origin(trained):
    kept = weights.load(trained.folder / 'weights.npz')
    assert np.array_equal(kept.mesh.nodes, MESH.nodes)
    assert np.array_equal(kept.mesh.midside, MESH.midside)
    assert kept.about['seed'] == 3 and kept.about['states'] == len(trained.parts['train'])
    assert json.dumps(kept.about)
    z = np.eye(4)
    assert np.allclose(kept.modes.decode(z), trained.network.modes.decode(z), atol=1e-8)


def test_a_file_that_is_no_network_is_refused(tmp_path):
    (tmp_path / 'weights.npz').write_bytes(b'nothing')
    with pytest.raises(InputError, match='arm-brachy train'):
        weights.load(tmp_path / 'weights.npz')


def test_forecast_knows_what_travel_tells_and_how_much_it_leaves_open():
    rng = stream(6, 'forecast')
    q = rng.uniform(0.0, 0.03, (400, 2))
    x = q / 0.03
    z = np.stack([x[:, 0] + x[:, 1] ** 2, 2.0 * x[:, 0] * x[:, 1]], axis=1)
    z += rng.standard_normal(z.shape) * [0.1, 0.2]
    found = weights.fit_forecast(z, q, 0.03, ridge=1e-6)
    assert np.allclose(found.mean([0.03, 0.015]), [1.25, 1.0], atol=0.08)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([0.1, 0.2], rel=0.15)
