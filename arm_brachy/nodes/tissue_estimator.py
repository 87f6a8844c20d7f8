"""ROS 2 shell of every estimator of the tissue's inside: markers and encoders in, targets out."""

import resource
import sys
import time

import numpy as np
from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.core.errors import CommandRefused, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation.known_load import instrument_loads
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.probe_face import ProbeFace

MM, MS = 1e3, 1e3
INSTRUMENTS = (graph.PROBE_STATE, graph.PROBE_POSE, graph.PROBE_WRENCH, graph.NEEDLE_TIP,
               graph.NEEDLE_STATE)
FRESH_NS = 250_000_000   # of what is told of them: older, and they are taken to be gone


class TissueEstimatorNode(Node):
    """Convert, estimate, convert back.

    in   optical/markers    OpticalFrame  in the tracker's frame: the node registers it
         actuators/state    JointState    encoders
         probe/state, probe/pose, probe/wrench, needle/tip, needle/state  what probe and needle
             load the tissue with, which `map` counts on
    out  estimate/<name>/<target>        PoseWithCovarianceStamped  stamp = acquisition
         estimate/<name>/mesh/topology   MeshTopology   latched, with the first estimate
         estimate/<name>/mesh/positions  MeshPositions  at the scenario's mesh rate
         cell/outcome       StepOutcome      why there is no estimate, which markers are left out
         /diagnostics       DiagnosticArray  residual of the registration, age of the estimate; at
             wall pace the time it took: in lockstep what is published follows from data alone
    par  scenario
    On closing, the log says how long estimates took and how much memory the process had.
    """

    def __init__(self, name, **kwargs):
        """name : of graph.ESTIMATORS."""
        spec = graph.node(f'{name}_estimator')
        super().__init__(spec.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._lockstep = setup.frame, setup.lockstep
        self._pads = [p.name for p in setup.cell.scene.pads]
        self._live = cell.build_estimator(setup.cell, name)
        self._mesh_period_ns = round(1e9 / setup.cell.scenario.mesh_rate)
        self._mesh_due_ns, self._announced = 0, False
        ticker = Ticker(self, spec, self._work, lockstep=setup.lockstep, tick_ns=setup.tick_ns,
                        peers=setup.peers, absent=setup.absent)
        self._pubs = {t: ticker.publisher(graph.estimate(name).at(target=t))
                      for t in self._live.targets}
        self._topology_pub = ticker.publisher(graph.estimate_topology(name))
        self._positions_pub = ticker.publisher(graph.estimate_positions(name))
        self._health = Health(self, ticker, self._frame)
        self._took, self._count, self._last = [], 0, None
        self._instruments = {}      # topic -> newest message
        self._skin = setup.cell.scenario.needle.needle.skin
        for topic in spec.subscribes:
            ticker.subscribe(topic)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        for msg in inputs[graph.ACTUATORS.name]:
            self._feel(t_ns, msg)
        for msg in inputs[graph.OPTICAL.name]:
            self._live.see(*convert.marker_frame(msg))
        self._bear(t_ns, inputs)
        begun = time.perf_counter()
        step = self._live.step(t_ns * 1e-9)
        if step is not None:
            self._took.append(time.perf_counter() - begun)
            self._last = step
            self._health.note(t_ns, step.outcome, step.message)
            if step.estimate is not None:
                self._publish(step.estimate)
        self._health.beat(t_ns, self._figures)

    def _feel(self, t_ns, msg):
        """Take the encoders in the scene's order of pads."""
        try:
            self._live.feel(convert.nanoseconds(msg) * 1e-9,
                            cell.in_driver_order(msg.name, msg.position, self._pads))
        except CommandRefused as refusal:
            self._health.refuse(t_ns, Outcome.REJECTED, f'{graph.ACTUATORS.name}: {refusal}')

    def _bear(self, t_ns, inputs):
        """Take what probe and needle load the tissue with, of messages that are not old."""
        for topic in INSTRUMENTS:
            for msg in inputs.get(topic.name, ()):
                self._instruments[topic] = msg
        fresh = {topic: msg for topic, msg in self._instruments.items()
                 if t_ns - convert.nanoseconds(msg) <= FRESH_NS}
        state, pose, wrench, tip, needle = map(fresh.get, INSTRUMENTS)
        pressing = state is not None and state.in_contact and None not in (pose, wrench)
        inside = None not in (tip, needle)
        try:
            loads = instrument_loads(
                (*convert.pose_of(pose.pose), convert.six(wrench.wrench)) if pressing else None,
                (*convert.pose_of(tip.pose), needle.effort[0], needle.position[0]) if inside
                else None, ProbeFace(), self._skin)
        except InputError as refusal:
            self._health.refuse(t_ns, Outcome.REJECTED, str(refusal))
            loads = ()
        self._live.bear(t_ns * 1e-9, loads)

    def _publish(self, estimate):
        self._count += 1
        for target, point, covariance in zip(estimate.targets, estimate.points,
                                             estimate.covariance, strict=True):
            self._pubs[target](convert.estimated_pose(self._frame, estimate.t, point, covariance))
        t_ns = round(estimate.t * 1e9)
        if estimate.x is not None and t_ns >= self._mesh_due_ns:
            self._publish_mesh(t_ns, estimate.x)

    def _publish_mesh(self, t_ns, x):
        self._mesh_due_ns = (t_ns // self._mesh_period_ns + 1) * self._mesh_period_ns
        if not self._announced:
            self._announced = True
            mesh = self._live.mesh
            self._topology_pub(convert.mesh_topology(t_ns, self._frame, mesh,
                                                     boundary_faces(mesh)))
        self._positions_pub(convert.mesh_positions(t_ns, self._frame, x))

    def _figures(self):
        fit, step = self._live.registration, self._last
        figures = {'estimates': self._count}
        if fit is not None:
            figures |= {'registration residual rms [mm]': f'{fit.rms * MM:.3f}',
                        'registered to': ', '.join(fit.names),
                        'landmarks left out': ', '.join(fit.rejected) or 'none',
                        'registration sd [mm]': _sds(fit.covariance[3:, 3:], MM),
                        'registration sd [mrad]': _sds(fit.covariance[:3, :3], 1e3)}
        if step is not None and step.estimate is not None:
            figures |= {'age of the estimate [ms]': f'{step.age * MS:.1f}',
                        'markers used': step.seen}
        if not self._lockstep and self._took:
            figures['time of the last estimate [ms]'] = f'{self._took[-1] * MS:.1f}'
        return figures

    def close(self):
        """Say how long estimates took, and how much memory was needed."""
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        took = np.array(self._took) * MS
        spent = '' if not len(took) else (
            f'median {np.median(took):.1f} ms, 95 % within {np.quantile(took, 0.95):.1f} ms, '
            f'longest {took.max():.1f} ms of wall time; ')
        # no logger: after a signal there is no topic left that it could publish on
        print(f'{self.get_name()}: {self._count} estimates: {spent}peak memory {memory:.0f} MB',
              file=sys.stderr)


def _sds(covariance, scale):
    return ' '.join(f'{sd * scale:.3f}' for sd in np.sqrt(np.diag(covariance)))


def run(name, args=None):
    """Run the node of one estimator."""
    spin_node(lambda: TissueEstimatorNode(name), args)
