"""How late a stream is against the encoders: planted delays, and what must not look like one."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.signal import lfilter

from arm_brachy.core.term import ActuationTerm, Stage, TermSpec
from arm_brachy.devices.terms.actuator_lag import ActuatorLag, first_order
from arm_brachy.diagnosis.isolation import clocks as clock_findings
from arm_brachy.diagnosis.signals.delay import Following, Lateness, lateness
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.regressors import history_columns, memories
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.noise_process import Colour
from arm_brachy.evaluation.timeseries import Series

PADS = ('pad_0', 'pad_1', 'pad_2')
STREAMS = {'pad markers': (OPTICAL, PADS), 'tissue markers': (OPTICAL, (TISSUE,)),
           'em': (EM, (TISSUE,)), 'force': (FORCE, PADS)}


@pytest.fixture(scope='module')
def prepared(recorded, laboratory):
    return prepare(evidence_of(recorded(), laboratory().scene))


def late(prepared, name, shift=0.0):
    kind, bodies = STREAMS[name]
    stream, noise = prepared.on(kind, *bodies)
    return lateness(replace(stream, t=stream.t + shift), prepared.travel, prepared.motion.touch,
                    noise, memory=name != 'pad markers')


@pytest.mark.parametrize('name', STREAMS)
def test_a_stream_in_time_is_not_late(prepared, name):
    """Half of what a calibration leaves (2 ms); the force relaxes with a memory of 1.5 s."""
    found = late(prepared, name)
    assert abs(found.value) < 1e-3 + 3.0 * found.sd


@pytest.mark.parametrize('name', STREAMS)
@pytest.mark.parametrize('shift', [0.02, -0.035, 0.6, -1.3])
def test_a_shift_of_the_stamps_is_measured(prepared, name, shift):
    """Against the same stream before the shift, noise and all."""
    assert late(prepared, name, shift).value - late(prepared, name).value == pytest.approx(
        shift, abs=0.05 * abs(shift) + 2e-4)


@pytest.mark.parametrize('name', [
    'tissue markers', *(
        pytest.param(name, marks=pytest.mark.validate) for name in ('em', 'force'))])
def test_play_that_no_marker_shows_is_no_lateness(recorded, laboratory, name):
    """After a reversal a pad with 0.6 mm of it is late too; 5 to 6 ms were told, clocks right."""
    entry = {'name': 'backlash', 'width_mm': 0.6, 'actuators': [0]}
    prepared = prepare(evidence_of(recorded(entry), laboratory().scene))
    kind, bodies = STREAMS[name]
    stream, noise = prepared.on(kind, *bodies)
    blind, found = (lateness(stream, prepared.travel, prepared.motion.touch, noise, lost=lost)
                    for lost in ((), (0, 1, 2)))
    assert abs(found.value) < 1e-3 + 3.0 * found.sd and found.sd < 3e-3
    assert blind.value > found.value + 3e-3


def test_play_is_asked_of_the_pads_that_no_marker_shows(prepared, monkeypatch):
    asked = []
    monkeypatch.setattr(clock_findings, 'lateness',
                        lambda *args, lost, **named: asked.append(lost))
    clock_findings.clocks_of(prepared, [SimpleNamespace(pad='pad_1')], prepared.travel)
    assert asked and set(asked) == {(0, 2)}


def test_a_delay_that_led_out_of_those_tried_is_no_estimate(prepared):
    """Of 3.5 s 3.1 were told: where the search ends, next to the best of it."""
    assert late(prepared, 'em', 3.5) is None


def moved(run, shift):
    """The RunData with the stamps of all streams but the encoders later by `shift` [s]."""
    return replace(run, force=Series(run.force.t + shift, run.force.values),
                   optical=replace(run.optical, t=run.optical.t + shift),
                   em={name: replace(s, t=s.t + shift) for name, s in run.em.items()})


@pytest.mark.parametrize('shift', [
    1.0, *(pytest.param(shift, marks=pytest.mark.validate) for shift in (-1.0, -0.3, 0.4))])
def test_clocks_farther_off_than_a_push_are_nothing_else(recorded, look, shift):
    """By one clock pads stand, by the other they move: neither noise nor gains are seen so.

    All late alike is one cause; pads do not lead their encoders, so that early ones are clocks.
    """
    prepared, structure = look(moved(recorded(), shift))
    if shift > 0.0:
        found, = structure.findings
        assert (found.term, found.rivals) == ('actuator_lag', ('clock_offset',))
    else:
        assert {f.term for f in structure.findings} == {'clock_offset'}
        assert {f.stream for f in structure.findings} == {OPTICAL, EM, FORCE}
    for found in structure.findings:
        assert found.value == pytest.approx(shift, abs=3e-3)
    for kind in (OPTICAL, EM, FORCE):
        assert prepared.evidence.late[kind] == pytest.approx(shift, abs=0.02)
        assert abs(structure.late(kind)) < 0.02     # what is left to be put right


def test_no_clock_is_set_back_for_less_than_a_push(recorded, look):
    assert look(moved(recorded(), 0.04))[0].evidence.late == {}


def test_errors_are_honest(laboratory, pushes):
    """Pad markers of six recordings: estimates scatter as they say."""
    z = []
    for seed in range(6):
        lab = laboratory((), 40 + seed)
        prepared = prepare(evidence_of(lab.record(pushes(pads=(0, 1), speeds=(0.02,))), lab.scene))
        found = late(prepared, 'pad markers')
        z.append(found.value / found.sd)
    assert np.sqrt(np.mean(np.square(z))) < 2.0


def test_a_faint_channel_that_fades_is_no_clock(prepared):
    """Noise of half its motion, a quarter of that lasting 0.3 s; the tissue cures meanwhile."""
    stream, noise = prepared.on(EM, TISSUE)
    stream, fade = stream.channels([0]), 1.0 - 0.4 * (1.0 - np.exp(-stream.t / 10.0))
    moved = stream.values - np.nanmean(stream.values, axis=0)
    sd = 0.5 * np.nanstd(moved)
    loud = replace(noise, sd=np.full((1, 3), sd), colour=Colour(0.25, 0.3))
    keep = np.exp(-stream.period / 0.3)
    z = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        drive = rng.standard_normal(moved.shape) * np.sqrt(1.0 - keep**2)
        slow = lfilter([1.0], [1.0, -keep], drive, axis=0)
        white = rng.standard_normal(moved.shape)
        values = fade[:, None, None] * moved + sd * (np.sqrt(0.75) * white + 0.5 * slow)
        found = lateness(replace(stream, values=values), prepared.travel, prepared.motion.touch,
                         loud)
        z += [] if found is None else [found.value / np.hypot(found.sd, 2e-3)]
    assert np.abs(z).max(initial=0.0) < 4.0


def test_noise_that_lasts_sends_nobody_far(prepared):
    """Half of it lasts 0.3 s: taken for white, it explains delays that it has not."""
    stream, _ = prepared.on(EM, TISSUE)
    t, keep, sent = stream.t, np.exp(-stream.period / 0.3), {'white': 0, 'lasting': 0}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        drive = rng.standard_normal((len(t), 3)) * np.sqrt(1.0 - keep**2)
        slow = lfilter([1.0], [1.0, -keep], drive, axis=0)
        y = np.sqrt(0.5) * (rng.standard_normal((len(t), 3)) + slow)
        for name, colour in (('white', Colour(0.0, 0.0)), ('lasting', Colour(0.5, 0.3))):
            series = Following(t, y, np.ones(y.shape, bool), colour, prepared.travel,
                               prepared.motion.touch, memory=True)
            sent[name] += series.scanned() != 0.0
    assert sent['lasting'] == 0 and sent['white'] > 6


def test_what_does_not_follow_the_pads_is_not_asked(prepared):
    stream, noise = prepared.on(OPTICAL, 'base')
    assert lateness(stream, prepared.travel, prepared.motion.touch, noise) is None


def test_memories_solve_their_equation():
    """time m' + m = u for a ramp that stops, written down."""
    tt = np.array([0.0, 1.0, 2.0, 6.0])
    u = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
    t, time = np.linspace(0.0, 6.0, 50), 0.8
    ramp, after = np.clip(t - 1.0, 0.0, 1.0), np.clip(t - 2.0, 0.0, None)
    at_end = 1.0 - time * (1.0 - np.exp(-1.0 / time))
    exact = np.where(t < 2.0, ramp - time * (1.0 - np.exp(-ramp / time)),
                     1.0 + (at_end - 1.0) * np.exp(-after / time))
    assert np.allclose(memories(t, tt, u, time)[:, 0], exact, atol=2e-4)


