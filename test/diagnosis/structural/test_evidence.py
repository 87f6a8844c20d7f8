"""What is taken from a recording, what is left out with a note, what is refused in one line."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.scene import Marker
from arm_brachy.diagnosis.signals import loading as module
from arm_brachy.diagnosis.signals.loading import evidence_of, load_evidence, told_apart
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, Stream, thinned
from arm_brachy.diagnosis.signals.validation import refuse_twice
from arm_brachy.evaluation.timeseries import EmSamples, RunData, Series, Tissue

PERIOD = 0.01


@pytest.fixture(scope='module')
def scene(laboratory):
    return laboratory().scene


@pytest.fixture(scope='module')
def run(laboratory):
    return laboratory((), 2).record([(np.array([6e-3, 0, 0]), 0.02, 0.5),
                                     (np.zeros(3), 0.02, 0.5)])


def optical(run, **changes):
    return replace(run, optical=replace(run.optical, **changes))


def same(one, other):
    assert one.notes == other.notes and one.streams.keys() == other.streams.keys()
    for kind, stream in one.streams.items():
        for name in ('t', 'values', 'valid', 'rest'):
            assert getattr(stream, name).tobytes() == getattr(other.streams[kind], name).tobytes()


def test_truth_changes_nothing(run, scene):
    """A recording that holds a truth, even a wrong one, gives the same Evidence as one without."""
    n = len(run.encoder)
    loud = replace(run, truth={t.name: Series(run.encoder.t, np.full((n, 3), 9.9))
                               for t in scene.targets},
                   pad_displacement=Series(run.encoder.t, np.full((n, 3), 7.7)),
                   tissue=Tissue(run.encoder.t[:1], np.ones((1, 4, 3)), np.ones((4, 3)),
                                 np.arange(4)[None]))
    same(evidence_of(loud, scene), evidence_of(run, scene))


def test_every_stream_keeps_its_own_clock_and_body(run, scene):
    found = evidence_of(run, scene)
    assert set(found.streams) == {ENCODER, FORCE, OPTICAL, EM}
    assert found.get(OPTICAL).t.tobytes() == run.optical.t.tobytes()
    assert len(found.get(EM).t) != len(found.get(FORCE).t)
    assert [found.get(OPTICAL).names[i] for i in found.get(OPTICAL).on('base')] == [
        'base_0', 'base_1', 'base_2']
    assert found.get(FORCE).bodies == found.pads
    assert not found.notes


def test_hidden_samples_are_not_valid(run, scene):
    found = evidence_of(run, scene).get(OPTICAL)
    assert np.array_equal(found.valid, run.optical.visible)
    assert np.isnan(found.values[~found.valid]).all()


def test_a_marker_that_was_never_seen_is_left_out_with_a_note(run, scene):
    k = run.optical.ids.index('tissue_4')
    visible = run.optical.visible.copy()
    visible[:, k] = False
    found = evidence_of(optical(run, visible=visible), scene)
    assert 'tissue_4' not in found.get(OPTICAL).names
    assert found.notes == ('marker tissue_4 was never seen and is left out.',)


def test_a_marker_that_the_scene_does_not_know_is_left_out_with_a_note(run, scene):
    ids = tuple('stray' if name == 'tissue_0' else name for name in run.optical.ids)
    found = evidence_of(optical(run, ids=ids), scene)
    assert len(found.get(OPTICAL).names) == len(ids) - 1 and 'stray' in found.notes[0]


def test_a_sensor_that_is_dead_is_left_out_with_a_note(run, scene):
    values = run.force.values.copy()
    values[:, 1] = 0.25
    found = evidence_of(replace(run, force=Series(run.force.t, values)), scene)
    assert found.get(FORCE).names == ('pad_0', 'pad_2')
    assert found.notes == ('force on pad_1 never changes, not even by noise, and is left out.',)


def test_frames_that_hold_nothing_are_left_out(run, scene):
    visible = run.optical.visible.copy()
    visible[1::2] = False
    found = evidence_of(optical(run, visible=visible), scene).get(OPTICAL)
    assert found.t.tobytes() == run.optical.t[::2].tobytes()


def test_repeated_stamps_are_left_out_with_a_note(run, scene):
    t = run.encoder.t.copy()
    t[100] = t[99]
    found = evidence_of(replace(run, encoder=Series(t, run.encoder.values)), scene)
    assert len(found.get(ENCODER).t) == len(t) - 1 and 'repeat a time stamp' in found.notes[0]


def test_the_travel_by_markers_is_the_same_wherever_the_tracker_stands(run, scene):
    """Origin half a metre away, axes turned by 40 degrees."""
    turn = Rotation.from_euler('zyx', [40.0, -15.0, 25.0], degrees=True).as_matrix()
    away = optical(run, points=run.optical.points @ turn.T + [0.5, -0.2, 0.9])
    here, there = (evidence_of(replace(one, encoder=None, encoder_pads=()), scene).get(ENCODER)
                   for one in (run, away))
    # Each is registered by its first frames, whose noise is 0.1 mm.
    assert np.nanmax(np.abs(there.values - here.values)) < 0.3e-3
    assert np.nanmax(there.values) > 5e-3


def test_without_encoders_markers_on_the_pads_tell_the_travel(run, scene):
    found = evidence_of(replace(run, encoder=None, encoder_pads=()), scene)
    q = found.get(ENCODER)
    known = np.stack([np.interp(q.t, run.encoder.t, c) for c in run.encoder.values.T], axis=1)
    seen = q.valid
    # calibration of a marker 0.15 mm and noise 0.1 mm, both rms lengths
    assert np.abs(q.values[..., 0] - known)[seen].max() < 0.7e-3
    assert 'from their markers' in found.notes[0]


def test_some_streams_are_enough(run, scene):
    bare = replace(run, optical=None, em={})
    assert set(evidence_of(bare, scene).streams) == {ENCODER, FORCE}


def test_a_force_sensor_on_no_pad_is_left_out_with_a_note(run, scene):
    """The wrench of a probe, for one: it belongs to no pad and not to the base."""
    values = np.concatenate([run.force.values, run.force.values[:, :1]], axis=1)
    found = evidence_of(replace(run, force=Series(run.force.t, values),
                                force_pads=(*run.force_pads, 'probe')), scene)
    assert found.get(FORCE).names == run.force_pads
    assert 'force sensors that the scene has no pad for were left out: probe.' in found.notes


def test_a_balance_under_the_base_is_kept(run, scene):
    values = np.concatenate([run.force.values, -run.force.values.sum(axis=1, keepdims=True)],
                            axis=1)
    with_base = replace(run, force=Series(run.force.t, values),
                        force_pads=(*run.force_pads, 'base'))
    found = evidence_of(with_base, scene)
    assert found.base_force.names == ('base',) and found.get(FORCE).names == run.force_pads


def scaled(run, kind, factor):
    if kind == 'optical':
        return optical(run, points=run.optical.points * factor)
    if kind == 'em':
        return replace(run, em={k: replace(e, position=e.position * factor)
                                for k, e in run.em.items()})
    return replace(run, **{kind: Series(getattr(run, kind).t, getattr(run, kind).values * factor)})


@pytest.mark.parametrize('kind, factor, word', [
    ('optical', 1e3, 'by .unit'), ('optical', 1e-3, 'by .unit'), ('em', 1e3, 'by .unit'),
    ('em', 1e-3, 'by .unit'), ('encoder', 1e3, 'by .unit'), ('encoder', 1e-3, 'push further'),
    ('force', 1e3, 'newtons')])
def test_units_wrong_by_a_thousand_are_refused(run, scene, kind, factor, word):
    with pytest.raises(RecordingError, match=word) as error:
        evidence_of(scaled(run, kind, factor), scene)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('factor', [1e3, 1e6, 1e-3], ids=['ms', 'us', 'ks'])
def test_a_unit_of_time_that_is_wrong_is_refused(run, scene, factor):
    """All streams alike: nothing else would tell."""
    def later(series):
        return replace(series, t=factor * series.t)
    other = replace(run, encoder=later(run.encoder), force=later(run.force),
                    optical=later(run.optical), em={k: later(s) for k, s in run.em.items()})
    with pytest.raises(RecordingError, match='mend the unit of time in the import'):
        evidence_of(other, scene)


def test_another_scene_is_refused_by_its_names(run, scene):
    others = tuple(replace(m, name=f'x{m.name}') for m in scene.markers)
    with pytest.raises(RecordingError, match='has the optical markers .* scene formulas knows'):
        evidence_of(run, replace(scene, markers=others))
    pads = tuple(replace(p, name=f'x{p.name}') for p in scene.pads)
    with pytest.raises(RecordingError, match='the recording has actuators'):
        evidence_of(run, replace(scene, pads=pads))


def test_another_body_with_the_same_names_is_refused(run, scene):
    rng = np.random.default_rng(3)
    moved = tuple(Marker(m.name, tuple(np.array(m.position) + 0.02 * rng.standard_normal(3)),
                         m.body) for m in scene.markers)
    with pytest.raises(RecordingError, match='after the best rigid fit'):
        evidence_of(run, replace(scene, markers=moved))


def test_a_tracker_that_stands_elsewhere_is_not_another_body(run, scene):
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    points = run.optical.points @ R.T + [0.4, -0.2, 0.9]
    assert not evidence_of(optical(run, points=points), scene).notes


def test_streams_that_do_not_overlap_are_refused(run, scene):
    later = replace(run, force=Series(run.force.t + 1.7e9, run.force.values))
    with pytest.raises(RecordingError, match='bring both on one clock'):
        evidence_of(later, scene)


def test_time_that_runs_backwards_is_refused(run, scene):
    t = run.force.t.copy()
    t[50] = t[10]
    with pytest.raises(RecordingError, match='force goes back in time'):
        evidence_of(replace(run, force=Series(t, run.force.values)), scene)


def test_nothing_that_moves_is_refused(laboratory, scene):
    still = laboratory((), 2).record([(np.array([1e-4, 0, 0]), 0.02, 0.5)])
    with pytest.raises(RecordingError, match='needs at least 0.2 mm'):
        evidence_of(still, scene)


@pytest.mark.parametrize('lost', ['one', 'all', 'in turn'])
def test_encoders_that_were_never_read_together_are_refused(run, scene, lost):
    values = run.encoder.values.copy()
    if lost == 'one':
        values[:, 1] = np.nan
    elif lost == 'all':
        values[:] = np.nan
    else:
        values[::2, 0], values[1::2, 1] = np.nan, np.nan
    with pytest.raises(RecordingError, match='travel of all pads together is known at 0 times'):
        evidence_of(replace(run, encoder=Series(run.encoder.t, values)), scene)


def test_nothing_that_moves_is_refused_with_a_sample_lost_as_well(run, scene):
    values = np.full_like(run.encoder.values, 3e-3)
    values[5] = np.nan
    with pytest.raises(RecordingError, match='no pad travels'):
        evidence_of(replace(run, encoder=Series(run.encoder.t, values)), scene)


def test_a_recording_given_twice_is_refused(laboratory, run, scene):
    """Whatever it is called; another one of the same pushes is another recording."""
    one, again = evidence_of(run, scene), evidence_of(replace(run, name='copy'), scene)
    other = evidence_of(laboratory((), 4).record([(np.array([6e-3, 0, 0]), 0.02, 0.5),
                                                  (np.zeros(3), 0.02, 0.5)]), scene)
    refuse_twice((one, other))
    with pytest.raises(RecordingError, match='^copy: recordings 1 and 3 of 3 hold the same'):
        refuse_twice((one, other, again))


def test_nothing_recorded_is_refused(run, scene):
    tools = {t: EmSamples(e.t, e.position, e.quality, e.status + 9) for t, e in run.em.items()}
    for nothing in (RunData('empty', '', 0, '', ''), RunData('lost', '', 0, '', '', em=tools),
                    replace(run, optical=None, em={}, force=None, force_pads=())):
        with pytest.raises(RecordingError, match='holds no forces, markers or EM tools'):
            evidence_of(nothing, scene)


def make_stream(t, x, valid=None):
    valid = np.ones((len(t), 1), dtype=bool) if valid is None else valid
    return Stream(FORCE, t, ('a',), np.where(valid[..., None], x, np.nan), valid, ('a',),
                  np.zeros((1, 1)))


def test_thinning_does_not_alias():
    """A sine of 47.3 Hz, seen at 10 Hz, must not turn up as a slow one; its mean is zero."""
    t = np.arange(20_000) / 1000.0
    out = thinned(make_stream(t, np.sin(2 * np.pi * 47.3 * t)[:, None, None]), 0.1)
    assert len(out.t) == 200 and np.abs(out.values).max() < 0.1


def test_thinning_keeps_a_ramp_in_its_place_across_gaps():
    t = np.arange(5000) / 1000.0
    valid = np.ones((len(t), 1), dtype=bool)
    valid[1010:1060] = valid[3333:3372] = False
    out = thinned(make_stream(t, 3.0 * t[:, None, None], valid), 0.1)
    assert out.valid.all() and np.allclose(out.values[:, 0, 0], 3.0 * out.t, atol=1e-12)


def test_a_bin_that_was_mostly_hidden_is_not_valid():
    t = np.arange(1000) / 1000.0
    valid = np.ones((len(t), 1), dtype=bool)
    valid[410:490] = False
    out = thinned(make_stream(t, np.ones((1000, 1, 1)), valid), 0.1)
    assert not out.valid[4, 0] and out.valid.sum() == 9


def test_long_recordings_are_averaged_to_a_bounded_number_of_samples(run, scene):
    found = evidence_of(run, scene, samples=200)
    assert all(len(s.t) <= 201 for s in found.streams.values())
    assert any('has 100 samples a second in all; they were averaged' in note
               for note in found.notes)
    fine = evidence_of(run, scene)
    assert np.nanmax(np.abs(found.get(OPTICAL).values[:10] - np.nanmean(
        fine.get(OPTICAL).values[:100], axis=0))) < 0.2e-3


def test_many_recordings_share_the_memory(monkeypatch, run, scene):
    monkeypatch.setattr(module, 'load_run', lambda bag, measured: run)
    monkeypatch.setattr(module, 'SAMPLES', 2_000)
    found = load_evidence(['bag'] * 20, scene)
    assert len(found) == 20
    assert sum(len(one.get(OPTICAL).t) for one in found) < 1.1 * 2_000


def test_recordings_of_one_name_are_told_apart_by_the_ends_of_their_paths(run, scene):
    """Repeats of a scenario have its name: a table and a page would mix them up."""
    one, other = (evidence_of(replace(run, name=name), scene) for name in ('probe', 'slow'))
    bags = ('runs/a/bag', 'runs/b/bag', 'runs/c/bag')
    assert [e.name for e in told_apart([one, one, other], bags)] == [
        'probe (a/bag)', 'probe (b/bag)', 'slow']
    assert told_apart([other], bags[:1])[0] is other


@pytest.mark.parametrize('ratio, words', [(0.1, 'times 10;'), (10.0, 'times 0.1;'),
                                          (1.0 / 25.4, 'positions span|times 25.4;')])
def test_lengths_in_another_unit_are_named(run, scene, ratio, words):
    with pytest.raises(RecordingError, match=words):
        evidence_of(optical(run, points=ratio * run.optical.points), scene)


def test_forces_and_tools_that_feel_nothing_are_in_another_unit(run, scene):
    faint = replace(run, force=replace(run.force, values=1e-3 * run.force.values))
    with pytest.raises(RecordingError, match='N only, where pushing'):
        evidence_of(faint, scene)
    em = {tool: replace(one, position=1e-3 * one.position) for tool, one in run.em.items()}
    with pytest.raises(RecordingError, match='EM tools stay within|em positions span'):
        evidence_of(replace(run, em=em), scene)


def test_channels_that_were_left_out_are_noted(run, scene):
    assert not any('Channels' in note for note in evidence_of(run, scene).notes)
    noted = evidence_of(replace(run, left_out=('/log', '/notes')), scene).notes
    assert 'Channels without ROS 2 messages were left out: /log, /notes.' in noted
