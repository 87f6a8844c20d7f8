"""Messages to arrays and back; the only place where fields of messages are spelled out."""

from array import array

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    Vector3,
    Wrench,
    WrenchStamped,
)
from rclpy.time import Time
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2, PointField
from std_msgs.msg import Header

from arm_brachy.cell import Reading
from arm_brachy.control.gate import Order
from arm_brachy.control.procedure_steps import NeedleSeen, ProbeSeen
from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.needle_path import NeedleInTissue
from arm_brachy_msgs.msg import (
    ActuatorCommand,
    BodyPoints,
    ManipulationState,
    MeshPositions,
    MeshTopology,
    OpticalFrame,
    PadState,
    ProbeContact,
    ProbeState,
    StepOutcome,
    TaskState,
    ToolStatus,
)

STATUS_PREFIX = 'arm_brachy: '     # of a node's name in /diagnostics
UNKNOWN_TURN = np.pi**2 / 3.0   # rad^2, variance of an angle of which nothing is known


def header(t_ns, frame):
    """std_msgs/Header for time t_ns [ns]."""
    return Header(stamp=Time(nanoseconds=int(t_ns)).to_msg(), frame_id=frame)


def nanoseconds(msg):
    """Stamp of a message with a header [ns]."""
    return msg.header.stamp.sec * 1_000_000_000 + msg.header.stamp.nanosec


def order(msg):
    """Order of an ActuatorCommand, for a gate to judge."""
    return Order(nanoseconds(msg) * 1e-9, msg.header.frame_id, msg.mode,
                 (*msg.position, *msg.velocity))


def allowance(msg):
    """Order of a SafetyState, for a gate to judge."""
    return Order(nanoseconds(msg) * 1e-9, msg.header.frame_id, msg.state)


def floats(values):
    """float64[] field from an array; array('d') is what rclpy takes without converting."""
    return array('d', np.ascontiguousarray(values, dtype=np.float64).tobytes())


def indices(values):
    """uint32[] field from an array."""
    return array('I', np.ascontiguousarray(values, dtype=np.uint32).tobytes())


def point(p):
    """geometry_msgs/Point from (3,)."""
    return Point(x=float(p[0]), y=float(p[1]), z=float(p[2]))


def vector(v):
    """geometry_msgs/Vector3 from (3,)."""
    return Vector3(x=float(v[0]), y=float(v[1]), z=float(v[2]))


def xyz(p):
    """(3,) from a Point or Vector3."""
    return np.array([p.x, p.y, p.z])


def joint_state(t_ns, frame, names, state):
    """sensor_msgs/JointState from a devices.actuator.BankState."""
    return JointState(header=header(t_ns, frame), name=list(names), position=floats(state.q),
                      velocity=floats(state.velocity), effort=floats(state.effort))


def actuator_command(t_ns, frame, names, q, speed=()):
    """ActuatorCommand MOVE to q (p,) [m] at most at speed (p,) [m/s]; () = as fast as it can."""
    return ActuatorCommand(header=header(t_ns, frame), mode=ActuatorCommand.MODE_MOVE,
                           names=list(names), position=floats(q), velocity=floats(speed))


def pad_state(t_ns, frame, names, pads):
    """PadState from true pad positions (p,) [m] along their directions."""
    return PadState(header=header(t_ns, frame), names=list(names), position=floats(pads))


def body_points(t_ns, frame, names, positions, rotations, pads, pad_displacement, force, moment):
    """BodyPoints from arrays: positions (k,3), rotations (k,3,3), pad arrays (p,3)."""
    return BodyPoints(
        header=header(t_ns, frame), names=list(names), positions=floats(positions),
        orientations=floats(Rotation.from_matrix(rotations).as_quat()), pads=list(pads),
        pad_displacement=floats(pad_displacement), pad_force=floats(force),
        pad_moment=floats(moment))


def positions_of(msg):
    """(k,3) positions of a BodyPoints."""
    return np.asarray(msg.positions).reshape(-1, 3)


def rotations_of(msg):
    """(k,3,3) rotations of a BodyPoints."""
    return Rotation.from_quat(np.asarray(msg.orientations).reshape(-1, 4)).as_matrix()


def mesh_topology(t_ns, frame, mesh, surface):
    """MeshTopology of a TetMesh; surface (s,3) outward triangles."""
    return MeshTopology(header=header(t_ns, frame), revision=1, rest_positions=floats(mesh.nodes),
                        tetrahedra=indices(mesh.tets), surface=indices(surface))


