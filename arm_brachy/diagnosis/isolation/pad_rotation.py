"""Several markers on one pad: the path of its centre, and whether it turns as it goes.

Each marker departs from the push of the encoder by a part of the travel, along it and across
(`pad_tracking`). Of a rigid pad with its centre at c these parts are a + w x (r - c) for a marker
at r: a how the centre departs, w [rad/m] how fast it turns.
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.diagnosis.isolation.pad_tracking import COMPLIANCE, GAIN
from arm_brachy.diagnosis.results.finding import Finding, threshold
from arm_brachy.diagnosis.signals.stream import OPTICAL

FASTEST = 200.0     # rad/m, 11 deg per mm: prior standard deviation, for what two do not show


def one_each(prepared, travels):
    """Return (PadTravel of every pad, one each; name of a pad that turns -> Finding).

    travels : pad_tracking.PadTravel of every marker on a pad
    That of the marker that is seen best stands for its pad; where the markers show that it turns,
    its gain and direction are those of the pad's centre. A marker may be off by what a gain may.
    Test: diagnosis/structural/test_pad_turns.py
    """
    pads, turning = [], {}
    names = dict.fromkeys(one.pad for one in travels)
    for name in names:
        mine = [one for one in travels if one.pad == name]
        best = min(mine, key=lambda one: one.gain[1])
        turn = _turn(prepared, mine) if len(mine) > 1 else None
        if turn is not None and turn.z > threshold(len(names), turn.dof):
            best = _at_centre(best, turn)
            turning[name] = _finding(prepared, best, turn)
        pads.append(best)
    return tuple(pads), turning


@dataclass(frozen=True)
class _Turn:
    """How the markers of one pad depart together, per metre of its travel, frame of its push.

    mean, sd : (6,) centre along, up and side, then the turn [rad/m];  z, dof : of the turn
    bent : [1/m] by which a marker departs more per travel, to second order in the turn
    """

    mean: np.ndarray
    sd: np.ndarray
    z: float
    dof: int
    bent: float


def _turn(prepared, mine):
    """The _Turn that the PadTravels of one pad show."""
    evidence, slack = prepared.evidence, prepared.calibration.gain
    optical = evidence.get(OPTICAL)
    centre = next(np.array(p.centre) for p in evidence.scene.pads if p.name == mine[0].pad)
    rows, off, levers = [np.eye(6)[3:] / FASTEST], [np.zeros(3)], []
    for one in mine:
        lever = one.frame @ (optical.rest[optical.names.index(one.marker)] - centre)
        levers.append(np.linalg.norm(lever))
        sd = np.hypot([one.gain[1], *one.tilt_sd], slack)
        rows.append(np.hstack([np.eye(3), -_cross(lever)]) / sd[:, None])
        off.append(np.array([one.gain[0], *one.tilt]) / sd)
    A, y = np.vstack(rows), np.concatenate(off)
    covariance = np.linalg.inv(A.T @ A)
    mean = covariance @ A.T @ y
    still = np.linalg.lstsq(A[:, :3], y, rcond=None)[0]
    fall = np.sum((y - A[:, :3] @ still) ** 2) - np.sum((y - A @ mean) ** 2)
    return _Turn(mean, np.sqrt(np.diag(covariance)), float(np.sqrt(max(fall, 0.0))),
                 2 if len(mine) == 2 else 3, float(0.5 * mean[3:] @ mean[3:] * max(levers)))


def _cross(v):
    """(3, 3) matrix that takes w to v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _at_centre(best, turn):
    """The PadTravel with gain and direction of the pad's centre."""
    sd = np.hypot(turn.sd[:3], turn.bent * best.moved)
    gain = float(turn.mean[0]), float(sd[0])
    kept = {cause: one for cause, one in best.causes.items() if cause not in (GAIN, COMPLIANCE)}
    return replace(best, causes=kept | {GAIN: gain}, gain=gain, tilt=turn.mean[1:3],
                   tilt_sd=sd[1:], rivals={GAIN: (COMPLIANCE,)} if COMPLIANCE in best.all else {})


def _finding(prepared, one, turn):
    rate = float(np.linalg.norm(turn.mean[3:]))
    least = 'at least ' if turn.dof == 2 else ''    # a turn about the line of two does not show
    return Finding(OPTICAL, one.marker, None, '', rate, 'rad/m', float(turn.sd[3:].max()), turn.z,
                   *map(float, prepared.evidence.span),
                   f'The markers on {one.pad} show that it turns by {least}'
                   f'{np.degrees(1e-3 * rate):.2f} deg per mm of its travel, which no term says; '
                   'they were not compared with the model.')
