"""What needs no missing physics to explain it in a release: frames, hands, places, loads.

Columns by which each, at one prior standard deviation, moves the rows of observation.Case.
Test: diagnosis/test_free_release.py
"""

import numpy as np

from arm_brachy.diagnosis.free_vibration.observation import (
    BASE,
    BESIDE,
    CREEP,
    DAMPING,
    FREQUENCY,
    HELD,
    SETTLED,
    SHAPE,
)

STEP = 0.1      # of a standard deviation, over which what a hand did is taken
OTHERS = 0.3    # of the size of other modes, whose damping is not known; own choice
ASIDE = 1e-6    # m, over which differences of where a marker goes are taken


def columns_of(case, specimen, swing, priors, holds, undamped=False):
    """Return (n, j) columns that belong to one recording alone.

    specimen : Specimen, swing : model.Swing of the case;  priors : observation.FreePriors
    holds : m of (initial_shape.Hold, Swing of the body that was held by STEP of it more)
    undamped : True where damping is not known
    Turns and shifts of the tracker 6, the hand m, motion of the base 6 where it is seen, 1 of a
    load that takes no part in the damping, 1 of damping, 1 of other modes.
    """
    points = specimen.rest[case.index]
    moved, shape = swing.moved[-1, case.index], swing.shape[case.index]
    shape = shape / np.linalg.norm(shape)
    base = case.release.base_rest
    every = np.vstack([points, base])
    pivot = (base if len(base) else points).mean(axis=0)
    out = [_turn(case, every - pivot, moved, shape, priors.turn * axis) for axis in np.eye(3)]
    out += [_rows(case, {HELD: np.broadcast_to(priors.frame * axis, every.shape)})
            for axis in np.eye(3)]
    none = np.zeros_like(base)
    out += [_rows(case, {HELD: np.vstack([hold.points[case.index], none]),
                         SETTLED: -hold.points[case.index], **_rung(case, swing, other)})
            for hold, other in holds]
    if len(base):
        out += [_rows(case, {SETTLED: shift, BASE: own}) for shift, own in zip(
            _rigid(points, base, priors.base), _rigid(base, base, priors.base), strict=True)]
    damping = np.array([row.kind == DAMPING for row in case.rows], dtype=float)
    out += [sd * damping for sd in (swing.carried, priors.damped * undamped) if sd]
    out.append(np.array([OTHERS * swing.others * (row.kind == BESIDE) for row in case.rows]))
    return np.column_stack(out)


def _rung(case, swing, other):
    """kind -> change of the ringing, per whole of what it was held by STEP more for `other`."""
    shapes = [one.shape[case.index] / np.linalg.norm(one.shape[case.index])
              for one in (swing, other)]
    return {SHAPE: (shapes[1] - shapes[0]) / STEP,
            FREQUENCY: np.log(other.frequency / swing.frequency) / STEP,
            DAMPING: (other.damping - swing.damping) / STEP}


def places_of(case, model, swing, sd):
    """Return name -> (n, 3), what a marker at another place does, along each axis by `sd` [m].

    model : model.FreeModel. It is seen there while it is held, and goes another way; rings
    as it goes, which of the lowest mode is nearly so.
    """
    names = case.release.names
    way = float(np.linalg.norm(swing.moved[-1, case.index]))
    there = model.displaced(swing.x, np.zeros(3))
    changes = [sd * (model.displaced(swing.x, ASIDE * axis) - there) / ASIDE for axis in np.eye(3)]
    every = (*names, *case.release.base_names)
    out = {}
    for k, name in enumerate(every):
        alone = (np.arange(len(every)) == k)[:, None]
        columns = []
        for axis, changed in zip(np.eye(3), changes, strict=True):
            goes = alone[:len(names)] * changed[case.index]
            columns.append(_rows(case, {HELD: alone * sd * axis, SETTLED: goes,
                                        SHAPE: goes / way}))
        out[name] = np.column_stack(columns)
    return out


def _turn(case, arms, moved, shape, turn):
    """A turn of the frame; what creeps is too little to show it."""
    return _rows(case, {HELD: np.cross(turn, arms), SETTLED: np.cross(turn, moved),
                        SHAPE: np.cross(turn, shape)})


def _rigid(points, pivots, sd):
    """Six small motions (k, 3) of `points` [m]; turns about the middle of `pivots`."""
    arm = points - pivots.mean(axis=0)
    own = pivots - pivots.mean(axis=0)
    lever = max(float(np.sqrt(np.mean(np.sum(own ** 2, axis=1)))), 1e-3)
    shifts = [np.broadcast_to(sd * axis, points.shape) for axis in np.eye(3)]
    return [*shifts, *(sd / lever * np.cross(axis, arm) for axis in np.eye(3))]


def _rows(case, values):
    """(n,) of a mapping kind -> (channels, 3); kinds that are left out are zero.

    Channels on the tissue come first, then those on the base; of BASE there are the latter alone;
    a kind that all channels share has a number.
    """
    names, base = case.release.names, case.release.base_names
    places = {name: k for k, name in enumerate((*names, *base))}
    out = np.zeros(len(case.rows))
    for i, row in enumerate(case.rows):
        if row.kind in values and row.axis < 0:
            out[i] = values[row.kind]
        elif row.kind in values and not row.kind.startswith(CREEP):
            k = places[row.channel] - (len(names) if row.kind == BASE else 0)
            out[i] = values[row.kind][k, row.axis]
    return out
