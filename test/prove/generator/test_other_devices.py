"""Other laws of devices are other laws, of about the same size, and physically what they say."""
from copy import deepcopy
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.prove.generator import catalogue, other_actuation, other_sensing
from arm_brachy.prove.generator.actuation import ACTUATION, compliance
from arm_brachy.prove.generator.body import draw_body
from arm_brachy.prove.generator.other_actuation import OTHER_ACTUATION
from arm_brachy.prove.generator.other_sensing import OTHER_SENSING
from arm_brachy.prove.generator.protocol import RATE, draw_protocol, set_points
from arm_brachy.prove.generator.sensing import SENSING, Stream
from arm_brachy.prove.generator.sensors import RATES
from arm_brachy.prove.generator.solver import NotSolved
from arm_brachy.prove.generator.world import columns_at, marker_names, pad_markers, target_names

ACTUATED = [(name, form) for name, forms in OTHER_ACTUATION.items() for form in forms]
SENSED = [(name, form) for name, forms in OTHER_SENSING.items() for form in forms]
BEGINS = [one for one in ACTUATED + SENSED if one[0] in ('lost_steps', 'marker_slip')]
STIFFNESS = 500.0       # N/m, of a pad in tissue


def push_back(y):
    """Force against pads that are each on a spring, and feel a tenth of the others' travel."""
    return STIFFNESS * (0.9 * y + 0.1 * y.sum(axis=1, keepdims=True))


@pytest.fixture(scope='module')
def run():
    """A body, its motors through one protocol, and what its sensors would show of it."""
    rng = np.random.default_rng(5)
    body = draw_body(rng, 'test')
    t, u = set_points(draw_protocol(rng, body), np.array([pad.stroke for pad in body.pads]))
    return SimpleNamespace(body=body, t=t, u=u, names=[pad.name for pad in body.pads],
                           streams=streams_of(body, t, u))


def streams_of(body, t, u):
    """Streams of tissue in which targets go a third as far as pads, and markers stay."""
    times = {name: np.arange(0.01, t[-1] - 0.01, 1 / rate) for name, rate in RATES.items()}
    y = {name: columns_at(at, t, u) for name, at in times.items()}
    way = np.array([pad.direction for pad in body.pads])
    count = len(body.surface_markers)
    still = np.vstack([body.points[:count], pad_markers(body.pads), body.base_markers])
    optical = np.repeat(still[None], len(times['optical']), axis=0)
    optical[:, count:-3] += y['optical'][:, :, None] * way
    targets = body.points[count:] + (y['em'] @ way / 3)[:, None]
    forces = -push_back(y['forces'])[:, :, None] * (way + [0.1, -0.1, 0.2])
    shown = {'optical': (marker_names(body), optical), 'em': (target_names(body), targets),
             'forces': (tuple(pad.name for pad in body.pads), forces)}
    return {name: Stream(names, times[name], times[name], values, y[name])
            for name, (names, values) in shown.items()}


def drawn(run, name, size=1.0):
    """Values of an effect as the catalogue draws them, at a size."""
    families = [family(np.random.default_rng(11), run.body, size)
                for family in catalogue.FAMILIES.values()]
    return next(values[name] for values in families if name in values)


def moved(run, act, v):
    """What an effect adds to the travel (t, p) [m] of the pads."""
    return act(run.t, run.u, run.names, v, push_back) - run.u


def changed(run, act, v):
    """What an effect adds to every stream, its stamps as well."""
    streams = deepcopy(run.streams)
    act(streams, v)
    return {name: (shown.stamps - run.streams[name].stamps,
                   shown.values - run.streams[name].values) for name, shown in streams.items()}


def flat(change):
    """All that an effect adds as one vector; one effect errs in one unit only."""
    if isinstance(change, dict):
        return np.concatenate([part.ravel() for pair in change.values() for part in pair])
    return change.ravel()


def both(run, name, form, v):
    """What is added by the registry's law, and by another, as vectors."""
    if name in ACTUATION:
        acts, shown = (ACTUATION[name], OTHER_ACTUATION[name][form].act), moved
    else:
        acts, shown = (SENSING[name], OTHER_SENSING[name][form].act), changed
    return [flat(shown(run, act, v)) for act in acts]


