"""Test of prove/oracle.py against a generalised least squares that is written out."""

import numpy as np
import pytest
from scipy.signal import lfilter

from arm_brachy.prove.folder import TrialFolder, read_json
from arm_brachy.prove.oracle import analyse_all, seen, whitened
from arm_brachy.prove.plan import Job

RNG = np.random.default_rng(5)


def by_hand(effect, nuisances, rival=None):
    """Standard score of an effect's amplitude, from the covariance of everything fitted."""
    columns = [effect, *nuisances.T] if rival is None else [effect, rival, *nuisances.T]
    a = np.column_stack(columns)
    prior = np.zeros(a.shape[1])
    prior[-nuisances.shape[1]:] = 1.0
    return 1.0 / np.sqrt(np.linalg.inv(a.T @ a + np.diag(prior))[0, 0])


def test_detectability_and_separation_are_those_of_a_fit_with_priors():
    effect, rival, nuisances = RNG.normal(size=40), RNG.normal(size=40), RNG.normal(size=(40, 6))
    rival = rival + effect
    found = seen(effect, nuisances, [('rival', rival)])
    assert found['detectability_sd'] == pytest.approx(by_hand(effect, nuisances))
    assert found['separation_sd'] == pytest.approx(by_hand(effect, nuisances, rival))


def test_a_rival_of_the_same_shape_leaves_nothing():
    effect, nuisances = RNG.normal(size=30), RNG.normal(size=(30, 2))
    found = seen(effect, nuisances, [('far', RNG.normal(size=30)), ('twin', -3.0 * effect)])
    assert found['rival'] == 'twin'
    assert found['separation_sd'] == pytest.approx(0.0, abs=1e-6)


def test_an_effect_that_is_a_nuisance_is_only_seen_beyond_its_prior():
    """Ten prior deviations of a nuisance that is measured well: 10 sd and no more."""
    column = 1e4 * np.ones(50)
    found = seen(10.0 * column, column[:, None], [])
    assert found['detectability_sd'] == pytest.approx(10.0, rel=1e-4)


def test_a_rival_that_cannot_be_seen_is_none():
    found = seen(np.ones(9), np.zeros((9, 1)), [('faint', 1e-3 * np.ones(9))])
    assert found['separation_sd'] is None
    assert found['detectability_sd'] == pytest.approx(3.0)


def test_noise_comes_out_white_and_of_size_one():
    """Coloured noise at 60 Hz, averaged over 0.1 s: variance 1 within 4 sd of its estimate."""
    rate, sd, share, memory, dt = 60.0, 0.05, 0.25, 0.3, 0.1
    rho = np.exp(-1.0 / (memory * rate))
    drive = RNG.normal(size=120_000) * np.sqrt(1.0 - rho**2)
    slow = lfilter([1.0], [1.0, -rho], drive)
    noise = sd * (np.sqrt(1.0 - share) * RNG.normal(size=len(slow)) + np.sqrt(share) * slow)
    sampled = noise.reshape(-1, 6).mean(axis=1)[:, None]
    white = whitened(sampled, dt, sd, share, memory, rate)[:, 0]
    assert np.var(white) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(white)) + 0.03)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 4.0 / np.sqrt(len(white)) + 0.02


class InOrder:
    """Workers that do their tasks here and stop at `after`."""

    def __init__(self, after):
        self._left = after

    def each(self, work, tasks):
        for task in tasks:
            if not self._left:
                raise KeyboardInterrupt
            self._left -= 1
            yield work(*task)


def test_bodies_that_were_seen_are_not_looked_at_again(tmp_path):
    folder = TrialFolder(tmp_path)
    jobs = [Job(f'case_{i}', 'single', 'backlash', i // 2, 1, i) for i in range(6)]
    steps = []

    def analysed(after):
        return analyse_all(folder, jobs, ('absolute',), 'made_up_signals', InOrder(after),
                           lambda stage, done, of: steps.append((done, of)))
    with pytest.raises(KeyboardInterrupt):
        analysed(after=1)
    assert set(read_json(folder / 'oracle.json')) == {'case_0', 'case_1'}
    assert set(analysed(after=2)) == {job.name for job in jobs}
    assert steps == [(0, 3), (1, 3), (1, 3), (2, 3), (3, 3)]
    found = read_json(folder / 'oracle.json')['case_0']['absolute']
    # Of a unit vector e times its size, beside a column of ones: e' (1 + 1 1')^-1 e = 1 - 1/6.
    assert found['detectability_sd'] == pytest.approx(
        np.sqrt(5.0 / 6.0) * found['at_best_detectability_sd'])
    assert found['rival'] == 'twin' and found['separation_sd'] < found['detectability_sd']
