"""Zero, drift and scale of the force sensors, without a model of the tissue."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.cell import pad_directions
from arm_brachy.diagnosis.isolation import force_bias
from arm_brachy.diagnosis.isolation.dropouts import gap_findings
from arm_brachy.diagnosis.isolation.force_balance import balance_findings
from arm_brachy.diagnosis.isolation.force_bias import (
    _fit,
    _fits,
    _rests,
    _unless_leant,
    force_findings,
)
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.evaluation.timeseries import Series
from arm_brachy.experiments.formula_recordings import coloured
from arm_brachy.registry import parse_terms


@pytest.fixture(scope='module')
def record(laboratory, pushes):
    known = {}

    def run(*entries, seed=31, **changes):
        key = repr((entries, seed, changes))
        if key not in known:
            lab = laboratory(parse_terms(list(entries), 'test'), seed, **changes)
            known[key] = lab.record(pushes(speeds=(0.02,))), lab.scene
        return known[key]
    return run


def test_a_drift_is_found_and_shared_by_no_other_pad(record):
    run, scene = record({'name': 'force_drift', 'rate_N_min': [0.0, 0.5, 0.0],
                         'pads': ['pad_1']})
    found, = force_findings(prepare(evidence_of(run, scene)))
    assert (found.term, found.parameter, found.channel) == ('force_drift', 'rate', 'pad_1')
    assert found.value == pytest.approx([0.0, 0.5 / 60.0, 0.0], abs=0.1 * 0.5 / 60.0)


def test_load_cells_of_one_axis_tell_the_drift_along_it(record):
    """The same recording as vectors along the pushes, and as readings in one axis."""
    run, scene = record({'name': 'force_drift', 'rate_N_min': [0.5, 0.5, 0.5],
                         'pads': ['pad_1']})
    ways = pad_directions(scene)
    read = np.sum(run.force.values * ways, axis=2, keepdims=True)
    found = [force_findings(prepare(evidence_of(replace(run, force=Series(run.force.t, one)),
                                                scene)))
             for one in (read * ways, read * [0.0, 0.0, -1.0])]
    for (drift,) in found:
        assert (drift.term, drift.parameter, drift.channel) == ('force_drift', 'rate', 'pad_1')
        assert drift.value == pytest.approx(ways[1] * ways[1].sum() * 0.5 / 60.0,
                                            abs=0.1 * 0.5 / 60.0)
        assert drift.value == pytest.approx(drift.parameters['rate'])
    np.testing.assert_allclose(found[0][0].value, found[1][0].value, rtol=1e-9)


def test_a_cell_of_three_axes_beside_two_of_one_tells_the_whole_drift(record):
    """Once, of the pad, as a vector; those beside it tell none, and nothing is said thrice."""
    run, scene = record({'name': 'force_drift', 'rate_N_min': [0.5, -0.4, 0.3],
                         'pads': ['pad_1']})
    ways, values = pad_directions(scene), run.force.values.copy()
    for k in (0, 2):
        values[:, k] = (values[:, k] @ ways[k])[:, None] * ways[k]
    prepared = prepare(evidence_of(replace(run, force=Series(run.force.t, values)), scene))
    assert len(prepared.evidence.get('force').names) == 5
    drift, = force_findings(prepared)
    assert (drift.term, drift.parameter, drift.channel) == ('force_drift', 'rate', 'pad_1')
    assert drift.value == pytest.approx(np.array([0.5, -0.4, 0.3]) / 60.0, abs=0.1 * 0.5 / 60.0)
    assert drift.sd.shape == (3,) and (drift.sd < 0.1 * 0.5 / 60.0).all()
    gaps = gap_findings(prepared)
    assert len(gaps) == len({(one.stream, one.channel, one.statement) for one in gaps})


def test_a_wrong_zero_is_found(record):
    run, scene = record({'name': 'force_drift', 'rate_N_min': [0, 0, 0],
                         'bias_N': [1.5, 0.0, 0.0], 'pads': ['pad_2']})
    found, = force_findings(prepare(evidence_of(run, scene)))
    assert (found.parameter, found.channel) == ('bias', 'pad_2')
    assert found.value == pytest.approx([1.5, 0.0, 0.0], abs=0.03)


def test_a_pad_that_touches_too_early_is_no_wrong_zero(record):
    """It presses at rest already, by more than sensors' zeros would explain (4.7 of them)."""
    run, scene = record({'name': 'actuator_gain', 'gain': 0.0, 'offset_mm': 0.75,
                         'actuators': [1]})
    prepared = prepare(evidence_of(run, scene))
    force = prepared.evidence.get('force')
    at_rest = np.abs(np.nanmean(force.values[force.t < 0.5, 1], axis=0)).max()
    assert at_rest > 4.7 * prepared.calibration.force_zero
    assert force_findings(prepared) == ()


