"""The probing protocol against its schedule: ramps, holds, home, interruptions."""

import numpy as np
import pytest

from arm_brachy.control.move_events import Phase, Status
from arm_brachy.control.moves import Move, PadTarget
from arm_brachy.control.push_protocol import Action, PushProtocol, Stage
from arm_brachy.control.safety import Permission
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.evaluation import regimes

PADS = ('a', 'b')
MM, TICK, SETTLE = 1e-3, 0.05, 0.5


def move(name, speed, hold, cycles=0, others='stay', **pads):
    targets = tuple(PadTarget(pad, q * MM) for pad, q in pads.items())
    return Move(name, speed * MM, targets, others, hold, cycles)


class Rig:
    """Pads that stand where they were last told to; `steps` keeps (t, ProtocolStep)."""

    def __init__(self, *moves, patience=120.0):
        self.protocol = PushProtocol(moves, PADS, SETTLE, patience)
        self.protocol.permit(Permission.RUN)
        self.q, self.k, self.steps, self.follows = np.zeros(2), 0, [], True

    @property
    def t(self):
        return self.k * TICK

    def tick(self, *, velocity=(0.0, 0.0)):
        self.k += 1
        step = self.protocol.step(self.t, self.q, np.array(velocity))
        self.steps.append((self.t, step))
        if step.command is not None and self.follows:
            self.q = step.command
        if step.action is Action.HOME and self.follows:
            self.q = np.zeros(2)
        return step

    def until(self, condition, limit=200.0):
        while not condition():
            self.tick()
            assert self.t < limit
        return self

    def to_the_end(self):
        return self.until(lambda: self.protocol.stage is Stage.FINISHED)

    def upto(self, t):
        return self.until(lambda: self.t >= t - 1e-9)

    @property
    def commands(self):
        """Times (n,) and commands (n, 2)."""
        given = [(t, s.command) for t, s in self.steps if s.command is not None]
        return np.array([t for t, _ in given]), np.array([c for _, c in given])

    @property
    def events(self):
        return [e for _, step in self.steps for e in step.events]

    def said(self):
        return [(e.status, e.name, e.message) for e in self.events]


BEGIN = TICK + SETTLE   # at home from the first tick on


def test_commands_are_the_schedule_and_nothing_else():
    """Two pads, 5 and 2 mm, at 4 mm/s: 1.25 s; hold; the first on to 6 mm at 20 mm/s; back."""
    rig = Rig(move('both', 4, 1.0, a=5, b=2), move('fast', 20, 0.4, a=6),
              move('back', 3, 0.3, others='home')).to_the_end()
    knots = np.cumsum([BEGIN, 1.25, 1.0, 0.05, 0.4, 2.0, 0.3])
    t, q = rig.commands
    assert t[0] == pytest.approx(BEGIN) and t[-1] == pytest.approx(knots[-1] - TICK)
    assert np.allclose(np.diff(t), TICK)
    expected = np.stack([np.interp(t, knots, [0, 5, 5, 6, 6, 0, 0]),
                         np.interp(t, knots, [0, 2, 2, 2, 2, 0, 0])], axis=1) * MM
    assert q == pytest.approx(expected, abs=1e-12)
    assert rig.protocol.made == 3 and rig.protocol.verdict == ''


def test_a_hold_lasts_what_it_says_however_ticks_fall():
    """Ramps of 1/3 s do not fall on ticks; the schedule does not drift with them."""
    rig = Rig(move('cycle', 3, 0.5, cycles=5, a=1)).to_the_end()
    t, _ = rig.commands
    begins = BEGIN + np.arange(10) * (1 / 3 + 0.5)
    assert t[-1] == pytest.approx(np.floor((begins[-1] + 1 / 3 + 0.5) / TICK) * TICK)
    said = [e.t for e in rig.events if e.message in ('load', 'unload')]
    assert said == pytest.approx(np.ceil(begins / TICK - 1e-9) * TICK)


def test_each_pad_is_given_the_speed_of_its_own_ramp():
    rig = Rig(move('both', 4, 1.0, a=5, b=2)).upto(BEGIN + 1.0)
    speed = rig.steps[-1][1].speed
    t, q = rig.commands
    slope = (q[-1] - q[-11]) / (t[-1] - t[-11])
    assert speed == pytest.approx(slope, rel=1e-9) and speed[0] == pytest.approx(4 * MM)


