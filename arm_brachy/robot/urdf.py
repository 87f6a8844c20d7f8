"""The arm as URDF text, from the same numbers that the controller uses.

PyBullet's own panda.urdf has inertias of 0.1 kg m2 about each axis, 20 to 120 times too much at
the wrist; hence one of our own. Frame names: arm_link_0 (base) to arm_link_7, arm_tip.
"""

from xml.etree import ElementTree

import numpy as np

from arm_brachy.robot import panda_parameters as panda

BASE, TIP = 'arm_link_0', 'arm_tip'
DRAWN_RADIUS = 0.05  # m of the cylinders and spheres that stand for the links' covers
_DRAWN_LEAST = 1e-3  # m between joints, below which no cylinder is drawn
_ANCHOR = 1e-3       # kg of a base that never moves
_NOTHING = 1e-9      # kg, kg m2 of a frame; PyBullet takes a link without inertia for 1 kg


def panda_urdf(arm, joint_names):
    """Return the URDF (text) of a rigid_body.Arm with the Panda's geometry.

    joint_names : 7 names. Joints have no damping and no friction: those are the simulation's.
    A payload is part of the last link, as `Arm.carrying` has it.
    """
    robot = ElementTree.Element('robot', name='panda')
    _link(robot, BASE, _ANCHOR, np.zeros(3), _ANCHOR * np.eye(3), reach=panda.DH[0])
    for i in range(panda.JOINTS):
        after = panda.DH[i + 1] if i + 1 < panda.JOINTS else None
        _link(robot, f'arm_link_{i + 1}', arm.mass[i], arm.centre[i], arm.inertia[i], after)
        _revolute(robot, i, joint_names[i])
    _tip(robot, arm.tip)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')


def origin_of(dh):
    """Return (p (3,) [m], rpy (3,) [rad]) of a joint's frame in the one before, at angle 0."""
    a, alpha, d = dh
    return np.array([a, -np.sin(alpha) * d, np.cos(alpha) * d]), np.array([alpha, 0.0, 0.0])


def _link(robot, name, mass, centre, inertia, reach):
    link = _weight(robot, name, mass, centre, inertia)
    _sphere(link)
    if reach is not None:
        end, _ = origin_of(reach)
        if np.linalg.norm(end) > _DRAWN_LEAST:
            _cylinder(link, end)


def _weight(robot, name, mass, centre, inertia):
    link = ElementTree.SubElement(robot, 'link', name=name)
    inertial = ElementTree.SubElement(link, 'inertial')
    ElementTree.SubElement(inertial, 'origin', xyz=_numbers(centre), rpy='0 0 0')
    ElementTree.SubElement(inertial, 'mass', value=repr(float(mass)))
    ElementTree.SubElement(inertial, 'inertia', {
        f'i{a}{b}': repr(float(inertia[i, j]))
        for i, a in enumerate('xyz') for j, b in enumerate('xyz') if i <= j})
    return link


def _sphere(link):
    visual = ElementTree.SubElement(link, 'visual')
    shape = ElementTree.SubElement(visual, 'geometry')
    ElementTree.SubElement(shape, 'sphere', radius=repr(DRAWN_RADIUS))


def _cylinder(link, end):
    """A cylinder from the link's origin to `end` (3,) [m]."""
    length = np.linalg.norm(end)
    rpy = 0.0, np.arccos(end[2] / length), np.arctan2(end[1], end[0])   # z onto end
    visual = ElementTree.SubElement(link, 'visual')
    ElementTree.SubElement(visual, 'origin', xyz=_numbers(end / 2), rpy=_numbers(rpy))
    shape = ElementTree.SubElement(visual, 'geometry')
    ElementTree.SubElement(shape, 'cylinder', radius=repr(DRAWN_RADIUS), length=repr(length))


def _revolute(robot, i, name):
    limits = panda.JOINT_LIMITS
    joint = ElementTree.SubElement(robot, 'joint', name=name, type='revolute')
    p, rpy = origin_of(panda.DH[i])
    ElementTree.SubElement(joint, 'origin', xyz=_numbers(p), rpy=_numbers(rpy))
    ElementTree.SubElement(joint, 'parent', link=f'arm_link_{i}')
    ElementTree.SubElement(joint, 'child', link=f'arm_link_{i + 1}')
    ElementTree.SubElement(joint, 'axis', xyz='0 0 1')
    ElementTree.SubElement(joint, 'limit', {
        key: repr(float(values[i])) for key, values in (
            ('lower', limits.low), ('upper', limits.high), ('velocity', limits.velocity),
            ('effort', limits.torque))})


def _tip(robot, tip):
    """The end effector's frame: a link without mass, which viewers and /tf name."""
    _weight(robot, TIP, _NOTHING, np.zeros(3), _NOTHING * np.eye(3))
    joint = ElementTree.SubElement(robot, 'joint', name='arm_tip_joint', type='fixed')
    ElementTree.SubElement(joint, 'origin', xyz=_numbers(tip), rpy='0 0 0')
    ElementTree.SubElement(joint, 'parent', link=f'arm_link_{panda.JOINTS}')
    ElementTree.SubElement(joint, 'child', link=TIP)


def _numbers(values):
    return ' '.join(repr(float(v)) for v in values)
