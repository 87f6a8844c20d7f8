"""When a node works: in lockstep with the cell's clock, or on its own timer.

Lockstep. The clock publishes tick k. A node answers it once it holds every message that its
upstream nodes published up to that tick (or up to the tick before, where the edge is a feedback),
which it knows from the counts in their TickDone. It then works, publishes, and answers with its
own TickDone. What a node computes therefore depends on the data alone and never on how loaded the
machine is. Wall. A timer fires every tick and the node works with what has arrived.
"""

import importlib
import time
from collections import deque
from functools import partial

import rclpy.clock
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from arm_brachy import graph
from arm_brachy.core.errors import InputError
from arm_brachy.core.session import SealError, unsealed
from arm_brachy.nodes.authors import author_of
from arm_brachy.nodes.inbox import Inbox
from arm_brachy_msgs.msg import TickDone

READY_PERIOD_S = 0.1
MUTE_S = 1.0          # of a wait for others in lockstep, which at a start is no news
WORD_PERIOD_S = 5.0   # of what is said of a wait
# rclpy's default event handlers (two per publisher and subscription, to log a mismatch of QoS that
# graph.py rules out) take part in every wait and make it three times as long.
_NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
_NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
START_PATIENCE_S = 10.0  # wall pace: longest wait for the recorder before the first tick
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


def unheard_by(node, publisher, names):
    """Those of the nodes `names` that have not connected to a publisher yet.

    Counting is not enough: strangers (Foxglove, ros2 bag) and the ghosts of killed nodes count
    too. Only reliable subscriptions are ours; that of use_sim_time to /clock is not.
    """
    found = {s.node_name for s in node.get_subscriptions_info_by_topic(publisher.topic_name)
             if s.qos_profile.reliability == ReliabilityPolicy.RELIABLE}
    names = list(names)
    missing = [n for n in names if n not in found]
    if not missing and publisher.get_subscription_count() < len(names):
        return names  # known to the graph, not all of them matched
    return missing


def call_every(node, seconds, callback):
    """Create a timer that follows neither simulated time nor corrections of the system's."""
    steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
    return node.create_timer(seconds, callback, clock=steady)


