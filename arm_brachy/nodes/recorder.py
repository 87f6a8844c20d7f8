"""ROS 2 shell of the recorder: every topic as raw bytes into an MCAP bag."""

from collections import Counter

from rclpy.node import Node

from arm_brachy import graph, provenance
from arm_brachy.core.errors import ConfigError
from arm_brachy.nodes import parameters
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker, offered
from arm_brachy.recording.canonical import Canonical
from arm_brachy.recording.qos import Qos
from arm_brachy.recording.schema import message_definition
from arm_brachy.recording.writer import BagWriter
from arm_brachy.scenario import bundle


class Thinning:
    """Keeps the first message of each period of a rate [Hz]."""

    def __init__(self, rate):
        self._period_ns, self._due_ns = round(1e9 / rate), 0

    def keeps(self, t_ns):
        """True if a message of time t_ns [ns] is to be kept; times must not run backwards."""
        if t_ns < self._due_ns:
            return False
        self._due_ns = (t_ns // self._period_ns + 1) * self._period_ns
        return True


class RecorderNode(Node):
    """Write what was published, tick by tick, in an order that follows from the data alone.

    At wall pace: in the order of receipt, which is the time of a message in the bag.
    Of images only some are kept, at the rates of the scenario's ultrasound: the rest can be made
    again from the recorded poses and mesh.
    in   every topic of the graph, raw;  cell/done/* of every peer;  in lockstep /clock
    par  scenario; output: folder of the bag, must not exist (required)
    """

    def __init__(self, **kwargs):
        super().__init__(graph.RECORDER.name, **kwargs)
        setup = parameters.node_setup(self)
        output = parameters.text(self, 'output', '', 'folder of the bag; must not exist yet')
        if not output:
            raise ConfigError('recorder: parameter output is missing; give -p output:=<folder>')
        cell = setup.cell
        self._writer = BagWriter(output, provenance=provenance.of(cell),
                                 attachments=bundle(cell))
        pads = [p.name for p in cell.scene.pads]
        targets = [t.name for t in cell.scene.targets]
        present = [t for t in graph.instances(cell.em_tools, pads, targets)
                   if graph.writers(t.name, setup.peers)]
        shared = [t for t in present if len(graph.writers(t.name, setup.peers)) > 1]
        answers = [graph.TICK_DONE.at(node=p) for p in setup.peers]
        self._topics = {t.name: t for t in (*present, *answers, graph.CLOCK)}
        self._declared, self._sequence, self._written_ns = {}, Counter(), 0
        seen = cell.scenario.ultrasound
        self._thinned = {graph.ULTRASOUND_IMAGE.name: Thinning(seen.recorded_rate),
                         graph.ULTRASOUND_OVERLAY.name: Thinning(seen.recorded_overlay_rate)}
        self._ticker = Ticker(self, graph.RECORDER, self._work, lockstep=setup.lockstep,
                              tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
                              session=setup.session)
        self._ticker.witness = self._keep
        rewritten = [*shared, *(t for t in present if t in graph.SEALED)]
        self._canonical = Canonical({t.type: message_definition(t.type) for t in rewritten})
        self._rewritten, self._ends = {t.name: t.type for t in rewritten}, []
        self._shared = {t.name for t in shared}
        for topic in present:
            self._ticker.subscribe(topic, raw=True, lossless=True, receipts=not setup.lockstep)
        self._ticker.start()

    def _work(self, tick, t_ns, inputs):
        self._write_all(t_ns, inputs)
        if self._ticker.lockstep:
            self._write_ends(t_ns)

    def _write_all(self, t_ns, inputs):
        if self._ticker.lockstep:
            self._write_tick(t_ns, inputs)
        else:
            self._write_receipts(inputs)

    def _write_receipts(self, inputs):
        """At wall pace the time of a message is that of its receipt, and so is their order.

        What the middleware had received but not handed over before others were written counts as
        received with those.
        """
        arrived = [(t_ns, name, data) for name, batch in inputs.items() for t_ns, data in batch]
        for t_ns, name, data in sorted([*arrived, *self._ends], key=lambda one: one[0]):
            self._written_ns = t_ns = max(t_ns, self._written_ns)
            if name not in self._thinned or self._thinned[name].keeps(t_ns):
                self._write(name, self._exact(name, data), t_ns)
        self._ends = []

    def _write_tick(self, t_ns, inputs):
        for name in sorted(inputs):
            for data in self._in_order(name, inputs[name]):
                if name not in self._thinned or self._thinned[name].keeps(t_ns):
                    self._write(name, data, t_ns)

    def _in_order(self, name, batch):
        """Messages of several publishers arrive in an order of chance: sort them by content."""
        batch = [self._exact(name, data) for data in batch]
        return sorted(batch) if name in self._shared else batch

    def _exact(self, name, data):
        """Messages without what serialisers leave in and behind them, where that would tell."""
        kind = self._rewritten.get(name)
        return data if kind is None else self._canonical.data(data, kind)

    def _write(self, name, data, t_ns):
        if name not in self._declared:
            self._declare(name)
        self._sequence[name] += 1
        self._writer.write(self._declared[name], data, t_ns, sequence=self._sequence[name])

    def _declare(self, name):
        """Tell the bag name, type and offer of a topic, as the table of the graph has them."""
        topic, full_name = self._topics[name], self.resolve_topic_name(name)
        self._writer.add_topic(full_name, topic.type, qos=(_qos(offered(topic)),))
        self._declared[name] = full_name

    def _keep(self, name, t_ns, data):
        receipt = t_ns if self._ticker.lockstep else self.get_clock().now().nanoseconds
        self._ends.append((receipt, name, data))

    def _write_ends(self, t_ns):
        """Ticks and answers up to t_ns, in order of time and name."""
        for when, name, data in sorted(e for e in self._ends if e[0] <= t_ns):
            self._write(name, data, when)
        self._ends = [e for e in self._ends if e[0] > t_ns]

    def close(self):
        """Write what has arrived since the last tick, then finish the bag."""
        self._write_all(self._ticker.last_ns, self._ticker.drain())
        self._writer.close()


def _qos(profile):
    return Qos(history=int(profile.history), depth=profile.depth,
               reliability=int(profile.reliability), durability=int(profile.durability))


def main(args=None):
    """Run the node."""
    spin_node(RecorderNode, args)
