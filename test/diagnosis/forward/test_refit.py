"""Full nonlinear fits against what was planted, on its own mesh: what noise and algebra allow."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError, MeshError, NotConverged
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.devices.terms.em_offset import EmOffset
from arm_brachy.devices.terms.force_gain import ForceGain
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.diagnosis.estimation import fit_model
from arm_brachy.diagnosis.estimation.fit import FAINTER, possible_start, unsettled
from arm_brachy.diagnosis.estimation.fit_model import Data, RecordingFit
from arm_brachy.diagnosis.estimation.map_fit import ROUGH, Options, Unsettled, refit
from arm_brachy.diagnosis.likelihood.constitutive_error import widened
from arm_brachy.diagnosis.likelihood.nuisances import nuisances
from arm_brachy.diagnosis.likelihood.observation import KINDS, Measured, Observables, channels_of
from arm_brachy.diagnosis.model.forward import STATICS, ForwardModel
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.pad_friction import ACCURACY, NEAR
from arm_brachy.diagnosis.model.sensitivities import loosened_change, together
from arm_brachy.diagnosis.selection.candidates import surface_places
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside
from arm_brachy.registry import by_name
from arm_brachy.tissue.terms.base_debond import FADE, RIM, BaseDebond
from arm_brachy.tissue.terms.external_force import ExternalForce
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.obstacle import Obstacle
from arm_brachy.tissue.terms.pad_slip import PadSlip
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

STATES = np.array([1.5, 2.5, 4.5, 5.4, 6.5, 7.5, 8.0, 9.0])
SOME = STATES[[0, 1, 2, 4]]     # what takes steps in time: two holds at either end
SD = {'optical': 3e-5, 'em': 1e-4, 'force': 0.01}   # windows of 100 samples averaged
LUMP = Inclusion(centre=(0.02, 0.01, 0.03), radius=0.012, ratio=4.0)


@pytest.fixture(scope='module')
def given(linear, encoder):
    """Function t -> (Baseline, nuisances) of the model as given."""
    known = {}

    def at(t):
        if tuple(t) not in known:
            baseline = Baseline(ForwardModel(linear), encoder, t)
            known[tuple(t)] = baseline, nuisances(baseline).values
        return known[tuple(t)]
    return at


@pytest.fixture
def record(linear, encoder, given):
    """Function from the terms of the truth to the Data that sensors with noise get of it."""
    def run(terms, *, seed=1, t=STATES, kinds=KINDS, noise=1.0, shown=None):
        if shown is None:
            found = ForwardModel(linear, terms).predict(encoder, t)
            shown = {kind: found.get(kind) for kind in KINDS}
        return dress(linear, encoder, t, shown, given(t)[1], np.random.default_rng(seed),
                     {kind: noise * SD[kind] for kind in kinds})
    return run


def dress(specimen, encoder, t, shown, columns, rng, sd):
    """Data of values with nuisances of their priors and white noise, kind -> sd."""
    lot = rng.standard_normal(columns['optical'].shape[3])
    shown = {kind: shown[kind] + columns[kind] @ lot for kind in sd}
    names = channels_of(specimen)
    streams = [Measured(kind, names[kind],
                        shown[kind] + sd[kind] * rng.standard_normal(shown[kind].shape),
                        np.ones(shown[kind].shape[:2], dtype=bool),
                        np.full(shown[kind].shape, sd[kind]), np.eye(len(t))) for kind in sd]
    observables = Observables(streams, names)
    return Data(specimen, encoder, t, observables, observables.whiten(columns))


def told(found, *known):
    """Estimates of a Refit that are as wide as `widened` says."""
    return found.space.estimates(found.z, found.mean, widened(found, *known))


def holds(estimate, truth, times=2.0):
    """True if the truth is in the interval made so many times as wide, in every component.

    Twice: one draw of noise leaves 90 % once in ten, this once in a thousand.
    """
    value, low, high = (np.array(v) for v in (estimate.value, estimate.low, estimate.high))
    low, high = value + times * (low - value), value + times * (high - value)
    return bool(np.all((low <= truth) & (np.array(truth) <= high)))


def width(estimate):
    return np.subtract(estimate.high, estimate.low)


def test_a_lump_is_found_from_the_next_place_and_half_its_contrast(record):
    data = record((LUMP,))
    near = hypothesis(Inclusion, centre=(0.012, 0.018, 0.036), radius=0.012)
    found = refit([data], (near,), [np.array([0.25])], held=('radius',))
    estimates = found.estimates[0]
    assert set(estimates) == {'centre', 'ratio'}
    assert np.linalg.norm(np.subtract(estimates['centre'].value, LUMP.centre)) < 3e-3
    assert holds(estimates['centre'], LUMP.centre)
    assert holds(estimates['ratio'], LUMP.ratio)
    assert found.after < found.before - 10.0
    chi2 = 2.0 * found.after / len(found.residual[0])
    assert chi2 == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(found.residual[0])))
    assert found.terms[0].radius == LUMP.radius


def half_off(term, where):
    """Glue of a base that has come off beyond a line across it, in place of BaseDebond's disc."""
    return np.clip((term.centre[0] - where[:, 0]) / (RIM * term.radius), 0.0, 1.0) ** FADE