def mesh_positions(t_ns, frame, x):
    """MeshPositions from nodes x (n,3) [m]."""
    return MeshPositions(header=header(t_ns, frame), revision=1, positions=floats(x))


def pose_of(msg):
    """R (3, 3), p (3,) of a geometry_msgs Pose; R is NaN where its quaternion has no length."""
    q = np.array([msg.orientation.x, msg.orientation.y, msg.orientation.z, msg.orientation.w])
    if not (np.isfinite(q).all() and q.any()):
        return np.full((3, 3), np.nan), xyz(msg.position)
    return Rotation.from_quat(q).as_matrix(), xyz(msg.position)


def needle_of(msg):
    """NeedleInTissue of a PoseArray of its path, template first, and its axes (k, 3).

    None and None where there is none.
    """
    points = positions_in(msg)
    if len(points) < 2:
        return None, None
    axes = np.array([pose_of(pose)[0][:, 2] for pose in msg.poses])
    depth = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return NeedleInTissue(points, depth), axes


def probe_contact(t_ns, frame, reading):
    """ProbeContact of a tissue ProbeReading."""
    force, moment = reading.wrench[:3], reading.wrench[3:]
    return ProbeContact(header=header(t_ns, frame),
                        wrench=Wrench(force=vector(force), torque=vector(moment)),
                        stiffness=floats(reading.stiffness), area=float(reading.area),
                        pressure=floats(reading.pressure))


def needle_wrench(t_ns, frame, force, needle):
    """WrenchStamped of the tissue on the needle: force [N] against insertion, at its tip."""
    along = np.zeros(3) if needle is None else needle.points[-1] - needle.points[-2]
    length = np.linalg.norm(along)
    along = along / length if length > 0.0 else along
    return WrenchStamped(header=header(t_ns, frame),
                         wrench=Wrench(force=vector(-force * along), torque=vector(np.zeros(3))))


def tool_pose(frame, sample):
    """geometry_msgs/PoseStamped from a devices.em_tracker.ToolSample."""
    q = sample.quaternion
    return PoseStamped(
        header=header(round(sample.t * 1e9), frame),
        pose=Pose(position=point(sample.position),
                  orientation=Quaternion(x=float(q[0]), y=float(q[1]), z=float(q[2]),
                                         w=float(q[3]))))


def estimated_pose(frame, t, place, covariance):
    """geometry_msgs/PoseWithCovarianceStamped of a point at t [s]: (3,) [m], (3, 3) [m^2].

    A point has no orientation: the identity, with the variance of an angle that is not known.
    """
    full = np.zeros((6, 6))
    full[:3, :3], full[3:, 3:] = covariance, UNKNOWN_TURN * np.eye(3)
    return PoseWithCovarianceStamped(
        header=header(round(t * 1e9), frame),
        pose=PoseWithCovariance(pose=Pose(position=point(place), orientation=Quaternion(w=1.0)),
                                covariance=full.ravel()))


def position(msg):
    """(3,) [m] of a PoseStamped or PoseWithCovarianceStamped."""
    pose = msg.pose.pose if isinstance(msg, PoseWithCovarianceStamped) else msg.pose
    return xyz(pose.position)


def marker_frame(msg):
    """(t [s], ids, points (n, 3) [m]) of an OpticalFrame; NaN where not visible."""
    points = np.array([xyz(p) for p in msg.points]).reshape(-1, 3)
    points[~np.array(msg.visible, dtype=bool)] = np.nan
    return nanoseconds(msg) * 1e-9, tuple(msg.ids), points


def tool_status(frame, sample):
    """ToolStatus from a devices.em_tracker.ToolSample."""
    return ToolStatus(header=header(round(sample.t * 1e9), frame), tool=sample.tool,
                      frame_number=sample.frame_number % 2**32, status=sample.status.value,
                      quality=float(sample.quality))


def optical_frame(frame, sample):
    """OpticalFrame from a devices.optical_tracker.OpticalFrame."""
    return OpticalFrame(
        header=header(round(sample.t * 1e9), frame), frame_number=sample.frame_number % 2**32,
        ids=list(sample.ids), points=[point(p) for p in sample.points],
        visible=[bool(v) for v in sample.visible])


def wrench(frame, sample):
    """geometry_msgs/WrenchStamped from a devices.force_sensor.ForceSample."""
    msg = WrenchStamped(header=header(round(sample.t * 1e9), frame))
    msg.wrench.force, msg.wrench.torque = vector(sample.force), vector(sample.moment)
    return msg


