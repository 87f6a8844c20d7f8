"""Does faults to needle, probe and supervisor at wall pace; prints one JSON line each.

What `arm-brachy abuse` starts beside `abuse_bench`. No tissue: the probe goes through the air over
a ball of points, the needle meets no force. Both are judged by the simulated truth. It takes half
a core: on a machine that cannot give that it ends, since every node is then too late.
"""

import time

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from arm_brachy import graph
from arm_brachy.control.faults import OF_THE_NEEDLE
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.nodes import convert
from arm_brachy.nodes.bench_node import (
    NOTICED_S,
    OBSERVED_S,
    BenchNode,
    last_motion,
)
from arm_brachy.nodes.needle_driver import NeedleDriverNode
from arm_brachy.nodes.probe_controller import ProbeControllerNode
from arm_brachy.nodes.spin import act_once
from arm_brachy.nodes.supervisor import SupervisorNode
from arm_brachy.nodes.ticker import offered
from arm_brachy_msgs.msg import ActuatorCommand, ProbeState

ASKED = 40e-3         # [m] deep, what the operator asks of the needle
FORBIDDEN = 80e-3     # [m] what every fault asks for
SHOWN = 12e-3         # [m] where the tip is out of its hole and known
SLOW, FAST = 4e-3, 20e-3   # [m/s] slow enough to be still under way when the fault comes
STILL = 2e-5          # [m] of the needle between ticks
SWAY = 2e-4           # [m] of the probe: braked it still gives way like the spring that it is
SKIN, POINTS = 0.06, 8000     # [m] radius of the ball that plays the skin; points on it
FAR = 2e-3            # [m] that the probe has moved when the fault comes
HOME_S = 10.0         # for the probe's way back
ATTEMPTS = 5          # to come back, and to set out


