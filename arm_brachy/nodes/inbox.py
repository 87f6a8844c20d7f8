"""What has arrived on one topic, counted, so that a tick takes exactly what is due."""

from collections import Counter, deque

from arm_brachy.core.errors import InputError


class Inbox:
    """Messages of one topic that have arrived and have not been worked on.

    In lockstep it refuses what the nodes of the table have not published: a stranger's message
    would shift every later one by a place. With one upstream node its publisher numbers messages
    as we count them. With several, or where the middleware gives no numbers, what had arrived
    when the last tick was worked on must be due by now. Where a message tells its author, it is
    ignored instead: a topic like /tf belongs to strangers too.
    """

    def __init__(self, name, upstream, delay, author=None):
        """upstream : nodes whose counts say what is due;  delay : 0 same tick, 1 one before.

        author : callable message -> name of its node, or None for a stranger
        """
        self._author, self._by = author, Counter()
        self.upstream = upstream
        self.delay = delay
        self._name = name
        self._queue = deque()
        self._taken = 0
        self._arrived = deque([0] * (delay + 1), maxlen=delay + 1)  # by the last ticks

    def put(self, msg, number=None):
        """Keep a message that has arrived; returns False if it is a stranger's and ignored.

        number : as its publisher counts, None = unchecked
        """
        if self._author is not None:
            return self._put_of_author(msg, number)
        self._queue.append(msg)
        if number is not None and number != self._taken + len(self._queue):
            self._refuse()
        return True

    def _put_of_author(self, msg, number):
        name = self._author(msg)
        if name not in self.upstream or (number is not None and number != self._by[name] + 1):
            return False
        self._by[name] += 1
        self._queue.append(msg)
        return True

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
