"""From recordings to the answer, on a coarse breast: what was planted is named, with its size."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_info, threadpool_limits

from arm_brachy.cell import pad_directions
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.devices.terms.axis_crosstalk import AxisCrosstalk
from arm_brachy.diagnosis.likelihood.discretisation import EnsembleOptions
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.specimen import attach, specimen_of
from arm_brachy.diagnosis.pipeline import diagnose
from arm_brachy.diagnosis.progress import FITS, STEPS
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.report.answer import Provenance
from arm_brachy.diagnosis.report.corrected_scenario import base_scenario, write_corrected
from arm_brachy.diagnosis.report.page import write_diagnosis
from arm_brachy.diagnosis.signals.loading import Evidence
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE, Stream
from arm_brachy.registry import parse_terms
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.simulator import TissueSimulator

SCENES = config_dir() / 'scenes'
PERIOD = 0.05       # s
NOISE = {OPTICAL: 3e-5, EM: 1e-4, FORCE: 0.02}
STIFFENING = {'name': 'strain_stiffening', 'ratio': 1.0}
# Truth and model share the mesh; what linear elements are wrong by would hide everything.
MESHES = EnsembleOptions(members=2, inflation=0.1)
PLAY = {'name': 'backlash', 'width_mm': 0.6, 'actuators': [0]}


@pytest.fixture(scope='module')
def scene():
    """Linear elements on the coarse mesh: wrong by millimetres, alike in truth and model."""
    coarse = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast' / 'breast_600.msh')
    return replace(coarse, element='linear')


# Pads 1 to 3 to 5 mm, pad 1 to 8, pads 1 and 2 together, each with its speed [mm/s].
PUSHES = (((5, 0, 0, 0), 20), ((0, 5, 0, 0), 20), ((0, 0, 5, 0), 20), ((5, 0, 0, 0), 4),
          ((8, 0, 0, 0), 20), ((5, 5, 0, 0), 20))
FEW = (PUSHES[0], PUSHES[1], PUSHES[4])     # enough to tell stiffening: two depths, two pads


def path_of(legs_mm):
    """Path at 20 Hz that goes each leg and back, stands between."""
    legs, q, t = [], np.zeros(len(legs_mm[0][0])), 2.0
    for targets, speed in legs_mm:
        for goal in (1e-3 * np.array(targets, dtype=float), 0.0 * q):
            way = np.abs(goal - q).max() / (1e-3 * speed)
            legs += [(t, q), (t + way, goal)]
            t, q = t + way + 1.0, goal
    corners_t, corners = zip(*legs, strict=True)
    clock = np.arange(0.0, t + 1.0, PERIOD)
    return Path(clock, np.stack([np.interp(clock, corners_t, c) for c in np.array(corners).T],
                                axis=1))


@pytest.fixture(scope='module')
def record(scene):
    """(entries of terms, seed) -> Evidence of the pushes under white noise."""
    specimen = specimen_of(scene)

    def one(entries=(), seed=1, name='made up', legs=PUSHES, start=0.0):
        path = path_of(legs)
        path = replace(path, t=path.t + start)
        found = ForwardModel(specimen, parse_terms(entries, 'test')).predict(path, path.t)
        assert found.valid.all()
        return seen(name, specimen, path, found.get, seed)

    return one


def seen(name, specimen, path, shown, seed):
    """Evidence of what is shown, kind -> (n, c, 3), on a Path under white noise."""
    rng, markers = np.random.default_rng(seed), len(specimen.markers)
    pads, tools = len(specimen.pads), len(specimen.tools)
    rest = {OPTICAL: specimen.rest[:markers], EM: specimen.rest[markers:],
            FORCE: np.zeros((pads, 3)), ENCODER: np.zeros((pads, 1))}
    names = {OPTICAL: specimen.markers, EM: specimen.tools, FORCE: specimen.pads,
             ENCODER: specimen.pads}
    bodies = {OPTICAL: specimen.carriers, EM: (TISSUE,) * tools, FORCE: specimen.pads,
              ENCODER: specimen.pads}
    streams = {}
    for kind in (OPTICAL, EM, FORCE, ENCODER):
        values = path.q[..., None] if kind == ENCODER else shown(kind)
        values = values + NOISE.get(kind, 1e-6) * rng.standard_normal(values.shape)
        streams[kind] = Stream(kind, path.t, names[kind], values,
                               np.ones(values.shape[:2], dtype=bool), bodies[kind], rest[kind])
    return Evidence(name, specimen.scene, pad_directions(specimen.scene), streams)


@pytest.mark.validate
def test_a_gain_of_one_of_two_sensors_comes_with_that_of_the_other(scene):
    """It is the inverse gain of the other beside another modulus; a weight would tell."""
    two = replace(scene, pads=scene.pads[:2], markers=tuple(
        m for m in scene.markers if m.body not in ('pad_3', 'pad_4')))
    specimen = specimen_of(two)
    path = path_of([(goal[:2], speed) for goal, speed in PUSHES if not any(goal[2:])])
    shown = ForwardModel(specimen, parse_terms(
        [{'name': 'force_gain', 'gain': 0.3, 'pads': ['pad_1']}], 'test')).predict(path, path.t)
    d = diagnose((seen('two pads', specimen, path, shown.get, 1),), source(),
                 meshes=MESHES).diagnosis
    assert d.verdict == 'equivalent'
    told = {cause.applies_to['pads']: cause for cause in d.causes}
    assert {cause.term for cause in d.causes} == {'force_gain'}
    ratios = [1.0 + told[pad,].parameters['gain'].value for pad in ('pad_1', 'pad_2')]
    assert np.prod(ratios) == pytest.approx(1.0, abs=0.05)
    # 0.3 is four times the typical size: the prior draws the gain to less, another modulus beside.
    assert ratios[0] == pytest.approx(1.3, abs=0.08)
    assert 0.05 < told['pad_1',].probability < 0.95
    assert d.next_experiment.instruction == 'Hang a known weight on the force sensors.'
    assert sentences.verdict(d).count('measured forces are scaled') == 1


def source():
    return Provenance('made up', 7, 'test', 'test', 'breast.yaml', ())


@pytest.fixture(scope='module')
def stiffening(record):
    return diagnose((record((STIFFENING,), legs=FEW),), source(), meshes=MESHES)


@pytest.mark.parametrize('legs', [PUSHES[:3], pytest.param(PUSHES, marks=pytest.mark.validate)],
                         ids=['three pushes', 'six'])
def test_nothing_is_missing_where_nothing_was_planted(record, legs):
    """And what is done meanwhile is told."""
    said = []
    d = diagnose((record(legs=legs),), source(), meshes=MESHES,
                 progress=lambda step, *_: said.append(step)).diagnosis
    assert d.verdict == 'nothing_missing' and d.causes == () and d.chance > 0.001
    assert all(fit.recalibrated < 1.5 * fit.noise_floor for fit in d.fit)
    # in their order; no candidate stands out here, so that full fits may be left out
    assert list(dict.fromkeys(said)) == [s for s in STEPS if s != FITS or s in said]


@pytest.mark.validate
def test_a_body_that_swings_lacks_nothing_where_its_scene_has_inertia(scene):
    """Markers are up to 0.4 mm off equilibria after stops, forces 0.02 N; the clocks are right."""
    soft = replace(scene, dynamics='implicit', rayleigh_alpha=2.0, rayleigh_beta=5e-4,
                   material=replace(scene.material, E=1e3))
    specimen, path = specimen_of(soft), path_of(PUSHES[:4])
    swinging = seen('swinging', specimen, path, _integrated(specimen, path).get, 1)
    d = diagnose((swinging,), source(), meshes=MESHES).diagnosis
    assert d.verdict == 'nothing_missing' and d.causes == ()
    assert any('dynamics: implicit' in note for note in d.notes)
    still = replace(swinging, scene=replace(soft, dynamics='quasi_static'))
    d = diagnose((still,), source(), meshes=MESHES).diagnosis
    assert {cause.term for cause in d.causes} <= {'clock_offset'}
    assert any('may swing' in note for note in d.notes)


def _integrated(specimen, path, parts=5):
    """kind -> (n, c, 3) of a body with inertia at the times of a Path, `parts` steps between."""
    plant = TissueSimulator(specimen.body, (), dynamics='implicit',
                            options=DynamicOptions(max_step=PERIOD / parts))
    plant.reset(path.t[0] - PERIOD)
    attached, markers = attach(specimen, specimen.body), len(specimen.markers)
    points, forces = [], []
    for t, q in zip(path.t, path.q, strict=True):
        pads = q[:, None] * specimen.directions
        state = plant.step(t, pads)
        points.append(attached.points(state.x, pads, np.zeros(3)))
        forces.append(state.pad_force)
    points = np.array(points)
    return {OPTICAL: points[:, :markers], EM: points[:, markers:], FORCE: np.array(forces)}


@pytest.mark.validate
@pytest.mark.parametrize('zeroed', [True, False], ids=['under the weight', 'before it'])
def test_the_weight_of_a_body_is_no_fault_of_its_force_sensors(scene, zeroed):
    """Pads carry up to 0.5 N at rest, which cells show or do not."""
    specimen = specimen_of(replace(scene, gravity=(0.0, 0.0, -9.81)))
    path = path_of(PUSHES[:4])
    found = ForwardModel(specimen).predict(path, path.t)
    shown = {kind: found.get(kind) for kind in (OPTICAL, EM, FORCE)}
    assert np.abs(shown[FORCE][0]).max() > 0.2
    if zeroed:
        shown[FORCE] = shown[FORCE] - shown[FORCE][0]
    d = diagnose((seen('heavy', specimen, path, shown.get, 1),), source(), meshes=MESHES).diagnosis
    assert d.verdict == 'nothing_missing' and d.causes == ()
    assert any('zeroed under it' in note for note in d.notes) == zeroed


@pytest.mark.validate
def test_a_pad_off_its_zero_presses_the_body_that_was_found(scene):
    """By half a millimetre, in tissue a fifth as stiff in volume: markers rest elsewhere."""
    specimen, path = specimen_of(scene), path_of(PUSHES[:4])
    off = np.array([0.0, -5e-4, 0.0, 0.0])

    def run(entries, seed, name):
        model = ForwardModel(specimen, parse_terms(entries, 'test'))
        found = model.predict(replace(path, q=path.q + off), path.t)
        return seen(name, specimen, path, found.get, seed)

    d = diagnose((run(({'name': 'compressibility', 'factor': 0.2},), 1, 'softer'),), source(),
                 null=(run((), 2, 'sound'),), meshes=MESHES).diagnosis
    cause, = d.causes
    assert d.verdict == 'named' and d.chance > 0.05
    assert cause.parameters['factor'].value == pytest.approx(0.2, rel=0.05)


def test_stiffening_is_named_with_its_size(stiffening):
    d = stiffening.diagnosis
    assert d.verdict == 'named'
    cause, = d.causes
    assert cause.term == 'strain_stiffening'
    assert cause.parameters['ratio'].value == pytest.approx(1.0, rel=0.2)
    optical, force = (next(f for f in d.fit if f.stream == k) for k in ('optical', 'force'))
    assert force.named < 0.5 * force.recalibrated
    assert optical.named < 1.5 * optical.noise_floor


@pytest.mark.validate
def test_a_force_sensor_drifts_from_when_it_was_tared(scene):
    """At 50 s, when the second recording of a session began, as at 0 in the first."""
    drift = parse_terms(({'name': 'force_drift', 'rate_N_min': [0.6, 0.0, 0.0]},), 'test')
    path, specimen = path_of(PUSHES[:1]), specimen_of(scene)
    t = path.t[::20]
    first, later = (ForwardModel(specimen, drift).predict(replace(path, t=path.t + start),
                                                          t + start).get(FORCE)
                    for start in (0.0, 50.0))
    np.testing.assert_allclose(later, first, atol=1e-9)
    assert first[-1, 3, 0] == pytest.approx(0.01 * t[-1], rel=0.2)     # a pad that is not pushed


@pytest.mark.validate
def test_cross_talk_of_a_force_sensor_is_named_at_its_pad(record):
    """Single shares are not known, as the load has one direction: what it makes of it is."""
    crosstalk = np.array([[0.0, 0.0, 0.05], [0.06, 0.0, 0.0], [-0.08, 0.0, 0.0]])
    evidence = record()
    pad = evidence.streams[FORCE].names.index('pad_1')
    shown = evidence.streams[FORCE].values
    load = shown[:, pad].mean(axis=0)
    shown[:, pad] += shown[:, pad] @ crosstalk.T
    d = diagnose((evidence,), source(), null=(record(seed=2, name='sound'),),
                 meshes=MESHES).diagnosis
    cause, = d.causes
    force = next(one for one in d.fit if one.stream == FORCE)
    assert force.named < 1.3 * force.noise_floor < 0.7 * force.recalibrated
    assert (d.verdict, cause.term) == ('named', 'axis_crosstalk')
    assert cause.applies_to == {'pads': ('pad_1',)}
    term = AxisCrosstalk(**{name: one.value for name, one in cause.parameters.items()})
    np.testing.assert_allclose(term.matrix @ load, crosstalk @ load,
                               atol=0.15 * np.linalg.norm(crosstalk @ load))


@pytest.mark.validate
def test_tissue_that_is_softer_than_in_the_null_recording_lacks_no_physics(record):
    """Calibration takes it up; with one modulus for both, softening was named."""
    soft = record(({'name': 'stiffness_scale', 'factor': 0.85},))
    d = diagnose((soft,), source(), null=(record(seed=2, name='sound'),), meshes=MESHES).diagnosis
    assert d.verdict == 'nothing_missing'
    E = d.recalibrated['E'].value / soft.scene.material.E
    assert E == pytest.approx(0.85, rel=0.03)


@pytest.mark.validate
def test_a_tool_that_sits_elsewhere_than_in_the_null_recording_is_named(record):
    """0.6 mm, three times what a laboratory leaves: otherwise it is the same in both."""
    tool = specimen_of(record().scene).tools[0]
    moved = ({'name': 'em_offset', 'offset_mm': [0.2, -0.5, 0.3], 'tools': [tool]},)
    d = diagnose((record(moved, legs=PUSHES[:3]),), source(), meshes=MESHES,
                 null=(record(seed=2, name='sound', legs=PUSHES[:3]),)).diagnosis
    cause, = d.causes
    assert (cause.term, cause.applies_to['tools']) == ('em_offset', (tool,))
    np.testing.assert_allclose(1e3 * np.array(cause.parameters['offset'].value),
                               [0.2, -0.5, 0.3], atol=0.15)


@pytest.mark.validate
def test_an_em_tracker_may_stand_elsewhere_than_in_the_null_recording(record):
    """All tools together, by as much as a laboratory leaves."""
    moved = ({'name': 'em_offset', 'offset_mm': [0.2, -0.2, 0.1]},)
    d = diagnose((record(moved, legs=PUSHES[:3]),), source(), meshes=MESHES,
                 null=(record(seed=2, name='sound', legs=PUSHES[:3]),)).diagnosis
    assert d.verdict == 'nothing_missing'


@pytest.mark.validate
def test_what_drifts_goes_on_from_one_recording_to_the_next(record):
    """A minute later the tissue is stiffer by a third from the start, and still stiffens."""
    drift = ({'name': 'stiffness_drift', 'rate_per_min': 0.3},)
    both = record(drift, name='first'), record(drift, 2, 'second', start=60.0)
    cause, = diagnose(both, source(), meshes=MESHES).diagnosis.causes
    assert cause.term == 'stiffness_drift'
    assert 60.0 * cause.parameters['rate'].value == pytest.approx(0.3, rel=0.1)


def test_two_jobs_give_the_same_bits(record, tmp_path):
    """Of a screen that forks share; on one core there is none to share it with."""
    short = record((STIFFENING,), legs=PUSHES[4:5])
    for jobs in (1, 2):
        d = diagnose((short,), source(), meshes=MESHES, jobs=jobs).diagnosis
        assert d.verdict != 'nothing_missing'
        d.to_json(tmp_path / str(jobs))
    assert (tmp_path / '1').read_bytes() == (tmp_path / '2').read_bytes()


def test_where_it_shows_most_the_measured_follows_what_was_found(stiffening):
    shown = {one.stream: one for one in stiffening.shown.partials}
    assert set(shown) == {OPTICAL, EM, FORCE}
    one = shown[FORCE]
    assert one.channel == 'pad_1'       # pushed deepest
    size = np.sqrt(np.mean(one.effect**2))
    assert np.sqrt(np.mean((one.measured - one.effect)**2)) < 0.2 * size
    assert size > 3.0 * np.sqrt(np.mean(one.sd**2))


def test_the_answer_becomes_a_page_and_a_scenario(stiffening, scene, tmp_path):
    page = write_diagnosis(stiffening.diagnosis, stiffening.shown, tmp_path / 'page.html')
    assert 'strain stiffening' in page.read_text()
    assert 'Where it shows most (made up)' in page.read_text()
    written = write_corrected(stiffening.diagnosis,
                              base_scenario(SCENES / 'breast.yaml', 'breast', 7),
                              tmp_path / 'corrected.yaml')
    terms = [entry['name'] for entry in load_cell(written).scenario.plant.terms]
    assert terms == ['strain_stiffening']


def test_the_next_recording_is_nearer_to_the_corrected_model(stiffening, record, scene, tmp_path):
    """Pushes that the diagnosis has not seen; what differs beside the noise is gone."""
    legs = (((0, 0, 0, 6), 10), ((0, 7, 0, 0), 10), ((6, 0, 4, 0), 10))
    following, path = record((STIFFENING,), seed=5, name='next', legs=legs), path_of(legs)
    cell = load_cell(write_corrected(
        stiffening.diagnosis, base_scenario(SCENES / 'breast.yaml', 'breast', 7),
        tmp_path / 'corrected.yaml'))
    corrected = replace(scene, material=cell.model.material)

    def left(one, terms, kind):
        shown = ForwardModel(specimen_of(one), terms).predict(path, path.t).get(kind)
        return np.sqrt(np.mean((following.get(kind).values - shown)**2))

    for kind in (OPTICAL, FORCE):
        before = left(scene, (), kind)
        after = left(corrected, cell.model_terms, kind)
        assert after < 1.1 * NOISE[kind]
        assert after**2 - NOISE[kind]**2 < 0.2 * (before**2 - NOISE[kind]**2)


@pytest.mark.validate
def test_what_was_found_predicts_a_recording_that_was_not_fitted(record):
    """To the noise, forces too: the modulus that was found with it is in its answer already."""
    later = record((STIFFENING,), seed=3, name='later', legs=PUSHES[2:4])
    fitted = [record((STIFFENING,), seed=seed, name=str(seed), legs=legs)
              for seed, legs in ((1, PUSHES[:4]), (2, PUSHES[4:]))]
    d = diagnose(fitted, source(), meshes=MESHES, held_out=(later,)).diagnosis
    assert [cause.term for cause in d.causes] == ['strain_stiffening']
    assert all(fit.held_out == 'later' and fit.named < 1.2 * fit.noise_floor for fit in d.fit)


def turned(evidence, pad, rate):
    """Evidence in which the marker on a pad turns about its centre, by rate [rad/m] of travel."""
    optical, i = evidence.get(OPTICAL), evidence.pads.index(pad)
    k, = optical.on(pad)
    lever = optical.rest[k] - np.array(evidence.scene.pads[i].centre)
    axis = np.cross(lever, (0.0, 0.0, 1.0)) / np.linalg.norm(lever[:2])
    angles = rate * evidence.get(ENCODER).values[:, i, 0]
    values = optical.values.copy()
    values[:, k] += Rotation.from_rotvec(angles[:, None] * axis).apply(lever) - lever
    return replace(evidence, streams={**evidence.streams, OPTICAL: replace(optical,
                                                                           values=values)})


@pytest.mark.validate
def test_a_marker_that_turns_by_itself_is_no_gain_and_no_direction_of_its_pad(record):
    """Tissue and forces answer as to a pad that goes as the scene says: how fast it turns."""
    rate = np.radians(1.5) / 1e-3
    d = diagnose((turned(record(), 'pad_1', rate),), source(), meshes=MESHES).diagnosis
    assert d.verdict == 'unexplained' and d.causes == ()
    assert (OPTICAL, 'pad_1') in {(place.stream, place.channel) for place in d.where}
    finding, = (f for f in d.findings if f.channel == 'pad_1')
    assert finding.term is None
    told = re.search(r'turns by ([0-9.]+) deg per mm', finding.statement)
    assert float(told[1]) == pytest.approx(1.5, rel=0.05)


@pytest.mark.validate
def test_what_nothing_explains_in_recordings_of_unlike_length_has_its_page(record, tmp_path):
    pair = [turned(record(seed=seed, name=name, legs=legs), 'pad_1', np.radians(1.5) / 1e-3)
            for seed, name, legs in ((1, 'long', PUSHES[:2]), (2, 'short', PUSHES[:1]))]
    found = diagnose(pair, source(), meshes=MESHES)
    d = found.diagnosis
    assert d.verdict == 'unexplained' and d.causes == ()
    assert (OPTICAL, 'pad_1') in {(place.stream, place.channel) for place in d.where}
    page = write_diagnosis(d, found.shown, tmp_path / 'page.html').read_text()
    assert 'no term of the catalogue explains' in page and 'short' in page


@pytest.mark.validate
@pytest.mark.parametrize('legs', [PUSHES, PUSHES[:1] * 4], ids=['certain', 'yield or gain'])
def test_a_marker_on_a_post_that_bends_is_no_yield_of_its_pad(record, legs):
    """Its motion falls short in proportion to force, as a yielding actuator's would."""
    evidence = record(legs=legs)
    optical, force = evidence.get(OPTICAL), evidence.get(FORCE)
    k, = optical.on('pad_1')
    values = optical.values.copy()
    axis = evidence.directions[0]
    values[:, k] += 2e-4 * np.outer(force.values[:, 0] @ axis, axis)
    bent = replace(evidence, streams={**evidence.streams, OPTICAL: replace(optical,
                                                                           values=values)})
    d = diagnose((bent,), source(), meshes=MESHES).diagnosis
    assert d.verdict == 'unexplained' and d.causes == ()
    assert (OPTICAL, 'pad_1') in {(place.stream, place.channel) for place in d.where}


