"""All of it together: sound recordings, planted faults, a tenth of them, a real rig."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy import registry
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.isolation.isolate import structure_of
from arm_brachy.diagnosis.signals.load_states import load_states
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.offline import load_run
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.scene_import import import_scene
from arm_brachy.scenario import load_cell

# term, key that carries its size, typical size
FAULTS = (
    ({'name': 'actuator_gain', 'actuators': [1]}, 'gain', 0.06),
    ({'name': 'actuator_compliance', 'actuators': [0]}, 'compliance_mm_N', 0.125),
    ({'name': 'backlash'}, 'width_mm', 0.25),
    ({'name': 'lost_steps', 'onset_s': 8.0, 'actuators': [0]}, 'shortfall_mm', 0.6),
    ({'name': 'clock_offset', 'stream': 'optical'}, 'delay_ms', 20.0),
    ({'name': 'clock_offset', 'stream': 'force'}, 'delay_ms', 20.0),
    ({'name': 'clock_offset', 'stream': 'em'}, 'delay_ms', 20.0),
)
KINDS = ({}, {'relaxing': 0.5, 'optical': OpticalParams()},
         {'optical': OpticalParams(noise=1.5e-4, noise_correlation=0.05),
          'em': EmTrackerParams(noise_correlation=0.3),
          'force': ForceSensorParams(noise_correlation=0.1)})


def planted(fault, share):
    entry, key, size = fault
    return {**entry, key: size * share}


@pytest.mark.parametrize('fault', [     # lost steps: test_events.py
    *FAULTS[:3], FAULTS[4], *(pytest.param(fault, marks=pytest.mark.validate)
                              for fault in (FAULTS[3], *FAULTS[5:]))],
    ids=lambda f: f[0]['name'] + f[0].get('stream', ''))
def test_a_fault_of_typical_size_is_named_with_its_parameter(looked_at, fault):
    entry = planted(fault, 1.0)
    found, = looked_at(entry)[1].findings
    term, = registry.parse_terms([entry], 'test')
    assert found.term == entry['name']
    assert found.value == pytest.approx(getattr(term, found.parameter), rel=0.2)
    made = type(term)(**found.parameters)   # the finding is enough to make the term from
    assert getattr(made, found.parameter) == pytest.approx(found.value)
    chosen = getattr(term, 'actuators', ())
    assert tuple(getattr(made, 'actuators', ())) == tuple(chosen)


@pytest.mark.parametrize('fault', [
    FAULTS[0], *(pytest.param(fault, marks=pytest.mark.validate) for fault in FAULTS[1:3])],
    ids=lambda f: f[0]['name'])
def test_a_tenth_of_it_is_not_called_something_else(looked_at, fault):
    for found in looked_at(planted(fault, 0.1))[1].findings:
        assert fault[0]['name'] in (found.term, *found.rivals)


@pytest.mark.parametrize('kind', [
    *(pytest.param(kind, marks=pytest.mark.validate) for kind in (0, 1)), 2])
def test_sound_recordings_have_no_findings(laboratory, short_pushes, look, kind):
    """Six recordings at 1 in 1000 each: one alarm would happen once in two hundred."""
    for seed in range(2):
        lab = laboratory((), 60 + seed, **KINDS[kind])
        assert look(lab.record(short_pushes()))[1].findings == ()


@pytest.mark.parametrize('gone', [
    ('em', 'force'), ('optical', 'em'), *(
        pytest.param(gone, marks=pytest.mark.validate) for gone in (
            ('optical',), ('optical', 'force')))])
def test_any_streams_will_do(recorded, look, gone):
    run = recorded(None, 2)
    for name in gone:
        run = replace(run, **({'em': {}} if name == 'em' else {name: None}),
                      **({'force_pads': ()} if name == 'force' else {}))
    prepared, structure = look(run)
    states = load_states(prepared, {kind: structure.late(kind) for kind in structure.clocks})
    assert structure.findings == ()
    assert set(states.streams) == {'optical', 'em', 'force'} - set(gone)
    assert all(np.isfinite(one.values).any() for one in states.streams.values())


def test_a_recording_that_begins_with_a_push(laboratory, look):
    """The first seconds are missing: rest, registration and first push."""
    lab = laboratory((), 3)
    run = lab.record([(np.array([6e-3, 0, 0]), 0.02, 3.0), (np.zeros(3), 0.02, 1.0),
                      (np.array([0, 6e-3, 0]), 0.02, 1.0), (np.zeros(3), 0.02, 1.0)])
    late = 3.0
    keep = run.optical.t > late
    cut = replace(run, encoder=run.encoder.between(late, 99.0),
                  force=run.force.between(late, 99.0), em={},
                  optical=replace(run.optical, t=run.optical.t[keep],
                                  points=run.optical.points[keep],
                                  visible=run.optical.visible[keep]))
    prepared, structure = look(cut)
    assert prepared.registration.span is None
    assert set(prepared.registration.on) == {'base_0', 'base_1', 'base_2'}
    assert structure.findings == ()


def test_a_pad_whose_encoder_stands_off_zero_all_the_time(recorded, look):
    run = recorded(None, 2)
    run = replace(run, encoder=replace(run.encoder, values=run.encoder.values.copy()))
    run.encoder.values[:, 2] = 2e-3
    assert not any(found.stream == 'optical' and 'base' in found.channel
                   for found in look(run)[1].findings)


def test_clocks_of_every_stream_are_handed_on(looked_at):
    structure = looked_at()[1]
    assert set(structure.clocks) == {'optical', 'em', 'force'}
    assert abs(structure.late('optical')) < 1e-3 and structure.late('encoder') == 0.0


def test_an_alarm_of_one_actuator_is_not_merged_with_sound_ones(looked_at):
    found, = looked_at(planted(FAULTS[0], 1.0))[1].findings
    assert found.channel == 'pad_1' and found.parameters['actuators'] == (1,)


@pytest.mark.parametrize('name', ['B', 'C'])
def test_a_rig_that_conceals_nothing_has_no_findings(recordings, tmp_path, name):
    """Another laboratory's simulator and sensors: clocks to 2 ms, registration to 0.3 mm."""
    source = recordings / 'dome_rig'
    files = import_scene(source / 'scene.yaml', tmp_path / 'scene', name='dome_rig')
    scene = load_cell(files['scenario']).scene
    import_csv(files['maps'][name], tmp_path / name)
    structure = structure_of(prepare(evidence_of(load_run(tmp_path / name), scene)))
    assert structure.findings == ()
    assert structure.clocks['optical'].sd < 3e-3
    for one in structure.pads:
        assert np.all(np.abs(one.tilt) < 4.0 * one.tilt_sd)
