"""Does faults to a driver and a supervisor that live at wall pace; prints one JSON line each.

What `arm-brachy abuse` starts. Driver, supervisor, a manipulator, a controller with the key and a
stranger without it run in this process and talk over DDS; pads are judged by the plant, not by
encoders.
"""

import time

import numpy as np
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from arm_brachy import graph
from arm_brachy.control.faults import OF_THE_NEEDLE, Kind
from arm_brachy.nodes import convert
from arm_brachy.nodes.actuator_driver import ActuatorDriverNode
from arm_brachy.nodes.bench_node import (
    NOTICED_S,
    OBSERVED_S,
    PATIENCE_S,
    BenchNode,
    last_motion,
)
from arm_brachy.nodes.keyed_goal import PARAMETER, action_of
from arm_brachy.nodes.mpc_manipulator import MpcManipulatorNode
from arm_brachy.nodes.spin import act_once
from arm_brachy.nodes.supervisor import SupervisorNode
from arm_brachy.nodes.ticker import offered
from arm_brachy_msgs.action import MoveTarget
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState
from arm_brachy_msgs.srv import SetGoal

ASKED = 4e-3          # [m] the controller asks for positions from zero to here
FORBIDDEN = 20e-3     # [m] what every fault asks for
CREEP = 1e-3          # [m/s] of a controller that goes on while the supervisor is silent
STILL = 1e-5          # [m] between ticks
FLOOD = 300           # messages
UP = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
DOWN = (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)
APART = 'apart'       # namespace of the manipulator: its name is the bench's
KINDS = tuple(kind for kind in Kind if kind not in OF_THE_NEEDLE)


