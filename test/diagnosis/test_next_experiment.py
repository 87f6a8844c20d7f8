"""What is asked for: the pushes and streams that split a class, checked by full runs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag

from arm_brachy.control.moves import check_moves
from arm_brachy.core.errors import InputError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.devices.actuator_driver import ActuatorParams
from arm_brachy.devices.terms.force_drift import ForceDrift
from arm_brachy.diagnosis.experiment_design import request as asking
from arm_brachy.diagnosis.experiment_design.advice import REMEDIES, advice
from arm_brachy.diagnosis.experiment_design.design import next_experiment
from arm_brachy.diagnosis.experiment_design.prediction import Option, Whitened, planned
from arm_brachy.diagnosis.experiment_design.trials import Trial, trial_of, trials_of
from arm_brachy.diagnosis.likelihood.match import OWN
from arm_brachy.diagnosis.likelihood.nuisances import nuisances
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.model.joint_linearisation import baselines
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.report.sentences import request
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.noise import Noise
from arm_brachy.diagnosis.signals.stream import FORCE
from arm_brachy.diagnosis.statistics.linear_gaussian import log_density
from arm_brachy.diagnosis.statistics.noise_process import Colour
from arm_brachy.registry import by_name

SCENES = config_dir() / 'scenes'
ENOUGH = 3.0    # sd


@pytest.fixture(scope='module')
def specimen():
    """Coarse and linear, with no marker on a pad: what makes gain and compliance a class."""
    scene = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast' / 'breast_600.msh')
    markers = tuple(m for m in scene.markers if not m.body.startswith('pad'))
    return specimen_of(replace(scene, element='linear', markers=markers))


def option(name, amplitude, names=None, **place):
    one = hypothesis(by_name(name), names, **place)
    return Option(name, (one,), amplitude * np.ones(len(one.strengths)))


def push(specimen, depth, speed, hold, states):
    """A Trial of one push of pad 1, seen at `states` [s]."""
    way = depth / speed
    t = np.union1d([0.0, 1.0, 1.0 + way, 1.0 + way + hold], states)
    q = np.zeros((len(t), len(specimen.pads)))
    q[:, 0] = np.interp(t, [1.0, 1.0 + way], [0.0, depth])
    return Trial((), Path(t, q), np.asarray(states), np.full(len(states), 0.05))


def at_hand(specimen, trial, options, streams):
    baseline = Baseline(ForwardModel(specimen), trial.path, trial.t)
    return planned(trial, baseline, options, {}).take(streams)


GAIN_OR_COMPLIANCE = (option('actuator_gain', 1.0, ('gain',), actuators=(0,)),
                      option('actuator_compliance', 1.0, actuators=(0,)))


@pytest.fixture(scope='module')
def one_push(specimen):
    """Pad 1 alone, one way, at one speed: where T8 holds."""
    return push(specimen, 6e-3, 1e-3, 2.0, 0.5 + np.arange(8))


def test_a_trial_among_others_is_a_recording_of_its_own(specimen):
    plans = trials_of(specimen, ('pad_2',))[:5]
    one, alone = baselines(ForwardModel(specimen), plans)[3], plans[3]
    other = Baseline(ForwardModel(specimen), alone.path, alone.t)
    relaxes = hypothesis(by_name('viscoelasticity'), ('g1',), tau1=3.0)
    for kind, shown in other.shown.items():
        assert np.abs(one.shown[kind] - shown).max() < 1e-5 * np.abs(shown).max()
    found, expected = respond(one, relaxes).values, respond(other, relaxes).values
    # 1 %: which states share a factor or a place differs; what the trials before left is 5 %
    for kind, values in expected.items():
        assert np.abs(found[kind] - values).max() < 1e-2 * np.abs(values).max()


def test_trials_can_be_made_by_the_cell(specimen):
    plans = trials_of(specimen)
    assert len(plans) <= 12 and all(len(plan.t) <= 12 for plan in plans)
    for plan in plans:
        check_moves(plan.moves, specimen.scene, ActuatorParams(), 1e-3, lambda *keys: str(keys))
        assert not plan.path.q[[0, -1]].any()
        assert np.all(np.diff(plan.t) > 0.0) and plan.t[-1] <= plan.path.t[-1]


def test_gain_and_compliance_of_one_actuator_are_split_against_another_stiffness(
        specimen, one_push):
    """T8: pushed by another pad, a compliant actuator yields where a wrong gain does nothing."""
    known = at_hand(specimen, one_push, GAIN_OR_COMPLIANCE, ('optical',))
    asked = next_experiment(specimen, (), GAIN_OR_COMPLIANCE, {}, ('optical',), at_hand=known)
    assert {pad.name for move in asked.moves for pad in move.pads} - {'pad_1'}
    assert asked.splits == (('actuator_gain', 'actuator_compliance'),)
    assert asked.separation > ENOUGH and not asked.record and not asked.instruction
    assert 'tell actuator gain from actuator compliance' in request(asked)


@pytest.mark.parametrize('true', [0, 1])
def test_the_recording_that_is_asked_for_decides(specimen, one_push, true):
    """Played out with the true cause by full nonlinear runs, and noise: the odds follow."""
    known = at_hand(specimen, one_push, GAIN_OR_COMPLIANCE, ('optical',))
    asked = next_experiment(specimen, (), GAIN_OR_COMPLIANCE, {}, ('optical',), at_hand=known)
    rng = np.random.default_rng(3 + true)
    first = played(specimen, one_push, true, rng)
    assert abs(odds([first], true)) < 5.0
    second = played(specimen, trial_of(asked.moves, specimen.pads), true, rng)
    # the log odds of two causes that are d sd apart are d^2 / 2, give or take d
    d = asked.separation
    assert odds([first, second], true) > 0.5 * d**2 - 4.0 * d > 10.0


def played(specimen, trial, true, rng):
    """(Whitened, r (N,)) of a recording by markers, in which option `true` acts."""
    model = ForwardModel(specimen)
    baseline = Baseline(model, trial.path, trial.t)
    plan = planned(trial, baseline, GAIN_OR_COMPLIANCE, {})
    cause = GAIN_OR_COMPLIANCE[true]
    acting = ForwardModel(specimen, (cause.hypotheses[0].term(cause.amplitudes),))
    new = acting.predict(trial.path, trial.t)
    effect = plan.observables.whiten({kind: (new.get(kind) - shown)[..., None]
                                      for kind, shown in baseline.shown.items()})[:, 0]
    rows = np.array([row.kind == 'optical' for row in plan.observables.rows])
    seen = plan.take(('optical',))
    return seen, effect[rows] + rng.normal(size=rows.sum())


def odds(recordings, true):
    """Log of the odds of the true cause against the other."""
    own = [np.array([n.startswith(OWN) for n in seen.names]) for seen, _ in recordings]
    U = np.hstack([block_diag(*(seen.U[:, o] for (seen, _), o in
                                zip(recordings, own, strict=True))),
                   np.vstack([seen.U[:, ~o] for (seen, _), o in
                              zip(recordings, own, strict=True)])])
    r = np.concatenate([r for _, r in recordings])
    density = [log_density(np.hstack([U, np.vstack([seen.columns[i] for seen, _ in
                                                    recordings])]), r) for i in range(2)]
    return density[true] - density[1 - true]


def test_a_late_clock_and_an_offset_at_one_speed_are_split_by_another_speed(specimen):
    """T8: while one pad moves one way at one speed, v times the delay is an offset."""
    speed = 10e-3
    late = option('clock_offset', 1.0, stream='optical')
    delay = late.hypotheses[0].term(late.amplitudes).delay
    offset = option('actuator_gain', 1.0, ('offset',), actuators=(0,))
    typical = offset.hypotheses[0].term(offset.amplitudes).offset
    scale = 1e-3 / (speed * delay), -1e-3 / typical    # both 1 mm, well above a touch offset
    options = tuple(replace(o, amplitudes=s * o.amplitudes)
                    for o, s in zip((late, offset), scale, strict=True))
    moving = push(specimen, 12e-3, speed, 1.0, 1.1 + 0.2 * np.arange(6))
    known = at_hand(specimen, moving, options, ('optical',))
    asked = next_experiment(specimen, (), options, {}, ('optical',), at_hand=known)
    assert asked.splits and asked.separation > ENOUGH and not asked.record


def test_what_happened_once_is_told_from_what_stays_by_any_further_recording(specimen, one_push):
    """Steps lost before the push are an offset of the actuator, but not in the next recording."""
    lost = option('lost_steps', -1.0, onset=0.0, actuators=(0,))
    offset = option('actuator_gain', 1.0, ('offset',), actuators=(0,))
    typical = [abs(o.hypotheses[0].strengths[0].typical) for o in (lost, offset)]
    options = tuple(replace(o, amplitudes=2e-3 / size * o.amplitudes)    # 10 touch offsets
                    for o, size in zip((lost, offset), typical, strict=True))
    known = at_hand(specimen, one_push, options, ('optical',))
    asked = next_experiment(specimen, (), options, {}, ('optical',), at_hand=known, reach=0.3)
    assert asked.splits and asked.separation > ENOUGH and not asked.record


RELAXES_OR_DRIFTS = (option('viscoelasticity', 1.0, ('g1',), tau1=3.0),
                     option('stiffness_drift', 1.0, onset=0.0))


def test_relaxation_or_drift_of_a_modulus_asks_for_forces(specimen):
    """T3: neither moves a marker under bonded pads; forces are what tells."""
    trial = trials_of(specimen)[0]
    known = at_hand(specimen, trial, RELAXES_OR_DRIFTS, ('optical',))
    asked = next_experiment(specimen, (), RELAXES_OR_DRIFTS, {}, ('optical',), at_hand=known)
    assert asked.record == ('force',) and asked.separation > ENOUGH
    assert 'Record the pad forces as well' in request(asked)


def test_load_cells_of_one_axis_are_planned_with_as_such(specimen, one_push):
    """Force along the push of every pad, and nothing aside: a drift aside would not show."""
    baseline = Baseline(ForwardModel(specimen), one_push.path, one_push.t)
    sheet = Noise(np.full((1, 1), 0.01), Colour(), 0.02, np.eye(1), 'data sheet')
    along = hypothesis(ForceDrift, ('rate',), pads=('pad_1',))
    options = (Option('force_drift', (along,), np.ones(len(along.strengths))),)
    cells, triads = (planned(one_push, baseline, options, noise) for noise in (
        {FORCE: sheet}, {FORCE: replace(sheet, sd=np.full((1, 3), 0.01), axes=np.eye(3))}))
    n = len(one_push.t) * len(specimen.pads)
    assert len(cells.take((FORCE,)).U) == n and len(triads.take((FORCE,)).U) == 3 * n
    drift = cells.take((FORCE,)).columns[0]
    pushed = specimen.directions[0]
    aside = np.linalg.svd(pushed[None])[2][1:]
    assert np.abs(drift @ aside.T).max() < 1e-9 * np.abs(drift @ pushed).max()


def test_with_the_deciding_stream_nothing_is_asked(specimen):
    streams = ('optical', 'force')
    known = at_hand(specimen, trials_of(specimen)[0], RELAXES_OR_DRIFTS, streams)
    assert next_experiment(specimen, (), RELAXES_OR_DRIFTS, {}, streams, at_hand=known) is None
    assert next_experiment(specimen, (), RELAXES_OR_DRIFTS[:1], {}, streams) is None


def test_what_nothing_tells_apart_is_answered_in_words(specimen):
    """Two names for one effect: no push separates them, a known length would."""
    scale = option('optical_scale', 1.0)
    twin = replace(scale, name='reference_shape')
    asked = next_experiment(specimen, (), (scale, twin), {}, ('optical',), reach=0.2)
    assert not asked.moves and not asked.record and asked.separation is None
    assert asked.instruction.startswith('Look at a ruler')


def test_advice_speaks_of_known_terms():
    assert all(by_name(term) for pair in REMEDIES for term in pair)
    assert advice([('viscoelasticity', 'stiffness_drift')]).count('only positions') == 2
    assert 'same recording again' in advice([('external_force', 'inclusion')])
    assert 'second orientation' in advice([('gravity + backlash', 'reference_shape')])
    assert advice([('force_gain', 'force_gain')]) == 'Hang a known weight on the force sensors.'
    assert 'backlash here and backlash there' in advice([('backlash', 'backlash')])


def test_nuisances_that_are_not_those_at_hand_are_refused(specimen, one_push):
    known = at_hand(specimen, one_push, GAIN_OR_COMPLIANCE, ('optical',))
    with pytest.raises(InputError, match='must be the same'):
        next_experiment(specimen, (), GAIN_OR_COMPLIANCE, {}, ('optical',), at_hand=known,
                        nuisance_columns=nuisances, reach=0.2)


def test_a_stream_that_any_of_the_recordings_has_is_no_new_one(monkeypatch):
    """The first without forces, the second without markers: both are recorded already."""
    def matched(**noise):
        return SimpleNamespace(
            recorded=SimpleNamespace(prepared=SimpleNamespace(noise=noise)),
            baseline=SimpleNamespace(model=SimpleNamespace(specimen=None, terms=())))

    one = SimpleNamespace(causes=('a',), explanations=(SimpleNamespace(columns=np.ones((1, 1))),))
    monkeypatch.setattr(asking, 'sizes_of', lambda *_: ((), [np.ones(1)]))
    monkeypatch.setattr(asking, 'next_experiment',
                        lambda specimen, terms, options, noise, streams, **_: (noise, streams))
    assembly = SimpleNamespace(
        problem=SimpleNamespace(U=None), names=(),
        matched=(matched(encoder=0, optical=1), matched(encoder=0, optical=2, force=3)))
    noise, streams = asking.asked(assembly, SimpleNamespace(
        unproven=None, accepted=one, equals=(one,)), None)
    assert set(streams) == {'optical', 'force'} and noise['optical'] == 1 and noise['force'] == 3


def test_the_modulus_of_null_recordings_is_no_other_recordings():
    rng = np.random.default_rng(1)
    names = ('touch_pad_1', 'modulus', 'modulus_of_nulls')
    known = Whitened(rng.normal(size=(9, 3)), names, (rng.normal(size=(9, 2)),))
    shared, products = known.normal()
    assert shared == ('modulus',) and products.shape == (3, 3)
