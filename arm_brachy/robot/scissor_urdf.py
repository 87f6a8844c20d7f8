"""The scissor linkage as URDF text: arcs as boxes, frames in the centre of the sphere.

All hinge axes go through the centre, so every link's frame has its origin there and its z along
its hinge: a hinge is a turn about z, an arc a turn about y. A URDF is a tree and the linkage is
closed, so both branches hang on the base, carrier and probe too, and the angles of the passive
joints come from `joint_positions`. Frame names: scissor_base (frame C of `scissor_loop`),
scissor_yoke, scissor_left_1 ..., scissor_right_1 ..., scissor_carrier, scissor_spindle,
scissor_probe. The joints that the holder has keep its names; theta_1 is the right branch's first.
"""

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.robot.scissor_rcm import polar_angle, rigid_passive_angle
from arm_brachy.robot.scissor_stiffness import mass_of_arc

BASE, PROBE = 'scissor_base', 'scissor_probe'
SIDES = {'left': 1, 'right': -1}
_EFFORT = '100'          # N m, N: a URDF must say something
_ANCHOR = 1e-3           # kg of a base that never moves, and of frames without a mass
_PIECES = 6              # boxes of an arc
_PIN = 0.012             # m, side of a hinge's pin
_POST = np.array([0.04, 0.04])          # m, section of the stand
_PLATE = 0.012           # m, of the carrier
_FACE = np.array([0.048, 0.016])        # m, of the probe
_HOUSING, _ROD = 0.1, 0.024             # m, length of the probe's housing; side of the stage's rod
_STEEL, _DARK = (0.72, 0.74, 0.78, 1.0), (0.3, 0.32, 0.36, 1.0)
_BRASS, _BLUE, _RIGHT = (0.8, 0.65, 0.3, 1.0), (0.25, 0.45, 0.75, 1.0), (0.56, 0.62, 0.7, 1.0)


def scissor_urdf(own, down):
    """Return the URDF (text) of the linkage with carrier, stage and probe.

    own : ScissorHolderParams;  down : (3,) towards the floor, frame C, along which the stand is
        drawn as long as the sphere's radius
    """
    link, robot = own.linkage, ElementTree.Element('robot', name='scissor_rcm')
    base = _body(robot, BASE, _ANCHOR, np.zeros(3), _ANCHOR * np.eye(3))
    hinge = np.array([0.0, 0.0, link.radius + link.width])
    _box(base, hinge, np.eye(3), [0.05, 0.05, 0.05], _DARK)
    _box(base, hinge + 0.5 * link.radius * down, _along(down), [*_POST, link.radius], _DARK)
    _body(robot, 'scissor_yoke', _ANCHOR, np.zeros(3), _ANCHOR * np.eye(3))
    for name, side in SIDES.items():
        _branch(robot, own, name, side)
    _carrier(robot, own)
    _joints(robot, own)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')


def joint_positions(linkage, q):
    """Return name -> angle [rad] or advance [m] of every joint of the URDF.

    linkage : ScissorParams;  q : (4,) theta_0, theta_1, spin, advance
    """
    theta_0, theta_1, spin, advance = q
    out = {'scissor_theta_0': theta_0, 'scissor_polar': polar_angle(linkage, theta_1),
           'scissor_spin': spin, 'scissor_stage': advance}
    passive = rigid_passive_angle(linkage, theta_1)
    for name, side in SIDES.items():
        for k in range(linkage.links):
            # The hinge before arc k: theta_1, then by turns that of a stage and the crossing's.
            turn = -theta_1 if k == 0 else passive if k % 2 else -2.0 * theta_1
            out[_hinge(name, k)] = side * turn
    return out


def link_frames(linkage, q):
    """Yield (parent, child, R (3, 3), p (3,) [m]) of every link at q (4,), as on /tf."""
    positions = joint_positions(linkage, q)
    for name, parent, child, xyz, rpy, axis in _tree(linkage):
        R = Rotation.from_euler('xyz', rpy)
        if name == 'scissor_stage':
            yield parent, child, R.as_matrix(), xyz + positions[name] * R.apply(axis)
        else:
            turn = R * Rotation.from_rotvec(positions[name] * np.array(axis))
            yield parent, child, turn.as_matrix(), np.array(xyz)


def _tree(linkage):
    """(joint, parent, child, xyz, rpy, axis) of every joint of the URDF."""
    still, z = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    yield 'scissor_theta_0', BASE, 'scissor_yoke', still, still, z
    for name in SIDES:
        before = 'scissor_yoke'
        for k in range(linkage.links):
            here = f'scissor_{name}_{k + 1}'
            yield _hinge(name, k), before, here, still, (0.0, linkage.beta if k else 0.0, 0.0), z
            before = here
    yield 'scissor_polar', 'scissor_yoke', 'scissor_carrier', still, still, (0.0, 1.0, 0.0)
    yield 'scissor_spin', 'scissor_carrier', 'scissor_spindle', still, still, z
    # The probe's frame: z towards the centre, y along the polar direction without spin.
    yield ('scissor_stage', 'scissor_spindle', PROBE, (0.0, 0.0, linkage.radius),
           (np.pi, 0.0, np.pi / 2), z)


def _hinge(side, k):
    """Name of the joint before arc k of a branch."""
    return 'scissor_theta_1' if (side, k) == ('right', 0) else f'scissor_{side}_{k + 1}_joint'


