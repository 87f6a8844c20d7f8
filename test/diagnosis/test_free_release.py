"""A release written down as formulas: what is read from it, what a description leaves of it."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.scene import Marker, MeshFile, Region, Scene
from arm_brachy.diagnosis.free_vibration.findings import base_marker_findings
from arm_brachy.diagnosis.free_vibration.held_out import Description, left, of_repeat
from arm_brachy.diagnosis.free_vibration.initial_shape import Held, Hold
from arm_brachy.diagnosis.free_vibration.look import Look
from arm_brachy.diagnosis.free_vibration.model import Swing
from arm_brachy.diagnosis.free_vibration.observation import (
    BESIDE,
    CREEP,
    DAMPING,
    FREQUENCY,
    case_of,
    predicted,
)
from arm_brachy.diagnosis.free_vibration.release import release_of
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.evaluation.timeseries import OpticalFrames, RunData

AT, LASTS, STEP = 0.5, 5.0, 0.01    # s
FREQUENCY_HZ, RATIO = 6.0, 0.06
SAG = np.array([[1e-3, 0.0, -8e-3], [0.5e-3, 1e-4, -5e-3]])     # m, of two markers at the end
CREEPS, TAU = 0.05, 2.0     # share of the sag that comes later, s
NOISE = 5e-6
PLACES = {'tip': (0.1, 0.0, 0.0), 'half': (0.06, 0.0, 0.01)}
BASE = {'b0': (0.0, -0.02, 0.0), 'b1': (0.0, 0.03, 0.0), 'b2': (0.0, 0.0, 0.03)}
SCENE = Scene('formula', MeshFile('none.msh'), Region('half_space'), dynamics='implicit',
              markers=tuple([Marker(n, p) for n, p in PLACES.items()]
                            + [Marker(n, p, 'base') for n, p in BASE.items()]))


def motion(t, swing=1.0):
    """(n, 2, 3) [m]: creep towards SAG and a mode of the same shape about it."""
    since = np.maximum(t - AT, 0.0)
    w = 2.0 * np.pi * FREQUENCY_HZ
    slow = 1.0 - CREEPS * np.exp(-since / TAU)
    ring = np.exp(-RATIO * w * since) * np.cos(w * np.sqrt(1.0 - RATIO ** 2) * since)
    return np.where(t > AT, slow - (1.0 - CREEPS) * swing * ring, 0.0)[:, None, None] * SAG


def prepared(seed=0, swing=1.0, odd=0.0, returns=False, begin=0.0, end=LASTS, hidden=(),
             order=None, hand=0.0, bounce=0.0):
    """hidden : (marker on the tissue, from, to [s]) each;  order : of markers under the names
    hand : [m] by which what holds it goes to and fro;  bounce : of the sag, at 1.7 times the pitch
    """
    t = np.arange(round(begin / STEP), round(end / STEP)) * STEP
    points = np.tile([*PLACES.values(), *BASE.values()], (len(t), 1, 1))
    went = motion(t, swing)
    points[:, :2] += went * (t < AT + 1.0)[:, None, None] if returns else went
    since = np.maximum(t - AT, 0.0)
    other = np.exp(-since / 2.0) * np.sin(2.0 * np.pi * 1.7 * FREQUENCY_HZ * since)
    points[:, :2] += bounce * other[:, None, None] * SAG
    points[:, :2, 2] += hand * np.where(t < AT, np.sin(8.0 * np.pi * t), 0.0)[:, None]
    points[t > AT, 4, 0] += odd
    points += np.random.default_rng(seed).normal(0.0, NOISE, points.shape)
    points = points[:, list(order or range(len(points[0])))]
    visible = np.ones(points.shape[:2], dtype=bool)
    for k, first, last in hidden:
        visible[(t >= first) & (t <= last), k] = False
    frames = OpticalFrames(t, (*PLACES, *BASE), points, visible)
    return prepare(evidence_of(RunData('formula', '', 0, '', '', optical=frames), SCENE))


def straight(release):
    """Its observation.Case, held straight beyond doubt."""
    every = list(PLACES)
    held = Held(Hold(0.0, np.zeros((2, 3))), np.zeros((0, 2, 3)), 3e-4)
    return case_of(release, SCENE, [every.index(name) for name in release.names], held)


@pytest.fixture(scope='module')
def release():
    return release_of(prepared())


def test_what_was_put_in_is_read(release):
    """To the noise over root n: some um; the creep is a straight line while it rings."""
    ring = release.ring
    assert release.t == pytest.approx(AT, abs=2.0 * STEP)
    assert ring.frequency == pytest.approx(FREQUENCY_HZ, rel=2e-3)
    assert ring.damping == pytest.approx(RATIO, rel=0.03)
    assert ring.shape == pytest.approx(SAG / np.linalg.norm(SAG), abs=2e-3)
    wanted = (1.0 - CREEPS * np.exp(-(release.times + release.t - AT) / TAU))[:, None, None] * SAG
    assert release.moved == pytest.approx(wanted, abs=10e-6)
    assert release.odd is None and release.base.shape[1] == 3


def test_a_body_that_ends_where_it_began_was_not_let_go():
    with pytest.raises(RecordingError, match='let go'):
        release_of(prepared(returns=True))


@pytest.mark.parametrize('span', [(0.0, 0.6), (0.7, 1.7), (1.5, 9.0), (4.0, 9.0)])
def test_a_marker_that_is_lost_where_it_is_needed_is_left_out(release, span):
    found = release_of(prepared(hidden=[(0, *span)]))
    assert found.names == ('half',) and found.lost == ('tip',)
    assert found.ring.frequency == pytest.approx(FREQUENCY_HZ, rel=2e-3)
    assert found.moved == pytest.approx(release.moved[:, 1:], abs=10e-6)
    assert left(straight(found), of_repeat(straight(found))) < 4.0 * NOISE + 0.05e-3


def test_a_marker_that_is_lost_for_a_while_takes_part(release):
    for span in ((0.52, 0.6), (2.5, 3.0)):
        found = release_of(prepared(hidden=[(0, *span)]))
        assert found.names == release.names and not found.lost
        assert found.ring.damping == pytest.approx(RATIO, rel=0.03)
        assert np.isfinite(left(straight(found), of_repeat(straight(found))))


@pytest.mark.parametrize('made, said', [
    ({'hidden': [(0, 0, 0.3), (1, 0, 0.3)]}, 'in its first'),
    ({'hidden': [(0, 3, 9), (1, 3, 9)]}, 'at its end'),
    ({'hidden': [(0, 3, 9), (1, 0, 0.3)]}, 'both while'),
    ({'begin': AT - 0.1}, 'begin earlier'), ({'begin': AT + 0.3}, 'begin earlier'),
    ({'end': AT + 0.4}, 'until it settles')])
def test_what_shows_no_release_from_rest_to_rest_is_refused(made, said):
    with pytest.raises(RecordingError, match=said):
        release_of(prepared(**made))


@pytest.mark.parametrize(('end', 'held'), [(1.4, True), (LASTS, True), (40.0, True),
                                           (40.0, False)])
def test_noise_is_that_of_where_it_is_quieter(end, held):
    """Of 1.4 s all are ringing but the first half; a hand that moves by 0.3 mm is no rest."""
    noise = prepared(end=end, hand=0.0 if held else 3e-4).noise[OPTICAL]
    assert noise.sd == pytest.approx(NOISE, rel=0.5)
    assert (noise.idle > 1.0) == (end == 40.0)


def test_a_long_rest_after_the_ringing_does_not_hide_it():
    found = release_of(prepared(end=40.0))
    assert found.ring.frequency == pytest.approx(FREQUENCY_HZ, rel=2e-3)
    assert found.ring.damping == pytest.approx(RATIO, rel=0.03)


@pytest.mark.parametrize('order, said', [
    ((1, 0, 2, 3, 4), 'names of tip and half exchanged'),
    ((2, 1, 0, 3, 4), 'give the scene'), ((1, 2, 3, 0, 4), 'give the scene')])
def test_markers_of_other_names_are_refused(order, said):
    with pytest.raises(RecordingError, match=said):
        Look(prepared(order=order))
    Look(prepared())


def test_a_long_hold_is_neither_noise_nor_end(release):
    """Of 65 s the last fifth has all of the ringing in it, of 105 s the last tenth as well."""
    for hold in (60.0, 100.0):
        found = release_of(prepared(begin=-hold))
        assert found.t == pytest.approx(AT, abs=2.0 * STEP)
        assert found.noise == pytest.approx(release.noise, rel=0.3)
        assert found.moved[-1] == pytest.approx(release.moved[-1], abs=10e-6)


def test_a_marker_of_the_base_that_comes_off_is_told_and_left_out():
    found = release_of(prepared(odd=0.8e-3))
    name, moved = found.odd
    assert name == 'b2' and moved[0] == pytest.approx(0.8e-3, abs=20e-6)
    assert found.base.shape[1] == 2
    finding, = base_marker_findings([found], 20e-6)
    assert finding.channel == 'b2' and '0.80 mm' in finding.statement


def test_rows_of_a_perfect_model_are_zero_within_their_errors(release):
    case = straight(release)
    moved = (1.0 - CREEPS * np.exp(-(release.times + release.t - AT) / TAU))[:, None, None] * SAG
    swing = Swing(moved, FREQUENCY_HZ, RATIO, SAG, None)
    z = (case.values - predicted(case, swing)) / case.sd
    assert np.abs(z).max() < 3.0
    for kind, other in ((FREQUENCY, replace(swing, frequency=1.05 * FREQUENCY_HZ)),
                        (DAMPING, replace(swing, damping=2.0 * RATIO)),
                        (CREEP, replace(swing, moved=np.broadcast_to(SAG, moved.shape)))):
        z = (case.values - predicted(case, other)) / case.sd
        assert max(abs(v) for v, r in zip(z, case.rows, strict=True)
                   if r.kind.startswith(kind)) > 4.0


def test_what_rings_beside_the_mode_is_none_of_a_body_that_rings_as_one(release):
    """A weight on a rubber band bounces at another pitch: a sixth of what rings shows, none of it
    does in a release that is one mode.
    """
    case, bounces = straight(release), straight(release_of(prepared(bounce=0.2)))
    of_both = [next(v / s for v, s, r in zip(one.values, one.sd, one.rows, strict=True)
                    if r.kind == BESIDE) for one in (case, bounces)]
    assert of_both[0] < 1.0 and of_both[1] > 4.0


def test_how_hard_and_when_the_hand_lets_go_is_no_error(release):
    """A repeat describes another, swung 20 % less, to the noise; 5 % of frequency it does not."""
    other = release_of(prepared(seed=1, swing=0.8))
    same = of_repeat(straight(release))
    assert left(straight(other), same) < 4.0 * NOISE + 0.05e-3
    wrong = Description(same.t, same.moved, 1.05 * same.frequency, same.damping, same.shape)
    assert left(straight(other), wrong) > 5.0 * left(straight(other), same)


def test_a_repeat_too_short_to_show_creep_describes_none(release):
    """What creeps after it, 5 % of 8 mm at most, is what it leaves; no slope of a tenth of it."""
    short = release_of(prepared(seed=1, end=AT + 1.6))
    assert left(straight(release), of_repeat(straight(short))) < CREEPS * np.abs(SAG).max()
