"""How well a probe followed a needle, and how well the needle met its target.

All distances are of the true tip, all over the step INSERTING unless they say otherwise:
    out of plane     y_P . (p_tip - p_P), distance of the tip from the image plane
    localisation     tip found in the image, placed by the arm's encoders, less the true tip
    target located   target by its outlines in the images less the true target, over INSERTING
                     and DWELLING
    off axis         distance of the tip from the axis of its hole
    turns            how often the needle was turned at its base
    insertion length way of the needle by its told depth, first to deepest
    miss             distance of tip and target, mean over DWELLING; across and along the needle
    seed miss        distance of a seed, left at the tip at the end of DWELLING, from the target,
                     once needle, probe and pads are gone: both in the body at rest
    off plan         distance of the tip, at the end, from the planned path where that is as deep
    force            see procedure_force; goals are judged by the true one, by the measured one
                     where a recording has no truth
Effort of the arm: mean over time of the joint torques' norm, and the path that joints went.
"""

from dataclasses import dataclass, fields

import numpy as np
from scipy.interpolate import CubicSpline

from arm_brachy.evaluation.material_point import at_rest
from arm_brachy.evaluation.procedure_data import sampled, vector
from arm_brachy.evaluation.procedure_force import force_figures
from arm_brachy.evaluation.result import Target
from arm_brachy.evaluation.timeseries import Series

MM = 1e3
IN_PLANE = 0.5e-3    # m: goal for the distance of the tip from the image plane
IN_PLANE_SHARE = 0.95
FORCE_RMS = 0.1      # N
STEADY = 0.01        # N
TARGETED = 1.56e-3   # m, tip to target; 0.86 and two sd of 0.35 mm, steered needles under a probe
                     # that follows them, Vrooijink et al. 2014, IJRR
LOCALISED = 0.5e-3   # m, rms
FOUND = 0.95         # share of frames
FORCE_OVER = 0.3     # N
FRAME_RATE = 20.0    # Hz, of the imager
_TURNED = 1e-3       # rad between two samples that make a turn


@dataclass(frozen=True)
class ProcedureMetrics:
    """Numbers of a procedure, SI; NaN where they cannot be said.

    outcome : name;  message : why it is not OK, '' if it is;  duration : [s]
    in_plane : share of the insertion within IN_PLANE
    found : share of the frames of the insertion in which the tip was found
    """

    outcome: str
    message: str
    duration: float
    insertion: float
    insertion_length: float
    turns: float
    in_plane: float
    plane_rms: float
    plane_largest: float
    localisation_rms: float
    found: float
    off_axis_largest: float
    off_axis_end: float
    off_plan_end: float
    miss: float
    miss_across: float
    miss_along: float
    miss_pads: float
    seed_miss: float
    target_located_rms: float
    force_rms: float
    force_steady: float
    force_peak: float
    force_overshoot: float
    true_force_rms: float
    true_force_steady: float
    true_force_peak: float
    true_force_overshoot: float
    torque: float
    joint_travel: float
    needle_peak: float


def out_of_plane(tip, probe):
    """Series (n,) [m] of the true tip from the true image plane, at the tip's times.

    tip : Series (n, 3);  probe : Series (m, 12)
    """
    pose = sampled(probe, tip.t)
    return Series(tip.t, np.einsum('ni,ni->n', pose[:, 1:9:3], tip.values - pose[:, 9:]))


def assess_procedure(data, target, tissue=None):
    """Return ProcedureMetrics.

    data : ProcedureData;  target : Series (n, 3) of the true target, or None
    tissue : timeseries.Tissue, for the place of a seed; None = not known
    """
    values = {f.name: np.nan for f in fields(ProcedureMetrics)}
    values |= {'outcome': data.outcome, 'message': data.message}
    if data.steps:
        values['duration'] = data.steps[-1][0] - data.steps[0][0]
    inserting, dwelling = data.when('inserting'), data.when('dwelling')
    values |= force_figures(data, inserting, dwelling)
    if inserting is not None:
        values['insertion'] = min(inserting[1], data.steps[-1][0]) - inserting[0]
        values |= _length(data, inserting) | _turns(data, inserting)
        values |= _plane(data, inserting) | _image(data, inserting) | _path(data, inserting)
        values |= _effort(data, inserting)
    if dwelling is not None and target is not None:
        values |= _miss(data, target, dwelling) | _seed(data, target, dwelling, tissue)
    if inserting is not None and target is not None:
        values |= _located(data, target, (inserting if dwelling is None else
                                          (inserting[0], dwelling[1])))
    return ProcedureMetrics(**values)


