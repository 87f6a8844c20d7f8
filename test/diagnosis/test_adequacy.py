"""Structured tests: right level under the model, power where a sum of squares has none."""

import numpy as np
import pytest
from scipy.stats import chi2

from arm_brachy.diagnosis.statistics.misfit_scan import scan

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


def by_threes(names):
    """Groups of each feature in channels 0 to 2, 3 to 5, ..."""
    groups = {}
    for i, (channel, feature) in enumerate(names):
        groups.setdefault((channel // 3, feature), []).append(i)
    return tuple(groups.values())


def test_level_is_as_stated(layout, rng):
    """Of 200 residuals that are as the model says, 5 % fall below 0.05, within 3 sd of that."""
    _, _, columns, _, U = layout
    chances = []
    for _ in range(200):
        r = U @ rng.normal(size=U.shape[1]) + rng.normal(size=len(U))
        chances.append(scan(U, r, columns, rng, draws=1000).chance)
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.046)


def test_level_is_as_stated_of_tests_judged_together(layout, rng):
    """Channels by threes, with correlations between the tests: still 5 % below 0.05."""
    _, _, columns, names, U = layout
    mixed = columns @ (np.eye(len(names)) + 0.3 * rng.normal(size=(len(names),) * 2)
                       / np.sqrt(len(names)))
    chances = []
    for _ in range(200):
        r = U @ rng.normal(size=U.shape[1]) + rng.normal(size=len(U))
        chances.append(scan(U, r, mixed, rng, together=by_threes(names), draws=1000).chance)
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.046)


def test_what_goes_along_no_axis_is_found_by_its_directions_together(layout, rng):
    """A trend of 4.0 sd in each of three channels: 6.9 sd in all, little in any."""
    channel, _, columns, names, U = layout
    time = columns[:, names.index((6, 'time'))] + columns[:, names.index((7, 'time'))] + columns[
        :, names.index((8, 'time'))]
    trend = time - 0.5 * np.isin(channel, (6, 7, 8))
    r = U @ rng.normal(size=U.shape[1]) + rng.normal(size=len(U))
    z = scan(U, r, columns, rng).z[[names.index((c, 'time')) for c in (6, 7, 8)]]
    size = np.sqrt(np.sum(trend[channel == 6]**2))
    r = r + sum((4.0 - z[i]) / size * trend * (channel == c) for i, c in enumerate((6, 7, 8)))
    alone = scan(U, r, columns, rng)
    together = scan(U, r, columns, rng, together=by_threes(names))
    assert names[together.worst] in [(6, 'time'), (7, 'time'), (8, 'time')]
    assert alone.chance > 1e-3 > 1e-5 > together.chance


def test_directions_that_repeat_each_other_are_one(layout, rng):
    """Three times the same column is no chi-square of three."""
    _, _, columns, _, U = layout
    r = rng.normal(size=len(U))
    thrice = np.hstack([columns[:, :1]] * 3)
    assert scan(U, r, thrice, rng, together=((0, 1, 2),)).chance == pytest.approx(
        scan(U, r, columns[:, :1], rng).chance, abs=0.03)


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
