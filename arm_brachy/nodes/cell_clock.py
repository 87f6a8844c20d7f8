"""The lockstep clock: ticks simulated time once every node has answered the tick before."""

import time
from functools import partial

from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.nodes import parameters
from arm_brachy.nodes.progress import Progress
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import call_every, listen_to, publish_to, unheard_by
from arm_brachy_msgs.msg import TaskState

PATIENCE_S = 60.0  # longest wait for one answer before the run is given up; a first solve compiles


class CellClock(Node):
    """Publish /clock; wait for every peer; stop when the operator has finished.

    in   cell/done/<node>  TickDone   of every peer
         cell/task         TaskState  FINISHED ends the run
    out  /clock            Clock      one message a tick, from tick 1
    par  scenario, peers, speed_limit (simulated seconds per second, 0 = as fast as answers come),
         patience_s
    """

    def __init__(self, **kwargs):
        super().__init__(graph.CELL_CLOCK.name, **kwargs)
        setup = parameters.node_setup(self)
        self._speed_limit = parameters.number(
            self, 'speed_limit', 0.0, 'simulated seconds per second; 0 = no limit', 0.0, 1e3)
        self._patience = parameters.number(
            self, 'patience_s', PATIENCE_S, 'longest wait for one answer, in wall time', 1.0, 1e4)
        self._tick_ns = setup.tick_ns
        self._answers = dict.fromkeys(set(setup.peers) - {graph.CELL_CLOCK.name}, -1)
        self._tick, self._tasks, self._tasks_due = 0, [], 0
        self._began = self._last_answer = time.monotonic()
        self._progress = Progress()
        self._pub = publish_to(self, graph.CLOCK)
        for peer in sorted(self._answers):
            listen_to(self, graph.TICK_DONE.at(node=peer), partial(self._on_done, peer),
                      lockstep=True)
        listen_to(self, graph.TASK, self._on_task, lockstep=True)
        call_every(self, 1.0, self._watch)

    def _on_task(self, msg):
        self._tasks.append(msg)
        self._advance()

    def _on_done(self, peer, msg):
        if msg.node != peer or len(msg.topics) != len(msg.counts):
            self.get_logger().warning(f'{graph.TICK_DONE.at(node=peer).name}: an answer of '
                                      f'{msg.node!r} is ignored', throttle_duration_sec=1.0)
            return
        if msg.tick > self._answers[msg.node]:  # tick 0 is answered again and again
            self._answers[msg.node] = msg.tick
            self._last_answer = time.monotonic()
        self._tasks_due = max(self._tasks_due, self._tasks_said(msg))
        self._advance()

    def _tasks_said(self, msg):
        return dict(zip(msg.topics, msg.counts, strict=True)).get(graph.TASK.name, 0)

    def _advance(self):
        """Go on when all have answered and every task message they published is here."""
        everyone = min(self._answers.values(), default=self._tick) >= self._tick
        if everyone and len(self._tasks) >= self._tasks_due and self._ready():
            self._next_tick()

    def _ready(self):
        """Before the first tick: every reader of /clock is connected."""
        return self._tick > 0 or not self._deaf()

    def _deaf(self):
        return unheard_by(self, self._pub, sorted(self._answers))

    def _next_tick(self):
        if self._tasks and self._tasks[-1].state == TaskState.FINISHED:
            self._finish()
            return
        if self._tick == 0:
            self._began = time.monotonic()
        self._tick += 1
        self._wait_for_wall()
        self._pub.publish(Clock(clock=Time(nanoseconds=self._tick * self._tick_ns).to_msg()))
        self._progress.sometimes(t=self._tick * self._tick_ns * 1e-9, factor=self._factor(),
                                 task=self._tasks[-1].name if self._tasks else '')

    def _wait_for_wall(self):
        if self._speed_limit > 0.0:
            due = self._began + self._tick * self._tick_ns * 1e-9 / self._speed_limit
            time.sleep(max(0.0, due - time.monotonic()))

    def _factor(self):
        """Simulated seconds per wall second since the first tick."""
        return self._tick * self._tick_ns * 1e-9 / max(time.monotonic() - self._began, 1e-9)

    def _finish(self):
        self._progress.now(t=self._tick * self._tick_ns * 1e-9, factor=self._factor(),
                           finished=True)
        raise SystemExit(0)

    def _watch(self):
        waited = time.monotonic() - self._last_answer
        if waited > self._patience:
            raise ArmBrachyError(
                f'tick {self._tick} has not ended for {waited:.0f} s, allowed '
                f'{self._patience:.0f} s: {self._missing()}; see the logs')

    def _missing(self):
        behind = sorted(n for n, k in self._answers.items() if k < self._tick)
        if gone := sorted(set(behind) - set(self.get_node_names())):
            return f'not running: {", ".join(gone)}'
        if behind:
            return f'no answer from {", ".join(behind)}'
        if len(self._tasks) < self._tasks_due:
            return f'{len(self._tasks)} of {self._tasks_due} messages of cell/task have arrived'
        return f'/clock is not heard by {", ".join(self._deaf())}'


def main(args=None):
    """Run the node."""
    spin_node(CellClock, args)
