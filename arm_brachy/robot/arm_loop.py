"""One period of the arm's loop, compiled: contact, sensor, limits, reference, torques.

The order is that of a real cell: what the tissue does to the probe, what the sensor reads of it,
what that says about contact and limits, where the reference goes, which torques follow. What the
motors really give the joints (torque less friction, plus what the contact puts on them) goes to
the simulation of the arm. Base frame of the arm, SI. Arrays in `Memory` are changed in place.

`run_period` takes each of these groups as one structured array (`packed`): their seventy arrays
and numbers, handed over one by one, take about as long as the period itself.
"""

from collections import namedtuple

import numba
import numpy as np

from arm_brachy.robot.contact_model import contact_wrench
from arm_brachy.robot.force_torque import read_wrench
from arm_brachy.robot.friction import friction_torque
from arm_brachy.robot.impedance import axial_force, force_slope, impedance_torque, shaped
from arm_brachy.robot.reference import rotation, rotation_vector, towards
from arm_brachy.robot.rigid_body import (
    end_effector,
    frames,
    mass_matrix,
    newton_euler,
    point_jacobian,
)
from arm_brachy.robot.switched import switched_velocity

# What a tick asks for: a pose; lateral pose and force along the axis; a stop; a way off the skin.
POSE, FORCE, BRAKE, RETREAT = range(4)
NO_TRIP, FORCE_TRIP, SPEED_TRIP, PLACE_TRIP, JOINT_TRIP = range(5)
REFRESH = 10        # periods between two shapings of damping and null space

# What does not change in a run. Names as in rigid_body.Arm, panda_parameters, ProbeArmParams.
Machine = namedtuple('Machine', (
    'dh mass centre inertia tip gravity low high joint_speed torque torque_rate posture '
    'friction_level friction_slope friction_shift friction_known tool_mass tool_centre sensor'))
Rules = namedtuple('Rules', (
    'period touch release release_time goal_rate force_most speed_most centre radius floor '
    'joint_margin joint_share side_rate switched'))
# What a tick asks for. R, p : goal at its start;  v, w : how the goal moves;  axial : [m/s] with
# which the skin is expected to move along the axis;  seek : [m/s] along the axis while nothing is
# touched;  goal : [N];  away : [m] of a retreat
Task = namedtuple('Task', 'mode R p v w axial seek goal away')
# The tissue's answer, and the probe's pose that it belongs to.
Touch = namedtuple('Touch', 'R p wrench stiffness')
# What the loop remembers. R, p, v, w, a, dw : reference;  side : [N] across the axis, filtered
# bias, weighed : (6,), (4,) of the tool as calibrated;  reading : (6,) sum over a tick
# wrench : (6,) on the probe, axes of P, compensated;  true_wrench : (6,) the contact's, base frame
Memory = namedtuple('Memory', (
    'q dq R p v w a dw torque inertia damping null side bias weighed reading wrench true_wrench '
    'retreat integrals flags values'))
# flags. QUIET counts periods; PRESSING: there is force to control, which ends before the contact
IN_CONTACT, TRIP, QUIET, RUN, POSITIONING, PRESSING = range(6)
# values [N], [N/s]: the goal and how it rises; the force as measured, as observed, how it rises
INTEGRAL, GOAL, GOAL_SLOPE, MEASURED, OBSERVED, SLOPE = range(6)


def packed(group):
    """Return a named tuple of arrays and numbers as a structured array (1,), as compiled code
    takes it for the tuple; its fields are copies."""
    parts = {name: np.asarray(value) for name, value in group._asdict().items()}
    out = np.zeros(1, dtype=[(name, part.dtype, part.shape) for name, part in parts.items()])
    for name, part in parts.items():
        out[name][0] = part
    return out


def unpacked(kind, array):
    """Return the named tuple `kind` whose arrays are those in a structured array (1,): views."""
    return kind(*(array[name][0] for name in kind._fields))


def start_memory(q, R, p, torque, load):
    """Return the Memory of an arm at rest.

    q : (7,);  R, p : end effector;  torque : (7,) that holds it;  load : force_torque.ToolLoad
    """
    n = len(q)
    return Memory(
        q=np.array(q, dtype=float), dq=np.zeros(n), R=np.array(R), p=np.array(p), v=np.zeros(3),
        w=np.zeros(3), a=np.zeros(3), dw=np.zeros(3), torque=np.array(torque, dtype=float),
        inertia=np.zeros((6, 6)), damping=np.zeros((6, 6)), null=np.zeros((n, n)),
        side=np.zeros(3),
        bias=np.array(load.bias), weighed=np.array([load.mass, *load.centre]),
        reading=np.zeros(6), wrench=np.zeros(6), true_wrench=np.zeros(6), retreat=np.zeros(3),
        integrals=np.zeros(7), flags=np.zeros(6, dtype=np.int64), values=np.zeros(6))