@pytest.mark.validate
def test_a_sector_of_another_shape_settles_among_the_ripples_of_its_nodes(
        record, linear, encoder, monkeypatch):
    """The nearest disc is far off, and nodes that come off one by one ripple the way there."""
    with monkeypatch.context() as other:
        other.setattr(BaseDebond, '_glue', half_off)
        data = record((BaseDebond(radius=0.02, centre=(0.02, 0.0, 0.0)),))
    data = replace(data, baseline=Baseline(ForwardModel(linear), encoder, STATES))
    near = hypothesis(BaseDebond, centre=(0.04, 0.01, 0.0))
    found = refit([data], (near,), [np.array([0.0])], options=Options(runs=25))
    disc, = found.terms
    assert disc.centre[0] - disc.radius < 0.03 < disc.centre[0]
    assert found.after < 0.5 * found.before


@pytest.mark.parametrize(('truth', 'place', 'size'), [
    (BaseDebond(radius=0.03, centre=(0.02, 0.01, 0.0)), (0.04, -0.01, 0.0), 0.5),
    pytest.param(Obstacle(gap=2e-4, centre=(0.0, 0.0, 0.0575)), (0.008, 0.006, 0.057), 1.0,
                 marks=pytest.mark.validate)])
def test_tangents_beside_a_support_lead_to_it_in_a_few_runs(record, truth, place, size):
    """Condensed answers, then full runs took 31 and 52, and the sector stayed 13 nats short."""
    data = record((truth,))
    found = refit([data], (hypothesis(type(truth), centre=place),), [np.array([size])])
    assert found.runs <= 25
    assert 2.0 * found.after / len(found.residual[0]) == pytest.approx(
        1.0, abs=4.0 * np.sqrt(2.0 / len(found.residual[0])))
    assert all(holds(one, getattr(truth, name)) for name, one in found.estimates[0].items())


def test_in_noise_twice_as_loud_a_fit_goes_on_from_where_it_ended(record):
    data = record((LUMP,))
    near, size = hypothesis(Inclusion, centre=(0.012, 0.018, 0.036)), [np.array([0.25])]
    quiet = refit([data], (near,), size)
    loud = replace(data, observables=data.observables.louder(dict.fromkeys(SD, 2.0),
                                                             np.eye(len(STATES))))
    plain, on = (refit([loud], (near,), size, start=start) for start in (None, quiet.z))
    assert on.runs < 0.7 * plain.runs
    assert on.after == pytest.approx(plain.after, abs=ROUGH)


