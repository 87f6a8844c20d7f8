"""Figures 5.7 to 5.9 on a small bench: a linear decoder whose answer is known."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.estimation.graph_vae.modes import modes_of
from arm_brachy.experiments import figure_5_7, figure_5_8, figure_5_9, latent_study


class Linear:
    """Stands for weights.Trained: exact for fields of three shapes."""

    def __init__(self, u):
        self.modes = modes_of(u, 3)
        self.encode, self.decode = self.modes.encode, self.modes.decode


@pytest.fixture(scope='module')
def bench():
    rng = stream(0, 'fields')
    shapes = 3e-3 * rng.standard_normal((3, 40, 3))
    u = np.einsum('sk,kni->sni', rng.standard_normal((60, 3)), shapes)
    trained = Linear(u)
    markers = np.eye(12, 40)

    def partial(z):
        return np.einsum('mn,sni->smi', markers, trained.decode(z)).reshape(len(z), -1)

    return latent_study.Bench(trained, u[:4].reshape(2, 2, 40, 3), markers, partial)


def test_markers_bring_the_mesh_to_the_target_the_faster_the_smaller_their_noise(bench):
    curves = {C_d: latent_study.curves(bench, 3, members=100, C_d=C_d, assimilations=5)
              for C_d in (0.1, 0.001)}
    assert curves[0.1].shape == (2, 3, 6)
    before, after = (curves[0.001][..., k].mean() for k in (0, -1))
    assert after < 0.05 * before and after < curves[0.1][..., -1].mean()


def test_the_network_at_best_is_beside_the_linear_modes(bench):
    assert latent_study.reconstruction(bench) == pytest.approx(np.zeros((2, 2)), abs=1e-12)


@pytest.mark.parametrize('module, rows', [(figure_5_7, 9), (figure_5_8, 15), (figure_5_9, 2)])
def test_figures_have_a_row_for_each_case(bench, module, rows, tmp_path, monkeypatch):
    monkeypatch.setattr(latent_study, 'bench', lambda folder: bench)
    result = module.reproduce(tmp_path, seeds=2)
    assert result.name == module.NAME
    assert len(result.rows) == rows and result.targets
    assert (tmp_path / f'{module.NAME}.png').stat().st_size > 10_000