@pytest.mark.validate
def test_a_gain_and_a_direction_that_a_pad_has_are_both_named(record):
    """As large as a turn of its marker would make them, in tissue that stiffens besides."""
    entries = ({'name': 'pad_misplacement', 'tilt_up_deg': 8.0, 'pads': ['pad_1']},
               {'name': 'actuator_gain', 'gain': -0.1, 'actuators': [0]}, STIFFENING)
    d = diagnose((record(entries),), source(), meshes=MESHES).diagnosis
    found = {cause.term: cause.parameters for cause in d.causes}
    assert found['pad_misplacement']['tilt_up'].value == pytest.approx(np.radians(8.0), rel=0.1)
    assert found['actuator_gain']['gain'].value == pytest.approx(-0.1, rel=0.1)


@pytest.mark.validate
def test_a_slip_in_one_of_two_recordings_is_named_and_is_none_in_the_other(record):
    """Another push, at the time of the slip, shows none."""
    slip = {'name': 'marker_slip', 'marker': 'tissue_3', 'onset_s': 6.0}
    d = diagnose((record((), seed=2, name='sound', legs=PUSHES[4:]),
                  record((slip,), seed=1, name='slipped', legs=PUSHES[:4])), source(),
                 meshes=MESHES).diagnosis
    assert d.verdict == 'named' and [cause.term for cause in d.causes] == ['marker_slip']
    when, = d.when
    onset = d.causes[0].parameters['onset']
    assert onset.low < 6.0 <= onset.high < onset.low + 0.2
    assert when.recording == 'slipped' and when.t_start == onset.low
    assert when.onset == (onset.low, onset.high)
    optical = next(fit for fit in d.fit if fit.stream == 'optical')
    assert optical.named < 1.2 * optical.noise_floor