def test_friction_is_found_from_a_run_with_contact(quadratic, encoder):
    """Predictions by contact condensed, the truth by the plant's, at pushes to 4 mm."""
    path, t = replace(encoder, q=0.5 * encoder.q), STATES[:5]
    full = ForwardModel(quadratic, (PadSlip(0.3, pads=('pad_1',)),)).predict(path, t)
    columns = nuisances(Baseline(ForwardModel(quadratic), path, t)).values
    data = dress(quadratic, path, t, {kind: full.get(kind) for kind in KINDS}, columns,
                 np.random.default_rng(4), SD)
    one = hypothesis(PadSlip, pads=('pad_1',))
    found = refit([data], (one,), [np.array([0.5])])    # starts at twice the friction
    estimates = told(found, [replace(data, baseline=Baseline(
        ForwardModel(quadratic), path, t))], 1.0, ACCURACY)[0]
    assert estimates['friction'].value == pytest.approx(0.3, rel=0.2)
    assert holds(estimates['friction'], 0.3, times=1.0) and found.after < found.before - 10.0


def test_beside_a_loose_pad_the_modulus_scales_forces_and_moves_nothing(linear, encoder, record):
    """As a body of that modulus, linearised and condensed by itself, says."""
    path, t = replace(encoder, q=0.5 * encoder.q), STATES[:5]
    terms = PadSlip(0.3, pads=('pad_1',)), StiffnessScale(1.4)
    data = replace(record((), t=t), encoder=path)
    shown = RecordingFit(data, terms).predicted(terms)[1]
    bonded = Baseline(ForwardModel(linear, terms[1:]), path, t)
    change = loosened_change(bonded, terms[0], NEAR)
    for kind in KINDS:
        largest = np.abs(change[kind]).max()
        assert shown[kind] == pytest.approx(bonded.shown[kind] + change[kind],
                                            abs=2e-3 * largest, rel=0.0)


def test_the_modulus_is_left_with_what_has_forces_of_its_own(linear, record):
    data, scale = record(()), StiffnessScale(1.4)
    offset = EmOffset(offset=(1e-3, 0.0, 0.0))
    assert data.modulus_apart((scale, offset)) == (1.4, (offset,))
    for other in (ForceGain(1.1), Backlash(1e-4), LUMP):
        assert data.modulus_apart((scale, other)) == (1.0, (scale, other))
    heavy = replace(linear, body=replace(linear.body, gravity=np.array([0.0, 0.0, -9.81])))
    assert replace(data, specimen=heavy).modulus_apart((scale,)) == (1.0, (scale,))


def test_memory_beside_loose_pads_is_not_fitted(record):
    hypotheses = hypothesis(PadSlip, pads=('pad_1',)), hypothesis(Viscoelasticity, ('g1',))
    with pytest.raises(NotConverged, match='run with contact at every step'):
        refit([record((), t=SOME)], hypotheses, [np.ones(1), np.ones(1)])


def test_size_and_contrast_are_left_to_the_prior_and_their_product_is_not(record):
    near = hypothesis(Inclusion, centre=(0.016, 0.014, 0.033), radius=0.010)
    found = refit([record((LUMP,))], (near,), [np.array([0.5])])
    radius, ratio = found.estimates[0]['radius'], found.estimates[0]['ratio']
    assert holds(radius, LUMP.radius) and holds(ratio, LUMP.ratio)
    i, j = -2, -1
    correlation = found.covariance[i, j] / np.sqrt(found.covariance[i, i]
                                                   * found.covariance[j, j])
    assert correlation < -0.8


def test_relaxation_is_found_from_another_time(record):
    truth = Viscoelasticity(g1=0.4, tau1=1.5)
    slow = hypothesis(Viscoelasticity, ('g1',), tau1=5.0)
    found = refit([record((truth,), t=SOME)], (slow,), [np.array([0.5])])
    estimates = found.estimates[0]
    assert set(estimates) == {'g1', 'tau1'}
    assert holds(estimates['g1'], 0.4) and holds(estimates['tau1'], 1.5)
    assert width(estimates['tau1']) < 0.3

    # theorem T3: of homogeneous relaxation, markers between bonded pads show next to nothing
    blind = refit([record((truth,), t=SOME, kinds=('optical',))], (slow,), [np.array([0.5])])
    assert width(blind.estimates[0]['g1']) > 5.0 * width(estimates['g1'])


