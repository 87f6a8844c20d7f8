"""Errors on kinds held out, of made-up parts whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.estimation.cross_validation import Part, chords, stream_fits
from arm_brachy.diagnosis.likelihood.observation import Measured, Observables
from arm_brachy.diagnosis.statistics.linear_gaussian import stacked

N, SD, SHIFT, EFFECT = 40, 1e-4, 2e-3, 5e-4


def part(rng, effect=EFFECT, named=True):
    """One marker at N states of two kinds, off by a shift and by an effect that grows."""
    size = np.tile(np.linspace(0.0, 1.0, N // 2), 2)[:, None, None] * np.ones((N, 1, 3))
    values = SHIFT + effect * size + SD * rng.standard_normal((N, 1, 3))
    measured = Measured('optical', ('a',), values, np.ones((N, 1), dtype=bool),
                        np.full((N, 1, 3), SD), np.eye(N))
    both = Observables((measured,), {'optical': ('a',)})
    zero = {'optical': np.zeros((N, 1, 3))}
    shifts = np.zeros((N, 1, 3, 3))
    shifts[:, 0] = 1e-2 * np.eye(3)
    U, J = both.whiten({'optical': shifts}), both.whiten({'optical': 1e-3 * size[..., None]})
    kinds = np.array(['slow', 'fast'])[(np.arange(N) >= N // 2).astype(int)][both.states]
    r = both.residual(zero)
    return Part(both, kinds, both.difference(zero), r, U, np.zeros(3, dtype=bool),
                np.zeros(3, dtype=bool), np.zeros(3, dtype=bool), np.zeros(len(r)),
                r if named else None, J if named else None)


def test_errors_fall_from_the_scene_as_it_came_to_the_noise():
    fit, = stream_fits([part(np.random.default_rng(1))])
    assert fit.as_given == pytest.approx(SHIFT + 0.5 * EFFECT, rel=0.02)
    assert fit.recalibrated == pytest.approx(np.hypot(EFFECT / np.sqrt(12.0), SD), rel=0.1)
    assert fit.named == pytest.approx(SD, rel=0.15) == fit.noise_floor


def test_without_a_cause_none_is_scored():
    fit, = stream_fits([part(np.random.default_rng(2), named=False)])
    assert fit.named is None


def test_a_recording_in_which_nothing_was_found_stays_as_it_is():
    """A step in one of two: the other is met as before, whichever comes first."""
    rng = np.random.default_rng(4)
    hit, sound = part(rng), part(rng, 0.0, named=False)
    both = [stream_fits(some)[0] for some in ((hit, sound), (sound, hit))]
    assert both[0].named == pytest.approx(SD, rel=0.15)
    assert both[0].named == pytest.approx(both[1].named, rel=1e-9)
    assert both[0].recalibrated > 1.5 * both[0].named


def test_a_recording_that_was_not_fitted_is_predicted_from_those_that_were():
    """Its own shift, known from the other by being shared, is not fitted to it again."""
    rng = np.random.default_rng(3)
    fit, = stream_fits([part(rng, 0.0)], [('later', part(rng))])
    assert fit.held_out == 'later'
    assert fit.recalibrated == pytest.approx(np.hypot(EFFECT / np.sqrt(3.0), SD), rel=0.1)


def test_where_the_tracker_stood_in_a_recording_held_out_is_no_prediction():
    """Its frame is matched there; how the effect grows is not."""
    rng, alone = np.random.default_rng(5), np.ones(3, dtype=bool)
    fitted, later = (replace(part(rng, size), own=alone, set_up=alone) for size in (0.0, EFFECT))
    fit, = stream_fits([fitted], [('later', later)])
    assert fit.recalibrated == pytest.approx(np.hypot(EFFECT / np.sqrt(12.0), SD), rel=0.1)
    unplaced, = stream_fits([replace(fitted, set_up=~alone)],
                            [('later', replace(later, set_up=~alone))])
    assert unplaced.recalibrated > SHIFT


def test_what_a_mesh_may_be_wrong_by_is_fitted_and_predicts_nothing():
    """Of a column of the mesh that explains all, the error stays; with the cause it goes."""
    one = part(np.random.default_rng(6))
    one = replace(one, U=np.hstack([one.U, one.columns]), own=np.zeros(4, dtype=bool),
                  mesh=np.array([False, False, False, True]), set_up=np.zeros(4, dtype=bool))
    fit, = stream_fits([one])
    # Less than the effect about its mean: the mesh was not taken for the shift.
    assert fit.recalibrated == pytest.approx(np.hypot(EFFECT / np.sqrt(3.0), SD), rel=0.1)
    fit, = stream_fits([replace(one, columns=10.0 * one.columns)])
    assert fit.named == pytest.approx(SD, rel=0.15)


def test_what_finer_elements_add_is_fitted_beside_and_predicts_nothing():
    """The effect is all the mesh's: known to be so it is not taken for the shift, and stays."""
    one = part(np.random.default_rng(7))
    fit, = stream_fits([replace(one, of_mesh=one.columns @ [EFFECT / 1e-3])])
    whole, plain = np.hypot(EFFECT / np.sqrt(3.0), SD), np.hypot(EFFECT / np.sqrt(12.0), SD)
    assert fit.recalibrated == pytest.approx(whole, rel=0.1) and whole > 1.4 * plain