def sample(kind, names, msg):
    """(c, 3) [m or N] of a marker frame, a pose or a wrench; NaN where not seen.

    kind : of stream, 'optical', 'em' or 'force';  names : markers, in the order that is wanted
    """
    if kind == 'optical':
        there = {name: xyz(p) for name, p, seen in zip(msg.ids, msg.points, msg.visible,
                                                       strict=True) if seen}
        return np.array([there.get(name, np.full(3, np.nan)) for name in names])
    return np.array([xyz(msg.pose.position if kind == 'em' else msg.wrench.force)])


def outcome(t_ns, frame, source, value, message=''):
    """StepOutcome; the message, where there is one, says more than the general advice."""
    return StepOutcome(header=header(t_ns, frame), source=source, outcome=value.name,
                       advice=message or value.advice)


def diagnostics(t_ns, name, outcome_value, message, values):
    """DiagnosticArray with one status; values : mapping name -> anything printable."""
    level = DiagnosticStatus.OK if outcome_value.ok else DiagnosticStatus.WARN
    status = DiagnosticStatus(
        level=level, name=STATUS_PREFIX + name, message=message or outcome_value.name.lower(),
        hardware_id='arm_brachy', values=[KeyValue(key=str(k), value=str(v))
                                          for k, v in values.items()])
    return DiagnosticArray(header=header(t_ns, ''), status=[status])


def reading(msg):
    """cell.Reading from a BodyPoints."""
    return Reading(nanoseconds(msg) * 1e-9, tuple(msg.names), positions_of(msg),
                   rotations_of(msg), np.reshape(msg.pad_displacement, (-1, 3)),
                   np.reshape(msg.pad_force, (-1, 3)), np.reshape(msg.pad_moment, (-1, 3)))


def move_state(t_ns, frame, event):
    """TaskState from a control.move_events.Event; a prescribed move has no target."""
    return TaskState(header=header(t_ns, frame), state=event.status, index=event.index,
                     name=event.name, message=event.message)


def manipulation_state(t_ns, frame, pursuit, step):
    """ManipulationState from a control.manipulator.ManipulatorStep."""
    closest = step.estimate if step.closest is None else step.closest
    return ManipulationState(
        header=header(t_ns, frame), target=pursuit.target, active=pursuit.active,
        reached=bool(step.reached), reference=point(step.reference),
        estimate=point(step.estimate), model=point(step.estimate - step.disturbance),
        disturbance=vector(step.disturbance), error=vector(step.error),
        jacobian=floats(step.jacobian), command=floats(step.command),
        feasible=step.reach is None or step.reach.feasible, closest=point(closest),
        outcome=step.outcome.name, message=step.message)


def pose_stamped(t_ns, frame, R, p):
    """geometry_msgs/PoseStamped from R (3, 3) and p (3,) [m]."""
    return PoseStamped(header=header(t_ns, frame), pose=_pose(R, p))


def _pose(R, p):
    x, y, z, w = (float(c) for c in Rotation.from_matrix(R).as_quat(canonical=True))
    return Pose(position=point(p), orientation=Quaternion(x=x, y=y, z=z, w=w))


def six(wrench):
    """(6,) [N, N m] of a geometry_msgs/Wrench."""
    return np.concatenate([xyz(wrench.force), xyz(wrench.torque)])


def needle_state(t_ns, frame, state):
    """sensor_msgs/JointState from a devices.needle_driver.NeedleState: depth, then roll."""
    return JointState(header=header(t_ns, frame), name=['needle', 'roll'],
                      position=floats([state.depth, state.roll]),
                      velocity=floats([state.velocity, 0.0]), effort=floats([state.force, 0.0]))


def needle_seen(msg):
    """control.procedure_steps.NeedleSeen of such a JointState; InputError if it has no joint."""
    if len(msg.position) == 0:
        raise InputError('no joint; must be needle, roll')
    return NeedleSeen(msg.position[0], msg.effort[0] if len(msg.effort) > 0 else np.nan)


def probe_seen(msg):
    """control.procedure_steps.ProbeSeen of a ProbeState; InputError for an outcome of nobody."""
    if msg.outcome not in Outcome.__members__:
        raise InputError(f'outcome {msg.outcome!r}; must be a name of core.outcome.Outcome')
    return ProbeSeen(msg.phase, msg.in_contact, msg.out_of_plane, Outcome[msg.outcome],
                     msg.message)