@pytest.mark.parametrize('truth', [Backlash(width=4e-4, actuators=(0,)),
                                   ActuatorGain(gain=0.05, actuators=(0,))])
def test_what_drives_the_pads_is_found_in_a_few_runs(record, truth):
    name = next(iter(vars(truth).keys() & {'width', 'gain'}))
    start = hypothesis(type(truth), (name,), actuators=(0,))
    found = refit([record((truth,))], (start,), [np.array([0.5])])
    estimate = found.estimates[0][name]
    assert holds(estimate, getattr(truth, name))
    assert width(estimate) < 0.2 * getattr(truth, name)     # touch points are as free
    assert found.runs <= 10


def test_play_that_begins_inside_its_gap_says_where(record):
    """It was taken as homed, and a touch point that is off had to make up for the rest."""
    truth = Backlash(width=6e-4, actuators=(0,), start=0.6)
    found = refit([record((truth,))], (hypothesis(Backlash, actuators=(0,)),), [np.array([0.5])])
    width_, start = (found.estimates[0][name] for name in ('width', 'start'))
    assert holds(width_, truth.width) and holds(start, truth.start)
    assert 0.0 <= start.low < start.high <= 1.0


def test_two_causes_at_once_and_the_model_has_a_third(linear, encoder, record):
    known = OpticalScale(scale=0.01)
    truth = (ActuatorGain(gain=0.06, actuators=(0,)), ForceGain(gain=-0.1, pads=('pad_1',)))
    data = replace(record((known, *truth)), terms=(known,))
    found = refit([data], (hypothesis(ActuatorGain, ('gain',), actuators=(0,)),
                           hypothesis(ForceGain, pads=('pad_1',))),
                  [np.array([0.0]), np.array([0.0])])
    assert holds(found.estimates[0]['gain'], 0.06)
    assert holds(found.estimates[1]['gain'], -0.1)
    assert [type(term) for term in found.terms] == [ActuatorGain, ForceGain]
    again = ForwardModel(linear, (known, *found.terms)).predict(encoder, STATES)
    for kind in KINDS:  # to the 10 nm at which a refit ends its solves
        assert np.allclose(found.predicted[0][kind], again.get(kind), rtol=0.0,
                           atol=1e-4 if kind == 'force' else 1e-7)


def test_what_first_order_leaves_out_of_memories_is_put_back(record, linear, encoder):
    """A large effect by a tenth of its noise: adjoints alone are off by several deviations."""
    data = record((Viscoelasticity(g1=0.5, tau1=1.5),), t=SOME, noise=0.1)
    one = hypothesis(Viscoelasticity, ('g1',), tau1=2.0)
    found = refit([data], (one,), [np.array([1.0])], held=('tau1',))
    stepped = ForwardModel(linear, found.terms).predict(encoder, SOME)
    residual = data.observables.residual({kind: stepped.get(kind) for kind in KINDS})
    assert Beside(data.U).square(residual - found.residual[0]) < 4.0 * Options().tolerance
    plain = Baseline(ForwardModel(linear), encoder, SOME)
    change = together(plain, found.terms)
    near = data.observables.residual({kind: plain.shown[kind] + change[kind] for kind in KINDS})
    assert Beside(data.U).square(residual - near) > 9.0


@pytest.mark.parametrize(('truth', 'held'), [
    (StiffnessGradient(gradient=(0.0, 4.0, 8.0)), ()), (LUMP, ('centre', 'radius'))])