@numba.njit(cache=True)
def run_period(machine, rules, gains, switched, rates, limits, task, touch, memory, errors, since):
    """Advance the control by one period; return what moves the simulated joints (7,) [N m].

    machine, rules, task, touch, memory : `packed`;  memory q, dq : joint states read just before
    gains, switched : impedance.Gains, switched.SwitchedGains, `packed`
    rates, limits : of `lead_limits`
    errors : (6,) zero and noise of the sensor in this period;  since : [s] since the tick began
    """
    return _period(machine[0], rules[0], gains[0], switched[0], rates, limits, task[0], touch[0],
                   memory[0], errors, since)


@numba.njit(cache=True, inline='always')
def _period(machine, rules, gains, switched, rates, limits, task, touch, memory, errors, since):
    q, dq = memory.q, memory.dq
    Rs, ps = frames(machine.dh, q)
    R, p = Rs[-1].copy(), end_effector(Rs, ps, machine.tip)
    J = point_jacobian(Rs, ps, p, len(q))
    twist = J @ dq
    memory.true_wrench[:] = contact_wrench(R, p, touch.R, touch.p, touch.wrench, touch.stiffness)
    memory.values[MEASURED] = read_wrench(machine, memory, R, errors)
    if memory.flags[TRIP] == NO_TRIP and (task.mode == POSE or task.mode == FORCE):
        memory.flags[TRIP] = _tripped(machine, rules, memory, p, twist)
        if memory.flags[TRIP] == FORCE_TRIP:
            memory.retreat[:] = p - task.away * R[:, 2]
    mode = task.mode
    if memory.flags[TRIP] != NO_TRIP and (mode == POSE or mode == FORCE):
        mode = RETREAT if memory.flags[TRIP] == FORCE_TRIP else BRAKE
    speed = R[:, 2].copy() @ twist[:3] - task.axial
    _notice_contact(rules, gains, mode, task, memory, speed)
    _lead(rules, switched, rates, limits, mode, task, memory, R, p, twist, since)
    if memory.flags[RUN] % REFRESH == 0:
        M = mass_matrix(Rs, ps, machine.mass, machine.centre, machine.inertia)
        memory.inertia[:], memory.damping[:], memory.null[:] = shaped(M, J, gains)
    memory.flags[RUN] += 1
    _drive(machine, rules, gains, memory, J, R, p, twist, speed)
    return memory.torque + J.T @ memory.true_wrench - friction_torque(
        dq, machine.friction_level, machine.friction_slope, machine.friction_shift)


@numba.njit(cache=True)
def _tripped(machine, rules, memory, p, twist):
    """The first limit that is passed, NO_TRIP if none is."""
    f = memory.wrench[:3]
    if f @ f > rules.force_most**2:
        return FORCE_TRIP
    for i in range(len(memory.q)):
        inside = min(memory.q[i] - machine.low[i], machine.high[i] - memory.q[i])
        fast = abs(memory.dq[i]) > rules.joint_share * machine.joint_speed[i]
        if inside < rules.joint_margin or fast:
            return JOINT_TRIP
    if twist[:3] @ twist[:3] > rules.speed_most**2:
        return SPEED_TRIP
    out = p - rules.centre
    if out @ out > rules.radius**2 or p[2] < rules.floor:
        return PLACE_TRIP
    return NO_TRIP


@numba.njit(cache=True)
def _notice_contact(rules, gains, mode, task, memory, speed):
    """Touch and loss, by the measured force; on a touch the goal goes on from what is there.

    Size and slope of the goal go over without a jump; from there it comes to the force asked for
    as a critically damped filter of second order does, hence without overshoot of its own.
    Where nothing presses back the force is no longer controlled, at once: it would push the probe
    into whatever comes. speed : [m/s] along the axis, as in `axial_force`
    """
    flags, values = memory.flags, memory.values
    force = values[MEASURED]
    if mode != FORCE:
        flags[PRESSING] = 0
        # While the arm brakes or leaves the skin, the probe still touches what it pressed on.
        if mode == POSE or force < rules.release:
            flags[IN_CONTACT] = 0
    elif not flags[PRESSING]:
        flags[QUIET] += 1
        if force > rules.touch:
            flags[IN_CONTACT], flags[PRESSING] = 1, 1
            _take_over(rules, gains, task, memory, speed)
        elif flags[QUIET] * rules.period > rules.release_time:
            flags[IN_CONTACT] = 0
    elif force < rules.release:
        flags[PRESSING], flags[QUIET] = 0, 1
    values[SLOPE] = force_slope(force, values[OBSERVED], speed, gains)
    values[OBSERVED] += rules.period * values[SLOPE]
    w = rules.goal_rate
    pull = w * w * (task.goal - values[GOAL]) - 2.0 * w * values[GOAL_SLOPE]
    values[GOAL_SLOPE] += rules.period * pull
    values[GOAL] += rules.period * values[GOAL_SLOPE]


