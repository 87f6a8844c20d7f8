"""The pushes of a recording as moves that a cell can make again."""

from dataclasses import replace

import numpy as np

from arm_brachy.control.moves import Move, PadTarget, least_hold
from arm_brachy.core.quantity import quantities

FINEST = 1e-5       # m, targets are rounded to


def moves_of(motion, pads, actuators, tick):
    """control.moves.Move each, from a motion.Motion of core.scene.PadPatch pads (p); a tuple.

    actuators : ActuatorParams;  tick : [s] of the cell that is to make them
    One move per ramp, with the stand after it, as long as the cell has to stand; what an encoder's
    noise adds below home, beyond the stroke or to the speed is cut off. What leads nowhere, or
    more slowly than a cell goes, is part of a stand.
    """
    stroke = np.array([pad.stroke for pad in pads])
    speed_info = quantities(Move)['speed']
    slowest = speed_info.low * speed_info.scale
    out, at = [], np.zeros(len(pads))
    for first, stop in motion.phases():
        goal = np.clip(FINEST * np.round(motion.q[stop] / FINEST), 0.0, stroke)
        speed = min(float(np.abs(motion.velocity[first:stop]).max()), actuators.max_speed)
        if motion.still[first] or speed < slowest or np.array_equal(goal, at):
            if out:
                out[-1] = _longer(out[-1], float(motion.t[stop] - motion.t[first]))
            continue
        at = goal
        out.append(Move(f'push_{len(out) + 1}', speed, tuple(
            PadTarget(pad.name, float(q)) for pad, q in zip(pads, goal, strict=True)), hold=0.0))
    return tuple(replace(one, hold=max(one.hold, least_hold(one.speed, actuators, tick)))
                 for one in out)


def _longer(move, stand):
    """A Move that holds for `stand` [s] more."""
    return replace(move, hold=move.hold + stand)