class AbuseBench(BenchNode):
    """The controller and the stranger; spins all nodes and watches the plant."""

    def __init__(self, **kwargs):
        super().__init__(graph.MPC_MANIPULATOR.name, KINDS, **kwargs)
        self._recorded, self._pads, self._state, self._obeyed = [], [], None, 0
        self._command_pub, self._safety_pub = map(self.publisher, (graph.COMMAND, graph.SAFETY))
        self.listen(graph.TRUTH_PADS, self._on_pads)
        self.listen(graph.ACTUATORS, self._on_state)
        peers = [graph.ACTUATOR_DRIVER.name, graph.SUPERVISOR.name]
        self._driver = self.start(ActuatorDriverNode, [*peers, graph.MPC_MANIPULATOR.name])
        self._supervisor = self.start(SupervisorNode, peers)
        self._manipulator = self.start(MpcManipulatorNode, [graph.MPC_MANIPULATOR.name],
                                       namespace=APART)
        self._moves = ActionClient(self, MoveTarget, f'/{APART}/mpc_manipulator/move_target')

    def _on_pads(self, msg):
        self._pads.append((time.monotonic(), np.array(msg.position)))

    def _on_state(self, msg):
        self._state = msg

    # what happens to the cell

    def suffer(self, fault):
        """One fault; returns what came of it."""
        self._command(ASKED * np.array([fault.size, 0.5 * fault.size, 0.0, 0.0]))
        self.spin(0.1)
        self._pads.clear()
        self._obeyed, begun = 0, time.monotonic()
        held = getattr(self, '_' + fault.kind.name.lower())(fault)
        self.spin(OBSERVED_S)
        over = max((np.max(np.maximum(-q, q - ASKED)) for _, q in self._pads), default=np.inf)
        lost = not self.allowed or fault.kind is Kind.FROZEN_SUPERVISOR
        rest = last_motion(self._pads, begun, STILL) if lost else 0.0
        bad = (over > self.bounds.overshoot or rest > self.bounds.rest or self._obeyed > 0
               or (held is not None and held > NOTICED_S))
        over_mm = round(1e3 * abs(max(float(over), 0.0)), 4)
        return {'overshoot_mm': over_mm, 'rest_s': round(rest, 3),
                'held_s': 0.0 if held is None else round(min(held, PATIENCE_S), 3),
                'obeyed': self._obeyed, 'violated': bool(bad)}

    def _forged(self, fault):
        self._repeat(fault, lambda: self._send(self._order()))

    def _other_key(self, fault):
        self._repeat(fault, lambda: self._send(self._order(), self.stranger))

    def _replayed(self, fault):
        for data in self._recorded[-fault.count:]:
            self._command_pub.publish(data)

    def _tampered(self, fault):
        data = bytearray(self._recorded[-1])
        data[int(fault.size * (len(data) - 1))] ^= 1 << fault.count % 8
        self._command_pub.publish(bytes(data))

    def _flooded(self, fault):
        for _ in range(FLOOD):
            self._send(self._order())
            self.executor_.spin_once(timeout_sec=0.0)

    def _past(self, fault):
        self._keyed(fault, ago=self._patience() * 1.1 + 1e9 * fault.size**8)

    def _future(self, fault):
        self._keyed(fault, ago=-0.3 - 1e8 * fault.size**8)

    def _foreign_frame(self, fault):
        self._keyed(fault, frame='map' if fault.size < 0.5 else '')

    def _unknown_mode(self, fault):
        self._keyed(fault, mode=3 + int(252 * fault.size))

    def _not_finite(self, fault):
        self._keyed(fault, q=(FORBIDDEN, (np.nan, np.inf, -np.inf)[fault.count % 3], 0.0, 0.0))

    def _forged_run(self, fault):
        self.call('supervisor/emergency_stop')
        run = SafetyState(header=convert.header(self.now(), self.setup.frame))
        for _ in range(fault.count):
            self._safety_pub.publish(run)
            self._send(self._order())
        self._obeyed += self.forge(self._driver, 'release')

    def _forged_state(self, fault):
        self.call('supervisor/hold')
        forger, pub = self._other_encoders(graph.ACTUATOR_DRIVER.name)
        self.spin(0.1)
        for k in range(fault.count):
            pub.publish(self._encoders(k * 1e-3))
            self.spin(0.05)
        forger.destroy_node()

    def _forged_sensor(self, fault):
        """Under a name that is not the driver's: seen in the graph, and a hold."""
        begun = time.monotonic()
        forger, pub = self._other_encoders('intruder')
        pub.publish(self._encoders(FORBIDDEN))
        held = self.held_after(begun)
        forger.destroy_node()
        self.spin(1.0)      # until the graph has forgotten it
        return held

    def _forged_services(self, fault):
        self.call('supervisor/hold')
        self._obeyed += sum(self.forge(node, action) for node, action in (
            (self._supervisor, 'reset'), (self._driver, 'release'), (self._driver, 'home')))
        self._obeyed += self.allowed

    def _cycled(self, fault):
        """In either order; the controller asks for what it may not all the while."""
        self.call('supervisor/emergency_stop')
        nodes = (self._driver, self._supervisor)[::1 if fault.size < 0.5 else -1]
        for transition in (*DOWN, *UP):
            for node in nodes:
                self._obeyed += not self._changed(node, transition)
                self._send(self._order(), self.session)
                self._obeyed += self.allowed

    def _transitions(self, fault):
        """Some of them impossible where they are asked for; in the end all is active again."""
        rng = np.random.default_rng(fault.count)
        for transition in rng.choice((*DOWN, *UP), fault.count):
            self._changed((self._driver, self._supervisor)[rng.integers(2)], int(transition))
            self._command(ASKED * rng.random() * np.array([fault.size, 1.0, 0.0, 0.0]))
            self._send(self._order())
        for transition in UP:
            for node in (self._driver, self._supervisor):
                self._changed(node, transition)
        self._obeyed += not (self._driver.active and self._supervisor.active)

    def _forged_goal(self, fault):
        """Without a ticket, with a stranger's, with one for another goal."""
        full = f'/{APART}/mpc_manipulator/set_goal'
        goal, other = (SetGoal.Request(target=self.setup.cell.scene.targets[0].name, relative=True,
                                       goal=convert.point((-size, 0.0, 0.0)), axes=[True] * 3)
                       for size in (FORBIDDEN, ASKED))
        for ticket in ('', self.stranger.ticket(action_of(full, goal), time.time_ns()),
                       self.session.ticket(action_of(full, other), time.time_ns())):
            if ticket:
                self._manipulator.set_parameters([Parameter(PARAMETER, value=ticket)])
            answer = self.ask(SetGoal, full, goal)
            self._obeyed += answer is None or 'needs the session key' not in answer.message
            self._obeyed += self._moved(goal)

    def _changed(self, node, transition):
        """Ask a node for a transition, as anybody may; returns whether it was made."""
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = self.ask(ChangeState, f'/{node.get_name()}/change_state', request)
        self.spin(0.02)
        return answer is not None and answer.success

    def _moved(self, goal):
        """1 if the same goal was obeyed as an action, else 0."""
        self.until(self._moves.server_is_ready, PATIENCE_S)
        sent = self._moves.send_goal_async(MoveTarget.Goal(
            target=goal.target, relative=True, goal=goal.goal, axes=goal.axes))
        self.until(sent.done, PATIENCE_S)
        ended = sent.result().get_result_async()
        return int(not self.until(ended.done, PATIENCE_S)
                   or 'needs the session key' not in ended.result().result.message)

    def _frozen_supervisor(self, fault):
        """Of a controller that goes on: pads rest all the same."""
        begun, at = time.monotonic(), ASKED * 0.5 * fault.size

        def creep():
            q = min(at + CREEP * (time.monotonic() - begun), ASKED)
            self._command(np.array([q, 0.5 * ASKED * fault.size, 0.0, 0.0]))
        self.freeze(self._supervisor, self._patience() + 0.5 + 0.5 * fault.size, creep)
        self._send(self._order(), self.session)
        self.spin(0.1)

    def _cut_stream(self, fault):
        self.spin(0.2 + 0.5 * fault.size)

    # means

    def _other_encoders(self, name):
        forger = Node(name)
        return forger, forger.create_publisher(JointState, graph.ACTUATORS.name,
                                               offered(graph.ACTUATORS))

    def _encoders(self, q):
        return JointState(header=convert.header(self.now(), self.setup.frame),
                          name=list(self._state.name), position=[q] * len(self._state.name))

    def _repeat(self, fault, action):
        for _ in range(fault.count):
            action()
            self.spin(0.01)

    def _keyed(self, fault, **wrong):
        """A controller that has the key and is wrong."""
        self._repeat(fault, lambda: self._send(self._order(**wrong), self.session))

    def _order(self, q=(FORBIDDEN,) * 4, ago=0.0, frame=None, mode=ActuatorCommand.MODE_MOVE):
        stamp = max(0, self.now() - round(ago * 1e9))
        frame = self.setup.frame if frame is None else frame
        return ActuatorCommand(header=convert.header(stamp, frame), mode=mode,
                               position=convert.floats(np.array(q)))

    def _send(self, msg, session=None):
        self._command_pub.publish(msg if session is None
                                  else self.sealed(self._command_pub, msg, session))

    def _command(self, q):
        """The controller's own."""
        self._recorded.append(self.sealed(self._command_pub, self._order(q)))
        self._recorded = self._recorded[-20:]
        self._command_pub.publish(self._recorded[-1])

    def _patience(self):
        return self.setup.cell.scenario.limits.silence

    def again(self):
        """Back to RUN, released, at home; returns whether it came so."""
        for _ in range(3):
            if not self.begin_again(self._supervisor, [self._driver]):
                return False
            self._command(np.zeros(4))
            if self.until(lambda: self._state is not None and max(
                    abs(q) for q in self._state.position) < 1e-4, 3.0):
                return True
        return False


def main(args=None):
    """Run the faults."""
    act_once(AbuseBench, AbuseBench.run, args)