def test_every_effect_of_a_device_has_other_forms():
    for own, others in ((ACTUATION, OTHER_ACTUATION), (SENSING, OTHER_SENSING)):
        assert own.keys() == others.keys()
        assert all(len(forms) >= 2 for forms in others.values())


@pytest.mark.parametrize(('name', 'form'), ACTUATED + SENSED)
def test_another_form_is_another_law_that_resembles_the_registrys(run, name, form):
    own, other = both(run, name, form, drawn(run, name))
    size = np.linalg.norm(own)
    assert np.linalg.norm(other - own) > 0.1 * size
    # About zero, not about the mean: a constant error resembles a constant error.
    assert own @ other > 0.5 * size * np.linalg.norm(other)
    assert 0.6 < np.abs(other).max() / np.abs(own).max() < 1.55


@pytest.mark.parametrize(('name', 'form'), ACTUATED + SENSED)
def test_same_values_give_the_same_bits_and_more_gives_more(run, name, form):
    one, two = (both(run, name, form, drawn(run, name))[1] for _ in range(2))
    np.testing.assert_array_equal(one, two)
    little, much = (np.abs(both(run, name, form, drawn(run, name, size))[1]).max()
                    for size in (0.2, 2.0))
    assert little < 0.25 * much


@pytest.mark.parametrize(('name', 'form'), ACTUATED + SENSED)
def test_same_values_are_those_the_effect_has(run, name, form):
    forms = {**OTHER_ACTUATION, **OTHER_SENSING}[name]
    assert set(forms[form].same) <= set(drawn(run, name))


@pytest.mark.parametrize(('name', 'form'), [a for a in ACTUATED if a[0] != 'actuator_lag'])
def test_other_actuators_are_left_alone(run, name, form):
    v = {**drawn(run, name), 'actuators': ('pad_2',)}
    change = moved(run, OTHER_ACTUATION[name][form].act, v)
    assert change[:, 1].any() and not np.delete(change, 1, axis=1).any()


@pytest.mark.parametrize(('name', 'form'), SENSED)
def test_other_channels_and_streams_are_left_alone(run, name, form):
    v = drawn(run, name)
    at = {'pads': ('forces', ('pad_2',)), 'tools': ('em', ('target_1',))}
    key = next((k for k in at if k in v), None)
    stream = at[key][0] if key else v.get('stream', 'em' if 'extent_mm' in v else 'optical')
    if key:
        v = {**v, key: at[key][1]}
    change = changed(run, OTHER_SENSING[name][form].act, v)
    assert {n for n, parts in change.items() if any(p.any() for p in parts)} == {stream}
    hit = change[stream][1].any(axis=(0, 2))
    if key:
        assert [n for n, h in zip(run.streams[stream].names, hit, strict=True) if h] == [*v[key]]
    if name == 'marker_slip':
        assert np.flatnonzero(hit).tolist() == [v['marker']]


@pytest.mark.parametrize(('name', 'form'), BEGINS)
def test_nothing_happens_before_the_onset_and_something_right_after(run, name, form):
    v = {**drawn(run, name), 'onset_s': 20.0}
    if name in ACTUATION:
        t, change = run.t, moved(run, OTHER_ACTUATION[name][form].act, v)
        whole = v['shortfall_mm'] * 1e-3
    else:
        t = run.streams['optical'].true
        change = changed(run, OTHER_SENSING[name][form].act, v)['optical'][1]
        whole = np.linalg.norm(v['offset_mm']) * 1e-3
    size = np.linalg.norm(change.reshape(len(t), -1), axis=1) / abs(whole)
    assert not size[t < 20].any()
    assert size[np.searchsorted(t, 20.5)] > 0.2
    np.testing.assert_allclose(size[t > 28], 1.0, atol=0.01)


