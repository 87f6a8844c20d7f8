"""The whitened vector of everything measured, and what may be in it without a cause."""

import numpy as np
import pytest

from arm_brachy.cell import pad_directions
from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.likelihood.nuisances import Priors, nuisances
from arm_brachy.diagnosis.likelihood.observation import (
    Measured,
    Observables,
    channels_of,
    measured,
)
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.load_states import load_states
from arm_brachy.diagnosis.signals.loading import Evidence
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.stream import Stream

STATES = np.array([2.5, 7.4, 9.0])
NAMES = {'optical': ('a', 'b', 'c'), 'em': ('tip',), 'force': ('pad',)}


def correlated(n=4):
    """Two of three markers, in another order than the model's; one value was not seen."""
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    correlation = 0.7 ** lag
    rng = np.random.default_rng(5)
    sd = rng.uniform(1e-4, 3e-4, (n, 2, 3))
    valid = np.ones((n, 2), dtype=bool)
    valid[1, 0] = False
    return Measured('optical', ('c', 'a'), np.zeros((n, 2, 3)), valid, sd, correlation)


def noise(stream, rng):
    factor = np.linalg.cholesky(stream.correlation)
    return stream.sd * np.einsum('ij,jca->ica', factor, rng.standard_normal(stream.sd.shape))


def test_noise_of_any_colour_and_size_comes_out_white():
    stream, rng = correlated(), np.random.default_rng(7)
    both = Observables((stream,), NAMES)
    model = {'optical': np.zeros((4, 3, 3))}
    draws = []
    for _ in range(1500):
        measured = Measured('optical', stream.names, noise(stream, rng), stream.valid, stream.sd,
                            stream.correlation)
        draws.append(Observables((measured,), NAMES).residual(model))
    covariance = np.cov(np.array(draws).T)
    assert covariance.shape == (len(both.rows),) * 2 == (21, 21)
    assert np.abs(covariance - np.eye(21)).max() < 5.0 * np.sqrt(2.0 / 1500)


def test_a_slow_sensor_makes_no_model_more_exact():
    """Noise that hardly changes cancels in differences; what a model is wrong by does not."""
    n, slow, own = 40, 1.0, 1e-5
    correlation = 0.999 ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    stream = Measured('em', ('tip',), np.zeros((n, 1, 3)), np.ones((n, 1), bool),
                      np.full((n, 1, 3), slow * own), correlation, np.full((n, 1, 3), own))
    both, rng = Observables((stream,), NAMES), np.random.default_rng(3)
    wrong = own * rng.standard_normal((n, 1, 3))
    told = both.residual({'em': wrong})
    assert np.mean(told**2) < 1.0 + 4.0 * np.sqrt(2.0 / (3 * n))
    assert both.sd == pytest.approx(np.full(3 * n, np.sqrt(2.0) * own))
    thought_slow = Measured('em', ('tip',), stream.values, stream.valid,
                            np.full((n, 1, 3), np.sqrt(2.0) * own), correlation)
    assert np.mean(Observables((thought_slow,), NAMES).residual({'em': wrong})**2) > 100.0


def test_a_sensor_of_one_axis_has_a_row_a_state_along_it():
    """Whatever is compared with it, or taken off it, counts by its part along the axis."""
    rng, way = np.random.default_rng(4), np.array([0.6, 0.0, -0.8])
    predicted, shift = rng.standard_normal((2, 5, 1, 3))
    measured = 0.1 + (predicted @ way)[..., None]
    stream = Measured('force', ('pad',), measured, np.ones((5, 1), bool), np.full((5, 1, 1), 0.05),
                      np.eye(5), along=way[None])
    both = Observables((stream,), NAMES)
    assert [(row.axis, row.state) for row in both.rows] == [(2, i) for i in range(5)]
    assert both.residual({'force': predicted}) == pytest.approx(np.full(5, 2.0))
    assert both.less({'force': shift}).residual({'force': predicted - shift}) == pytest.approx(
        np.full(5, 2.0))
    assert both.whiten_shift({'force': shift}) == pytest.approx((shift @ way)[:, 0] / 0.05)
    assert both.at(np.array([1, 3])).residual({'force': predicted[[1, 3]]}) == pytest.approx(
        np.full(2, 2.0))


def test_what_was_not_seen_has_no_row_and_names_find_their_place():
    both = Observables((correlated(),), NAMES)
    assert not any(row.channel == 'c' and row.state == 1 for row in both.rows)
    assert not any(row.channel == 'b' for row in both.rows)
    only_a = {'optical': np.zeros((4, 3, 3, 1))}
    only_a['optical'][:, 0] = 1e-3
    moved = both.whiten(only_a)[:, 0] != 0.0
    assert {row.channel for row, m in zip(both.rows, moved, strict=True) if m} == {'a'}


def test_residual_and_columns_are_whitened_alike():
    stream = correlated()
    shift = {'optical': np.random.default_rng(2).normal(size=(4, 3, 3))}
    both = Observables((stream,), NAMES)
    columns = both.whiten({'optical': shift['optical'][..., None]})
    assert np.allclose(both.residual(shift), -columns[:, 0])


