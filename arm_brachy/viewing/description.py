"""The actuators, and the arm of a cell that has one, as URDF: what a viewer calls its robot model.

Links are frames on /tf. A pad's frame has its name and the axes of the base, its origin in the
middle of the disc: the wrench that the sensor behind it measures is in that frame.
"""

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.robot.urdf import origin_of
from arm_brachy.viewing.drawing import PAD_THICKNESS

ROD = 6e-3     # m, diameter of the rod behind a pad
_EFFORT = 1e3  # N: a URDF must say something; the limits are those of the scenario


def description(frame, pads, strokes, speed, arm=None):
    """Return the URDF (text) of a cell.

    frame : of the base;  pads : drawing.Pad;  strokes : (p,) [m];  speed : [m/s]
    arm : (R, p, name, URDF) of the base of what holds the probe: where its base is in the base
        frame, the name of that link, the rest as text; None = there is none
    """
    robot = ElementTree.Element('robot', name='arm_brachy')
    ElementTree.SubElement(robot, 'link', name=frame)
    for pad, stroke in zip(pads, strokes, strict=True):
        _actuator(robot, frame, pad, stroke, speed)
    if arm is not None:
        _arm(robot, frame, *arm)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')


def arm_links(dh, q):
    """Yield (parent, child, R (3, 3), p (3,) [m]) of every moving link of the arm at q (n,)."""
    for i, (row, angle) in enumerate(zip(dh, q, strict=True)):
        p, rpy = origin_of(row)
        turn = Rotation.from_euler('xyz', rpy) * Rotation.from_euler('z', angle)
        yield f'arm_link_{i}', f'arm_link_{i + 1}', turn.as_matrix(), p


def _actuator(robot, frame, pad, stroke, speed):
    link = ElementTree.SubElement(robot, 'link', name=pad.name)
    _cylinder(link, pad.direction, -0.5 * PAD_THICKNESS, pad.radius, PAD_THICKNESS)
    _cylinder(link, pad.direction, -PAD_THICKNESS - 0.5 * stroke, 0.5 * ROD, stroke)
    joint = ElementTree.SubElement(robot, 'joint', name=pad.name, type='prismatic')
    ElementTree.SubElement(joint, 'origin', xyz=_text(pad.centre), rpy='0 0 0')
    ElementTree.SubElement(joint, 'parent', link=frame)
    ElementTree.SubElement(joint, 'child', link=pad.name)
    ElementTree.SubElement(joint, 'axis', xyz=_text(pad.direction))
    ElementTree.SubElement(joint, 'limit', lower='0.0', upper=repr(float(stroke)),
                           velocity=repr(float(speed)), effort=repr(_EFFORT))


def _cylinder(link, axis, along, radius, length):
    """A cylinder about `axis` (3,), its middle `along` [m] it."""
    rpy = 0.0, np.arccos(axis[2]), np.arctan2(axis[1], axis[0])   # z onto the axis
    visual = ElementTree.SubElement(link, 'visual')
    ElementTree.SubElement(visual, 'origin', xyz=_text(along * axis), rpy=_text(rpy))
    geometry = ElementTree.SubElement(visual, 'geometry')
    ElementTree.SubElement(geometry, 'cylinder', radius=repr(float(radius)),
                           length=repr(float(length)))


def _arm(robot, frame, R, p, base, urdf):
    robot.extend(ElementTree.fromstring(urdf))
    joint = ElementTree.SubElement(robot, 'joint', name='arm_base_joint', type='fixed')
    ElementTree.SubElement(joint, 'origin', xyz=_text(p),
                           rpy=_text(Rotation.from_matrix(R).as_euler('xyz')))
    ElementTree.SubElement(joint, 'parent', link=frame)
    ElementTree.SubElement(joint, 'child', link=base)


def _text(values):
    return ' '.join(repr(float(v)) for v in np.asarray(values))
