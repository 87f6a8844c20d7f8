"""Structured tests: right level under the model, power where a sum of squares has none."""

import numpy as np
import pytest
from scipy.stats import chi2

from arm_brachy.diagnosis.adequacy import scan

CHANNELS, STATES = 40, 50


@pytest.fixture
def rng():
    return np.random.default_rng(8)


@pytest.fixture
def layout(rng):
    """Rows of 40 channels at 50 states, features of the states, a nuisance per channel."""
    channel = np.repeat(np.arange(CHANNELS), STATES)
    depth = np.tile(rng.uniform(0.0, 1.0, STATES), CHANNELS)
    time = np.tile(np.linspace(0.0, 1.0, STATES), CHANNELS)
    features = {'constant': np.ones_like(depth), 'depth': depth, 'depth^2': depth**2,
                'time': time}
    names = [(c, name) for c in range(CHANNELS) for name in features]
    columns = np.column_stack([(channel == c) * features[name] for c, name in names])
    nuisance = 10.0 * (channel[:, None] == np.arange(CHANNELS))
    return channel, depth, columns, names, nuisance


def test_level_is_as_stated(layout, rng):
    """Of 200 residuals that are as the model says, 5 % fall below 0.05, within 3 sd of that."""
    _, _, columns, _, U = layout
    chances = []
    for _ in range(200):
        r = U @ rng.normal(size=U.shape[1]) + rng.normal(size=len(U))
        chances.append(scan(U, r, columns, rng, draws=1000).chance)
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.046)


def test_a_trend_in_one_channel_is_found_where_the_sum_of_squares_sees_nothing(layout, rng):
    channel, depth, columns, names, U = layout
    r = rng.normal(size=len(U)) + 3.0 * (channel == 7) * (depth - 0.5)
    found = scan(U, r, columns, rng)
    assert names[found.worst][0] == 7 and names[found.worst][1].startswith('depth')
    assert found.chance < 1e-3
    assert chi2.sf(np.sum(r**2), len(r)) > 0.01


def test_what_the_model_explains_is_not_held_against_it(layout, rng):
    """A constant per channel is a nuisance here: however large, it is no misfit."""
    channel, _, columns, names, U = layout
    r = rng.normal(size=len(U)) + 8.0 * (channel == 3)
    assert scan(U, r, columns, rng).chance > 0.01