def needle_shaft(t_ns, frame, points, axes):
    """geometry_msgs/PoseArray of points (k, 3) [m] with z along axes (k, 3), unit.

    About z x axis, the smallest turn that takes z there; half a turn about x if it is -z.
    """
    turns = np.column_stack([-axes[:, 1], axes[:, 0], np.zeros(len(axes)), 1.0 + axes[:, 2]])
    turns[~turns.any(axis=1)] = [1.0, 0.0, 0.0, 0.0]
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return PoseArray(header=header(t_ns, frame), poses=[
        Pose(position=point(p), orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]))
        for p, q in zip(points, turns.tolist(), strict=True)])


def places(t_ns, frame, points):
    """geometry_msgs/PoseArray of points (k, 3) [m] without orientation: the identity."""
    return PoseArray(header=header(t_ns, frame), poses=[
        Pose(position=point(p), orientation=Quaternion(w=1.0)) for p in points])


def positions_in(msg):
    """(k, 3) [m] of a geometry_msgs/PoseArray."""
    return np.array([xyz(pose.position) for pose in msg.poses]).reshape(-1, 3)


def image(t_ns, frame, picture):
    """sensor_msgs/Image, mono8 from (height, width), rgb8 from (height, width, 3), uint8."""
    height, width = picture.shape[:2]
    depth = 1 if picture.ndim == 2 else picture.shape[2]  # noqa: PLR2004 - rows and columns
    return Image(header=header(t_ns, frame), height=height, width=width,
                 encoding='mono8' if depth == 1 else 'rgb8', is_bigendian=0, step=width * depth,
                 data=array('B', picture.tobytes()))


def image_info(t_ns, frame, params):
    """sensor_msgs/CameraInfo of a devices.ultrasound.UltrasoundParams.

    An ultrasound image is no projection: K and P say u = K[0] x + K[2], v = K[4] z + K[5], with
    x along the elements and z deep, in metres of the probe's frame, and no distortion.
    """
    (fx, fz), (cx, _) = 1.0 / params.pixel, params.pixels([0.0, 0.0])
    k = [fx, 0.0, cx, 0.0, fz, 0.0, 0.0, 0.0, 1.0]
    return CameraInfo(header=header(t_ns, frame), height=params.height, width=params.width, k=k,
                      r=np.eye(3).ravel(), p=np.column_stack([np.reshape(k, (3, 3)),
                                                              np.zeros(3)]).ravel())


def cloud(t_ns, frame, points):
    """sensor_msgs/PointCloud2 of points (n, 3) [m], float32."""
    data = np.ascontiguousarray(points, dtype='<f4')
    fields = [PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
              for k, name in enumerate('xyz')]
    return PointCloud2(header=header(t_ns, frame), height=1, width=len(data), fields=fields,
                       is_bigendian=False, point_step=12, row_step=12 * len(data),
                       data=array('B', data.tobytes()), is_dense=True)


def cloud_points(msg):
    """(n, 3) [m] of a PointCloud2 with float32 x, y, z first in each point."""
    raw = np.frombuffer(bytes(msg.data), dtype=np.uint8).reshape(-1, msg.point_step)
    return np.ascontiguousarray(raw[:, :12]).view('<f4').astype(float)


def probe_state(t_ns, frame, step):
    """ProbeState from a robot.probe_arm.ProbeArmStep."""
    return ProbeState(
        header=header(t_ns, frame), phase=int(step.phase), in_contact=step.in_contact,
        force_goal=step.force_goal, force=floats(step.force), out_of_plane=step.out_of_plane,
        goal=_pose(step.goal_R, step.goal_p), torque=_seven(step.torque),
        outcome=step.outcome.name, message=step.message)


def _seven(torque):
    """As many as the message has; a holder with fewer joints leaves the rest NaN."""
    out = np.full(len(ProbeState().torque), np.nan)
    out[:len(torque)] = torque
    return out


def probe_joints(t_ns, frame, names, step):
    """sensor_msgs/JointState from a robot.probe_arm.ProbeArmStep."""
    return JointState(header=header(t_ns, frame), name=list(names), position=floats(step.q),
                      velocity=floats(step.dq), effort=floats(step.torque))


def probe_wrench(t_ns, frame, step):
    """geometry_msgs/WrenchStamped from a robot.probe_arm.ProbeArmStep; frame : of the probe."""
    msg = WrenchStamped(header=header(t_ns, frame))
    msg.wrench.force, msg.wrench.torque = vector(step.wrench[:3]), vector(step.wrench[3:])
    return msg