@pytest.mark.parametrize('relaxing', [0.0, 0.5])
def test_recovery_of_the_tissue_is_no_drift(record, relaxing):
    """Half of the force relaxes with 1.5 s; after a push the pads are pulled."""
    run, scene = record(relaxing=relaxing)
    assert force_findings(prepare(evidence_of(run, scene))) == ()


def test_what_a_first_push_leaves_for_good_is_no_drift(record):
    """A guide that rubs: 0.15 N the one way until its pad is first pushed, the other way since."""
    run, scene = record()
    pushed = run.encoder.values[:, 2] > 1e-3
    since = run.force.t > run.encoder.t[pushed.argmax()]
    values = run.force.values.copy()
    values[since, 2, 0] += 0.15
    stepped = replace(run, force=Series(run.force.t, values))
    assert force_findings(prepare(evidence_of(stepped, scene))) == ()


def with_balance(run, gains=(1.0, 1.0, 1.0)):
    """A balance under the base that feels what the true pad forces do, and a weight of 5 N."""
    base = -(run.force.values / np.array(gains)[:, None]).sum(axis=1) + [0.0, 0.0, -5.0]
    base += 0.02 * np.random.default_rng(1).standard_normal(base.shape)
    values = np.concatenate([run.force.values, base[:, None]], axis=1)
    return replace(run, force=Series(run.force.t, values), force_pads=(*run.force_pads, 'base'))


def test_the_balance_tells_which_sensor_has_the_wrong_scale(record):
    run, scene = record({'name': 'force_gain', 'gain': 0.15, 'pads': ['pad_0']})
    found, = balance_findings(prepare(evidence_of(with_balance(run, (1.15, 1.0, 1.0)), scene)))
    assert (found.term, found.channel) == ('force_gain', 'pad_0')
    assert found.value == pytest.approx(0.15, rel=0.1)


def test_a_balance_that_agrees_finds_nothing(record):
    run, scene = record()
    assert balance_findings(prepare(evidence_of(with_balance(run), scene))) == ()
    assert balance_findings(prepare(evidence_of(run, scene))) == ()


def test_somebody_who_leans_on_it_is_no_drift_whichever_rests_that_falls_in(record):
    """A line and a memory of pushes bend to a force in one or two rests; a real drift stays."""
    sound, scene = record()
    drifting, _ = record({'name': 'force_drift', 'rate_N_min': [0.0, 0.5, 0.0],
                          'pads': ['pad_1']})
    prepared = prepare(evidence_of(sound, scene))
    force = prepared.evidence.get('force')
    rests = [force.t[rows] for rows in _rests(prepared, force)]
    assert len(rests) > 6
    for first in range(1, len(rests) - 2, 6):
        within = (force.t >= rests[first][0]) & (force.t <= rests[first + first % 2][-1])
        lean = np.multiply.outer(within, [[0.2, 0.0, 0.1]] * len(force.names))
        runs = [replace(run, force=Series(run.force.t, run.force.values + lean))
                for run in (sound, drifting)]
        none, (drift,) = (force_findings(prepare(evidence_of(run, scene))) for run in runs)
        assert none == ()
        assert (drift.parameter, drift.channel) == ('rate', 'pad_1')
        assert drift.value == pytest.approx([0.0, 0.5 / 60.0, 0.0], abs=0.1 * 0.5 / 60.0)