def test_what_is_said_names_move_and_phase():
    rig = Rig(move('in', 10, 0.5, a=4), move('swap', 10, 0.5, others='home', b=4),
              move('out', 10, 0.5, others='home')).to_the_end()
    active, idle = Status.ACTIVE, Status.IDLE
    assert rig.said() == [
        (idle, '', 'rest'), (active, 'in', 'load'), (active, 'in', 'hold'),
        (Status.DONE, 'in', ''),
        (active, 'swap', 'exchange'), (active, 'swap', 'hold'), (Status.DONE, 'swap', ''),
        (active, 'out', 'unload'), (active, 'out', 'rest'), (Status.DONE, 'out', ''),
        (Status.HOMING, '', ''), (idle, '', 'rest'), (Status.FINISHED, '', '')]
    assert [e.index for e in rig.events if e.status is Status.DONE] == [0, 1, 2]


def test_phases_are_called_as_the_evaluation_calls_them():
    assert {p.value for p in Phase} - {'held'} == {
        regimes.REST, regimes.LOAD, regimes.HOLD, regimes.UNLOAD, regimes.EXCHANGE}


def test_it_rests_at_home_at_both_ends():
    rig = Rig(move('in', 10, 0.5, a=4)).to_the_end()
    t, _ = rig.commands
    home, = [e.t for e in rig.events if e.status is Status.HOMING]
    resting, finished = (e.t for e in rig.events[-2:])
    assert t[0] == pytest.approx(TICK + SETTLE)
    assert home == pytest.approx(t[-1] + TICK) and resting == pytest.approx(home + TICK)
    assert finished == pytest.approx(resting + SETTLE)
    assert rig.tick().action is Action.FINISH and rig.tick().events == ()


def test_nothing_is_commanded_before_the_pads_are_home():
    rig = Rig(move('in', 10, 0.5, a=4))
    rig.q = np.array([0.0, 3 * MM])
    rig.upto(2.0)
    rig.q = np.zeros(2)
    rig.tick(velocity=(0.0, -5 * MM))   # at zero and not yet at rest
    assert rig.commands[0].size == 0 and rig.protocol.stage is Stage.AWAITING_HOME
    rig.until(lambda: rig.commands[0].size > 0)
    assert rig.t == pytest.approx(2.0 + 2 * TICK + SETTLE)


def test_nothing_is_commanded_before_the_first_permission():
    rig = Rig(move('in', 10, 0.5, a=4))
    rig.protocol.permit(Permission.HOLD, 'starting')
    rig.upto(3.0)
    assert rig.events == [] and {s.outcome for _, s in rig.steps} == {Outcome.OK}
    rig.protocol.permit(Permission.RUN)
    rig.until(lambda: rig.commands[0].size > 0)
    assert rig.t == pytest.approx(3.0 + TICK + SETTLE)


def test_a_hold_while_it_rests_begins_the_rest_anew():
    rig = Rig(move('in', 10, 0.5, a=4)).upto(0.4)
    rig.protocol.permit(Permission.HOLD, 'looked at')
    rig.upto(1.0)
    rig.protocol.permit(Permission.RUN)
    rig.until(lambda: rig.commands[0].size > 0)
    assert rig.t == pytest.approx(1.0 + SETTLE, abs=TICK + 1e-9)


@pytest.fixture
def interrupted():
    """Half-way in, 2 mm of 4 at 4 mm/s; the pad was stopped at 1.7 mm. Then permitted again."""
    rig = Rig(move('in', 4, 0.5, a=4), move('on', 4, 0.5, b=2)).upto(BEGIN + 0.5)
    rig.protocol.permit(Permission.STOP, 'force')
    rig.q, rig.follows = np.array([1.7 * MM, 0.0]), False
    rig.upto(BEGIN + 1.0)
    rig.protocol.permit(Permission.RUN)
    rig.upto(BEGIN + 1.5)
    rig.follows = True
    return rig


def test_an_interrupted_move_waits_to_be_told(interrupted):
    t, _ = interrupted.commands
    assert t[-1] == pytest.approx(BEGIN + 0.5)
    steps = [s for t, s in interrupted.steps if t > BEGIN + 0.5]
    assert {s.outcome for s in steps} == {Outcome.HELD}
    assert 'STOP (force)' in steps[0].message and 'push_protocol/resume' in steps[-1].message
    assert interrupted.said()[-1] == (Status.IDLE, 'in', 'held')