def test_where_tangents_lead_the_end_is_that_of_full_runs(record, linear, encoder, truth, held):
    """With half the runs of a gradient; a hard lump bends too much to be led.

    Predictions may be off by 2 times the tolerance, squared, against noise of one.
    """
    data = record((truth,))
    near = hypothesis(type(truth), **{name: getattr(truth, name) for name in held})
    start = [np.full(len(near.strengths), 0.5)]
    plain = refit([data], (near,), start, held=held)
    led = refit([replace(data, baseline=Baseline(ForwardModel(linear), encoder, STATES))],
                (near,), start, held=held)
    assert led.after == pytest.approx(plain.after, abs=np.sqrt(2.0 * Options().tolerance))
    for field, one in led.estimates[0].items():
        other = plain.estimates[0][field]
        assert np.all(np.abs(np.subtract(one.value, other.value)) < 0.1 * width(other))
    assert led.runs <= (plain.runs + 1 if held else 0.5 * plain.runs)


def test_numbers_of_a_fit_that_did_not_settle_have_no_intervals():
    found = unsettled(hypothesis(ExternalForce, centre=(0.0, 0.0, 0.058)),
                      np.array([1.0, 0.0, -0.5]))['force']
    assert found.value[1] == 0.0 and found.value[2] == -0.5 * found.value[0] != 0.0
    assert np.isneginf(found.low).all() and np.isposinf(found.high).all()


def test_a_bump_that_elements_do_not_stand_starts_lower(linear):
    """And one that they stand starts as it is; what is no change of the body is not asked."""
    bump = hypothesis(by_name('reference_shape'), bump_centre=(0.0, 0.05, 0.03),
                      bump_radius=0.02)
    with pytest.raises(MeshError):
        bump.term(np.array([0.0, 0.0, -12.0])).prepare(linear.body)
    start = possible_start(linear.body, bump, np.array([0.0, 0.0, -12.0]))
    assert start[2] in -12.0 * FAINTER[1:]
    bump.term(start).prepare(linear.body)
    low = np.array([0.1, 0.0, -0.5])
    np.testing.assert_array_equal(possible_start(linear.body, bump, low), low)
    gain = hypothesis(ActuatorGain)
    assert possible_start(linear.body, gain, low) is low


def test_a_push_is_found_from_the_next_place_on_the_surface(record, linear):
    truth = ExternalForce(force=(0.0, -0.4, -0.2), centre=(0.03, 0.03, 0.044), onset=2.0,
                          duration=3.0)
    places = surface_places(linear, 60, base=False)
    away = np.linalg.norm(places - truth.centre, axis=1)
    near = tuple(places[np.argsort(away)[1]])
    start = hypothesis(ExternalForce, centre=near, onset=2.0, duration=3.0)
    found = refit([record((truth,))], (start,), [np.array([0.0, -0.5, -0.5])])
    estimates = found.estimates[0]
    assert set(estimates) == {'force', 'centre', 'radius'}
    assert np.linalg.norm(np.subtract(estimates['centre'].value, truth.centre)) < 6e-3
    assert np.abs(np.subtract(estimates['force'].value, truth.force)).max() < 0.05


def test_a_limit_that_is_hit_ends_the_interval(record, given):
    shown = {kind: values.copy() for kind, values in given(STATES)[0].shown.items()}
    shown['optical'] *= 1.25        # optical_scale allows 20 %
    found = refit([record((), shown=shown)], (hypothesis(OpticalScale),), [np.array([1.0])],
                  held=('centre',))
    scale = found.estimates[0]['scale']
    assert scale.value == scale.high == pytest.approx(0.2, abs=1e-12)
    assert 0.19 < scale.low < 0.2


def test_without_enough_data_the_interval_is_that_of_the_prior(record):
    found = refit([record((), noise=1e5)], (hypothesis(ForceGain),), [np.array([1.0])])
    gain = found.estimates[0]['gain']
    assert gain.high == pytest.approx(1.645 * 0.08, rel=0.01)
    assert gain.low == pytest.approx(-1.645 * 0.08, rel=0.01)


