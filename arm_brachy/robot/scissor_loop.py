"""A tick of the scissor linkage that holds the probe, period by period, compiled.

Four joints: theta_0, theta_1, spin about the radius, advance of the stage towards the centre. All
are position servos; none is driven by torque, since geared motors and a ball screw are not driven
back. In each period
    bending    (1 + C K) d = C W_0,  the probe stands at the encoders' pose moved by d; C as at the
               beginning of the tick, links without inertia
    force      advance' = a + f_d' / K_e + k (f_d - f) + k r int (f_d - f) dt,  a : what the skin
               is expected to do, K_e : its expected stiffness
    lead       q_r'' within the acceleration limit, towards q_goal + q_goal' t, critically damped
    servo      q'' = w^2 (q_r - q) + 2 w (q_r' - q'),  within its limits
C : compliance at the face;  K, W_0 : stiffness of the tissue, and what it would do to an unbent
linkage. Frame C: origin in the centre, axes of frame B of `scissor_rcm`. SI.
Source: force control by position, Siciliano et al. 2009, Robotics, sec. 9.4.
"""

from collections import namedtuple

import numba
import numpy as np

from arm_brachy.robot.contact_model import contact_wrench
from arm_brachy.robot.force_torque import read_wrench
from arm_brachy.robot.reference import rotation

POSE, FORCE, BRAKE, RETREAT = range(4)
NO_TRIP, FORCE_TRIP, SPEED_TRIP, PLACE_TRIP = range(4)
THETA_0, THETA_1, SPIN, ADVANCE = range(4)
JOINTS = 4

# What does not change in a run. tan : of the arc of a link
# low, high, speed, acceleration : (4,) limits of the joints
# origin, up : (3,) of W and its z;  gravity : (3,);  sensor : [m] from sensor to face
Linkage = namedtuple('Linkage', (
    'radius links tan low high speed acceleration origin up gravity '
    'tool_mass tool_centre sensor'))
Rules = namedtuple('Rules', (
    'period touch release release_time goal_rate tissue force_most speed_most reach floor rate '
    'bandwidth force_gain force_rate integral_most'))
# What a tick asks for. q, dq : (4,) goal and how it moves;  the rest as in `arm_loop.Task`
Task = namedtuple('Task', 'mode q dq axial seek goal away')
# The tissue's answer, the probe's true pose that it belongs to, and bent : (6, 6) (1 + C K)^-1 C.
Touch = namedtuple('Touch', 'R p wrench stiffness bent')
# q, dq : (4,) of the joints;  lead, dlead : (4,) of the reference;  R, p : the probe's true pose
# wrench : (6,) axes of P, compensated;  true_wrench : (6,);  bias, weighed : of the tool
Memory = namedtuple('Memory', (
    'q dq lead dlead R p bias weighed reading wrench true_wrench flags values'))
IN_CONTACT, TRIP, QUIET = range(3)                      # flags; QUIET counts periods
INTEGRAL, GOAL, SLOPE, MEASURED, RETREAT_TO = range(5)  # values [N s, N, N/s, N, m]


def start_memory(linkage, q, load):
    """Return the Memory at rest at q (4,).  load : force_torque.ToolLoad"""
    R, p = pose(linkage, np.asarray(q, dtype=float))
    return Memory(np.array(q, dtype=float), np.zeros(JOINTS), np.array(q, dtype=float),
                  np.zeros(JOINTS), R, p, np.array(load.bias),
                  np.array([load.mass, *load.centre]), np.zeros(6), np.zeros(6), np.zeros(6),
                  np.zeros(3, dtype=np.int64), np.zeros(5))


@numba.njit(cache=True)
def triad(linkage, q):
    """Return (radial, polar, azimuth) (3,) at the carrier, and the polar angle with its slope."""
    c = np.cos(q[THETA_1])
    polar = linkage.links * np.arctan(linkage.tan * c)
    slope = -linkage.links * linkage.tan * np.sin(q[THETA_1]) / (1.0 + (linkage.tan * c)**2)
    sp, cp, s0, c0 = np.sin(polar), np.cos(polar), np.sin(q[THETA_0]), np.cos(q[THETA_0])
    return (np.array([sp * c0, sp * s0, cp]), np.array([cp * c0, cp * s0, -sp]),
            np.array([-s0, c0, 0.0]), polar, slope)