def test_what_is_of_one_recording_alone_stands_side_by_side():
    rng = np.random.default_rng(4)
    one, other = part(rng), part(rng)
    own = [Part(p.observables, p.kinds, p.given, p.r, p.U, np.array([True, False, False]),
                np.zeros(3, dtype=bool), np.zeros(3, dtype=bool), np.zeros(len(p.r)))
           for p in (one, other)]
    U = stacked(own)
    assert U.shape == (len(one.r) + len(other.r), 4)
    assert not U[len(one.r):, 0].any() and not U[:len(one.r), 1].any()


def test_how_far_pads_are_off_their_zeros_is_of_each_recording_alone():
    """By as much one way in one recording as the other way in another: neither is left."""
    rng = np.random.default_rng(8)
    both = [replace(part(rng, size), columns=np.zeros((3 * N, 0)), back=part(rng).columns)
            for size in (EFFECT, -EFFECT)]
    fit, = stream_fits(both)
    assert fit.recalibrated > 2.0 * SD and fit.named == pytest.approx(SD, rel=0.15)


def test_a_cause_that_other_kinds_do_not_show_predicts_nothing():
    """A bump at a place, in one kind of push: held out, not even the place is known."""
    none = np.zeros(0, dtype=bool)
    one = replace(part(np.random.default_rng(9), 0.0), own=none, mesh=none, set_up=none)
    one = replace(one, U=one.U[:, :0])
    u = np.where(one.kinds == 'fast', np.tile(np.linspace(0.0, 1.0, N // 2), 6), -9.0)
    z = np.array([2.0, 3.0])            # how high, and where, in tenths from 0

    def bump(height, where):
        return 20.0 * height * np.exp(-((u - 0.1 * where) / 0.1)**2)

    h, left = 1e-5, one.r
    tangents = np.column_stack([bump(1.0, z[1]), (bump(z[0], z[1] + h) - bump(*z)) / h])
    one = replace(one, r=left + bump(*z))
    fits = [stream_fits([replace(one, named=left + columns @ z, columns=columns)])[0]
            for columns in (chords(tangents, z, bump(*z)), tangents)]
    chord, tangent = (fit.named / fit.recalibrated for fit in fits)
    assert chord == pytest.approx(1.0, rel=1e-6) and tangent > 1.5


def test_what_the_mesh_is_known_to_be_wrong_by_can_be_taken_off():
    """It predicts nothing, but need not hide what a cause does."""
    plain = part(np.random.default_rng(6))
    off = np.where(np.arange(len(plain.r)) % 2, 30.0, -30.0)
    hidden = replace(plain, r=plain.r + off, named=plain.named + off, of_mesh=off)
    blurred, (seen,) = stream_fits([hidden])[0], stream_fits([hidden.beside_mesh()])
    assert blurred.named > 10.0 * SD and seen.named == pytest.approx(SD, rel=0.15)
    assert seen.recalibrated == pytest.approx(stream_fits([plain])[0].recalibrated, rel=1e-9)