def test_intervals_hold_as_often_as_they_say(record, given):
    """Truths and nuisances drawn from their priors: 45 +- 2.1 of 50 hold (binomial)."""
    rng, t = np.random.default_rng(11), STATES[:2]
    plain, right = given(t)[0].shown, 0
    one = hypothesis(ForceGain, pads=('pad_1',))
    for draw in range(50):
        truth = ForceGain(gain=float(0.08 * rng.standard_normal()), pads=('pad_1',))
        shown = {kind: values.copy() for kind, values in plain.items()}
        shown['force'][:, 0] += truth.gain * plain['force'][:, 0]
        data = record((), seed=100 + draw, t=t, kinds=('force',), noise=5.0, shown=shown)
        found = refit([data], (one,), [np.array([0.0])])
        assert found.runs == 1      # no tissue is solved for a sensor
        right += holds(found.estimates[0]['gain'], truth.gain, times=1.0)
    assert 40 <= right <= 48


def test_recordings_share_terms_and_have_nuisances_of_their_own(record):
    one = hypothesis(ActuatorGain, ('gain',), actuators=(0,))
    truth = (ActuatorGain(gain=0.05, actuators=(0,)),)
    first, second = (record(truth, seed=seed, t=SOME) for seed in (1, 2))
    apart = [refit([data], (one,), [np.array([0.5])]) for data in (first, second)]
    both = refit([first, second], (one,), [np.array([0.5])])
    sd = [np.sqrt(found.covariance[0, 0]) for found in (*apart, both)]
    assert sd[2] == pytest.approx(sd[0] / np.sqrt(2.0), rel=0.1)
    ends = sorted(float(found.z[0]) for found in apart)
    assert ends[0] <= both.z[0] <= ends[1]
    assert len(both.predicted) == len(both.residual) == len(both.columns) == 2


def test_what_belongs_to_the_set_up_does_not_average_out_over_recordings(record):
    """A modulus that none of them is told leaves its scale as open in four as in one."""
    every = [record((StiffnessScale(factor=1.2),), seed=seed, noise=0.1) for seed in range(4)]

    def opened(shared):
        """What four say over what one does, 1 / variance; the modulus is the last nuisance."""
        data = [replace(one, own=np.arange(one.U.shape[1]) < one.U.shape[1] - shared)
                for one in every]
        first, four = (refit(some, (hypothesis(StiffnessScale),), [np.zeros(1)])
                       for some in (data[:1], data))
        said = [1.0 / found.covariance[0, 0] - 1.0 for found in (four, first)]   # beside its prior
        return said[0] / said[1]
    assert opened(shared=1) == pytest.approx(1.0, abs=0.05)
    assert opened(shared=0) == pytest.approx(4.0, rel=0.05)


def test_what_happened_in_one_recording_is_not_asked_of_another(record):
    """The relaxation that only the first has is found as from that alone; nor is it run beside."""
    one = hypothesis(ActuatorGain, ('gain',), actuators=(0,))
    other = hypothesis(Viscoelasticity, ('g1',), tau1=2.0)
    gain, relaxes = ActuatorGain(gain=0.05, actuators=(0,)), Viscoelasticity(g1=0.3, tau1=2.0)
    first, second = record((gain, relaxes), t=SOME), record((gain,), seed=2, t=SOME)
    found = refit([first, replace(second, absent=(1,))], (one, other),
                  [np.array([0.5]), np.array([1.0])])
    assert holds(found.estimates[0]['gain'], 0.05) and holds(found.estimates[1]['g1'], 0.3)
    with_it = [np.abs(columns[:, found.space.owner == 1]).max() for columns in found.columns]
    assert with_it[0] > 0.1 and with_it[1] == 0.0


@pytest.mark.parametrize(('term', 'error', 'share'), [
    (LUMP, 0.03, 1.0), (ActuatorGain(gain=0.05), 0.03, 1.0),
    # steps between faces that come loose: each makes predictions jump
    (BaseDebond(radius=0.03, centre=(0.02, 0.01, 0.0)), 0.01, 0.01),
    pytest.param(Obstacle(gap=2e-4, centre=(0.0, 0.0, 0.058)), 0.01, 0.03,
                 marks=pytest.mark.validate),
    # all but what memory makes of the change
    pytest.param(Viscoelasticity(g1=0.3, tau1=2.0), 0.2, 1.0, marks=pytest.mark.validate)])