class Ticker:
    """Collects inputs, calls `work` once a tick, counts what is published, answers the tick.

    work(tick, t_ns, inputs) : inputs maps topic name -> list of messages, oldest first. It may
    return a future; the tick is answered when that is done (a service call in progress).
    unready() : optional, names of whatever else must be there before the first tick (services)
    asleep() : optional, what somebody must do before any tick is worked on, '' = nothing
    witness(topic name, t_ns, bytes) : optional, called with every Clock and TickDone as it came
    over the wire (the recorder keeps them).
    on_refusal(topic name, reason) : optional, called for every message that is not from this cell
    """

    def __init__(self, node, spec, work, *, lockstep, tick_ns, peers, absent=(), session=None):
        """spec : graph.NodeSpec of this node; peers : names of the nodes that take part.

        absent : peers that only a replayer speaks for; they read nothing
        session : core.session.Session that seals graph.SEALED and opens them; None = unsealed
        """
        self._session, self.on_refusal = session, lambda topic, reason: None
        self.lockstep, self.tick_ns, self.last_ns = lockstep, tick_ns, 0
        self.witness, self.unready, self.asleep = None, lambda: [], lambda: ''
        self._node, self._spec, self._work = node, spec, work
        self._peers = frozenset(peers) - {spec.name}
        self._readers, self._replayed = self._peers - frozenset(absent), bool(absent)
        self._inboxes, self._publishers, self._counts = {}, {}, {}
        self._done = {}          # upstream -> {tick: counts by topic}
        self._ticks = deque()    # (tick, t_ns) announced and not yet answered
        self._tick, self._busy, self._started = 0, False, False
        self._alarm = None       # timer that looks whether we are still asleep in lockstep
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
        sealed = self._session is not None and topic in graph.SEALED

        def publish(msg):
            self._counts[topic.name] += 1
            pub.publish(self._seal(pub.topic_name, msg) if sealed else msg)

        return publish

    def _seal(self, full_name, msg):
        return self._session.seal(full_name, serialize_message(msg), time.time_ns())

    def subscribe(self, topic, *, raw=False, lossless=False, receipts=False):
        """Collect a graph.Topic; who publishes it, and with what delay, the table says.

        lossless : ask for every message at wall pace too
        receipts : collect (time of receipt [ns], message) in place of messages
        """
        upstream = graph.writers(topic.name, self._peers)
        delay = 1 if any(u in self._spec.previous for u in upstream) else 0
        author = self._author(topic, upstream, raw, receipts)
        inbox = self._inboxes[topic.name] = Inbox(topic.name, upstream, delay, author)
        numbered = self.lockstep and (len(upstream) == 1 or author is not None)

        def arrived(msg, info):
            if receipts:
                msg = (info['received_timestamp'], msg)
            if not inbox.put(msg, info['publication_sequence_number'] if numbered else None):
                self.on_refusal(topic.name, 'not from this cell')
            self._advance()

        self.listen(topic, arrived, lockstep=self.lockstep or lossless, raw=raw)

    def _author(self, topic, upstream, raw, receipts):
        """Callable that says whose a message is, or its bytes; None where it does not tell."""
        author = author_of(topic, upstream, self._node.get_parameter('base_frame').value)
        if author is None or not raw:
            return author
        kind = message_type(topic.type)
        return lambda data: author(deserialize_message(data[1] if receipts else data, kind))

    def listen(self, topic, callback, *, lockstep, raw=False):
        """Call back (message, info) with what comes on a graph.Topic, if it is from this cell."""
        if topic not in graph.SEALED:
            listen_to(self._node, topic, callback, lockstep=lockstep, raw=raw)
            return
        name, kind = self._node.resolve_topic_name(topic.name), message_type(topic.type)

        def opened(data, info):
            try:
                data = unsealed(data) if self._session is None else self._session.open(name, data)
            except SealError as error:
                self.on_refusal(topic.name, str(error))
                return
            callback(data if raw else deserialize_message(data, kind), info)

        listen_to(self._node, topic, opened, lockstep=lockstep, raw=True)

    def start(self):
        """Begin to tick; call it once all publishers and subscriptions exist."""
        if self.lockstep or self.witness is not None:
            for upstream in sorted({*self._spec.same, *self._spec.previous} & self._peers):
                self._done[upstream] = {}
                listen_to(self._node, graph.TICK_DONE.at(node=upstream),
                          partial(self._on_done, upstream), lockstep=True, raw=True)
        if not self.lockstep:
            self._deadline = time.monotonic() + START_PATIENCE_S
            call_every(self._node, self.tick_ns * 1e-9, self._on_timer)
            return
        self._mute_until = time.monotonic() + MUTE_S
        listen_to(self._node, graph.CLOCK, self._on_clock, lockstep=True, raw=True)
        self._ready_timer = call_every(self._node, READY_PERIOD_S, self._announce_ready)

    def drain(self):
        """Return all that has arrived and was not worked on: topic name -> messages."""
        return {name: box.take() for name, box in self._inboxes.items()}

    def lonely(self):
        """Topics of ours, and the readers promised by the table that are not connected yet."""
        wanted = [(name, pub, graph.readers(name, self._readers))
                  for name, pub in self._publishers.items()]
        wanted.append((graph.TICK_DONE.at(node=self._spec.name).name, self._done_pub,
                       graph.waiters(self._spec.name, self._readers)))
        missing = ((name, unheard_by(self._node, pub, map(self._player, nodes)))
                   for name, pub, nodes in wanted)
        return [f'{name} ({", ".join(nodes)})' for name, nodes in missing if nodes]

    def _player(self, name):
        """The process that plays a node: in a replay the clock is the replayer."""
        return graph.REPLAYER if name == graph.CELL_CLOCK.name and self._replayed else name

    def _recorder_missing(self):
        """At wall pace, for a while: no recorder yet that would keep what we publish."""
        return graph.RECORDER.name in self._readers and time.monotonic() < self._deadline and any(
            unheard_by(self._node, pub, [graph.RECORDER.name])
            for pub in (*self._publishers.values(), self._done_pub))

    def _announce_ready(self):
        """Answer tick 0, again and again until the clock starts."""
        if self._started:
            self._ready_timer.cancel()
            return
        asleep, missing = self.asleep(), [*self.lonely(), *self.unready()]
        if not (asleep or missing):
            self._answer(0, 0)
        if time.monotonic() > self._mute_until:
            self._say_waiting(asleep or (f'the other end of {", ".join(missing)}' if missing
                                         else f'the first tick of {graph.CELL_CLOCK.name}'))

    def _on_clock(self, data):
        t_ns = Time.from_msg(deserialize_message(data, Clock).clock).nanoseconds
        if t_ns % self.tick_ns:
            raise InputError(f'{self._spec.name}: /clock at {t_ns} ns; must be a multiple of the '
                             f'tick, {self.tick_ns} ns: give clock and nodes the same scenario')
        if self.witness is not None:
            self.witness(graph.CLOCK.name, t_ns, data)
        self._check_order(t_ns // self.tick_ns)
        self._started = True
        self._ticks.append((t_ns // self.tick_ns, t_ns))
        self._advance()

    def _check_order(self, tick):
        """Two clocks in a domain are two cells, and no tick of either means anything."""
        last = self._ticks[-1][0] if self._ticks else self._tick
        if last > 0 and tick != last + 1:
            raise InputError(f'{self._spec.name}: /clock went from tick {last} to {tick}; is a '
                             'second cell or simulator in this DDS domain? set another '
                             'ROS_DOMAIN_ID for one of them')

    def _on_done(self, upstream, data):
        msg = deserialize_message(data, TickDone)
        if msg.node != upstream or len(msg.topics) != len(msg.counts):
            self.on_refusal(graph.TICK_DONE.at(node=upstream).name, 'not from this cell')
            return
        if self.witness is not None and msg.tick > 0:
            self.witness(graph.TICK_DONE.at(node=msg.node).name,
                         Time.from_msg(msg.stamp).nanoseconds, data)
        if self.lockstep:
            self._done[msg.node][msg.tick] = dict(zip(msg.topics, msg.counts, strict=True))
            self._advance()

    def _on_timer(self):
        t_ns = self._node.get_clock().now().nanoseconds
        if t_ns <= self.last_ns:  # the system's time was set back: wait until it has caught up
            return
        self._started = self._started or not self._recorder_missing()
        if asleep := self.asleep():
            self.drain()    # nobody will want what came meanwhile
            self._say_waiting(asleep)
            return
        missing = self.unready() if self._started else [graph.RECORDER.name]
        if missing:
            self._say_waiting(', '.join(missing))
        elif not self._busy:
            self._run(self._tick + 1, t_ns, self.drain())

    def _say_waiting(self, what):
        self._node.get_logger().info(f'waiting for {what}', throttle_duration_sec=WORD_PERIOD_S)

    def _advance(self):
        if self._busy or not self._ticks or self._sleeps():
            return
        tick, t_ns = self._ticks[0]
        due = self._due_counts(tick)
        if due is None:
            return
        self._ticks.popleft()
        inputs = {name: box.take(due[name]) for name, box in self._inboxes.items()}
        self._forget()
        self._run(tick, t_ns, inputs)

    def _sleeps(self):
        """True while asleep in lockstep, where no timer of ours would end it."""
        asleep = self.asleep() != ''
        if asleep and self._alarm is None:
            self._alarm = call_every(self._node, READY_PERIOD_S, self._wake)
        elif asleep and self._alarm.is_canceled():
            self._alarm.reset()
        return asleep

    def _wake(self):
        if asleep := self.asleep():
            self._say_waiting(asleep)
            return
        self._alarm.cancel()
        self._advance()

    def _due_counts(self, tick):
        """Messages due per topic for `tick`, or None while something is missing.

        A feedback edge looks at the tick answered last: a replay need not begin with tick 1.
        """
        for upstream, answers in self._done.items():
            if (self._tick if upstream in self._spec.previous else tick) not in answers:
                return None
        due = {}
        for name, box in self._inboxes.items():
            when = self._tick if box.delay else tick
            due[name] = sum(self._done[u][when].get(name, 0) for u in box.upstream)
            if not box.holds(due[name]):
                return None
        return due

    def _forget(self):
        for answers in self._done.values():
            for old in [k for k in answers if k < self._tick]:
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
