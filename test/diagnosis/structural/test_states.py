"""Load states against the body that was recorded: values, errors, labels, budget."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.signals.load_states import _averaged, load_states
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.motion import Motion
from arm_brachy.diagnosis.signals.noise import Noise
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL, Stream
from arm_brachy.diagnosis.signals.windows import windows_of
from arm_brachy.diagnosis.statistics.noise_process import Colour
from arm_brachy.evaluation.regimes import HELD, HOLD, LOAD, REST, RINGING, SETTLED, UNLOAD
from arm_brachy.evaluation.timeseries import OpticalFrames, RunData
from arm_brachy.offline import with_scene


@pytest.fixture(scope='module')
def lab(laboratory):
    """Trackers without constant errors: what is left is noise."""
    return laboratory((), 11, optical=OpticalParams(noise=1e-4, calibration_error=0.0,
                                                    noise_correlation=0.05),
                      em=EmTrackerParams())


@pytest.fixture(scope='module')
def prepared(lab, pushes):
    return prepare(evidence_of(lab.record(pushes()), lab.scene))


@pytest.fixture(scope='module')
def states(prepared):
    return load_states(prepared)


def truth(lab, q):
    """Markers and tools (m, k, 3) of the body with the pads at q (m, 3)."""
    return np.array([lab.points(0.0, pad) for pad in q])


def test_the_number_of_states_is_bounded(prepared):
    for limit in (150, 60, 20):
        states = load_states(prepared, limit=limit)
        assert len(states.t) <= limit and np.all(np.diff(states.t) > 0.0)
        assert {LOAD, HOLD, UNLOAD} <= set(states.labels.regime)


def test_states_are_the_body_within_their_errors(lab, states):
    """(measured - true) / sd has mean square one, over all states, markers, tools and axes.

    The pads are where the encoder says to a count, 12 um, and the markers move with them.
    """
    exact = truth(lab, states.q)
    for kind, part in ((OPTICAL, slice(0, 18)), (EM, slice(18, 20))):
        stream = states.streams[kind]
        count = 0.0122e-3 / np.sqrt(12.0)
        z = (stream.values - exact[:, part]) / np.sqrt(stream.variance + count ** 2)
        seen = np.isfinite(z)
        assert seen.mean() > 0.95
        assert np.sqrt(np.mean(z[seen] ** 2)) == pytest.approx(1.0, abs=0.15)


def test_errors_shrink_with_the_window(states):
    sd = np.sqrt(states.streams[EM].variance.min(axis=(1, 2)))
    long, short = sd[states.width > 0.5].mean(), sd[states.width < 0.1].mean()
    assert long < 0.5 * short


def test_a_late_stream_is_read_later(lab, prepared):
    """Reading 20 ms later on a ramp of 20 mm/s shifts the marker of its pad by 0.4 mm."""
    on_time, late = load_states(prepared), load_states(prepared, {OPTICAL: 0.02})
    labels = on_time.labels
    fast = (labels.direction == 1) & (labels.pad == 0) & (labels.speed > 0.019)
    k = on_time.streams[OPTICAL].names.index('pad_0')
    moved = (late.streams[OPTICAL].values - on_time.streams[OPTICAL].values)[fast, k]
    along = moved[np.abs(on_time.velocity[fast, 0] - 0.02) < 1e-3] @ lab.directions[0]
    assert len(along) > 3 and along == pytest.approx(4e-4, abs=1.5e-4)


def test_labels_of_a_known_protocol(laboratory):
    """Pad 0 to 4 mm and home, pad 0 to 8 mm with a halt on the way back, pad 1 to 4 mm."""
    lab = laboratory((), 12)
    one, two = np.array([1e-3, 0.0, 0.0]), np.array([0.0, 1e-3, 0.0])
    run = lab.record([(4 * one, 0.004, 1.0), (0 * one, 0.02, 1.0), (8 * one, 0.02, 1.0),
                      (3 * one, 0.004, 1.0), (0 * one, 0.004, 1.0), (4 * two, 0.01, 1.0),
                      (0 * two, 0.01, 1.0)])
    states = load_states(prepare(evidence_of(run, lab.scene)))
    labels, q = states.labels, states.q
    first, deep, other = (np.flatnonzero(labels.excursion == e) for e in (1, 2, 3))
    assert labels.regime[0] == REST and labels.pad[0] == -1 and labels.excursion[0] == 0
    assert [r for i, r in enumerate(labels.regime[first]) if i == 0
            or r != labels.regime[first][i - 1]] == [LOAD, HOLD, UNLOAD, REST]
    assert [labels.amplitude[i[0]] for i in (first, deep, other)] == pytest.approx(
        [4e-3, 8e-3, 4e-3], abs=2e-5)
    assert [labels.cycle[i[0]] for i in (first, deep, other)] == [0, 1, 0]
    assert labels.past_maximum[first][labels.regime[first] == LOAD].all()
    beyond = q[deep, 0] > 4.2e-3
    assert labels.past_maximum[deep][beyond].all()
    assert not labels.past_maximum[deep][q[deep, 0] < 3.9e-3].any()
    assert set(labels.pad[deep]) == {0} and set(labels.pad[other]) == {1}
    loading = (labels.regime == LOAD) & (labels.excursion == 1)
    assert labels.speed[loading] == pytest.approx(4e-3, rel=0.02)
    back = (labels.regime == HOLD) & (labels.excursion == 2) & (q[:, 0] < 3.5e-3)
    assert back.any() and labels.speed[back] == pytest.approx(4e-3, rel=0.02)
    assert np.all(labels.direction[labels.regime == UNLOAD] == -1)


def test_stands_are_seen_early_and_late(laboratory):
    lab = laboratory((), 13)
    run = lab.record([(np.array([6e-3, 0, 0]), 0.02, 5.0), (np.zeros(3), 0.02, 3.0)])
    states = load_states(prepare(evidence_of(run, lab.scene)))
    since = states.labels.since[states.labels.regime == HOLD]
    assert since.min() < 0.2 and since.max() > 4.5 and len(since) >= 4
    push = -np.einsum('mc,c->m', states.streams[FORCE].values[:, 0], lab.directions[0])
    held = push[states.labels.regime == HOLD]
    assert np.all(np.diff(held) < 0.03) and held[0] - held[-1] > 0.1 * held[0]   # it relaxes


def test_ramps_are_seen_on_their_straight_parts(states, prepared):
    moving = states.labels.direction != 0
    assert moving.sum() > 20
    travel = np.ptp(prepared.motion.q, axis=0).max()
    covered = states.width[moving] * states.labels.speed[moving]
    assert np.all(covered <= 0.11 * travel + 0.04 * 0.02)


def test_the_path_runs_through_corners_and_states(states, prepared):
    assert np.all(np.diff(states.path_t) >= 0.0)
    assert np.array_equal(states.path_t[states.state], states.t)
    assert np.array_equal(states.path_q[states.state], states.q)
    t, q = prepared.travel
    line = np.stack([np.interp(t, states.path_t, c) for c in states.path_q.T], axis=1)
    assert np.abs(line - q).max() < 3.0 * prepared.motion.tolerance + 0.0122e-3


def test_hundreds_of_pushes_keep_to_the_budget():
    t, q = [0.0], [0.0]
    for _ in range(400):
        for wait, to in ((1.0, 0.0), (0.5, 5e-3), (1.0, 5e-3), (0.5, 0.0)):
            t.append(t[-1] + wait)
            q.append(to)
    motion = Motion(np.array(t), np.array(q)[:, None], 1e-5, 1e-4)
    windows = windows_of(motion, 150)
    assert len(windows) == 150
    centres = np.array([w.centre for w in windows])
    assert np.diff(centres).max() < 5.0 * np.diff(centres).mean()


@pytest.mark.parametrize(('cycles', 'limit'), [(79, 80), (158, 80), (100, 80), (39, 40), (22, 12)])
def test_a_protocol_that_repeats_is_seen_in_all_its_phases(cycles, limit):
    """Ramp, hold, ramp, rest: four windows a cycle, so that every fourth would be a rest."""
    t, q = [0.0, 2.0], [0.0, 0.0]
    for _ in range(cycles):
        for lasts, to in ((0.3, 5e-3), (1.5, 5e-3), (0.3, 0.0), (1.5, 0.0)):
            t.append(t[-1] + lasts)
            q.append(to)
    motion = Motion(np.array(t), np.array(q)[:, None], 1e-5, 1e-4)
    windows = windows_of(motion, limit)
    at = np.interp([w.centre for w in windows], motion.t, motion.q[:, 0])
    moves = np.array([w.moves for w in windows])
    assert 0.8 * limit < len(windows) <= limit
    assert np.sum(~moves & (at > 4.9e-3)) >= 0.2 * limit
    assert np.sum(moves) >= 0.2 * limit
    assert 1 <= np.sum(~moves & (at < 1e-4)) <= 0.21 * limit


@pytest.mark.parametrize('start', [3.1, 50.1, 101.0, 143.5])
def test_a_touch_of_two_seconds_is_seen_however_few_the_states(start):
    """One that fell between the states of a long recording was told as nothing that is known."""
    t, q = [0.0, 2.0], [0.0, 0.0]
    for _ in range(40):
        for lasts, to in ((0.3, 5e-3), (1.5, 5e-3), (0.3, 0.0), (1.5, 0.0)):
            t.append(t[-1] + lasts)
            q.append(to)
    motion, ends = Motion(np.array(t), np.array(q)[:, None], 1e-5, 1e-4), (start, start + 2.0)

    def inside(windows):
        return [w for w in windows if ends[0] < w.start and w.stop < ends[1]]

    assert len(inside(windows_of(motion, 20))) < 3
    windows = windows_of(motion, 20, events=ends)
    assert 3 <= len(inside(windows)) and len(windows) < 20 + 12
    edges = [(w.start, w.stop) for w in windows]
    assert all(a[1] < b[0] + 1e-9 for a, b in zip(edges[:-1], edges[1:], strict=True))


def test_what_happens_all_the_time_asks_for_no_states_of_its_own():
    t = np.arange(0.0, 60.0, 3.0)
    motion = Motion(t, 5e-3 * (np.arange(len(t)) % 4 > 1)[:, None], 1e-5, 1e-4)
    plain, events = windows_of(motion, 20), np.linspace(1.0, 55.0, 12)
    assert windows_of(motion, 20, events=events) == plain
    assert len(windows_of(motion, 20, events=events[:11])) > len(plain)


def test_a_rhythm_is_not_averaged_away():
    """In every window on a stand its mean is its value in the middle, to 1 % of its height."""
    t, q = np.array([0.0, 5.0, 5.5, 9.0, 9.5, 12.0]), np.array([0.0, 0.0, 5e-3, 5e-3, 0.0, 0.0])
    motion, frequency = Motion(t, q[:, None], 1e-5, 1e-4), 0.25
    windows = [w for w in windows_of(motion, 80, frequency) if not w.moves]
    off = [np.mean(np.sin(2 * np.pi * frequency * np.linspace(w.start, w.stop, 200)))
           - np.sin(2 * np.pi * frequency * w.centre) for w in windows]
    assert len(windows) > 5 and np.abs(off).max() < 0.011
    assert max(w.stop - w.start for w in windows_of(motion, 80)) == 5.0


def test_a_body_that_is_let_go_needs_no_pads(laboratory):
    """Held for 0.5 s, rings at 3 Hz, settles: single samples while it moves, means while not."""
    scene = replace(laboratory().scene, pads=(), targets=(), markers=tuple(
        m for m in laboratory().scene.markers if m.body == 'tissue'))
    t, rest = np.arange(1000) * 0.01, np.array([m.position for m in scene.markers])
    s = np.clip(t - 0.5, 0.0, None)
    z = -5e-3 * (s > 0) * (1.0 - np.exp(-2.0 * s) * np.cos(2 * np.pi * 3.0 * s))
    noise = 2e-5 * stream(1, 'free').standard_normal((len(t), len(rest), 3))
    points = rest + z[:, None, None] * [0.0, 0.0, 1.0] + noise
    run = RunData('free', '', 0, '', '', optical=OpticalFrames(
        t, tuple(m.name for m in scene.markers), points, np.ones(points.shape[:2], dtype=bool)))
    states = load_states(prepare(evidence_of(with_scene(run, scene), scene)), limit=120)
    regime = states.labels.regime
    assert len(states.t) <= 120 and regime[0] == HELD and regime[-1] == SETTLED
    ringing = states.t[regime == RINGING]
    assert np.all((ringing > 0.4) & (ringing < 4.0)) and np.diff(ringing).max() < 0.05
    off = states.streams[OPTICAL].values[:, 0, 2] - rest[0, 2]
    assert off[regime == RINGING] == pytest.approx(
        np.interp(ringing, t, z) + (off[0]), abs=1e-4)
    assert off[-1] - off[0] == pytest.approx(-5e-3, abs=2e-5)


@pytest.mark.parametrize(('hold', 'period'), [(1.0, 0.5), (0.3, 0.5), (1.0, 0.2)])
def test_a_slow_stream_is_seen_where_it_was_sampled_and_once(hold, period):
    """What a stand shows was sampled in it: 2 Hz and pushes of 8 mm, 20 mm/s."""
    t, q = [0.0, 2.0], [0.0, 0.0]
    for _ in range(5):
        for lasts, to in ((0.4, 8e-3), (hold, 8e-3), (0.4, 0.0), (hold, 0.0)):
            t.append(t[-1] + lasts)
            q.append(to)
    motion = Motion(np.array(t), np.array(q)[:, None], 1e-5, 1e-4)
    windows = windows_of(motion, 80)
    ts = np.arange(0.13, t[-1], period)
    there = np.interp(ts, t, q)
    stream = Stream(OPTICAL, ts, ('a',), np.repeat(there[:, None, None], 3, axis=2),
                    np.ones((len(ts), 1), dtype=bool), ('tissue',), np.zeros((1, 3)))
    noise = Noise(np.full((1, 3), 1e-5), Colour(), period, np.eye(3), 'idle')
    found = _averaged(stream, noise, windows, 0.0)
    true = np.interp([w.centre for w in windows], t, q)
    off = np.abs(found.values[:, 0, 0] - true)
    stands = np.array([not w.moves for w in windows])
    assert np.isfinite(off[stands]).any()
    assert np.nanmax(off) < 1e-9
    # No sample is in two stands.
    assert np.sum(found.count[stands & np.isfinite(off), 0]) <= len(ts)
