"""Shapes and frames to the messages of viewers: the part of `convert` that cell_viewer needs."""

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from arm_brachy.nodes import convert
from arm_brachy.viewing.shapes import SHADES, Kind, Shape, palette, rounded, shade_index

TYPES = {Kind.TRIANGLES: Marker.TRIANGLE_LIST, Kind.SPHERES: Marker.SPHERE_LIST,
         Kind.DOTS: Marker.POINTS, Kind.LINE: Marker.LINE_STRIP, Kind.ARROW: Marker.ARROW,
         Kind.DISC: Marker.CYLINDER, Kind.ELLIPSOID: Marker.SPHERE, Kind.BOX: Marker.CUBE,
         Kind.TEXT: Marker.TEXT_VIEW_FACING}
POSED = (Kind.DISC, Kind.ELLIPSOID, Kind.BOX)
ARROW_HEAD = 2.0    # diameter of the head, of that of the shaft
FOR_EVER = Duration()


def markers(t_ns, frame, shapes):
    """visualization_msgs/MarkerArray of viewing.shapes; the first marker deletes what was there.

    A layer is a marker's namespace. Stamp t_ns [ns]; frame : of the base.
    """
    header = convert.header(t_ns, frame)
    out, numbers, shades = [Marker(header=header, action=Marker.DELETEALL)], {}, {}
    for shape in shapes:
        number = numbers[shape.layer] = numbers.get(shape.layer, -1) + 1
        out.append(_marker(header, shape, number, shades))
    return MarkerArray(markers=out)


def _marker(header, shape, number, shades):
    size = float(shape.size)
    msg = Marker(header=header, ns=shape.layer, id=number, type=TYPES[shape.kind],
                 action=Marker.ADD, color=_colour(shape.colour), text=shape.text,
                 pose=Pose(orientation=Quaternion(w=1.0)), lifetime=FOR_EVER)
    points = rounded(shape.points)
    if shape.kind in POSED:
        msg.pose, msg.scale = _pose(shape.axes, points[0]), convert.vector(shape.scale)
    elif shape.kind is Kind.TEXT:
        msg.pose, msg.scale = _pose(shape.axes, points[0]), Vector3(x=size, y=size, z=size)
    else:
        msg.points, msg.scale = _points(points), _scale(shape.kind, size)
    if shape.triangles is not None:      # a list of triangles names every corner anew
        corners = shape.triangles.ravel().tolist()
        msg.points = [msg.points[k] for k in corners]
        if shape.shades is not None:
            colours = _shaded(shape.shades, float(shape.colour[3]), shades)
            msg.colors = [colours[k] for k in corners]
    return msg


def _scale(kind, size):
    if kind is Kind.TRIANGLES:
        return Vector3(x=1.0, y=1.0, z=1.0)
    if kind is Kind.ARROW:
        return Vector3(x=size, y=ARROW_HEAD * size, z=0.0)
    return Vector3(x=size, y=size, z=size)


def _points(points):
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]


def _colour(rgba):
    r, g, b, a = (float(c) for c in rgba)
    return ColorRGBA(r=r, g=g, b=b, a=a)


def _shaded(shades, alpha, made):
    if not made:
        made.update(enumerate(_colour((*rgb, alpha)) for rgb in palette()))
    return [made[k] for k in shade_index(shades).tolist()]


def _pose(R, p):
    return Pose(position=convert.point(p), orientation=_quaternion(R))


def _quaternion(R):
    x, y, z, w = (float(c) for c in Rotation.from_matrix(R).as_quat(canonical=True))
    return Quaternion(x=x, y=y, z=z, w=w)


def transform(t_ns, parent, child, R, p):
    """geometry_msgs/TransformStamped: pose R (3, 3), p (3,) [m] of `child` in `parent`."""
    return TransformStamped(
        header=convert.header(t_ns, parent), child_frame_id=child,
        transform=Transform(translation=convert.vector(p), rotation=_quaternion(R)))


def joined_joints(t_ns, states):
    """One sensor_msgs/JointState of several, in their order; stamp t_ns [ns]."""
    joined = JointState(header=convert.header(t_ns, ''))
    for state in states:
        joined.name = [*joined.name, *state.name]
        for key in ('position', 'velocity', 'effort'):
            getattr(joined, key).extend(getattr(state, key))
    return joined


def shapes(msg):
    """Yield the viewing.shapes of a MarkerArray that `markers` made; others are left out."""
    kinds = {number: kind for kind, number in TYPES.items()}
    for marker in msg.markers:
        if marker.action == Marker.ADD and marker.type in kinds:
            yield _shape(kinds[marker.type], marker)


def _shape(kind, msg):
    c, s = msg.color, msg.scale
    R, p = convert.pose_of(msg.pose)
    points = np.array([[q.x, q.y, q.z] for q in msg.points]) if msg.points else p[None]
    triangles = shades = None
    if kind is Kind.TRIANGLES:
        points, first, which = np.unique(points, axis=0, return_index=True, return_inverse=True)
        triangles = which.reshape(-1, 3)
        if msg.colors:
            seen = np.array([[msg.colors[k].r, msg.colors[k].g, msg.colors[k].b] for k in first])
            away = np.linalg.norm(seen[:, None] - palette(), axis=2)
            shades = away.argmin(axis=1) / (SHADES - 1)
    return Shape(msg.ns, kind, points, (c.r, c.g, c.b, c.a), s.x, triangles, shades, R,
                 (s.x, s.y, s.z), msg.text)