def test_a_channel_that_the_model_does_not_have_is_refused():
    with pytest.raises(InputError, match='optical has c'):
        Observables((correlated(),), {**NAMES, 'optical': ('a', 'b')})


@pytest.fixture(scope='module')
def baseline(linear, encoder):
    return Baseline(ForwardModel(linear), encoder, STATES)


def test_touch_offsets_are_those_of_encoders_that_begin_elsewhere(baseline, encoder):
    found = nuisances(baseline, Calibration(touch=2e-5))
    column = found.names.index('touch_pad_2')
    shifted = Path(encoder.t, encoder.q + 2e-5 * np.array([0.0, 1.0, 0.0, 0.0]))
    new = baseline.model.predict(shifted, STATES)
    for kind in ('optical', 'em', 'force'):
        expected = new.get(kind) - baseline.shown[kind]
        off = np.linalg.norm(found.values[kind][..., column] - expected)
        assert off < 0.02 * np.linalg.norm(expected)


def test_without_weight_the_modulus_scales_forces_and_moves_nothing(baseline):
    found = nuisances(baseline, priors=Priors(modulus=0.5))
    column = found.names.index('modulus')
    assert np.allclose(found.values['force'][..., column], 0.5 * baseline.shown['force'],
                       rtol=1e-3, atol=1e-6)
    assert np.abs(found.values['optical'][..., column]).max() < 1e-8


def test_frames_turn_rigidly_and_nuisances_are_complete(baseline, linear):
    found = nuisances(baseline)
    markers, tools, pads = (len(names) for names in channels_of(linear).values())
    assert len(found.names) == 6 + 3 * markers + 3 * tools + 3 * pads + 2 * pads + 1
    turn = found.values['optical'][..., found.names.index('frame_turn_z')]
    points = baseline.shown['optical']
    apart = points[:, :, None] - points[:, None]
    turned = turn[:, :, None] - turn[:, None]
    assert np.abs(np.sum(apart * turned, axis=3)).max() < 1e-15   # distances stay, to first order


@pytest.fixture(scope='module')
def prepared(coarse_scene, encoder):
    """The scene's markers at rest under white noise, the first one hidden during a hold."""
    scene, rng = coarse_scene('linear'), np.random.default_rng(11)
    rest = np.array([m.position for m in scene.markers])
    values = rest + 1e-4 * rng.standard_normal((len(encoder.t), *rest.shape))
    values[(encoder.t > 1.5) & (encoder.t < 3.1), 0] = np.nan
    optical = Stream('optical', encoder.t, tuple(m.name for m in scene.markers), values,
                     np.isfinite(values).all(axis=2), tuple(m.body for m in scene.markers), rest)
    pads = tuple(p.name for p in scene.pads)
    pushes = Stream('encoder', encoder.t, pads, encoder.q[..., None],
                    np.ones(encoder.q.shape, dtype=bool), pads, np.zeros((len(pads), 1)))
    return prepare(Evidence('made up', scene, pad_directions(scene),
                            {'optical': optical, 'encoder': pushes}))


def test_load_states_become_rows_where_a_marker_was_seen(prepared):
    states = load_states(prepared)
    stream, = measured(states)
    hidden = (states.t - states.width > 1.5) & (states.t + states.width < 3.1)
    assert hidden.any() and stream.valid[:, 1:].all()
    assert np.array_equal(stream.valid[hidden, 0], np.zeros(hidden.sum(), dtype=bool))
    both = Observables((stream,), {'optical': stream.names})
    assert len(both.rows) == 3 * stream.valid.sum()
    rest = prepared.evidence.get('optical').rest
    residual = both.residual({'optical': np.broadcast_to(rest, stream.values.shape)})
    assert 0.7 < np.sqrt(np.mean(residual**2)) < 1.4   # the noise's size is found from a second


def test_more_noise_adds_its_own_covariance():
    """Covariance of either part, added."""
    stream, f = correlated(), 2.5
    memory = np.exp(-np.abs(np.subtract.outer(np.arange(4.0), np.arange(4.0))))
    louder = Observables((stream,), NAMES).louder({'optical': f}, memory)
    one, = louder.measured
    for c in range(2):
        for axis in range(3):
            sd = stream.sd[:, c, axis]
            wanted = np.outer(sd, sd) * (stream.correlation + (f - 1.0) * memory)
            found = np.outer(*2 * [one.sd[:, c, axis]]) * one.correlation
            np.testing.assert_allclose(found, wanted, rtol=1e-12)
    same = Observables((stream,), NAMES).louder({'em': f}, memory).measured[0]
    np.testing.assert_array_equal(same.sd, stream.sd)
    np.testing.assert_array_equal(same.correlation, stream.correlation)


def test_a_factor_of_every_state_goes_through_the_whitening():
    both, rng = Observables((correlated(),), NAMES), np.random.default_rng(8)
    values, factors = rng.normal(size=(4, 3, 3, 1)), rng.uniform(0.0, 2.0, 4)
    plain = both.whiten({'optical': values})[:, 0]
    grown = both.whiten({'optical': factors[:, None, None, None] * values})[:, 0]
    assert np.allclose(both.times(plain, factors), grown, rtol=1e-10)
    assert not np.allclose(plain, grown)