def _length(data, window):
    depth = np.empty(0) if data.needle is None else data.needle.between(*window).values
    return {'insertion_length': float(depth[:, 0].max() - depth[0, 0])} if len(depth) else {}


def _turns(data, window):
    if data.roll is None:
        return {}
    change = np.abs(np.diff(data.roll.between(*window).values))
    return {'turns': float(np.count_nonzero(change > _TURNED))}


def _plane(data, window):
    if data.tip is None or data.probe is None:
        return {}
    off = np.abs(out_of_plane(data.tip.between(*window), data.probe).values)
    if not len(off):
        return {}
    return {'in_plane': float(np.mean(off <= IN_PLANE)), 'plane_largest': float(off.max()),
            'plane_rms': _rms(off)}


def _image(data, window):
    if data.tip_image is None or data.tip is None:
        return {'found': 0.0} if data.frames else {}
    seen = data.tip_image.between(*window)
    if not len(seen.t):
        return {'found': 0.0}
    off = np.linalg.norm(seen.values - _interpolated(data.tip, seen.t), axis=1)
    last = min(window[1], data.tip.t[-1])
    return {'localisation_rms': _rms(off),
            'found': min(1.0, len(seen.t) / max(1.0, (last - window[0]) * FRAME_RATE))}


def _path(data, window):
    plan = data.plan
    if data.tip is None or not plan:
        return {}
    tips = data.tip.between(*window)
    if not len(tips.t):
        return {}
    off = _across(tips.values - vector(plan['hole_m']), hole_axis(data))
    aside = np.linalg.norm(off, axis=1)
    end = off[-1] - planned_path(data, tips.values[-1:])[0]
    return {'off_axis_largest': float(aside.max()), 'off_axis_end': float(aside[-1]),
            'off_plan_end': float(np.linalg.norm(end))}


def planned_path(data, points):
    """(n, 3) [m] from the axis of the hole to the planned path, level with points (n, 3) [m].

    Beyond its end it goes on as it bent. NaN for a recording without the plan's path.
    """
    if 'path_m' not in data.plan:
        return np.full_like(points, np.nan)
    hole, axis = vector(data.plan['hole_m']), hole_axis(data)
    path = vector(data.plan['path_m']).reshape(-1, 3) - hole
    return CubicSpline(path @ axis, _across(path, axis))((points - hole) @ axis)


def hole_axis(data):
    """(3,) axis of the hole: the needle's direction while it had not bent yet."""
    axis = data.axis.values[0]
    return axis / np.linalg.norm(axis)


def _across(vectors, axis):
    return vectors - np.multiply.outer(vectors @ axis, axis)


def _seed(data, target, window, tissue):
    """How far from the target a seed comes to rest that is left at the tip at the end."""
    if data.tip is None or tissue is None:
        return {}
    shown = np.flatnonzero((tissue.t >= window[0]) & (tissue.t <= window[1]))
    if not len(shown):
        return {}
    last = shown[-1]
    both = np.vstack([_interpolated(s, tissue.t[[last]]) for s in (data.tip, target)])
    seed, rest = at_rest(both, tissue.positions[last], tissue.rest, tissue.tets)
    return {'seed_miss': float(np.linalg.norm(seed - rest))}


def _miss(data, target, window):
    if data.tip is None:
        return {}
    tips = data.tip.between(*window)
    if not len(tips.t):
        return {}
    off = tips.values - _interpolated(target, tips.t)
    axis = hole_axis(data)
    along = off @ axis
    away = _across(_interpolated(target, tips.t) - vector(data.plan['goal_m']), axis)
    return {'miss': float(np.mean(np.linalg.norm(off, axis=1))),
            'miss_along': float(np.mean(np.abs(along))),
            'miss_across': float(np.mean(np.linalg.norm(_across(off, axis), axis=1))),
            'miss_pads': float(np.mean(np.linalg.norm(away, axis=1)))}


