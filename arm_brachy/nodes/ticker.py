"""When a node works: in lockstep with the cell's clock, or on its own timer.

Lockstep. The clock publishes tick k. A node answers it once it holds every message that its
upstream nodes published up to that tick (or up to the tick before, where the edge is a feedback),
which it knows from the counts in their TickDone. It then works, publishes, and answers with its
own TickDone. What a node computes therefore depends on the data alone and never on how loaded the
machine is. Wall. A timer fires every tick and the node works with what has arrived.
"""

import importlib
from collections import deque

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from arm_brachy import graph
from arm_brachy.core.errors import InputError
from arm_brachy_msgs.msg import TickDone

READY_PERIOD_S = 0.1
# rclpy's default event handlers (two per publisher and subscription, to log a mismatch of QoS that
# graph.py rules out) take part in every wait and make it three times as long.
_NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
_NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
LOSSLESS_DEPTH = 1000  # a burst at start-up (nodes slow to import) must not push anything out


def message_type(name):
    """'geometry_msgs/msg/PoseStamped' -> the class."""
    package, kind, cls = name.split('/')
    return getattr(importlib.import_module(f'{package}.{kind}'), cls)


def offered(topic):
    """QoS of a publisher: reliable and deep, so that neither kind of subscriber is refused."""
    return _profile(max(topic.depth, LOSSLESS_DEPTH) if not topic.latched else topic.depth, True,
                    topic.latched)


def asked(topic, lockstep):
    """QoS of a subscriber: the table's when paced by the wall, lossless in lockstep."""
    if lockstep:
        return _profile(LOSSLESS_DEPTH, True, topic.latched)
    return _profile(topic.depth, topic.reliable, topic.latched)


def _profile(depth, reliable, latched):
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)


def publish_to(node, topic):
    """Create the publisher of a graph.Topic."""
    return node.create_publisher(message_type(topic.type), topic.name, offered(topic),
                                 event_callbacks=_NO_PUBLISHER_EVENTS)


def listen_to(node, topic, callback, *, lockstep, raw=False):
    """Create the subscription of a graph.Topic; raw = the callback gets bytes."""
    return node.create_subscription(message_type(topic.type), topic.name, callback,
                                    asked(topic, lockstep), raw=raw,
                                    event_callbacks=_NO_SUBSCRIPTION_EVENTS)


class Inbox:
    """Messages of one topic that have arrived and have not been worked on."""

    def __init__(self, upstream, delay):
        """upstream : nodes whose counts say what is due;  delay : 0 same tick, 1 one before."""
        self.upstream = upstream
        self.delay = delay
        self._queue = deque()
        self._taken = 0

    def put(self, msg):
        """Keep a message that has arrived."""
        self._queue.append(msg)

    def holds(self, count):
        """True once everything up to the publishers' total `count` has arrived."""
        return self._taken + len(self._queue) >= count

    def take(self, count=None):
        """Remove and return the messages up to `count` (None = all there are), oldest first."""
        n = len(self._queue) if count is None else count - self._taken
        self._taken += n
        return [self._queue.popleft() for _ in range(n)]


