"""Single readings that are far off are left out; what moves, steps or is digitised is not."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.outliers import spikes
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL
from arm_brachy.evaluation.timeseries import Series

PERIOD = 0.05     # s


def told(evidence):
    return [note for note in evidence.notes if 'one' in note]


def optical(run, points):
    return replace(run, optical=replace(run.optical, points=points))


def with_spikes(run, count, size):
    """RunData with `count` samples of single markers moved by `size` [m], and which (n, k)."""
    rng = np.random.default_rng(3)
    points, hit = run.optical.points.copy(), np.zeros(run.optical.visible.shape, dtype=bool)
    hit[rng.integers(1, len(points) - 1, count), rng.integers(0, points.shape[1], count)] = True
    way = rng.normal(size=(int(hit.sum()), 3))
    points[hit] += size * way / np.linalg.norm(way, axis=1, keepdims=True)
    return optical(run, points), hit & run.optical.visible


@pytest.mark.parametrize('size', [2e-3, 2e-2])
def test_spikes_are_all_that_is_left_out_and_nothing_slipped(recorded, look, size):
    run, hit = with_spikes(recorded(), 30, size)
    prepared, structure = look(run)
    assert np.array_equal(prepared.evidence.get(OPTICAL).valid, run.optical.visible & ~hit)
    note, = told(prepared.evidence)
    k = int(np.argmax(hit.sum(axis=0)))
    assert f'{hit[:, k].sum()} of {run.optical.ids[k]}' in note
    assert structure.findings == ()


def test_a_wild_reading_of_a_force_is_left_out(recorded, laboratory):
    run = recorded()
    values = run.force.values.copy()
    values[700:702, 1] += [0.0, 30.0, 0.0]
    found = evidence_of(replace(run, force=Series(run.force.t, values)), laboratory().scene)
    assert not found.get(FORCE).valid[700:702, 1].any() and '2 of pad_1' in told(found)[0]


def test_what_is_off_often_is_left_in(recorded, laboratory):
    run = recorded()
    points = run.optical.points.copy()
    points[10::30, 4] += [0.0, 0.01, 0.0]
    found = evidence_of(optical(run, points), laboratory().scene)
    assert np.array_equal(found.get(OPTICAL).valid, run.optical.visible)
    assert 'left in: tissue_1.' in told(found)[0]


@pytest.mark.parametrize('rate', [20.0, 100.0])
@pytest.mark.parametrize('noise', [0.0, 1e-4])
@pytest.mark.parametrize('depth', [1e-3, 8e-3])
def test_a_tap_is_no_spike(laboratory, rate, noise, depth):
    """Out and back at 20 mm/s without a rest: at 20 Hz 1 mm is seen in one frame or two."""
    lab = laboratory(optical=OpticalParams(rate=rate, noise=noise))
    moves = [(q * np.eye(3)[0], 0.02, 0.0) for q in (depth, 0.0) * 8]
    assert not told(evidence_of(lab.record(moves), lab.scene))


@pytest.mark.parametrize('count', [1e-4, 1e-3])
def test_a_count_more_or_less_is_no_spike(recorded, laboratory, count):
    run = recorded()
    found = evidence_of(optical(run, np.round(run.optical.points / count) * count),
                        laboratory().scene)
    assert not told(found)


@pytest.mark.parametrize(('path', 'lone'), [
    ([0, 0, 0, 0, 9, 0, 0, 0, 0], [4]), ([0, 0, 0, 9, 8, 0, 0, 0, 0], [3, 4]),
    ([0, 0, 0, 9, 8, 9, 0, 0, 0], []), ([0, 0, 0, 0, 9, 9, 9, 9, 9], []),
    ([0, 0, 9, 0, 9, 0, 0, 0, 0], [2, 3, 4]), ([0, 1, 2, 3, 14, 5, 6, 7, 8], [4]),
    ([4, 3, 2, 1, 0, 1, 2, 3, 4], []), ([0, 0, 0, 0, 12, 9, 9, 9, 9], [])])
def test_a_spike_is_left_and_come_back_from_in_three_frames(path, lone):
    """An honest sample between two spikes stands aside as much as they: it goes with them."""
    t = PERIOD * np.arange(len(path))
    assert np.flatnonzero(spikes(t, np.array(path, float)[:, None], 0.5)).tolist() == lone


def test_after_a_gap_nobody_knows_what_was_between():
    t = np.concatenate([PERIOD * np.arange(8), 2.0 + PERIOD * np.arange(8), [4.0 + PERIOD]])
    values = np.where(np.arange(17) == 16, 0.0, np.where(np.arange(17) == 15, 9.0, 0.0))
    assert not spikes(t, values[:, None], 0.5).any()