def test_resuming_goes_straight_from_where_the_pads_are(interrupted):
    rig = interrupted
    rig.protocol.resume()
    first = rig.tick()
    assert first.command == pytest.approx([1.7 * MM, 0.0]) and first.outcome is Outcome.OK
    rig.to_the_end()
    t, q = rig.commands
    late = t > BEGIN + 1.2
    knots = np.cumsum([first.events[0].t, 2.3 / 4, 0.5, 0.5, 0.5])
    assert q[late, 0] == pytest.approx(np.interp(t[late], knots[:2], [1.7, 4]) * MM, abs=1e-12)
    assert q[late, 1] == pytest.approx(np.interp(t[late], knots[2:4], [0, 2]) * MM, abs=1e-12)
    assert rig.protocol.made == 2
    assert [e.message for e in rig.events if e.name == 'in'] == [
        'load', 'held', 'load', 'hold', '']


def test_resuming_is_refused_without_permission_or_reason(interrupted):
    interrupted.protocol.permit(Permission.HOLD, 'again')
    with pytest.raises(CommandRefused, match=r'HOLD \(again\).*supervisor/reset'):
        interrupted.protocol.resume()
    with pytest.raises(CommandRefused, match='nothing was interrupted'):
        Rig(move('in', 4, 0.5, a=4)).protocol.resume()


def test_an_interrupted_homing_is_begun_again():
    rig = Rig(move('in', 10, 0.5, a=4))
    rig.until(lambda: rig.protocol.stage is Stage.HOMING)
    rig.q = np.array([2 * MM, 0.0])   # held on its way
    rig.protocol.permit(Permission.HOLD, 'test')
    rig.tick()
    rig.protocol.permit(Permission.RUN)
    assert rig.tick().action is Action.GO_ON
    rig.protocol.resume()
    assert rig.tick().action is Action.HOME
    rig.to_the_end()
    assert rig.protocol.verdict == ''


@pytest.mark.parametrize(('when', 'left'), [(BEGIN + 0.2, 2), (BEGIN + 1.8, 1)])
def test_an_interruption_that_nobody_ends_ends_the_run(when, left):
    rig = Rig(move('in', 4, 0.5, a=4), move('on', 4, 0.5, a=6), patience=3.0).upto(when)
    rig.protocol.permit(Permission.STOP, 'force')
    rig.to_the_end()
    assert rig.t == pytest.approx(when + 3.0 + 2 * TICK, abs=TICK)
    assert f'STOP (force); {left} of 2 moves not made' in rig.protocol.verdict
    assert rig.said()[-1] == (Status.FINISHED, '', rig.protocol.verdict)


def test_pads_that_never_come_home_end_the_run():
    rig = Rig(move('in', 10, 0.5, a=4), patience=3.0)
    rig.until(lambda: rig.protocol.stage is Stage.MOVING).follows = False
    rig.q = np.array([4 * MM, 0.0])
    rig.to_the_end()
    assert 'the pads are not at home; 0 of 1 moves not made' in rig.protocol.verdict


def test_a_move_whose_pads_do_not_follow_is_not_made():
    rig = Rig(move('in', 10, 0.5, cycles=1, a=4), move('again', 10, 0.5, a=4))
    rig.upto(BEGIN + 0.2).follows = False     # 2 mm in: blocked
    rig.upto(BEGIN + 1.0).follows = True      # the way back is free again
    rig.to_the_end()
    done = {e.name: e for e in rig.events if e.status in (Status.DONE, Status.REFUSED)}
    assert done['in'].status is Status.REFUSED
    assert '2.0 mm from where it was sent' in done['in'].message
    assert done['again'].status is Status.DONE and rig.protocol.made == 1
    assert rig.protocol.verdict == '1 of 2 moves not made'


def test_a_ramp_shorter_than_a_tick_is_commanded_with_its_own_speed():
    rig = Rig(move('small', 20, 0.5, a=0.5)).to_the_end()   # 25 ms
    t, q = rig.commands
    first = np.flatnonzero(q[:, 0] > 0.0)[0]
    assert q[first, 0] == pytest.approx(0.5 * MM) and t[first] == pytest.approx(BEGIN + TICK)
    speeds = [s.speed[0] for _, s in rig.steps if s.speed is not None]
    assert speeds == pytest.approx([20 * MM] * len(speeds))


def test_time_may_be_a_date():
    rig = Rig(move('in', 4, 0.5, a=4))
    rig.k = round(1.7e9 / TICK)
    begin = rig.t
    while rig.protocol.stage is not Stage.FINISHED:
        rig.tick()
    t, q = rig.commands
    assert q[:, 0] == pytest.approx(np.interp(t - begin, [BEGIN, BEGIN + 1], [0, 4]) * MM,
                                    abs=1e-8)