class AbuseProbeBench(BenchNode):
    """The operator with the key and the stranger without; watches needle and probe."""

    def __init__(self, **kwargs):
        super().__init__(graph.OPERATOR.name, OF_THE_NEEDLE, **kwargs)
        self._depths, self._places, self._probe = [], [], None
        self._recorded, self._obeyed, self._moving = [], 0, False
        self._needle_pub = self.publisher(graph.NEEDLE_COMMAND)
        self._skin_pub = self.publisher(graph.SURFACE)
        self.listen(graph.TRUTH_NEEDLE_PATH, self._on_needle)
        self.listen(graph.TRUTH_PROBE, self._on_probe)
        self.listen(graph.PROBE_STATE, self._on_state)
        peers = [n.name for n in (graph.NEEDLE_DRIVER, graph.PROBE_CONTROLLER, graph.SUPERVISOR)]
        self._driver, self._controller, self._supervisor = (
            self.start(kind, peers)
            for kind in (NeedleDriverNode, ProbeControllerNode, SupervisorNode))
        self._skin_pub.publish(convert.cloud(self.now(), self.setup.frame, _ball()))

    def _on_needle(self, msg):
        points = convert.positions_in(msg)
        depth = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        self._depths.append((time.monotonic(), np.array([depth])))

    def _on_probe(self, msg):
        self._places.append((time.monotonic(), convert.xyz(msg.pose.position)))

    def _on_state(self, msg):
        self._probe = msg

    # what happens to the cell

    def suffer(self, fault):
        """One fault; returns what came of it."""
        self._depths.clear()
        self._places.clear()
        self._obeyed, self._lost, self._judged = 0, None, ()
        held = getattr(self, '_' + fault.kind.name.lower())(fault)
        self.spin(OBSERVED_S)
        over = max((max(-q[0], q[0] - ASKED) for _, q in self._depths), default=np.inf)
        rest = max((last_motion(track, self._lost, still) for track, still in self._judged),
                   default=0.0)
        bad = (over > self.bounds.overshoot or rest > self.bounds.rest or self._obeyed > 0
               or (held is not None and held > NOTICED_S))
        over_mm = round(1e3 * abs(max(float(over), 0.0)), 4)
        return {'overshoot_mm': over_mm, 'rest_s': round(rest, 3),
                'held_s': 0.0 if held is None else round(min(held, 99.0), 3),
                'obeyed': self._obeyed, 'violated': bool(bad)}

    def _forged_needle(self, fault):
        self._drive(ASKED * fault.size)
        self.spin(0.3)
        for k in range(fault.count):
            order = self._order(FORBIDDEN)
            self._needle_pub.publish((order, self.sealed(self._needle_pub, order, self.stranger),
                                      self._recorded[0])[k % 3])
            self.spin(0.02)

    def _forged_follow(self, fault):
        """The probe stays where it is."""
        self._show()
        self._obeyed += self.forge(self._controller, 'follow')
        self._obeyed += self.forge(self._controller, 'release')
        self._obeyed += self.forge(self._driver, 'release')
        self.spin(0.2)
        self._obeyed += self._probe.phase != ProbeState.IDLE

    def _forged_image(self, fault):
        """A tip elsewhere, from a stranger that the graph shows."""
        forger = Node('intruder')
        topic = (graph.NEEDLE_TIP, graph.PROBE_POSE)[fault.count % 2]
        pub = forger.create_publisher(PoseStamped, topic.name, offered(topic))
        begun = time.monotonic()
        pub.publish(PoseStamped(header=convert.header(self.now(), self.setup.frame)))
        held = self.held_after(begun)
        forger.destroy_node()
        self.spin(1.0)      # until the graph has forgotten it
        return held

    def _needle_alone(self, fault):
        """Needle and probe move; nobody says RUN any more."""
        self._set_out((self._depths, STILL), (self._places, SWAY))
        self.freeze(self._supervisor, self._patience() + 0.5 + fault.size)

    def _dead_needle(self, fault):
        """The probe stops: the supervisor holds since the needle is silent.

        The needle is simulated in its driver, and what dies with it is not judged.
        """
        self._set_out((self._places, SWAY))
        self.freeze(self._driver, self._patience() + 0.5 + fault.size)
        self._obeyed += self.allowed

    def _dead_probe(self, fault):
        """The needle stops."""
        self._set_out((self._depths, STILL))
        self.freeze(self._controller, self._patience() + 0.5 + fault.size)
        self._obeyed += self.allowed

    # means

    def _set_out(self, *judged):
        """The needle on its way, the probe on its own; judged : (track, still) that rest then."""
        for _ in range(ATTEMPTS):      # of a loaded machine: any late node is a hold
            self._show()
            self._drive(ASKED)
            here = self._places[-1][1]
            if self.give(self._controller, 'follow') and self.until(
                    lambda here=here: np.abs(self._places[-1][1] - here).max() > FAR, HOME_S / 2):
                break
            why = self._why()
            self.again()
        else:
            raise ArmBrachyError(f'the probe did not set out in {ATTEMPTS} attempts: '
                                 f'{why}')
        for track in (self._depths, self._places):
            track.clear()
        self._lost, self._judged = time.monotonic(), judged

    def _why(self):
        """What probe, supervisor and needle say."""
        return (f'probe {self._probe.phase} {self._probe.outcome} {self._probe.message}, safety '
                f'{self.word.state} {self.word.reason}, needle at {self._depths[-1][1][0]:.4f} m')

    def _show(self):
        """The tip out of its hole."""
        self._drive(SHOWN, FAST)
        self.until(lambda: self._depths and self._depths[-1][1][0] > SHOWN - STILL, HOME_S)
        self.spin(0.3)

    def _drive(self, depth, speed=SLOW):
        """The operator's own order."""
        self._recorded = [self.sealed(self._needle_pub, self._order(depth, speed)),
                          *self._recorded[:20]]
        self._needle_pub.publish(self._recorded[0])

    def _order(self, depth, speed=SLOW):
        return ActuatorCommand(header=convert.header(self.now(), self.setup.frame),
                               mode=ActuatorCommand.MODE_MOVE, names=['needle'],
                               position=[depth], velocity=[speed])

    def _patience(self):
        return self.setup.cell.scenario.limits.silence

    def again(self):
        """Back to RUN, needle out, probe at home; returns whether it came so."""
        return any(self._all_back() for _ in range(ATTEMPTS))

    def _all_back(self):
        if not self.begin_again(self._supervisor, [self._driver]):
            return False
        if self._probe is not None and self._probe.phase != ProbeState.IDLE:
            self.call('probe_controller/retract')
        self._recorded = []
        self._needle_pub.publish(self.sealed(self._needle_pub, self._order(0.0, FAST)))
        return self.until(self._is_back, HOME_S) and self.begin_again(
            self._supervisor, [self._driver, self._controller])

    def _is_back(self):
        return (self._probe is not None and self._depths and self._depths[-1][1][0] < 1e-4
                and self._probe.phase in (ProbeState.IDLE, ProbeState.STOPPED))


def _ball():
    """Points (n, 3) of the upper half of a ball, [m]."""
    u = np.random.default_rng(0).normal(size=(POINTS, 3))
    u[:, 2] = np.abs(u[:, 2])
    return SKIN * u / np.linalg.norm(u, axis=1, keepdims=True)


def main(args=None):
    """Run the faults."""
    act_once(AbuseProbeBench, AbuseProbeBench.run, args)
