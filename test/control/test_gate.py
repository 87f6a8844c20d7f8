"""Orders that must not move anything, one by one; what makes nothing move is always heard."""

import math

import pytest

from arm_brachy.control.gate import Order, OrderGate, Tally

MOVE, HOLD, STOP = 0, 1, 2
T = 1.8e9


@pytest.fixture
def gate():
    return OrderGate({MOVE: False, HOLD: True, STOP: True}, 'cell_base', max_age=1.0)


def order(stamp=T, frame='cell_base', code=MOVE, values=(0.001, 0.0)):
    return Order(stamp, frame, code, values)


@pytest.mark.parametrize(('wrong', 'said'), [
    ({'stamp': 0.0}, 'ago; allowed 1 s'),
    ({'stamp': T - 1.1}, '1.1 s ago'),
    ({'stamp': T + 0.2}, '0.2 s in the future; allowed 0.1 s'),
    ({'stamp': T + 2e8}, 'in the future'),
    ({'frame': 'map'}, "frame_id = 'map'; must be 'cell_base'"),
    ({'frame': ''}, "frame_id = ''"),
    ({'code': 77}, 'mode 77; must be one of 0, 1, 2'),
    ({'values': (0.001, math.nan)}, 'nan; all must be finite'),
    ({'values': (-math.inf,)}, '-inf; all must be finite'),
])
def test_an_order_is_refused_and_the_next_good_one_obeyed(gate, wrong, said):
    assert said in gate.refusal(T, order(**wrong)).message
    assert gate.refusal(T, order()) is None


def test_an_order_outrun_by_a_later_one_is_refused(gate):
    assert gate.refusal(T, order(stamp=T - 0.1)) is None
    assert gate.refusal(T, order(stamp=T - 0.1)) is None     # two orders of one tick
    assert '0.1 s before the one obeyed last' in gate.refusal(T, order(stamp=T - 0.2)).message


@pytest.mark.parametrize('code', [HOLD, STOP])
def test_what_makes_nothing_move_is_never_too_late(gate, code):
    assert gate.refusal(T, order(0.0, 'map', code, (math.nan,))) is None
    assert gate.refusal(T, order()) is None


def test_a_flood_is_counted_whole_and_said_once_a_second():
    tally = Tally()
    said = [tally.note(k * 1e-3, 'no seal') for k in range(2500)]
    assert said.count(True) == 3 and tally.counts == {'no seal': 2500}
    assert tally.note(2.5, 'another kind')
