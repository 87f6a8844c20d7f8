"""ROS 2 messages as CDR bytes without ROS, for the importers.

Serialisation is that of the rosbags type system, fed with the same message definitions that go
into the bag; it agrees byte for byte with rclpy (test/recording/test_encode.py).
"""

import numpy as np

from arm_brachy.recording import schema

JOINT_STATE = 'sensor_msgs/msg/JointState'
WRENCH = 'geometry_msgs/msg/WrenchStamped'
POSE = 'geometry_msgs/msg/PoseStamped'
OPTICAL = 'arm_brachy_msgs/msg/OpticalFrame'
TOOL_STATUS = 'arm_brachy_msgs/msg/ToolStatus'
TOOL_OK, TOOL_MISSING = 0, 1  # constants of ToolStatus.msg

IDENTITY = (0.0, 0.0, 0.0, 1.0)  # quaternion x y z w
NOT_MEASURED = float('nan')


class Encoder:
    """Serialises the message types of laboratory recordings.

    All times are ns since the recording's origin; SI; vectors in `frame`.
    Raises RecordingError if a message package is not installed.
    """

    def __init__(self):
        names = (JOINT_STATE, WRENCH, POSE, OPTICAL, TOOL_STATUS)
        self.definitions = {name: schema.message_definition(name) for name in names}
        self._store = schema.typestore(self.definitions)

    def encode(self, type_name, **fields):
        """Return the CDR bytes of one message; every field must be given."""
        message = self._make(type_name, **fields)
        return bytes(self._store.serialize_cdr(message, type_name))

    def joint_state(self, t_ns, frame, names, position):
        """Actuator positions along their push directions; position : (k,) [m]."""
        nothing = np.zeros(0)
        return self.encode(JOINT_STATE, header=self._header(t_ns, frame), name=list(names),
                           position=np.asarray(position, dtype=float), velocity=nothing,
                           effort=nothing)

    def wrench(self, t_ns, frame, force):
        """External force on the tool (3,) [N]; the torque is NaN because it was not measured."""
        wrench = self._make('geometry_msgs/msg/Wrench', force=self._vector(force),
                            torque=self._vector([NOT_MEASURED] * 3))
        return self.encode(WRENCH, header=self._header(t_ns, frame), wrench=wrench)

    def optical_frame(self, t_ns, frame, number, names, points):
        """All markers of one frame; points : (k, 3) [m], a row with NaN is not visible."""
        points = np.asarray(points, dtype=float)
        visible = np.isfinite(points).all(axis=1)
        points = np.where(visible[:, None], points, np.nan)
        return self.encode(
            OPTICAL, header=self._header(t_ns, frame), frame_number=number, ids=list(names),
            points=[self._point(p) for p in points.tolist()], visible=visible)

    def pose(self, t_ns, frame, position, orientation=IDENTITY):
        """Position (3,) [m] and orientation x y z w of a tracked tool."""
        x, y, z, w = (float(v) for v in orientation)
        turn = self._make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)
        pose = self._make('geometry_msgs/msg/Pose', position=self._point(position),
                          orientation=turn)
        return self.encode(POSE, header=self._header(t_ns, frame), pose=pose)

    def tool_status(self, t_ns, frame, tool, number, present, quality=NOT_MEASURED):
        """State of a tracked tool at one frame; quality NaN = the file does not say."""
        return self.encode(TOOL_STATUS, header=self._header(t_ns, frame), tool=tool,
                           frame_number=number, status=TOOL_OK if present else TOOL_MISSING,
                           quality=float(quality))

    def _make(self, type_name, **fields):
        return self._store.types[type_name](**fields)

    def _header(self, t_ns, frame):
        seconds, rest = divmod(int(t_ns), 10**9)
        stamp = self._make('builtin_interfaces/msg/Time', sec=seconds, nanosec=rest)
        return self._make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)

    def _vector(self, v):
        return self._make('geometry_msgs/msg/Vector3', x=float(v[0]), y=float(v[1]), z=float(v[2]))

    def _point(self, v):
        return self._make('geometry_msgs/msg/Point', x=float(v[0]), y=float(v[1]), z=float(v[2]))
