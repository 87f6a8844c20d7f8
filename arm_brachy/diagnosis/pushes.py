"""The pushes of a recording as moves that a cell can make again."""

import numpy as np

from arm_brachy.control.moves import Move, PadTarget

FINEST = 1e-5       # m, targets are rounded to


def moves_of(motion, pads):
    """control.moves.Move each, from a motion.Motion of pads (p names); a tuple.

    One per ramp, with the stand after it; positions below zero, an encoder's noise, are home.
    """
    out = []
    phases = motion.phases()
    for k, (first, stop) in enumerate(phases):
        if motion.still[first]:
            continue
        goal = np.maximum(FINEST * np.round(motion.q[stop] / FINEST), 0.0)
        speed = float(np.abs(motion.velocity[first:stop]).max())
        hold = 0.0
        if k + 1 < len(phases) and motion.still[phases[k + 1][0]]:
            hold = float(motion.t[phases[k + 1][1]] - motion.t[phases[k + 1][0]])
        out.append(Move(f'push_{len(out) + 1}', speed, tuple(
            PadTarget(name, float(q)) for name, q in zip(pads, goal, strict=True)), hold=hold))
    return tuple(out)