LEAN = {'name': 'external_force', 'force_N': [0.01, 0.0, -0.05], 'centre_mm': [-20.0, 13.0, 50.0],
        'radius_mm': 8.0, 'duration_s': 1000.0}


@pytest.mark.validate
def test_somebody_who_leans_on_it_in_the_middle_of_pushes_is_named(record):
    """Set in and gone over 0.8 s, no step of any channel: 0.05 N, forces with 0.02 of noise."""
    plain, leant = record(), record((LEAN,))
    t = plain.streams[OPTICAL].t
    share = np.interp(t, [6.4, 7.2, 10.5, 11.3], [0.0, 1.0, 1.0, 0.0])[:, None, None]
    streams = {kind: replace(one, values=one.values + share * (
        leant.streams[kind].values - one.values)) for kind, one in plain.streams.items()}
    d = diagnose((replace(plain, streams=streams),), source(), meshes=MESHES).diagnosis
    assert not any(finding.onset for finding in d.findings)
    assert d.verdict == 'named' and [cause.term for cause in d.causes] == ['external_force']
    found = d.causes[0].parameters
    assert found['force'].value == pytest.approx(LEAN['force_N'], abs=0.02)
    assert np.linalg.norm(1e3 * np.array(found['centre'].value) - LEAN['centre_mm']) < 10.0
    assert 5.5 < found['onset'].value < 7.2
    assert 10.5 < found['onset'].value + found['duration'].value < 12.2