@numba.njit(cache=True)
def pose(linkage, q):
    """Return (R (3, 3), p (3,)) of the probe by the encoders q (4,)."""
    radial, polar, azimuth, _, _ = triad(linkage, q)
    c, s = np.cos(q[SPIN]), np.sin(q[SPIN])
    R = np.empty((3, 3))
    for i in range(3):
        R[i, 0] = c * azimuth[i] - s * polar[i]
        R[i, 1] = c * polar[i] + s * azimuth[i]
        R[i, 2] = -radial[i]
    return R, (linkage.radius - q[ADVANCE]) * radial


def probe_jacobian(linkage, q):
    """Return J (6, 4): velocity and angular velocity of the probe per joint rate."""
    radial, _, azimuth, _, slope = triad(linkage, q)
    p = (linkage.radius - q[ADVANCE]) * radial
    axes = np.array([[0.0, 0.0, 1.0], slope * azimuth, radial])
    J = np.zeros((6, JOINTS))
    J[3:, :ADVANCE], J[:3, :ADVANCE] = axes.T, np.cross(axes, p).T
    J[:3, ADVANCE] = -radial
    return J


def joint_rates(linkage, q, v, w):
    """Return dq (4,) that turns the probe's axis with w (3,), spins with it, goes out with v (3,).

    Of v only the part along the radius is taken; the rest follows from w. Valid within the stroke,
    where neither the sine of the polar angle nor its slope is zero.
    """
    radial, polar, azimuth, angle, slope = triad(linkage, q)
    turn = np.cross(w, radial)
    swing = (turn @ azimuth) / np.sin(angle)
    return np.array([swing, (turn @ polar) / slope, w @ radial - swing * np.cos(angle),
                     -(v @ radial)])


@numba.njit(cache=True)
def run_tick(linkage, rules, task, touch, memory, errors, forces):
    """Advance by len(forces) periods; forces receives what the sensor read along the axis [N].

    errors : (k, 6) zero and noise of the sensor in each period
    """
    for k in range(len(forces)):
        R, p = pose(linkage, memory.q)
        _bend(linkage, touch, memory, R, p)
        memory.values[MEASURED] = read_wrench(linkage, memory, memory.R, errors[k])
        if memory.flags[TRIP] == NO_TRIP and (task.mode == POSE or task.mode == FORCE):
            memory.flags[TRIP] = _tripped(linkage, rules, memory, p)
            if memory.flags[TRIP] == FORCE_TRIP:
                memory.values[RETREAT_TO] = memory.q[ADVANCE] - task.away
        mode = task.mode
        if memory.flags[TRIP] != NO_TRIP and (mode == POSE or mode == FORCE):
            mode = RETREAT if memory.flags[TRIP] == FORCE_TRIP else BRAKE
        _notice_contact(rules, mode, task, memory)
        _lead(linkage, rules, mode, task, memory, k * rules.period)
        _serve(linkage, rules, memory)
        forces[k] = memory.values[MEASURED]
    # What stands at the end of the tick is what the tissue meets next.
    R, p = pose(linkage, memory.q)
    _bend(linkage, touch, memory, R, p)


@numba.njit(cache=True)
def _bend(linkage, touch, memory, R, p):
    """The probe's true pose and what the tissue does to it, from its pose by the encoders."""
    memory.R[:] = R
    memory.p[:] = p
    memory.true_wrench[:] = contact_wrench(R, p, touch.R, touch.p, touch.wrench, touch.stiffness)
    d = touch.bent @ memory.true_wrench
    memory.R[:] = rotation(d[3:]) @ R
    memory.p[:] = p + d[:3]
    memory.true_wrench[:] = contact_wrench(memory.R, memory.p, touch.R, touch.p, touch.wrench,
                                           touch.stiffness)


@numba.njit(cache=True)
def _tripped(linkage, rules, memory, p):
    """The first limit that is passed, NO_TRIP if none is. The servos keep those of the joints."""
    f = memory.wrench[:3]
    if f @ f > rules.force_most**2:
        return FORCE_TRIP
    _, _, _, angle, slope = triad(linkage, memory.q)
    out = linkage.radius - memory.q[ADVANCE]
    v = np.array([out * np.sin(angle) * memory.dq[THETA_0], out * slope * memory.dq[THETA_1],
                  memory.dq[ADVANCE]])
    if v @ v > rules.speed_most**2:
        return SPEED_TRIP
    place = p - linkage.origin
    if place @ place > rules.reach**2 or linkage.up @ place < rules.floor:
        return PLACE_TRIP
    return NO_TRIP


