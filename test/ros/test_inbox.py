"""A tick takes what the table's nodes have published, and nothing else gets in unseen."""

import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.nodes.inbox import Inbox


def test_a_tick_takes_what_is_due_oldest_first():
    box = Inbox('force', ('sensor',), 0)
    for k in range(3):
        box.put(k, k + 1)
    assert box.holds(3) and not box.holds(4)
    assert box.take(2) == [0, 1]
    assert box.take(3) == [2]


def test_a_strangers_number_is_refused():
    box = Inbox('actuators/command', ('mpc_manipulator',), 1)
    box.put('ours', 1)
    with pytest.raises(InputError, match='actuators/command.*not published by mpc_manipulator'):
        box.put("a stranger's first", 1)


@pytest.mark.parametrize('delay', [0, 1])
def test_a_surplus_that_never_comes_due_is_refused(delay):
    """Both writers said at every tick that they had published nothing new."""
    box = Inbox('diagnostics', ('em_tracker', 'supervisor'), delay)
    box.put('em')
    box.put('supervisor')
    assert box.take(2) == ['em', 'supervisor']
    box.put('whose?')
    for _ in range(1 + delay):
        assert box.take(2) == []
    with pytest.raises(InputError, match='em_tracker or supervisor'):
        box.take(2)


@pytest.mark.parametrize('delay', [0, 1])
def test_what_comes_early_is_kept_for_its_tick(delay):
    """A service may publish after its node has answered the tick; the next answer counts it."""
    box = Inbox('outcome', ('a', 'b'), delay)
    box.put('early')
    for _ in range(1 + delay):
        assert box.take(0) == []
    assert box.take(1) == ['early']


def test_where_a_message_tells_its_author_a_strangers_is_ignored():
    box = Inbox('diagnostics', ('em_tracker', 'supervisor'), 0, author=lambda msg: msg[0])
    assert box.put(('em_tracker', 'a'), 1)
    assert not box.put(('robot', 'x'), 1)
    assert not box.put(('em_tracker', 'forged'), 7)     # its publisher counts otherwise
    assert box.put(('supervisor', 'b'), 1) and box.put(('em_tracker', 'c'), 2)
    assert box.take(3) == [('em_tracker', 'a'), ('supervisor', 'b'), ('em_tracker', 'c')]
    assert box.take(3) == []