@numba.njit(cache=True)
def _take_over(rules, gains, task, memory, speed):
    """From motion to force: the goal begins with the force, and its rise, that are there."""
    values, force = memory.values, memory.values[MEASURED]
    values[INTEGRAL], values[GOAL], values[OBSERVED] = 0.0, force, force
    fastest = rules.goal_rate * max(task.goal - force, 0.0)
    values[GOAL_SLOPE] = min(max(gains.tissue * speed, 0.0), fastest)
    memory.integrals[:] = 0.0


@numba.njit(cache=True)
def _lead(rules, switched, rates, limits, mode, task, memory, R, p, twist, since):
    """Advance the reference. Along the axis it goes with the probe while that is in contact."""
    z = R[:, 2].copy()
    touching = memory.flags[PRESSING] == 1
    wanted, turning = np.zeros(3), np.zeros(3)
    if mode == RETREAT:
        wanted[:] = rates[0] * (memory.retreat - memory.p)
    elif mode != BRAKE and rules.switched and mode == FORCE:
        wanted, turning, positioning = switched_velocity(
            switched, rules.period, R, p, twist[:3], twist[3:], rotation(since * task.w) @ task.R,
            task.p + since * task.v, memory.values[GOAL] - memory.values[MEASURED], touching,
            memory.flags[POSITIONING] == 1, memory.integrals)
        memory.flags[POSITIONING] = 1 if positioning else 0
        if not touching:
            wanted += task.seek * z
    elif mode != BRAKE:
        R_goal = rotation(since * task.w) @ task.R
        turning[:] = task.w + rates[0] * (memory.R @ rotation_vector(memory.R.T @ R_goal))
        wanted[:] = task.v + rates[0] * (task.p + since * task.v - memory.p)
        if mode == FORCE:
            wanted += z * ((0.0 if touching else task.seek) - z @ wanted)
    memory.v[:], memory.a[:] = towards(wanted, memory.v, memory.a, rates, limits[0], rules.period)
    memory.w[:], memory.dw[:] = towards(turning, memory.w, memory.dw, rates, limits[1],
                                        rules.period)
    memory.p[:] += rules.period * memory.v
    memory.R[:] = rotation(rules.period * memory.w) @ memory.R
    if touching and not rules.switched:
        memory.p[:] += z * (z @ (p - memory.p))
        memory.v[:] += z * (z @ (twist[:3] - memory.v))
        memory.a[:] -= z * (z @ memory.a)


@numba.njit(cache=True)
def _drive(machine, rules, gains, memory, J, R, p, twist, speed):
    """Motor torques into memory.torque, within the limits of size and rate."""
    q, dq, values = memory.q, memory.dq, memory.values
    z = R[:, 2].copy()
    touching = memory.flags[PRESSING] == 1 and not rules.switched
    axial = 0.0
    side = np.zeros(3)
    if touching:
        error = values[GOAL] - values[MEASURED]
        grown = values[INTEGRAL] + gains.force_rate * rules.period * error
        values[INTEGRAL] = min(max(grown, -gains.force_most), gains.force_most)
        axial = axial_force(values[GOAL], values[MEASURED], values[INTEGRAL],
                            values[GOAL_SLOPE] - values[SLOPE], speed, gains)
        side = R @ memory.wrench[:3]
        side -= z * (z @ side)
    memory.side[:] += rules.side_rate * (side - memory.side)
    wanted = impedance_torque(J, R, p, memory.inertia, memory.damping, memory.null, gains,
                              machine.posture, machine.low, machine.high, q, dq, memory.R,
                              memory.p, memory.v, memory.w, memory.a, memory.dw, touching, axial)
    wanted -= J[:3].T @ memory.side
    wanted += newton_euler(machine.dh, machine.mass, machine.centre, machine.inertia,
                           machine.gravity, q, dq, np.zeros(len(q)))
    wanted += machine.friction_known * friction_torque(
        dq, machine.friction_level, machine.friction_slope, machine.friction_shift)
    change = rules.period * machine.torque_rate
    for i in range(len(q)):
        low, high = memory.torque[i] - change[i], memory.torque[i] + change[i]
        torque = min(max(wanted[i], low), high)
        memory.torque[i] = min(max(torque, -machine.torque[i]), machine.torque[i])