def test_derivatives_are_those_of_full_runs(record, linear, encoder, term, error, share):
    """share : of the steps that tangents are taken over, where full runs are"""
    data = record((term,), t=SOME)
    place = {name: getattr(term, name) for name in ('centre', 'radius') if hasattr(term, name)}
    one = hypothesis(type(term), **place)
    start = [np.array([(getattr(term, s.name) - s.neutral) / (s.typical - s.neutral)
                       for s in one.strengths])]
    found = refit([data], (one,), start, options=Options(tolerance=1.0))
    low, high = found.space.joined('low'), found.space.joined('high')
    for j, step in enumerate(np.diag(share * found.space.joined('step'))):
        at = np.maximum(found.z - step, low), np.minimum(found.z + step, high)
        ends = [ForwardModel(linear, found.space.terms(z), options=STATICS).predict(encoder, SOME)
                for z in at]
        change = {kind: (ends[1].get(kind) - ends[0].get(kind))[..., None] / np.sum(at[1] - at[0])
                  for kind in KINDS}
        expected = data.observables.whiten(change)[:, 0]
        off = np.linalg.norm(found.columns[0][:, j] - expected)
        assert off < error * max(np.linalg.norm(expected), 10.0)


@pytest.mark.parametrize('both', [False, True])
def test_where_the_mesh_refuses_one_end_of_a_difference_the_other_one_serves(record, monkeypatch,
                                                                             both):
    """A narrow bump whose middle leaves the surface at a step: no reason to give up the fit."""
    truth = StiffnessGradient(gradient=(0.0, 0.0, 8.0))
    data = record((truth,), t=SOME)
    found = refit([data], (hypothesis(StiffnessGradient),), [np.array([0.1, 0.1, 0.8])])
    recording, sound = RecordingFit(data, found.terms), StiffnessGradient.prepare
    model, _ = recording.predicted(found.terms)
    now, most = SimpleNamespace(z=found.z, terms=found.terms), found.terms[0].gradient[2]
    central = recording.columns(found.space, now, model)

    def prepare(term, body):
        off = term.gradient[2] - most
        if off > 1e-9 or both and off < -1e-9:
            raise MeshError('off the surface')
        return sound(term, body)

    monkeypatch.setattr(StiffnessGradient, 'prepare', prepare)
    if both:
        with pytest.raises(NotConverged, match='off the surface'):
            recording.columns(found.space, now, model)
    else:
        one_sided = recording.columns(found.space, now, model)
        np.testing.assert_allclose(one_sided[:, :2], central[:, :2], atol=1e-3)  # of some 100
        off = np.linalg.norm(one_sided[:, 2] - central[:, 2])
        assert 0.0 < off < 0.05 * np.linalg.norm(central[:, 2])     # of second order


def test_at_a_limit_there_is_no_slope_where_the_mesh_refuses_the_other_end():
    def change(z):
        if z[0] > 0.0:
            raise MeshError('off the surface')
        return {kind: np.full((1, 1, 3), 2.0 * z[0]) for kind in KINDS}

    z, step = np.zeros(1), np.ones(1)
    with pytest.raises(NotConverged, match='off the surface'):
        fit_model._slope(change, z, (z, z + step))      # z is its lower limit
    slope = fit_model._slope(change, z, (z - step, z + step))
    assert slope['force'] == pytest.approx(2.0)


