"""Prescribed moves: what legs they are made of, how a leg runs, what is refused."""

import numpy as np
import pytest

from arm_brachy.control.moves import Leg, Move, PadTarget, legs_of

PADS = ('a', 'b', 'c')
MM = 1e-3


def move(name, speed=2 * MM, hold=1.0, cycles=0, others='stay', **pads):
    targets = tuple(PadTarget(pad, q * MM) for pad, q in pads.items())
    return Move(name, speed, targets, others, hold, cycles)


def targets(moves):
    """Targets of all legs, in mm."""
    return [(leg.target / MM).round(9).tolist() for leg in legs_of(moves, PADS)]


def test_pads_that_are_not_named_stay_or_go_home():
    moves = [move('in', a=5, b=2), move('on', a=7), move('swap', others='home', c=3),
             move('home', others='home')]
    assert targets(moves) == [[5, 2, 0], [7, 2, 0], [0, 0, 3], [0, 0, 0]]
    assert targets([move('in', b=2), move('wait', hold=3.0)]) == [[0, 2, 0], [0, 2, 0]]


def test_cycles_go_there_and_back_to_where_the_move_began():
    moves = [move('in', b=1), move('twice', a=5, cycles=2), move('on', b=4)]
    assert targets(moves) == [[0, 1, 0], [5, 1, 0], [0, 1, 0], [5, 1, 0], [0, 1, 0], [0, 4, 0]]
    legs = legs_of(moves, PADS)
    assert [leg.move for leg in legs] == [0, 1, 1, 1, 1, 2]
    assert [leg.last for leg in legs] == [True, False, False, False, True, True]


def test_all_pads_leave_and_arrive_together_on_a_straight_line():
    """The pad with the longest way has the speed asked for; the line is that of pad space."""
    start, end = np.array([1.0, 6.0, 2.0]) * MM, np.array([9.0, 2.0, 2.0]) * MM
    leg = Leg(0, 'x', end, 4 * MM, 1.0, True)
    assert leg.lasts(start) == pytest.approx(2.0, rel=1e-12)
    assert leg.at(start, 0.0) == pytest.approx(start, abs=1e-15)
    for t in (0.3, 1.0, 1.999):
        done = (leg.at(start, t) - start)[:2] / (end - start)[:2]
        assert done == pytest.approx([t / 2.0] * 2, rel=1e-12)
        assert leg.at(start, t)[2] == start[2]
    assert np.array_equal(leg.at(start, leg.lasts(start)), end)
    assert np.array_equal(leg.at(start, 5.0), end)


def test_the_speed_of_every_pad_is_the_slope_of_its_ramp():
    start, end = np.array([1.0, 6.0, 2.0]) * MM, np.array([9.0, 2.0, 2.0]) * MM
    leg = Leg(0, 'x', end, 4 * MM, 1.0, True)
    slope = np.abs(leg.at(start, 1.5) - leg.at(start, 0.5))
    assert leg.speeds(start)[:2] == pytest.approx(slope[:2], rel=1e-12)
    assert leg.speeds(start)[2] == 4 * MM   # it stands: a driver takes no speed of zero
    assert np.array_equal(leg.speeds(end), [4 * MM] * 3)
    assert leg.lasts(end) == 0.0
