"""A probing protocol in one process: the pads do what the moves say, and the data show it."""

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.control.safety import Permission
from arm_brachy.control.sequencer import HOME
from arm_brachy.core import config
from arm_brachy.core.paths import config_dir
from arm_brachy.evaluation import regimes
from arm_brachy.evaluation.assess import assess, to_result
from arm_brachy.scenario import Scenario, resolve

PATH = config_dir() / 'scenarios' / 'in_process.yaml'  # no such file; scenes are found from there
SETTLE, TICK, MM = 0.5, 0.05, 1e-3
COUNT = 0.0122 * MM   # of the encoder
MOVES = [
    {'name': 'fast', 'pads': [{'name': 'pad_1', 'position_mm': 6}], 'speed_mm_s': 20,
     'hold_s': 0.6, 'cycles': 1},
    {'name': 'pair', 'pads': [{'name': 'pad_2', 'position_mm': 4},
                              {'name': 'pad_3', 'position_mm': 2}],
     'speed_mm_s': 4, 'hold_s': 0.6},
    {'name': 'back', 'others': 'home', 'speed_mm_s': 8, 'hold_s': 0.6}]
BEGIN = 2 * TICK + SETTLE   # the supervisor's first word arrives in the second tick
# s after BEGIN: position [mm] of pads 1 to 4
KNOTS = np.cumsum([BEGIN, 0.3, 0.6, 0.3, 0.6, 1.0, 0.6, 0.5, 0.6])
SCHEDULE = np.array([[0, 6, 6, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 4, 4, 0, 0],
                     [0, 0, 0, 0, 0, 2, 2, 0, 0], [0] * 9]) * MM


def make(**changes):
    coarse = {'file': '../scenes/breast/breast_600.msh'}
    plant = {'mesh': coarse, 'element': 'linear', 'terms': [{'name': 'backlash', 'width_mm': 0.3}]}
    given = {'name': 'probing', 'seed': 4, 'scene': '../scenes/breast.yaml', 'settle_s': SETTLE,
             'plant': plant, 'moves': MOVES, **changes}
    return resolve(config.from_mapping(Scenario, given, 'probing'), PATH)


@pytest.fixture(scope='module')
def probed():
    return inprocess.run(make(), sensors=inprocess.SENSORS)


def schedule(t):
    return np.stack([np.interp(t, KNOTS, pad) for pad in SCHEDULE], axis=1)


def test_commands_are_the_moves(probed):
    command = probed.command_position
    assert command.t[0] == pytest.approx(BEGIN)
    assert command.t[-1] == pytest.approx(KNOTS[-1] - TICK)
    assert command.values == pytest.approx(schedule(command.t), abs=1e-12)


def test_pads_follow_a_tick_late_and_stand_where_they_were_sent(probed):
    """At the start a pad falls behind by what it takes to speed up, v^2 / 2a, and by its servo."""
    t, q = probed.encoder.t, probed.encoder.values
    params = make().scenario.actuators
    v = 20 * MM
    behind = v**2 / (2 * params.max_acceleration) + v * (params.servo_time_constant + TICK)
    assert np.abs(q - schedule(t - TICK)).max() < behind
    for end, where in zip(KNOTS[2::2], SCHEDULE.T[2::2], strict=True):
        assert q[np.searchsorted(t, end - 1e-9)] == pytest.approx(where, abs=COUNT)


def test_pads_cruise_at_the_speed_asked_for(probed):
    """No stop and go from set-point to set-point: every tick brings the same way."""
    t, q = probed.encoder.t, probed.encoder.values
    for pad, begin, end, speed in ((0, BEGIN, BEGIN + 0.3, 20), (1, KNOTS[4], KNOTS[5], 4),
                                   (2, KNOTS[4], KNOTS[5], 2)):
        inside = (t > begin + 0.2) & (t < end + TICK - 1e-9)
        ways = np.diff(q[inside, pad])
        assert len(ways) >= 1 and ways == pytest.approx(speed * MM * TICK, abs=1.01 * COUNT)


def test_pads_of_one_move_arrive_together(probed):
    """To the difference in braking time, v / a = 10 ms here: within a tick."""
    t, q = probed.encoder.t, probed.encoder.values
    arrived = [t[np.argmax(q[:, pad] > SCHEDULE[pad, 5] - 2 * COUNT)] for pad in (1, 2)]
    assert abs(arrived[0] - arrived[1]) < TICK + 1e-9
    assert KNOTS[5] < arrived[0] < KNOTS[5] + 3 * TICK


def test_every_sensor_is_recorded_from_rest_to_rest(probed):
    assert set(probed.em) == {f'target_{i}' for i in range(1, 6)}
    end = probed.encoder.t[-1]
    for stream in (probed.em['target_1'], probed.optical, probed.force):
        assert stream.t[0] < BEGIN - 0.4 and stream.t[-1] > end - 0.1
    assert end == pytest.approx(KNOTS[-1] + TICK + SETTLE)   # at home already: one tick of homing
    assert np.all(probed.encoder.values[-1] < HOME)