def test_what_finer_elements_add_is_added(record, given):
    shown = dict(given(STATES)[0].shown)
    finer = {'optical': np.full(shown['optical'].shape, 5e-4)}
    shown['optical'] = shown['optical'] + finer['optical']
    data = record((), shown=shown)
    one = hypothesis(OpticalScale)
    with_it = refit([replace(data, finer=finer)], (one,), [np.array([0.0])], held=('centre',))
    without = refit([data], (one,), [np.array([0.0])], held=('centre',))
    assert with_it.after < 0.6 * len(with_it.residual[0])
    gap = without.residual[0] - with_it.residual[0]
    assert np.sqrt(np.mean(gap ** 2)) > 5.0


@pytest.mark.parametrize('grows', [False, True])
def test_a_law_that_errs_in_one_channel_moves_numbers_as_far_as_intervals_say(record, given,
                                                                              grows):
    """The effect on pad 1 along x is 5 % larger than the law has it, at all times or as it is
    pushed; noise stays what it was."""
    law, one = 0.05, hypothesis(StiffnessGradient)
    data = replace(record((StiffnessGradient(gradient=(12.0, 0.0, 0.0)),), t=SOME, noise=0.1),
                   baseline=given(SOME)[0])
    start, fine = [np.zeros(3)], Options(tolerance=1e-4)
    found = refit([data], (one,), start, options=fine)
    effect = data.observables.residual(data.baseline.shown) - found.residual[0]
    if grows:
        q = data.baseline.path.at(data.baseline.t)[:, 0]
        effect = data.observables.times(effect, q / q.max())
    mine = np.array([(row.kind, row.channel, row.axis) == ('force', 'pad_1', 0)
                     for row in data.observables.rows])
    wrong = replace(data, observables=Shifted(data.observables, np.where(mine, law * effect, 0.0)))
    moved = refit([wrong], (one,), start, options=fine).z - found.z
    wide = told(found, [data], 1.0, law)[0]['gradient']
    same = told(found, [data], 1.0, 0.0)[0]['gradient']
    assert same == found.estimates[0]['gradient']
    half = [0.5 * width(estimate) / 1.6449 for estimate in (wide, same)]
    chart, = found.space.charts
    assert np.abs(moved[0]) > 0.1 * np.sqrt(found.covariance[0, 0])
    assert half[0][0]**2 - half[1][0]**2 > (0.9 * chart.scale[0] * moved[0])**2


def test_an_effect_that_is_too_large_as_a_whole_opens_numbers_by_as_much(record, given):
    """Of a gradient of 12 / m, which answers about in proportion, a tenth: 1.2 / m."""
    data = replace(record((StiffnessGradient(gradient=(12.0, 0.0, 0.0)),), t=SOME, noise=0.1),
                   baseline=given(SOME)[0])
    found = refit([data], (hypothesis(StiffnessGradient),), [np.zeros(3)])
    wide, same = (told(found, [data], 1.0, 0.0, share)[0]['gradient'] for share in (0.1, 0.0))
    half = [0.5 * width(estimate)[0] / 1.6449 for estimate in (wide, same)]
    assert np.sqrt(half[0]**2 - half[1]**2) == pytest.approx(1.2, rel=0.2)


class Shifted:
    """Observables whose measured values lie higher by errors (N,) over the noise."""

    def __init__(self, observables, errors):
        self._inside, self._errors = observables, errors

    def __getattr__(self, name):
        return getattr(self._inside, name)

    def residual(self, shown):
        return self._inside.residual(shown) + self._errors


def test_what_does_not_end_or_begin_is_told(record):
    near = hypothesis(Inclusion, centre=(0.012, 0.018, 0.036), radius=0.012)
    data = record((LUMP,))
    with pytest.raises(Unsettled, match='of at most 6') as ended:
        refit([data], (near,), [np.array([0.25])], options=Options(runs=6))
    afresh, on = (refit([data], (near,), [np.array([0.25])], start=start)
                  for start in (None, ended.value.z))
    assert on.before < afresh.before and on.runs < afresh.runs
    assert on.after == pytest.approx(afresh.after, abs=2.0 * Options().tolerance)
    with pytest.raises(InputError, match='no field is free'):
        refit([data], (near,), [np.array([0.25])], held=('centre', 'radius', 'ratio'))