@pytest.mark.parametrize('form', sorted(OTHER_ACTUATION['actuator_lag']))
def test_other_lags_are_as_late_on_a_ramp_there_and_back(form):
    t = np.arange(0, 6, 1 / RATE)
    u = np.column_stack([0.01 * np.minimum(t, 6 - t)])
    v = {'time_constant_ms': 20.0, 'delay_ms': 30.0}
    late = (u - OTHER_ACTUATION['actuator_lag'][form].act(t, u, ('a',), v, None))[:, 0] / 0.01
    there, back = late[2900], -late[-1]
    np.testing.assert_allclose((there + back) / 2, 0.05, atol=6e-4)
    np.testing.assert_allclose(there - back, 0.016 if form == 'slower_inwards' else 0.0, atol=1e-4)


def test_a_loop_that_overshoots_does_so_by_a_sixth():
    t = np.arange(0, 1, 1 / RATE)
    u = np.column_stack([1e-3 * (t > 0.1)])
    v = {'time_constant_ms': 20.0, 'delay_ms': 0.0}
    y = other_actuation.overshooting(t, u, ('a',), v, None)
    assert y.max() == pytest.approx(1e-3 * (1 + np.exp(-np.pi / np.sqrt(3))), rel=2e-3)
    assert y[-1, 0] == pytest.approx(1e-3)


@pytest.mark.parametrize('form', sorted(OTHER_ACTUATION['actuator_gain']))
def test_a_bent_pitch_is_right_at_home_and_off_by_the_gain_at_the_end(form):
    u = np.linspace(0, 4e-3, 101)[:, None]
    v = {'gain': 0.06, 'offset_mm': 0.1, 'actuators': ()}
    off = OTHER_ACTUATION['actuator_gain'][form].act(None, u, ('a',), v, None) - u - 1e-4
    assert abs(off[0, 0]) < 1e-15 and off[-1, 0] == pytest.approx(0.06 * 4e-3)
    assert off[50, 0] / (0.03 * 4e-3) == pytest.approx({'growing': 0.5, 'fading': 1.5}[form])


def there_and_back(speed, far=4e-3):
    """Travel (t, 1) [m] of a motor that pushes and withdraws at a speed [m/s], then rests."""
    knots = np.cumsum([0, far / speed, far / speed, 1.0])
    t = np.arange(0, knots[-1], 1 / RATE)
    return t, np.interp(t, knots, [0, far, 0, 0])[:, None]


PLAYED = {'width_mm': 0.5, 'actuators': ()}


@pytest.mark.parametrize('form', sorted(OTHER_ACTUATION['backlash']))
def test_a_play_is_never_ahead_and_comes_home(form):
    t, u = there_and_back(0.002)
    y = OTHER_ACTUATION['backlash'][form].act(t, u, ('a',), PLAYED, None)
    assert (y <= u + 1e-15).all() and abs(y[-1, 0]) < 1e-12


def test_a_rounded_play_loses_as_much_at_last():
    t, u = there_and_back(0.002)
    y = other_actuation.rounded(t, u, ('a',), PLAYED, None)[:, 0]
    top = u[:, 0].argmax()
    assert y[top] == pytest.approx(u[top, 0] - 5e-4, abs=1e-9)
    early = u[:top, 0] < 2e-4
    np.testing.assert_array_less(0.5 * u[:top, 0][early], y[:top][early] + 1e-12)


@pytest.mark.parametrize(('speed', 'least', 'most'), [(0.05, 0.7, 1.0), (0.0005, 0.0, 0.05)])
def test_a_pad_creeps_back_through_the_play_of_a_slow_motor(speed, least, most):
    """Half withdrawn, it is as far ahead of where it was at this place as it did not creep."""
    t, u = there_and_back(speed)
    y = other_actuation.creeping_back(t, u, ('a',), PLAYED, None)[:, 0]
    top = u[:, 0].argmax()
    there, back = (np.interp(2e-3, *pair) for pair in (
        (u[:top, 0], y[:top]), (u[top:top + top, 0][::-1], y[top:top + top][::-1])))
    assert least <= (back - there) / 5e-4 <= most