@pytest.mark.validate
def test_recordings_of_unlike_length_are_answered_together(record):
    """Forces 80 ms late in both."""
    pair = [late(record(seed=seed, name=name, legs=legs), FORCE, 0.08)
            for seed, name, legs in ((1, 'long', PUSHES[:4]), (2, 'short', PUSHES[4:]))]
    d = diagnose(pair, source(), meshes=MESHES).diagnosis
    cause, = d.causes
    assert d.verdict == 'named'
    assert cause.term == 'clock_offset' and cause.applies_to['stream'] == FORCE
    assert cause.parameters['delay'].value == pytest.approx(0.08, abs=0.005)


def late(evidence, kind, delay):
    """Evidence whose stream of a kind has stamps that are late by `delay` [s]."""
    stream = evidence.get(kind)
    return replace(evidence, streams={**evidence.streams, kind: replace(
        stream, t=stream.t + delay)})


@pytest.mark.validate
def test_the_modulus_is_that_of_the_first_recording_with_forces(record):
    """Which comes first changes neither it nor how well it is known, nor what a mesh may hide."""
    blind = record(seed=1, name='blind', legs=PUSHES[:2])
    blind = replace(blind, streams={k: s for k, s in blind.streams.items() if k != FORCE})
    seeing = record(seed=2, name='seeing', legs=PUSHES[2:4])
    forces = seeing.get(FORCE)
    seeing = replace(seeing, streams={**seeing.streams, FORCE: replace(
        forces, values=2.5 * forces.values)})
    one, other = (diagnose(some, source(), meshes=MESHES).diagnosis
                  for some in ((seeing, blind), (blind, seeing)))
    E, same = (d.recalibrated['E'] for d in (one, other))
    assert same.value == pytest.approx(E.value, rel=1e-3)
    assert same.high - same.low == pytest.approx(E.high - E.low, rel=0.02)
    assert [f.mesh for f in other.fit] == pytest.approx([f.mesh for f in one.fit], rel=0.01)