def _located(data, target, window):
    if data.target_image is None:
        return {}
    seen = data.target_image.between(*window)
    if not len(seen.t):
        return {}
    off = seen.values - _interpolated(target, seen.t)
    return {'target_located_rms': _rms(np.linalg.norm(off, axis=1))}


def _effort(data, window):
    out = {}
    if data.torque is not None:
        norms = np.linalg.norm(data.torque.between(*window).values, axis=1)
        out['torque'] = float(norms.mean()) if len(norms) else np.nan
    if data.joints is not None:
        q = data.joints.between(*window).values
        out['joint_travel'] = float(np.abs(np.diff(q, axis=0)).sum())
    if data.needle is not None:
        force = data.needle.between(*window).values[:, 2]
        out['needle_peak'] = float(np.abs(force).max()) if len(force) else np.nan
    return out


def _interpolated(series, t):
    return np.column_stack([np.interp(t, series.t, column) for column in series.values.T])


def _rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def procedure_targets(numbers):
    """The goals of a procedure as result.Target; that of the target where its truth is known."""
    def goal(name, value, unit, text, met):
        known = value is not None and np.isfinite(value)
        return Target(name, value, unit, text, bool(met(value)) if known else None)

    truly = np.isfinite(numbers.true_force_rms)

    def force(name, what, goals_text, limit):
        value = getattr(numbers, ('true_' if truly else '') + name)
        return goal(f'contact force, {"true" if truly else "as measured"}: {what}', value, 'N',
                    goals_text, lambda v: v <= limit)

    hit = goal('tip to target at the dwell', numbers.miss * MM, 'mm', f'<= {TARGETED * MM:g}',
               lambda v: v <= TARGETED * MM)
    return (
        Target('procedure', numbers.outcome, '1', '= OK', numbers.outcome == 'OK'),
        *((hit,) if hit.met is not None else ()),
        goal('insertion with the tip within 0.5 mm of the image plane', 100 * numbers.in_plane,
             '%', '>= 95', lambda v: v >= 100 * IN_PLANE_SHARE),
        goal('tip found in the image: frames', 100 * numbers.found, '%', '>= 95',
             lambda v: v >= 100 * FOUND),
        goal('tip found in the image: rms error', numbers.localisation_rms * MM, 'mm', '<= 0.5',
             lambda v: v <= LOCALISED * MM),
        force('force_rms', 'rms error', '<= 0.1', FORCE_RMS),
        # What a controller can do; the true one is off by the drift of the sensor's zero as well.
        goal('contact force, as measured: mean error at the end of the dwell',
             numbers.force_steady, 'N', '<= 0.01', lambda v: v <= STEADY),
        force('force_overshoot', 'overshoot of its goal, touch to withdrawal', '<= 0.3',
              FORCE_OVER))


def procedure_row(numbers):
    """One flat dict, units in the keys."""
    n = numbers
    return {
        'outcome': n.outcome, **({'why': n.message} if n.message else {}),
        'duration_s': n.duration, 'insertion_s': n.insertion,
        'insertion_length_mm': n.insertion_length * MM, 'turns': n.turns,
        'tip_in_plane_percent': 100 * n.in_plane, 'out_of_plane_rms_mm': n.plane_rms * MM,
        'out_of_plane_largest_mm': n.plane_largest * MM,
        'localisation_rms_mm': n.localisation_rms * MM, 'frames_found_percent': 100 * n.found,
        'off_axis_end_mm': n.off_axis_end * MM, 'off_plan_end_mm': n.off_plan_end * MM,
        'tip_to_target_mm': n.miss * MM, 'tip_to_target_across_mm': n.miss_across * MM,
        'tip_to_target_along_mm': n.miss_along * MM, 'target_to_goal_mm': n.miss_pads * MM,
        'seed_to_target_mm': n.seed_miss * MM,
        'target_located_rms_mm': n.target_located_rms * MM,
        'force_rms_N': n.force_rms, 'force_steady_N': n.force_steady,
        'force_peak_error_N': n.force_peak, 'force_overshoot_N': n.force_overshoot,
        'true_force_rms_N': n.true_force_rms, 'true_force_steady_N': n.true_force_steady,
        'true_force_peak_error_N': n.true_force_peak,
        'true_force_overshoot_N': n.true_force_overshoot,
        'torque_mean_Nm': n.torque,
        'joint_travel_rad': n.joint_travel, 'needle_force_peak_N': n.needle_peak}