def test_a_worn_play_is_wider_at_home():
    t, u = there_and_back(0.002)
    y = other_actuation.worn_at_home(t, u, ('a',), PLAYED, None)[:, 0]
    top = u[:, 0].argmax()
    starts = np.flatnonzero(y > 1e-9)[0]
    # Width is 1.4 at home, 0.6 at 4 mm: it moves once u = 0.5 (1.4 - 0.2 u) [mm].
    assert u[starts, 0] == pytest.approx(0.7e-3 / 1.1, abs=3e-6)
    assert u[top, 0] - y[top] == pytest.approx(0.3e-3, abs=1e-6)


def spring(run, c):
    return {'compliance_mm_N': c, 'actuators': ('pad_1',)}


def test_a_stiffening_spring_gives_what_its_law_says(run):
    v = spring(run, 0.2)
    y = other_actuation.stiffening(run.t, run.u, run.names, v, push_back)
    force, top = push_back(y)[:, 0], push_back(run.u)[:, 0].max()
    given = 0.2e-3 * force * 2 / (1 + np.abs(force) / top)
    np.testing.assert_allclose(run.u[:, 0] - y[:, 0], given, atol=2e-8)
    slope = np.diff(given) / np.where(np.abs(np.diff(force)) > 1e-7, np.diff(force), np.nan)
    assert np.nanmax(slope) / np.nanmin(slope) > 3


def test_a_rubbing_spring_takes_work_and_is_held_back(run):
    v = spring(run, 0.2)
    y = other_actuation.rubbing(run.t, run.u, run.names, v, push_back)
    force, given = push_back(y)[:, 0], run.u[:, 0] - y[:, 0]
    top = push_back(run.u)[:, 0].max()
    assert np.abs(given - 0.2e-3 * force).max() == pytest.approx(0.2e-3 * 0.125 * top, rel=0.02)
    assert np.trapezoid(force, given) > 0.05 * 0.2e-3 * top**2


@pytest.mark.parametrize('act', [compliance, other_actuation.stiffening, other_actuation.rubbing])
def test_a_spring_that_finds_no_balance_says_so(run, act):
    with pytest.raises(NotSolved):
        act(run.t[::50], run.u[::50], run.names, spring(run, 0.2),
            lambda y: 5e4 * np.sign(np.sin(1e7 * y)))


def test_depth_is_scaled_more_than_what_lies_across(run):
    v = {'scale': 0.01, 'centre_mm': (0.0, 0.0, 0.0)}
    change = changed(run, other_sensing.depth_most, v)['optical'][1]
    x = run.streams['optical'].values
    np.testing.assert_allclose(change, 0.01 * x * [0.75, 0.75, 1.75], atol=1e-15)


def test_a_lens_leaves_the_middle_and_bends_with_the_cube(run):
    v = {'scale': 0.01, 'centre_mm': (10.0, 0.0, 0.0)}
    change = changed(run, other_sensing.lens, v)['optical'][1]
    arm = np.linalg.norm(run.streams['optical'].values - [0.01, 0, 0], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(change, axis=-1), 0.01 * arm**3 / 0.07**2)


def em_alone(points, travel):
    """A stream of EM positions (t, k, 3) [m] while the first pad is at `travel` (t,) [m]."""
    t = np.arange(float(len(points)))
    names = tuple(f'target_{i + 1}' for i in range(points.shape[1]))
    return {'em': Stream(names, t, t, points.copy(), np.column_stack([travel, 0 * travel]))}


DISTORTED = {'centre_mm': (0.0, 0.0, 0.0), 'gradient_mm_per_mm': 0.1,
             'rotation_mm_per_mm': (0.0, 0.0, 0.05), 'extent_mm': 150.0,
             'pad_coupling_mm_per_mm': (0.1, 0.0, 0.0), 'pad': 0}


def test_iron_aside_errs_by_the_inverse_cube_of_its_distance():
    streams = em_alone(np.array([[[0.04, 0, 0], [-0.04, 0, 0]]]), np.zeros(1))
    other_sensing.iron_aside(streams, DISTORTED)
    near, far = streams['em'].values[0, :, 0]
    assert (near - 0.04) / (-0.04 - far) == pytest.approx((0.24 / 0.16)**3)