@pytest.mark.validate
def test_what_a_sound_recording_shows_as_well_is_no_fault(record):
    d = diagnose((record((PLAY,), seed=3),), source(), meshes=MESHES,
                 null=(record((PLAY,), seed=4, name='sound'),)).diagnosis
    assert d.verdict == 'nothing_missing'
    assert [r.role for r in d.provenance.recordings][-1] == 'null'


def test_a_scene_whose_pads_touch_is_refused_by_its_name(record, scene):
    touching = replace(scene, pads=tuple(replace(pad, contact='touching') for pad in scene.pads))
    with pytest.raises(ConfigError, match='scene breast has pads that touch; must be bonded'):
        diagnose((replace(record(legs=PUSHES[:1]), scene=touching),), source(), meshes=MESHES)


@pytest.mark.validate
def test_a_lump_that_one_push_shows_is_a_place_and_no_cause(record, tmp_path):
    """T6: a load that comes with the push would do as well."""
    lump = {'name': 'inclusion', 'centre_mm': (20.0, 10.0, 30.0), 'radius_mm': 12.0, 'ratio': 5.0}
    one_way = tuple(((depth, 0, 0, 0), 20) for depth in (3, 6, 8))
    found = diagnose((record([lump], legs=one_way),), source(), meshes=MESHES)
    d = found.diagnosis
    assert d.verdict == 'unexplained' and not d.causes
    assert np.linalg.norm(np.subtract(d.where[0].position, (20e-3, 10e-3, 30e-3))) < 15e-3
    assert 'like inclusion would explain it' in ' '.join(d.notes)
    assert 'another pad' in d.next_experiment.instruction
    page = write_diagnosis(d, found.shown, tmp_path / 'page.html').read_text()
    assert 'these recordings cannot name' in page and 'To decide it: Push with another' in page


def test_a_diagnosis_takes_one_thread_of_blas(scene):
    """Two doubled its processor time, 51 to 109 s for a minute of recording, for nothing."""
    seen = []

    class Stopped(Exception):
        pass

    def progress(*so_far):
        seen.extend(one['num_threads'] for one in threadpool_info()
                    if one['user_api'] == 'blas')
        raise Stopped

    with threadpool_limits(2), pytest.raises(Stopped):
        diagnose((SimpleNamespace(scene=scene, name='A'),), SimpleNamespace(seed=0),
                 progress=progress)
    assert seen and set(seen) == {1}
