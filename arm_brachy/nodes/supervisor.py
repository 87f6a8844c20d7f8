"""ROS 2 shell of the supervisor: watches forces and signs of life, allows or forbids motion."""

import time

import numpy as np
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.control.cell_watch import MotionWatch, PulseWatch
from arm_brachy.control.safety import Permission, Safety
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.session import RUN_AGAIN
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_trigger import KeyedTrigger
from arm_brachy.nodes.managed_node import AbstractManagedNode
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker, call_every, listen_to
from arm_brachy_msgs.msg import SafetyState

LOOK_PERIOD_S = 0.5   # at the graph
UNKNOWN = '_NODE_NAME_UNKNOWN_'   # rmw's word for a node that it has not learnt the name of yet


class SupervisorNode(AbstractManagedNode):
    """Convert, judge, publish the permission every tick and at once when a service changes it.

    At wall pace it holds until it has heard every peer, and each wrench of a force sensor, and
    when it sees two alive under one name. In lockstep the clock waits for whoever is silent; a
    clock that is silent itself is in the log. Unless it is active it watches and publishes as
    ever, but what it says is HOLD, or STOP. That it was deactivated is a hold until ~/reset.

    in   actuators/state  JointState  motion without permission is a stop
         force/<pad>/wrench  WrenchStamped  against the force limit
         needle/state  JointState  force along the needle, and how old it is
         probe/state   ProbeState  the contact forces of the tick
         cell/done/<node>    TickDone       sign of life of every peer (wall pace)
    out  cell/safety         SafetyState    every tick
    srv  ~/emergency_stop, ~/hold  Trigger, open to all
         ~/reset             Trigger; in a cell with a key for a reset_ticket
         ~/change_state and the others of a managed node
    par  scenario, autostart, pad_force_N, silence_s
    """

    def __init__(self, **kwargs):
        super().__init__(graph.SUPERVISOR.name, **kwargs)
        setup = parameters.node_setup(self)
        limits = parameters.device_parameters(self, setup.cell.scenario.limits)
        self._frame, self._silence = setup.frame, limits.silence
        self._pads = {graph.WRENCH.at(pad=p.name).name: p.name for p in setup.cell.scene.pads}
        # in lockstep the clock waits for whoever is silent, so nothing moves meanwhile
        watched = () if setup.lockstep else self._watched(setup.peers)
        wrenches = self._pads if graph.FORCE_SENSOR.name in watched else ()
        self._safety = Safety(limits.pad_force, [*watched, *wrenches],
                              {'probe': limits.probe_force, 'needle': limits.needle_force})
        self._needle_age, self._needle_ns = limits.needle_age, None
        self._heard, self._now_ns = {}, 0
        self._motion, self._pulse, self._strangers = MotionWatch(), PulseWatch(), ()
        self._lockstep, self._peers = setup.lockstep, setup.peers
        self._ticked = None      # wall time of the last tick
        ticker = Ticker(self, graph.SUPERVISOR, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
                        session=setup.session)
        self._sealed_topics = graph.SEALED if setup.session is not None else ()
        pads = tuple(self._pads.values())
        self._sensor_topics = [t for t in graph.instances(setup.cell.em_tools, pads)
                               if t not in graph.SEALED and not graph.is_shared(t)]
        self._pub = ticker.publisher(graph.SAFETY)
        self._health = Health(self, ticker, self._frame)
        for topic in graph.received(graph.SUPERVISOR, setup.peers, pads=self._pads.values()):
            ticker.subscribe(topic)
        for peer in (*watched, *((graph.SUPERVISOR.name,) if not setup.lockstep else ())):
            listen_to(self, graph.TICK_DONE.at(node=peer), self._on_alive, lockstep=False)
        self.create_service(Trigger, '~/emergency_stop', self._on_stop)
        self.create_service(Trigger, '~/hold', self._on_hold)
        self.reset = KeyedTrigger(self, setup.session, 'reset', self._reset)
        call_every(self, LOOK_PERIOD_S, self._look)
        ticker.start()
        self.begin()

    @staticmethod
    def _watched(peers):
        """Nodes whose silence is a hold: what is not recorded shall not move either."""
        return set(peers) - {graph.SUPERVISOR.name, graph.CELL_CLOCK.name, graph.CELL_VIEWER.name}

    def hold(self):
        """Say HOLD at once, and until ~/reset: whoever activates needs no key."""
        self._safety.hold('supervisor was deactivated')
        self._publish()

    @property
    def permission(self):
        """What is allowed now; not RUN unless active."""
        return self._safety.permission if self.active else max(self._safety.permission,
                                                               Permission.HOLD)

    @property
    def reason(self):
        """Why not everything is allowed, in one line; '' in RUN."""
        if self.active or self._safety.permission is Permission.STOP:
            return self._safety.reason
        return self.why_not_active()

    def _on_alive(self, msg):
        now = time.monotonic()
        self._pulse.heard(now, msg.node, msg.tick)
        if msg.node in self._peers and msg.node != graph.SUPERVISOR.name:
            self._heard[msg.node] = now
            self._safety.heard(msg.node)

    def _work(self, tick, t_ns, inputs):
        self._now_ns = t_ns
        for name, pad in self._pads.items():
            for msg in inputs.get(name, ()):
                self._safety.heard(name)
                self._safety.force(pad, convert.xyz(msg.wrench.force))
        self._watch_needle(t_ns, inputs.get(graph.NEEDLE_STATE.name, ()))
        for msg in inputs.get(graph.PROBE_STATE.name, ()):
            if len(msg.force):
                self._safety.force('probe', [np.abs(msg.force).max()])
        now = self._ticked = time.monotonic()
        self._watch_motion(inputs.get(graph.ACTUATORS.name, ()))
        self._safety.doubled(self._pulse.doubles(now))
        self._safety.silent(sorted(n for n, t in self._heard.items() if now - t > self._silence))
        self._publish()
        outcome = Outcome.OK if self.permission is Permission.RUN else Outcome.HELD
        self._health.note(t_ns, outcome, self.reason)
        self._health.beat(t_ns, lambda: {
            'permission': self.permission.name,
            **({'strangers': ', '.join(self._strangers)} if self._strangers else {})})

    def _watch_motion(self, states):
        """Encoders against the permission that was in force when they were read."""
        for msg in states:
            said = self._motion.breach(convert.nanoseconds(msg) * 1e-9,
                                       self.permission is Permission.RUN,
                                       dict(zip(msg.name, msg.position, strict=False)))
            if said:
                self._safety.breach(said)

    def _foreign(self, topics):
        """Who publishes which of the topics and is not who shall, in one line each."""
        for topic in topics:
            ours = graph.writers(topic.name, self._peers)
            name = self.resolve_topic_name(topic.name)
            owned = ours or topic in self._sealed_topics
            for end in self.get_publishers_info_by_topic(name) if owned else ():
                if end.node_name == UNKNOWN:
                    continue
                if (end.node_namespace != self.get_namespace()
                        or end.node_name not in (*ours, graph.REPLAYER)):
                    yield f'{_full_name(end)} on {name}'

    def _look(self):
        """On the wall's clock: who else publishes what only we may, and whether ticks come."""
        seen = set(self._foreign(self._sealed_topics))
        unsealed = () if self._lockstep else tuple(self._foreign(self._sensor_topics))
        for stranger in sorted({*seen, *unsealed} - set(self._strangers)):
            self.get_logger().warning(f'stranger: {stranger}')
        self._strangers = tuple(sorted({*seen, *unsealed}))
        self._safety.foreign(unsealed)
        waited = 0.0 if self._ticked is None else time.monotonic() - self._ticked
        if self._lockstep and waited > self._silence:
            self.get_logger().warning(
                f'no tick for {waited:.1f} s: cell_clock is frozen, or a node that it waits for '
                'is slow; nothing moves meanwhile', throttle_duration_sec=5.0)

    def _watch_needle(self, t_ns, states):
        """Its force, and how old it is: the probe follows what is known of the needle."""
        for msg in states:
            self._needle_ns = convert.nanoseconds(msg)
            if len(msg.effort):
                self._safety.force('needle', [msg.effort[0]])
        if self._needle_ns is not None:
            self._safety.old('needle', (t_ns - self._needle_ns) * 1e-9, self._needle_age)

    def _publish(self):
        self._pub(SafetyState(header=convert.header(self._now_ns, self._frame),
                              state=int(self.permission), reason=self.reason))

    def _on_stop(self, request, response):
        self._safety.stop('emergency stop on request')
        return self._changed(response, True, f'stopped; to run again: {RUN_AGAIN}')

    def _on_hold(self, request, response):
        self._safety.hold('hold on request')
        return self._changed(response, True, f'holding; to run again: {RUN_AGAIN}')

    def _reset(self):
        if not self.active:
            raise CommandRefused(self.why_not_active())
        stopped = self._safety.permission is Permission.STOP
        done, message = self._safety.reset()
        self._publish()
        if not done:
            raise CommandRefused(message)
        return message + ('; the drives stay cut until actuator_driver/release' if stopped else '')

    def _changed(self, response, success, message):
        self._publish()
        response.success, response.message = success, message
        return response


def _full_name(end):
    """Name of the node of an endpoint, with its namespace if it has one."""
    return end.node_name if end.node_namespace == '/' else f'{end.node_namespace}/{end.node_name}'


def main(args=None):
    """Run the node."""
    spin_node(SupervisorNode, args)