def _joints(robot, own):
    """All joints with their limits."""
    link = own.linkage
    most = {'scissor_theta_0': own.swing, 'scissor_spin': own.spin}
    for name, parent, child, xyz, rpy, axis in _tree(link):
        slides = name == 'scissor_stage'
        joint = ElementTree.SubElement(robot, 'joint', name=name,
                                       type='prismatic' if slides else 'revolute')
        _placed(joint, xyz, rpy)
        ElementTree.SubElement(joint, 'parent', link=parent)
        ElementTree.SubElement(joint, 'child', link=child)
        ElementTree.SubElement(joint, 'axis', xyz=_numbers(axis))
        low, high = ((link.radius - own.farthest, link.radius - own.nearest) if slides
                     else (-most.get(name, np.pi), most.get(name, np.pi)))
        ElementTree.SubElement(
            joint, 'limit', lower=_number(low), upper=_number(high), effort=_EFFORT,
            velocity=_number(own.stage_speed if slides else own.turning_speed))


def _branch(robot, own, name, side):
    link = own.linkage
    # Crossing links pass each other in layers.
    radius = link.radius - 0.5 * side * link.width
    colour = _STEEL if side > 0 else _RIGHT
    mass = mass_of_arc(link, own.density)
    centre, inertia = _arc_inertia(link, mass)
    for k in range(link.links):
        body = _body(robot, f'scissor_{name}_{k + 1}', mass, centre, inertia)
        step = link.beta / _PIECES
        for i in range(_PIECES):
            R = _about_y((i + 0.5) * step)
            _box(body, radius * R[:, 2], R, [1.05 * radius * step, link.thickness, link.width],
                 colour)
        _box(body, link.radius * np.array([0.0, 0.0, 1.0]), np.eye(3),
             [_PIN, _PIN, 2.2 * link.width], _BRASS)
        if k == link.links - 1:      # the pin that the carrier stands on
            R = _about_y(link.beta)
            _box(body, (link.radius + 0.5 * link.width) * R[:, 2], R,
                 [_PIN, _PIN, 3.0 * link.width], _BRASS)


def _carrier(robot, own):
    link = own.linkage
    apart = 2.0 * link.radius * np.sin(link.beta) if link.links % 2 else 0.04
    carrier = _body(robot, 'scissor_carrier', _ANCHOR, np.zeros(3), _ANCHOR * np.eye(3))
    top = np.array([0.0, 0.0, link.radius + link.width + _PLATE])
    _box(carrier, top, np.eye(3), [0.04, apart + 0.04, _PLATE], _DARK)
    spin = _body(robot, 'scissor_spindle', _ANCHOR, np.zeros(3), _ANCHOR * np.eye(3))
    _box(spin, top + [0.0, 0.0, 0.02], np.eye(3), [0.05, 0.05, 0.03], _BRASS)
    probe = _body(robot, PROBE, _ANCHOR, np.zeros(3), _ANCHOR * np.eye(3))
    _box(probe, np.array([0.0, 0.0, -0.5 * _HOUSING]), np.eye(3), [*_FACE, _HOUSING], _BLUE)
    rod = link.radius - own.nearest
    _box(probe, np.array([0.0, 0.0, -_HOUSING - 0.5 * rod]), np.eye(3), [_ROD, _ROD, rod], _DARK)


def _arc_inertia(link, mass, samples=64):
    """Centre (3,) [m] and inertia (3, 3) [kg m2] about it, of an arc from z towards x."""
    angle = (np.arange(samples) + 0.5) * link.beta / samples
    x = link.radius * np.column_stack([np.sin(angle), np.zeros(samples), np.cos(angle)])
    centre = x.mean(axis=0)
    moved = x - centre
    line = mass * (np.mean(np.sum(moved**2, axis=1)) * np.eye(3) - moved.T @ moved / samples)
    # The section: width along the radius (z of the middle), thickness along y.
    R, w, t = _about_y(0.5 * link.beta), link.width, link.thickness
    section = mass / 12.0 * np.diag([w**2 + t**2, w**2, t**2])
    return centre, line + R @ section @ R.T


def _body(robot, name, mass, centre, inertia):
    link = ElementTree.SubElement(robot, 'link', name=name)
    inertial = ElementTree.SubElement(link, 'inertial')
    _placed(inertial, centre, np.zeros(3))
    ElementTree.SubElement(inertial, 'mass', value=_number(mass))
    ElementTree.SubElement(inertial, 'inertia', {
        f'i{a}{b}': _number(inertia[i, j])
        for i, a in enumerate('xyz') for j, b in enumerate('xyz') if i <= j})
    return link


def _box(link, centre, R, size, colour):
    visual = ElementTree.SubElement(link, 'visual')
    _placed(visual, centre, _rpy(R))
    shape = ElementTree.SubElement(visual, 'geometry')
    ElementTree.SubElement(shape, 'box', size=_numbers(size))
    material = ElementTree.SubElement(visual, 'material', name=f'rgba_{_numbers(colour)}')
    ElementTree.SubElement(material, 'color', rgba=_numbers(colour))


def _placed(element, xyz, rpy):
    ElementTree.SubElement(element, 'origin', xyz=_numbers(xyz), rpy=_numbers(rpy))


def _about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _along(z):
    """A rotation whose z is a unit vector."""
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _rpy(R):
    """Roll, pitch, yaw [rad] of a rotation, away from a pitch of 90 deg."""
    return (np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2])),
            np.arctan2(R[1, 0], R[0, 0]))


def _number(value):
    return repr(float(value))


def _numbers(values):
    return ' '.join(_number(v) for v in values)
