"""The pushes of a recording as moves that a cell can make again."""

import numpy as np

from arm_brachy.control.moves import Move, PadTarget, least_hold

FINEST = 1e-5       # m, targets are rounded to


def moves_of(motion, pads, actuators, tick):
    """control.moves.Move each, from a motion.Motion of core.scene.PadPatch pads (p); a tuple.

    actuators : ActuatorParams;  tick : [s] of the cell that is to make them
    One move per ramp, with the stand after it, as long as the cell has to stand; what an encoder's
    noise adds below home, beyond the stroke or to the speed is cut off.
    """
    stroke = np.array([pad.stroke for pad in pads])
    out = []
    phases = motion.phases()
    for k, (first, stop) in enumerate(phases):
        if motion.still[first]:
            continue
        goal = np.clip(FINEST * np.round(motion.q[stop] / FINEST), 0.0, stroke)
        speed = min(float(np.abs(motion.velocity[first:stop]).max()), actuators.max_speed)
        hold = least_hold(speed, actuators, tick)
        if k + 1 < len(phases) and motion.still[phases[k + 1][0]]:
            hold = max(hold, float(motion.t[phases[k + 1][1]] - motion.t[phases[k + 1][0]]))
        out.append(Move(f'push_{len(out) + 1}', speed, tuple(
            PadTarget(pad.name, float(q)) for pad, q in zip(pads, goal, strict=True)), hold=hold))
    return tuple(out)
