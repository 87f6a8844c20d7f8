"""Feeds a recording back to live nodes, as the clock and the nodes that are not there."""

import time
from dataclasses import replace
from functools import partial

from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError, ConfigError, RecordingError
from arm_brachy.nodes import parameters
from arm_brachy.nodes.progress import Progress
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import call_every, listen_to, publish_to, unheard_by
from arm_brachy.recording.reader import CellBag
from arm_brachy_msgs.msg import TickDone

PATIENCE_S = 60.0


class ReplayerNode(Node):
    """Publish what was recorded up to a tick, answer for the absent nodes, wait for the live ones.

    out  every recorded topic that one absent node publishes, as raw bytes; /clock; cell/done/*
    in   cell/done/<node>  TickDone  of every live node
    par  scenario; bag: recording (required); peers: live and absent nodes; absent: those we play;
         patience_s
    Topics that several nodes publish (health) are not replayed: live nodes speak for themselves.
    The first tick is the one before or at the first message, so that dates are times as well.
    """

    def __init__(self, **kwargs):
        super().__init__(graph.REPLAYER, **kwargs)
        setup = parameters.node_setup(self)
        path = parameters.text(self, 'bag', '', 'recording to feed back')
        if not path:
            raise ConfigError('replayer: parameter bag is missing; give -p bag:=<folder>')
        self._patience = parameters.number(
            self, 'patience_s', PATIENCE_S, 'longest wait for one answer, in wall time', 1.0, 1e4)
        self._bag, self._tick_ns = CellBag(path), setup.tick_ns
        self._absent = setup.absent
        self._live = tuple(p for p in setup.peers
                           if p not in setup.absent and p != graph.CELL_CLOCK.name)
        self._clock_pub = publish_to(self, graph.CLOCK)
        self._done_pubs = {n: publish_to(self, graph.TICK_DONE.at(node=n))
                           for n in self._absent}
        self._pubs, self._voice, self._counts = {}, {}, {}
        for name, topic in self._bag.topics().items():
            self._adopt(name, topic.type)
        if not self._pubs:
            raise RecordingError(f'{path}: no topic that {", ".join(self._live)} could hear; it '
                                 f'holds {", ".join(self._bag.topics())}')
        self._records = iter(self._bag.records(sorted(self._pubs)))
        self._pending = next(self._records, None)
        begin_ns, self._last_ns = self._bag.span_ns
        self._first = max(1, begin_ns // self._tick_ns)
        self._tick, self._answers = 0, dict.fromkeys(self._live, -1)
        self._progress, self._heard = Progress(), time.monotonic()
        for name in self._live:
            listen_to(self, graph.TICK_DONE.at(node=name), partial(self._on_done, name),
                      lockstep=True)
        call_every(self, 0.1, self._announce)

    def _adopt(self, name, type_name):
        """Play one recorded topic if exactly one absent node publishes it and none does live."""
        short = next((t for t in graph.TOPICS if t.matches(name) or t.matches(name[1:])), None)
        if short is None or short in (graph.CLOCK, graph.TICK_DONE):
            return
        local = name if short.matches(name) else name[1:]
        speakers = graph.writers(local, (*self._absent, *self._live))
        if len(speakers) != 1 or speakers[0] not in self._absent:
            return
        if type_name != short.type:
            raise RecordingError(f'{self._bag.path}: {name} is recorded as {type_name}; must be '
                                 f'{short.type}')
        self._pubs[name] = publish_to(self, replace(short, name=local))
        self._voice[name], self._counts[name] = (speakers[0], local), 0

    def _deaf(self):
        """Live nodes that some topic of ours does not reach yet."""
        wanted = [(pub, graph.readers(self._voice[n][1], self._live))
                  for n, pub in self._pubs.items()]
        wanted += [(pub, graph.waiters(n, self._live)) for n, pub in self._done_pubs.items()]
        wanted.append((self._clock_pub, self._live))
        return sorted({n for pub, nodes in wanted for n in unheard_by(self, pub, nodes)})

    def _announce(self):
        """Until the first tick: say tick 0 for the absent, once everyone can hear it."""
        if self._tick == 0 and not self._deaf():
            self._answer_for_absent(0)
            self._advance()
        if time.monotonic() - self._heard > self._patience:
            late = [n for n, k in self._answers.items() if k < self._tick]
            missing = f'no answer from {", ".join(late)}' if late \
                else f'not connected: {", ".join(self._deaf())}'
            raise ArmBrachyError(f'tick {self._tick} has not ended for {self._patience:.0f} s: '
                                 f'{missing}; see the logs')

    def _on_done(self, name, msg):
        if msg.node != name:
            return
        if msg.tick > self._answers[msg.node]:  # tick 0 is answered again and again
            self._answers[msg.node] = msg.tick
            self._heard = time.monotonic()
        self._advance()

    def _advance(self):
        if min(self._answers.values()) < self._tick or (self._tick == 0 and self._deaf()):
            return
        if self._pending is None and self._tick * self._tick_ns >= self._last_ns:
            self._progress.now(t=self._tick * self._tick_ns * 1e-9, finished=True)
            raise SystemExit(0)
        self._tick = max(self._tick + 1, self._first)
        t_ns = self._tick * self._tick_ns
        while self._pending is not None and self._pending.log_time_ns <= t_ns:
            self._pubs[self._pending.topic].publish(self._pending.data)
            self._counts[self._pending.topic] += 1
            self._pending = next(self._records, None)
        self._clock_pub.publish(Clock(clock=Time(nanoseconds=t_ns).to_msg()))
        self._answer_for_absent(self._tick)
        self._progress.sometimes(t=t_ns * 1e-9)

    def _answer_for_absent(self, tick):
        stamp = Time(nanoseconds=tick * self._tick_ns).to_msg()
        for name, pub in self._done_pubs.items():
            said = {self._voice[full][1]: n for full, n in self._counts.items()
                    if self._voice[full][0] == name}
            pub.publish(TickDone(stamp=stamp, tick=tick, node=name, topics=list(said),
                                 counts=list(said.values())))

    def close(self):
        """Close the recording."""
        self._bag.close()


def main(args=None):
    """Run the node."""
    spin_node(ReplayerNode, args)
