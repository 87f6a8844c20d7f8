"""From a bag of a procedure to evaluation.procedure_data, without ROS."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy import cell as cells
from arm_brachy import graph
from arm_brachy.evaluation.procedure_data import ArmPicture, Frame, ProcedureData
from arm_brachy.evaluation.timeseries import Series

FRAME_EVERY = 1.0   # s between pictures that are kept
TURNING = 3         # joints of the scissor linkage that turn; the fourth is a stage


def _xyz(p):
    return np.array([p.x, p.y, p.z])


def _row(pose):
    """Rotation row by row and position (12,) of a Pose."""
    q = pose.orientation
    R = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    return np.concatenate([R.ravel(), _xyz(pose.position)])


def _on_needle(tally, topic, t, msg):
    tally.add('needle', t, (msg.position[0], msg.velocity[0], msg.effort[0]))
    tally.add('roll', t, msg.position[1])


def _on_needle_tip(tally, topic, t, msg):
    tally.add('tip_told', t, _xyz(msg.pose.position))


def _on_image_tip(tally, topic, t, msg):
    tally.add('tip_image', t, _xyz(msg.pose.position))


def _on_image_target(tally, topic, t, msg):
    tally.add('target_image', t, _xyz(msg.pose.pose.position))


def _on_true_needle(tally, topic, t, msg):
    last = _row(msg.poses[-1])
    tally.add('tip', t, last[9:])
    tally.add('axis', t, last[2:9:3])
    tally.shafts[t] = np.array([_xyz(p.position) for p in msg.poses])


def _on_true_probe(tally, topic, t, msg):
    tally.add('probe', t, _row(msg.pose))


def _on_true_contact(tally, topic, t, msg):
    tally.add('contact', t, _xyz(msg.wrench.force))


def _on_probe(tally, topic, t, msg):
    tally.add('probe_told', t, _row(msg.pose))


def _on_probe_state(tally, topic, t, msg):
    tally.add('probe_state', t, (msg.phase, msg.in_contact, msg.force_goal, msg.out_of_plane))
    tally.add('torque', t, np.array(msg.torque))
    tally.periods.append((t, np.array(msg.force)))


def _on_joints(tally, topic, t, msg):
    tally.add('joints', t, np.array(msg.position))


def _on_overlay(tally, topic, t, msg):
    """One picture a second is enough for a report; all of them would fill the memory."""
    if not tally.frames or t - tally.frames[-1].t >= FRAME_EVERY:
        tally.frames.append(Frame(t, np.frombuffer(bytes(msg.data), np.uint8).reshape(
            msg.height, msg.width, 3)))


def _on_procedure(tally, topic, t, msg):
    tally.steps.append((t, {one.key: one.value for one in msg.status[0].values}))


def procedure_of(get, steps, periods, frames, shafts):
    """ProcedureData, or None of a run without one.

    get : callable, name of a signal -> Series or None;  steps : (t, mapping)
    periods : (t, forces of the controller's periods up to t);  frames : Frame
    shafts : t -> (k, 3) of the needle
    """
    if not steps:
        return None
    return ProcedureData(
        steps=tuple(steps), needle=get('needle'), roll=get('roll'), tip=get('tip'),
        axis=get('axis'), tip_told=get('tip_told'), tip_image=get('tip_image'),
        target_image=get('target_image'), probe=get('probe'),
        probe_told=get('probe_told'), state=get('probe_state'), force=_periods(periods),
        contact=get('contact'), joints=get('joints'), torque=get('torque'),
        frames=tuple(frames), shafts=dict(shafts))


def _periods(periods):
    """Series of the forces of all periods, spaced evenly between the messages."""
    if len(periods) < 2:    # noqa: PLR2004 - two ends of an interval
        return None
    tick = periods[1][0] - periods[0][0]
    t = np.concatenate([end - tick * np.arange(len(f))[::-1] / max(1, len(f))
                        for end, f in periods])
    return Series(t, np.concatenate([f for _, f in periods]))


def with_instruments(data, cell):
    """ProcedureData with what only the scenario knows, and a picture of arm and needle.

    data : ProcedureData or None;  cell : scenario.Cell
    """
    if data is None:
        return None
    scenario = cell.scenario
    return replace(data, target=scenario.procedure.target, overlay=scenario.procedure.overlay,
                   strategy=scenario.probe.strategy, control=scenario.probe.control,
                   picture=_picture(data, cell), **_turning(data, cell))


def _turning(data, cell):
    """Joints and torques of what turns alone: metres and newtons of a stage do not add to them."""
    if cell.scenario.probe.probe_holder == 'panda':
        return {}
    return {name: replace(series, values=series.values[:, :TURNING]) for name, series in
            (('joints', data.joints), ('torque', data.torque)) if series is not None}


def _picture(data, cell):
    """The cell in the middle of the dwell, or when the needle was deepest; None if not known."""
    if data.joints is None or data.probe is None or not data.shafts:
        return None
    window = data.when('dwelling')
    t = (data.needle.t[data.needle.values[:, 0].argmax()] if window is None
         else 0.5 * (window[0] + min(window[1], data.steps[-1][0])))
    row = data.probe.values[np.abs(data.probe.t - t).argmin()]
    q = data.joints.values[np.abs(data.joints.t - t).argmin()]
    template = cells.build_template(cell)
    holes = np.array([[template.hole(i, j) for j in range(template.params.rows)]
                      for i in range(template.params.columns)]).reshape(-1, 3)
    times = np.array(list(data.shafts))
    return ArmPicture(t, cells.arm_line(cell, q), row[:9].reshape(3, 3), row[9:], holes,
                      data.shafts[times[np.abs(times - t).argmin()]])


HANDLERS = (
    (graph.NEEDLE_STATE, _on_needle),
    (graph.NEEDLE_TIP, _on_needle_tip), (graph.ULTRASOUND_TIP, _on_image_tip),
    (graph.ULTRASOUND_TARGET, _on_image_target),
    (graph.TRUTH_NEEDLE, _on_true_needle), (graph.TRUTH_PROBE, _on_true_probe),
    (graph.TRUTH_CONTACT, _on_true_contact),
    (graph.PROBE_POSE, _on_probe), (graph.PROBE_STATE, _on_probe_state),
    (graph.PROBE_JOINTS, _on_joints), (graph.ULTRASOUND_OVERLAY, _on_overlay),
    (graph.PROCEDURE, _on_procedure))
# Not decoded: nobody evaluates them, and they are most of a bag.
UNREAD = (graph.ULTRASOUND_IMAGE, graph.ULTRASOUND_INFO, graph.SURFACE)
# Of these the recorder keeps some a second.
DECIMATED = (graph.ULTRASOUND_IMAGE, graph.ULTRASOUND_OVERLAY)