def test_metal_on_a_pad_saturates():
    travel = np.array([0.0, 0.0015, 0.003, 0.006])
    streams = em_alone(np.zeros((4, 1, 3)), travel)
    other_sensing.plate_below(streams, DISTORTED)
    shift = streams['em'].values[:, 0, 0]
    assert shift[2] == pytest.approx(0.1 * travel[2])
    assert shift[1] > 0.1 * travel[1] and shift[3] < 0.7 * 0.1 * travel[3]


def test_a_plate_below_stretches_upwards():
    points = np.array([[[0.01, 0, 0], [0, 0, 0.01]]])
    streams = em_alone(points, np.zeros(1))
    other_sensing.plate_below(streams, DISTORTED)
    across, upwards = (streams['em'].values - points)[0]
    assert across[0] == pytest.approx(0.06e-2)
    assert upwards[2] == pytest.approx(0.175e-2 * np.exp(-1 / 15))


def test_an_offset_settles(run):
    v = {'offset_mm': (1.0, 0.0, 0.0), 'tools': ('target_1',)}
    change = changed(run, other_sensing.settling, v)['em'][1][:, 0, 0]
    at = np.interp([20.0, 40.0], run.streams['em'].true, change)
    np.testing.assert_allclose(at, 1e-3 * (1 - np.exp([-1.0, -2.0])), atol=1e-6)


def test_an_offset_turns_and_keeps_its_length_and_its_mean(run):
    v = {'offset_mm': (0.6, 0.0, 0.8), 'tools': ('target_1',)}
    change = changed(run, other_sensing.turning, v)['em'][1][:, 0]
    np.testing.assert_allclose(np.linalg.norm(change, axis=1), 1e-3, atol=1e-12)
    assert np.rad2deg(np.arccos(change[0] @ change[-1] / 1e-6)) == pytest.approx(60.0)
    np.testing.assert_allclose(change.mean(axis=0) / 1e-3, v['offset_mm'], atol=0.05)


def test_gain_grows_with_load_up_to_the_gain(run):
    v = {'gain': 0.08, 'pads': ('pad_1',)}
    change = changed(run, other_sensing.gain_with_load, v)['forces'][1][:, 0]
    force = run.streams['forces'].values[:, 0]
    size = np.linalg.norm(force, axis=1)
    np.testing.assert_allclose(change, 0.08 * (size / size.max())[:, None] * force, atol=1e-12)


def test_gain_of_one_axis_is_of_that_which_carries_most(run):
    v = {'gain': 0.08, 'pads': ('pad_1',)}
    change = changed(run, other_sensing.gain_of_one_axis, v)['forces'][1][:, 0]
    force = run.streams['forces'].values[:, 0]
    axis = np.abs(force).max(axis=0).argmax()
    np.testing.assert_allclose(change[:, axis], 0.08 * force[:, axis], atol=1e-12)
    assert not np.delete(change, axis, axis=1).any()


TALKING = {'onward': (0.05, 0.02, -0.03), 'backward': (-0.04, 0.01, 0.03), 'pads': ('pad_1',)}


def test_a_rocking_sensor_turns_with_load_and_keeps_the_length_of_forces(run):
    force = run.streams['forces'].values[:, 0]
    shown = force + changed(run, other_sensing.rocking, TALKING)['forces'][1][:, 0]
    size = np.linalg.norm(force, axis=1)
    np.testing.assert_allclose(np.linalg.norm(shown, axis=1), size, atol=1e-12)
    most, half = size.argmax(), np.abs(size - 0.5 * size.max()).argmin()
    own = np.linalg.norm(changed(run, SENSING['axis_crosstalk'], TALKING)['forces'][1][most, 0])
    for at in (most, half):
        turn = np.linalg.norm(np.cross(force[at], shown[at])) / size[at]**2
        assert np.arcsin(turn) == pytest.approx(own / size[most] * size[at] / size[most])


def test_a_force_is_turned_to_where_the_shares_show_it():
    v = {'onward': (0.03, 0.0, 0.0), 'backward': (0.04, 0.0, 0.0)}
    turn = other_sensing.askew(np.array([[2.0, 0.0, 0.0]]), other_sensing.matrix(v))
    np.testing.assert_allclose(np.cross(turn, [1.0, 0.0, 0.0]), [0.0, 0.03, 0.04], atol=1e-15)