def test_the_tissue_answers_where_it_is_pushed(probed):
    """pad_1 pushes along -x: target_1 goes that way, and the force on the pad points back."""
    during = probed.moves[0].regimes[1]
    moved = probed.truth['target_1'].between(during.t_end - 0.2, during.t_end).values.mean(axis=0)
    rest = probed.truth['target_1'].values[0]
    assert (moved - rest)[0] < -0.5 * MM
    held = probed.force.between(during.t_end - 0.2, during.t_end).values.mean(axis=0)
    assert held[0, 0] > 1.0


def test_moves_and_their_phases_are_in_the_data(probed):
    assert [m.name for m in probed.moves] == ['fast', 'pair', 'back']
    assert all(m.made for m in probed.moves)
    said = [(r.name, r.t_start) for m in probed.moves for r in m.regimes]
    assert [name for name, _ in said] == ['load', 'hold', 'unload', 'rest', 'load', 'hold',
                                          'unload', 'rest']
    assert [t for _, t in said] == pytest.approx(KNOTS[:-1], abs=TICK)


def test_encoders_tell_the_same_phases(probed):
    """Found from the encoders alone: within half a window, and two ticks and the braking late."""
    found = [r for r in regimes.pad_regimes(probed.encoder) if r.t_end - r.t_start > 0.15]
    told = [r for m in probed.moves for r in m.regimes]
    assert [r.name for r in found] == ['rest', *(r.name for r in told)]
    within = 0.5 * regimes.WINDOW + 2 * TICK + 20 * MM / make().scenario.actuators.max_acceleration
    assert [r.t_start for r in found[1:]] == pytest.approx([r.t_start for r in told],
                                                           abs=within + 1e-9)


def test_the_evaluation_has_a_row_per_move_and_one_goal(probed):
    numbers = assess(probed)
    result = to_result(probed, numbers)
    assert [(g.name, g.value, g.met) for g in result.targets] == [('moves made', 3, True)]
    fast, pair, _ = result.rows
    assert fast['move'] == 'fast' and fast['duration_s'] == pytest.approx(1.8)
    assert fast['pad_travel_mm'] == pytest.approx(12.0, abs=0.1)
    assert pair['deepest_mm'] == pytest.approx(4.0, abs=0.02) and pair['peak_force_N'] > 0.5


def test_a_pad_that_is_blocked_is_a_move_not_made():
    blocked = make(actuators={'force_limit_N': 1.0}, moves=MOVES[:1])
    data = inprocess.run(blocked)
    move, = data.moves
    assert not move.made and 'see what actuator_driver reported' in move.message
    goal, = assess(data).targets
    assert (goal.name, goal.value, goal.met) == ('moves made', 0, False)
    assert ('actuator_driver', 'HELD') in {(o.node, o.outcome) for o in data.outcomes}


def upto(loop, t):
    """Tick an InProcess until t [s]; returns it."""
    while loop.t < t - 1e-9:
        loop.tick()
    return loop


def test_an_emergency_stop_interrupts_and_resuming_completes():
    loop = upto(inprocess.InProcess(make(moves=MOVES[1:])), BEGIN + 0.5)
    loop.safety.stop('test')
    loop.tick()
    where = loop.data().encoder.values[-1]
    upto(loop, loop.t + 0.5)
    assert loop.safety.reset()[0] and loop.safety.permission is Permission.RUN
    loop.driver.release()
    upto(loop, loop.t + 0.5)
    data = loop.data()
    assert np.array_equal(data.encoder.values[-1], where) and 1 * MM < where[1] < 3 * MM
    assert data.command_position.t[-1] == pytest.approx(BEGIN + 0.5)
    assert ('push_protocol', 'HELD') in {(o.node, o.outcome) for o in data.outcomes}
    loop.protocol.resume()
    first = len(data.command_position)
    while not loop.finished:
        loop.tick()
    data = loop.data()
    assert np.abs(data.command_position.values[first] - where).max() < 1e-12   # no jump
    pair, back = data.moves
    assert [r.name for r in pair.regimes] == ['load', 'held', 'load', 'hold'] and pair.made
    standing = data.encoder.between(back.t_start - 0.1, back.t_start).values[-1]
    assert standing == pytest.approx(SCHEDULE[:, 5], abs=COUNT)


def test_too_much_force_stops_a_protocol():
    loop = inprocess.InProcess(make(limits={'pad_force_N': 2.0}), ('force',))
    upto(loop, BEGIN + 1.0)
    assert loop.safety.permission is Permission.STOP
    assert loop.data().encoder.values[-1][0] < 5 * MM and loop.data().moves == ()


def test_a_run_may_end_with_its_last_move():
    data = inprocess.run(make(moves=MOVES[:2]), go_home=False)
    assert [m.made for m in data.moves] == [True, True]
    assert data.encoder.values[-1] == pytest.approx(SCHEDULE[:, 5], abs=COUNT)


def test_the_same_seed_gives_the_same_bits(probed):
    again = upto(inprocess.InProcess(make(), inprocess.SENSORS), 2.0).data()
    n, m = len(again.encoder), len(again.em['target_1'].t)
    assert probed.encoder.values[:n].tobytes() == again.encoder.values.tobytes()
    assert probed.em['target_1'].position[:m].tobytes() == \
        again.em['target_1'].position.tobytes()