class Ticker:
    """Collects inputs, calls `work` once a tick, counts what is published, answers the tick.

    work(tick, t_ns, inputs) : inputs maps topic name -> list of messages, oldest first. It may
    return a future; the tick is answered when that is done (a service call in progress).
    unready() : optional, names of whatever else must be there before the first tick (services)
    witness(topic name, t_ns, bytes) : optional, called with every Clock and TickDone as it came
    over the wire (the recorder keeps them).
    """

    def __init__(self, node, spec, work, *, lockstep, tick_ns, peers, absent=()):
        """spec : graph.NodeSpec of this node; peers : names of the nodes that take part.

        absent : peers that only a replayer speaks for; they read nothing
        """
        self.lockstep, self.tick_ns, self.last_ns = lockstep, tick_ns, 0
        self.witness, self.unready = None, lambda: []
        self._node, self._spec, self._work = node, spec, work
        self._peers = frozenset(peers) - {spec.name}
        self._readers = self._peers - frozenset(absent)
        self._inboxes, self._publishers, self._counts = {}, {}, {}
        self._done = {}          # upstream -> {tick: counts by topic}
        self._ticks = deque()    # (tick, t_ns) announced and not yet answered
        self._tick, self._busy, self._started = 0, False, False
        self._done_pub = publish_to(node, graph.TICK_DONE.at(node=spec.name))

    @property
    def answered(self):
        """Number of the last tick answered."""
        return self._tick

    @property
    def counts(self):
        """Messages published so far, by topic."""
        return dict(self._counts)

    def publisher(self, topic):
        """Create the publisher of a graph.Topic; returns a callable that publishes and counts."""
        pub = publish_to(self._node, topic)
        self._publishers[topic.name] = pub
        self._counts[topic.name] = 0

        def publish(msg):
            self._counts[topic.name] += 1
            pub.publish(msg)

        return publish

    def subscribe(self, topic, *, raw=False):
        """Collect a graph.Topic; who publishes it, and with what delay, the table says."""
        upstream = graph.writers(topic.name, self._peers)
        delay = 1 if any(u in self._spec.previous for u in upstream) else 0
        inbox = self._inboxes[topic.name] = Inbox(upstream, delay)

        def arrived(msg):
            inbox.put(msg)
            self._advance()

        listen_to(self._node, topic, arrived, lockstep=self.lockstep, raw=raw)

    def start(self):
        """Begin to tick; call it once all publishers and subscriptions exist."""
        if not self.lockstep:
            self._started = True
            self._node.create_timer(self.tick_ns * 1e-9, self._on_timer)
            return
        for upstream in sorted({*self._spec.same, *self._spec.previous} & self._peers):
            self._done[upstream] = {}
            listen_to(self._node, graph.TICK_DONE.at(node=upstream), self._on_done,
                      lockstep=True, raw=True)
        listen_to(self._node, graph.CLOCK, self._on_clock, lockstep=True, raw=True)
        self._ready_timer = self._node.create_timer(READY_PERIOD_S, self._announce_ready)

    def drain(self):
        """Return all that has arrived and was not worked on: topic name -> messages."""
        return {name: box.take() for name, box in self._inboxes.items()}

    def lonely(self):
        """Topics of ours that some reader promised by the table has not connected to yet."""
        names = [name for name, pub in self._publishers.items()
                 if pub.get_subscription_count() < graph.readers(name, self._readers)]
        if self._done_pub.get_subscription_count() < graph.waiters(self._spec.name, self._readers):
            names.append(graph.TICK_DONE.at(node=self._spec.name).name)
        return names

    def _announce_ready(self):
        """Answer tick 0, again and again until the clock starts."""
        if self._started:
            self._ready_timer.cancel()
        elif missing := [*self.lonely(), *self.unready()]:
            self._node.get_logger().info(f'waiting for the other end of {", ".join(missing)}',
                                         throttle_duration_sec=5.0, skip_first=True)
        else:
            self._answer(0, 0)

    def _on_clock(self, data):
        t_ns = Time.from_msg(deserialize_message(data, Clock).clock).nanoseconds
        if t_ns % self.tick_ns:
            raise InputError(f'{self._spec.name}: /clock at {t_ns} ns; must be a multiple of the '
                             f'tick, {self.tick_ns} ns: give clock and nodes the same scenario')
        if self.witness is not None:
            self.witness(graph.CLOCK.name, t_ns, data)
        self._started = True
        self._ticks.append((t_ns // self.tick_ns, t_ns))
        self._advance()

    def _on_done(self, data):
        msg = deserialize_message(data, TickDone)
        self._done[msg.node][msg.tick] = dict(zip(msg.topics, msg.counts, strict=True))
        if self.witness is not None and msg.tick > 0:
            self.witness(graph.TICK_DONE.at(node=msg.node).name,
                         Time.from_msg(msg.stamp).nanoseconds, data)
        self._advance()

    def _on_timer(self):
        if not self._busy and not self.unready():
            t_ns = self._node.get_clock().now().nanoseconds
            self._run(self._tick + 1, t_ns, self.drain())

    def _advance(self):
        if self._busy or not self._ticks:
            return
        tick, t_ns = self._ticks[0]
        due = self._due_counts(tick)
        if due is None:
            return
        self._ticks.popleft()
        inputs = {name: box.take(due[name]) for name, box in self._inboxes.items()}
        self._forget(tick)
        self._run(tick, t_ns, inputs)

    def _due_counts(self, tick):
        """Messages due per topic for `tick`, or None while something is missing."""
        for upstream, answers in self._done.items():
            if tick - (upstream in self._spec.previous) not in answers:
                return None
        due = {}
        for name, box in self._inboxes.items():
            due[name] = sum(self._done[u][tick - box.delay].get(name, 0) for u in box.upstream)
            if not box.holds(due[name]):
                return None
        return due

    def _forget(self, tick):
        for answers in self._done.values():
            for old in [k for k in answers if k < tick - 1]:
                del answers[old]

    def _run(self, tick, t_ns, inputs):
        self._busy = True
        pending = self._work(tick, t_ns, inputs)
        if pending is None:
            self._finish(tick, t_ns)
        else:
            pending.add_done_callback(lambda _: self._finish(tick, t_ns))

    def _finish(self, tick, t_ns):
        self._busy = False
        self._answer(tick, t_ns)
        self._advance()

    def _answer(self, tick, t_ns):
        self._tick, self.last_ns = tick, t_ns
        msg = TickDone(stamp=Time(nanoseconds=t_ns).to_msg(), tick=tick, node=self._spec.name)
        msg.topics = list(self._counts)
        msg.counts = list(self._counts.values())
        self._done_pub.publish(msg)