@numba.njit(cache=True)
def _notice_contact(rules, mode, task, memory):
    """Touch and loss, by the measured force; on a touch the goal goes on from what is there.

    From the force and its rise at touch it comes to what is asked for as in `arm_loop`.
    """
    flags, values = memory.flags, memory.values
    force = values[MEASURED]
    if mode != FORCE:
        flags[IN_CONTACT] = 0
    elif not flags[IN_CONTACT]:
        if force > rules.touch:
            flags[IN_CONTACT], flags[QUIET] = 1, 0
            values[INTEGRAL], values[GOAL] = 0.0, force
            rise = rules.tissue * (memory.dq[ADVANCE] - task.axial)
            fastest = rules.goal_rate * max(task.goal - force, 0.0)
            values[SLOPE] = min(max(rise, 0.0), fastest)
    else:
        flags[QUIET] = flags[QUIET] + 1 if force < rules.release else 0
        if flags[QUIET] * rules.period > rules.release_time:
            flags[IN_CONTACT] = 0
    w = rules.goal_rate
    pull = w * w * (task.goal - values[GOAL]) - 2.0 * w * values[SLOPE]
    values[SLOPE] += rules.period * pull
    values[GOAL] += rules.period * values[SLOPE]


@numba.njit(cache=True)
def _lead(linkage, rules, mode, task, memory, since):
    """Advance the reference of every joint towards its goal, within its limits."""
    dt = rules.period
    for i in range(JOINTS):
        low, high = linkage.low[i], linkage.high[i]
        wanted = 0.0
        if mode == POSE or (mode == FORCE and i != ADVANCE):
            goal = min(max(task.q[i] + since * task.dq[i], low), high)
            wanted = task.dq[i] + rules.rate * (goal - memory.lead[i])
        elif mode == FORCE:
            wanted = _stage_velocity(linkage, rules, task, memory)
        elif mode == RETREAT and i == ADVANCE:
            goal = min(max(memory.values[RETREAT_TO], low), high)
            wanted = rules.rate * (goal - memory.lead[i])
        wanted = min(max(wanted, rules.rate * (low - memory.lead[i])),
                     rules.rate * (high - memory.lead[i]))
        wanted = min(max(wanted, -linkage.speed[i]), linkage.speed[i])
        most = dt * linkage.acceleration[i]
        change = wanted - memory.dlead[i]
        if not (mode == FORCE and i == ADVANCE):    # the loop of the force has its own poles
            change *= min(1.0, 4.0 * rules.rate * dt)
        memory.dlead[i] += min(max(change, -most), most)
        memory.lead[i] += dt * memory.dlead[i]


@numba.njit(cache=True)
def _stage_velocity(linkage, rules, task, memory):
    """[m/s] towards the centre: seek the skin, or keep the force on it."""
    values = memory.values
    if not memory.flags[IN_CONTACT]:
        return task.seek
    error = values[GOAL] - values[MEASURED]
    plain = (task.axial + values[SLOPE] / rules.tissue
             + rules.force_gain * (error + rules.force_rate * values[INTEGRAL]))
    if abs(plain) < linkage.speed[ADVANCE]:         # else it would only wind up
        grown = values[INTEGRAL] + rules.period * error
        values[INTEGRAL] = min(max(grown, -rules.integral_most), rules.integral_most)
    return plain


@numba.njit(cache=True)
def _serve(linkage, rules, memory):
    """Move the joints: position loops after the reference, within speed and acceleration."""
    w, dt = rules.bandwidth, rules.period
    for i in range(JOINTS):
        pull = w * (w * (memory.lead[i] - memory.q[i])
                    + 2.0 * (memory.dlead[i] - memory.dq[i]))
        most = linkage.acceleration[i]
        speed = memory.dq[i] + dt * min(max(pull, -most), most)
        memory.dq[i] = min(max(speed, -linkage.speed[i]), linkage.speed[i])
        memory.q[i] += dt * memory.dq[i]
