"""ROS 2 shell of the live comparison: sensors and the model's prediction in, departures out."""

import numpy as np
from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.core.outcome import Outcome
from arm_brachy.diagnosis.monitoring import Limits, watched
from arm_brachy.diagnosis.residual_monitor import Monitor
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker


def _streams(setup):
    """(graph.Topic, kind, channels, device parameters, pushes) of everything that is compared."""
    scenario, pads = setup.scenario, tuple(pad.name for pad in setup.scene.pads)
    if setup.scene.markers:
        yield graph.OPTICAL, OPTICAL, cell.marker_names(setup), scenario.optical, None
    for tool in setup.em_tools:
        yield graph.EM_POSE.at(tool=tool), EM, (tool,), scenario.em, None
    for pad, push in zip(pads, cell.pad_directions(setup.scene), strict=True):
        yield graph.WRENCH.at(pad=pad), FORCE, (pad,), scenario.force, np.array([push])


class MismatchMonitorNode(Node):
    """Convert, compare, say which channel departs from its prediction, and since when.

    in   model/points         BodyPoints      what the model predicts
         optical/markers      OpticalFrame    in the base frame of the cell
         em/<tool>/pose       PoseStamped
         force/<pad>/wrench   WrenchStamped
    out  cell/outcome         StepOutcome     DEPARTED when a departure begins, OK at the end
         /diagnostics         DiagnosticArray a warning while there is one, all of them listed
    par  scenario, and every quantity of monitoring.Limits
    """

    def __init__(self, **kwargs):
        super().__init__(graph.MISMATCH_MONITOR.name, **kwargs)
        setup = parameters.node_setup(self)
        limits = parameters.device_parameters(self, Limits())
        streams = tuple(_streams(setup.cell))
        self._streams = {topic.name: (kind, names) for topic, kind, names, *_ in streams}
        self._monitor = Monitor({topic.name: watched(kind, names, params, pushes)
                                 for topic, kind, names, params, pushes in streams}, limits)
        self._raised = 0
        ticker = Ticker(self, graph.MISMATCH_MONITOR, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._health = Health(self, ticker, setup.frame)
        for topic in (graph.MODEL_POINTS, *(topic for topic, *_ in streams)):
            ticker.subscribe(topic)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        raised = []
        for msg in inputs[graph.MODEL_POINTS.name]:
            raised += self._monitor.predict(convert.nanoseconds(msg) * 1e-9, self._expected(msg))
        for topic, (kind, names) in self._streams.items():
            for msg in inputs[topic]:
                raised += self._monitor.measure(
                    topic, convert.nanoseconds(msg) * 1e-9, convert.sample(kind, names, msg))
        self._raised += len(raised)
        active = sorted(self._monitor.active, key=lambda alarm: alarm.onset)
        for alarm in sorted(raised, key=lambda alarm: alarm.onset):
            self._health.note(t_ns, Outcome.DEPARTED, str(alarm))
        if not active:
            self._health.note(t_ns, Outcome.OK)
        self._health.beat(t_ns, lambda: {'departures so far': self._raised} | {
            f'departure {i}': alarm for i, alarm in enumerate(active, start=1)})

    def _expected(self, msg):
        """Topic -> (c, 3) of a BodyPoints."""
        points = dict(zip(msg.names, convert.positions_of(msg), strict=True))
        forces = dict(zip(msg.pads, np.reshape(msg.pad_force, (-1, 3)), strict=True))
        return {topic: np.array([(forces if kind == FORCE else points)[name] for name in names])
                for topic, (kind, names) in self._streams.items()}


def main(args=None):
    """Run the node."""
    spin_node(MismatchMonitorNode, args)