def test_only_pads_that_push_have_regressors():
    tt = np.linspace(0.0, 5.0, 100)
    q = np.stack([4e-3 * np.sin(tt) ** 2, 1e-6 * tt, 2e-3 * np.sin(tt) ** 2], axis=1)
    columns = history_columns(tt, (tt, q), 1e-4, memory=False)
    assert set(columns) == {'q0^1', 'q0^2', 'q0^3', 'q2^1', 'q2^2', 'q2^3', 'q0q2'}


@pytest.mark.parametrize('sd, kept', [(2e-3, 1.0), (2e-2, 4e-6 / (4e-6 + 4e-4))])
def test_a_clock_that_is_not_known_is_taken_for_right(prepared, monkeypatch, sd, kept):
    """65 ms late: to 2 ms it is a fault and put right; to 20 ms it is what nobody knows."""
    unsure = Lateness(-0.065, sd, ('tissue_00',))
    monkeypatch.setattr(clock_findings, 'lateness', lambda *args, **named: unsure)
    clocks = clock_findings.clocks_of(prepared, (), prepared.travel)
    right = clock_findings.believed(clocks, prepared.calibration.clock)
    assert right[EM].value == pytest.approx(-0.065 * kept)
    found = clock_findings.clock_findings(prepared, clocks)
    assert {one.stream for one in found} == (set(clocks) if kept == 1.0 else set())


