"""What has arrived on one topic, counted, so that a tick takes exactly what is due."""

from collections import deque

from arm_brachy.core.errors import InputError


class Inbox:
    """Messages of one topic that have arrived and have not been worked on.

    In lockstep it refuses what the nodes of the table have not published: a stranger's message
    would shift every later one by a place. With one upstream node its publisher numbers messages
    as we count them. With several, or where the middleware gives no numbers, what had arrived
    when the last tick was worked on must be due by now.
    """

    def __init__(self, name, upstream, delay):
        """upstream : nodes whose counts say what is due;  delay : 0 same tick, 1 one before."""
        self.upstream = upstream
        self.delay = delay
        self._name = name
        self._queue = deque()
        self._taken = 0
        self._arrived = deque([0] * (delay + 1), maxlen=delay + 1)  # by the last ticks

    def put(self, msg, number=None):
        """Keep a message that has arrived; `number` as its publisher counts, None = unchecked."""
        self._queue.append(msg)
        if number is not None and number != self._taken + len(self._queue):
            self._refuse()

    def holds(self, count):
        """True once everything up to the publishers' total `count` has arrived."""
        return self._taken + len(self._queue) >= count

    def take(self, count=None):
        """Remove and return the messages up to `count` (None = all there are), oldest first."""
        if count is None:
            n = len(self._queue)
        else:
            if self._arrived[0] > count:
                self._refuse()
            self._arrived.append(self._taken + len(self._queue))
            n = count - self._taken
        self._taken += n
        return [self._queue.popleft() for _ in range(n)]

    def _refuse(self):
        raise InputError(f'{self._name}: holds a message that was not published by '
                         f'{" or ".join(self.upstream) or "any node of this run"}; in lockstep '
                         'nobody else may: end the other publisher or set pace: wall')