@pytest.mark.parametrize(('form', 'low', 'high'), [('talk_with_load', 0.45, 0.55),
                                                   ('talk_at_once', 1.4, 1.8)])
def test_axes_talk_by_the_shares_at_the_largest_load_alone(run, form, low, high):
    act = OTHER_SENSING['axis_crosstalk'][form].act
    own, other = (np.linalg.norm(changed(run, a, TALKING)['forces'][1][:, 0], axis=1)
                  for a in (SENSING['axis_crosstalk'], act))
    size = np.linalg.norm(run.streams['forces'].values[:, 0], axis=1) / np.linalg.norm(
        run.streams['forces'].values[:, 0], axis=1).max()
    most = size.argmax()
    assert other[most] == pytest.approx(own[most])
    half = np.abs(size - 0.5).argmin()
    assert low < other[half] / own[half] < high


DRIFTS = {'rate': {'rate_N_min': (0.25, 0.0, 0.0), 'bias_N': (0.0, 0.0, 0.0), 'pads': ('pad_1',)},
          'bias': {'rate_N_min': (0.0, 0.0, 0.0), 'bias_N': (0.0, 0.25, 0.0), 'pads': ('pad_1',)}}


@pytest.mark.parametrize('form', sorted(OTHER_SENSING['force_drift']))
@pytest.mark.parametrize('kind', sorted(DRIFTS))
def test_a_zero_has_gone_as_far_after_a_minute(run, kind, form):
    act = OTHER_SENSING['force_drift'][form].act
    t, own, other = (run.streams['forces'].true, *(
        np.linalg.norm(changed(run, a, DRIFTS[kind])['forces'][1][:, 0], axis=1)
        for a in (SENSING['force_drift'], act)))
    after = np.searchsorted(t, 60.0)
    np.testing.assert_allclose(other[after], own[after], rtol=0.01)
    first = t < 60
    sizes = [np.linalg.norm(error[first]) for error in (own, other)]
    assert 0.6 < sizes[1] / sizes[0] < 1.6
    assert own[first] @ other[first] > 0.8 * sizes[0] * sizes[1]


def test_a_zero_that_warms_is_fast_first(run):
    t = run.streams['forces'].true
    error = changed(run, other_sensing.warming, DRIFTS['rate'])['forces'][1][:, 0, 0]
    first, second = np.interp([20.0, 40.0], t, error)
    assert (second - first) / first == pytest.approx(np.exp(-1), rel=1e-3)


def test_a_walk_is_another_for_other_values(run):
    walks = [changed(run, other_sensing.wandering, v)['forces'][1][:, 0].sum(axis=1)
             - changed(run, SENSING['force_drift'], v)['forces'][1][:, 0].sum(axis=1)
             for v in DRIFTS.values()]
    assert abs(np.corrcoef(walks)[0, 1]) < 0.99
    first = run.streams['forces'].true < 60
    for walk in walks:
        assert np.sqrt((walk[first]**2).mean()) == pytest.approx(0.2 * 0.25, rel=0.05)


@pytest.mark.parametrize('delay', [40.0, -40.0])
@pytest.mark.parametrize('stream', ['optical', 'em', 'forces'])
@pytest.mark.parametrize('form', sorted(OTHER_SENSING['clock_offset']))
def test_stamps_increase_and_are_late_by_the_delay_on_average(run, form, stream, delay):
    streams = deepcopy(run.streams)
    OTHER_SENSING['clock_offset'][form].act(streams, {'stream': stream, 'delay_ms': delay})
    assert (np.diff(streams[stream].stamps) > 5e-5).all()
    late = (streams[stream].stamps - streams[stream].true) / (delay * 1e-3)
    assert late.mean() == pytest.approx(1.0, abs=0.03)
    if form == 'drifting':
        np.testing.assert_allclose(late[[0, -1]], [0.5, 1.5])
    else:
        assert np.abs(late - 1).max() < 0.3 + 1e-9
        assert late.std() > 0.12