CLOCKS = {OPTICAL: (10.8, 0.2), FORCE: (9.7, 1.0)}     # ms


@pytest.mark.parametrize('clocks, terms, rivals', [
    (CLOCKS, {'actuator_lag'}, {'clock_offset'}),
    (CLOCKS | {EM: (2.0, 9.0)}, {'actuator_lag'}, {'clock_offset'}),
    (CLOCKS | {FORCE: (9.7, 4.0)}, {'clock_offset'}, {'actuator_lag'}),
    (CLOCKS | {FORCE: (5.0, 20.0)}, {'clock_offset'}, {'actuator_lag'}),
    (CLOCKS | {FORCE: (0.3, 1.0)}, {'clock_offset'}, set()),
    ({OPTICAL: (10.8, 0.2)}, {'clock_offset'}, set()),
    ({OPTICAL: (-10.8, 0.2), FORCE: (-9.7, 1.0)}, {'clock_offset'}, {'viscoelasticity'})])
def test_what_all_streams_share_is_one_cause(prepared, clocks, terms, rivals):
    """All late by as much: pads lag; one late, others right: its clock; not told: either."""
    late = {kind: Lateness(1e-3 * value, 1e-3 * sd, ()) for kind, (value, sd) in clocks.items()}
    found = clock_findings.clock_findings(prepared, late)
    assert {one.term for one in found} == terms
    assert {rival for one in found for rival in one.rivals} == rivals
    assert len(found) == 1 or found[0].value < 0.0
    if terms == {'actuator_lag'}:
        assert {one['stream'] for one in found[0].ways['clock_offset']} == set(clocks)


@dataclass(frozen=True)
class PadLag(ActuationTerm):
    """Pads that follow their encoders by a first-order lag, of which no term of the cell says."""

    time_constant: float
    spec: ClassVar[TermSpec] = replace(ActuatorLag.spec, stage=Stage.TRANSMISSION)

    def memory(self, q0):
        return np.array(q0), np.array(q0)

    def step(self, memory, u, effort, t, dt):
        y = first_order(*memory, u, dt, self.time_constant)
        return y, (y.copy(), np.array(u))


def test_pads_that_lag_their_encoders_are_one_cause(laboratory, short_pushes, look):
    """Of 13 ms: it was told as the clocks of all other streams."""
    found, = look(laboratory((PadLag(0.013),), 2).record(short_pushes()))[1].findings
    assert found.term == 'actuator_lag' and found.rivals == ('clock_offset',)
    assert found.value == pytest.approx(0.013, abs=2e-3)