@pytest.mark.parametrize('rests, pads', [(5, 1), (6, 2), (8, 5)])
def test_noise_of_few_rests_is_no_lean(monkeypatch, rests, pads):
    """However well few numbers and many pasts bend to it; one sensor's fault is none either."""
    t = 2.0 * np.arange(rests)
    monkeypatch.setattr(force_bias, '_recovery', lambda *_: [np.exp(-(t % w) / 3.0)
                                                             for w in (7.0, 9.0, 11.0)])
    monkeypatch.setattr(force_bias, '_begun', lambda *_: ((t > 3.0).astype(float),))
    rng = np.random.default_rng(0)
    rows = [np.arange(10 * i, 10 * i + 10) for i in range(rests)]
    for case in range(30):
        seen = rng.normal(0.0, 5e-3, (rests, pads, 3))
        seen[2:4, 0] += 0.1 * (pads > 1 and case % 2)
        force = SimpleNamespace(t=np.repeat(t, 10), names=tuple(range(pads)),
                                values=np.repeat(seen, 10, axis=0),
                                valid=np.ones((10 * rests, pads), dtype=bool))
        fits = [_fits(None, force, k, rows, t, ()) for k in range(pads)]
        assert all(one is its[0][0] for one, its in zip(_unless_leant(fits), fits, strict=True))


def test_a_memory_that_is_over_by_the_next_rest_is_not_fitted_beside_a_lean_at_that_one():
    """Six seconds after a push it is smaller by exp(-15): one column too many, and no crash."""
    t = 6.0 * np.arange(17.0)
    lean, memory = (t == 42.0).astype(float), np.where(t < 42.0, 0.0, np.exp(-2.5 * (t - 40.0)))
    y = np.random.default_rng(0).normal(0.0, 5e-3, (17, 3))
    assert _fit([np.ones(17), t, lean, memory], y, t) is None
    one = _fit([np.ones(17), t, memory], y, t)
    X = np.stack([np.ones(17), t, memory], axis=1)
    assert one.beta == pytest.approx(np.linalg.lstsq(X, y)[0])
    assert one.covariance == pytest.approx(np.linalg.pinv(X) @ np.linalg.pinv(X).T)
    assert (one.left, one.dof) == (pytest.approx(y - X @ one.beta), 14)


@pytest.fixture(scope='module')
def wandering(record):
    """(draw, drift of pad_1 [N/min]) -> Finding each; cells that wander by 0.1 N in a minute."""
    run, scene = record()
    prepared = prepare(evidence_of(run, scene))
    force = prepared.evidence.get('force')

    def found(draw, drift=0.0):
        rng = np.random.default_rng(draw)
        noise = 0.1 * coloured(rng, (len(force.t), force.vectors[0].size), force.period, 0.9, 60.0)
        values = force.values + noise.reshape(force.values.shape)
        values[:, 1, 1] += drift / 60.0 * force.t
        streams = {**prepared.evidence.streams, 'force': replace(force, values=values)}
        return force_findings(replace(prepared, evidence=replace(prepared.evidence,
                                                                 streams=streams)))
    return found


def test_a_zero_that_wanders_is_no_drift(wandering):
    """Slow noise was taken for white from rest to rest: in 15 of 20 draws a pad had a drift."""
    assert not any(one.parameter == 'rate' for draw in range(5) for one in wandering(draw))


def test_a_drift_is_found_in_cells_that_wander(wandering):
    drift, = (one for one in wandering(0, 1.5) if one.parameter == 'rate')
    assert drift.channel == 'pad_1' and drift.sure
    assert drift.value == pytest.approx([0.0, 0.025, 0.0], abs=0.01)
