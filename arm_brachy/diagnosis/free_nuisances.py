"""What needs no missing physics to explain it in a release: frames, hands, places, mesh, modulus.

Columns by which each, at one prior standard deviation, moves the rows of free_table.Case.
Test: diagnosis/test_free_release.py
"""

import numpy as np

from arm_brachy.diagnosis.free_table import BASE, CREEP, SETTLED, SHAPE


def columns_of(case, model, swing, priors, placement):
    """Return (n, j) columns that belong to one recording alone.

    model : free_model.FreeModel, swing : its Swing;  priors : free_table.FreePriors
    placement : [m] standard deviation per axis of a marker's place in the tissue
    Turns of the tracker 3, the hand 6, motion of the base 6 where it is seen, places 3 a channel.
    """
    points = model.specimen.rest[case.index]
    moved, shape = swing.moved[-1, case.index], swing.shape[case.index]
    shape = shape / np.linalg.norm(shape)
    out = [_turn(case, moved, shape, priors.turn * axis) for axis in np.eye(3)]
    out += [_rows(case, {SETTLED: shift}) for shift in _rigid(points, points, priors.hold)]
    base = case.release.base_rest
    if len(base):
        out += [_rows(case, {SETTLED: shift, BASE: own}) for shift, own in zip(
            _rigid(points, base, priors.base), _rigid(base, base, priors.base), strict=True)]
    out += _places(case, model, swing, placement)
    return np.column_stack(out)


def _turn(case, moved, shape, turn):
    """A turn of the frame; what creeps is too little to show it."""
    return _rows(case, {SETTLED: np.cross(turn, moved), SHAPE: np.cross(turn, shape)})


def _rigid(points, pivots, sd):
    """Six small motions (k, 3) of `points` [m]; turns about the middle of `pivots`."""
    arm = points - pivots.mean(axis=0)
    own = pivots - pivots.mean(axis=0)
    lever = max(float(np.sqrt(np.mean(np.sum(own ** 2, axis=1)))), 1e-3)
    shifts = [np.broadcast_to(sd * axis, points.shape) for axis in np.eye(3)]
    return [*shifts, *(sd / lever * np.cross(axis, arm) for axis in np.eye(3))]


def _places(case, model, swing, sd):
    """Markers that are not where the scene has them go another way."""
    out = []
    for axis in np.eye(3):
        change = model.displaced(swing.x, sd * axis) - model.displaced(swing.x, 0.0 * axis)
        for k, i in enumerate(case.index):
            alone = np.zeros((len(case.index), 3))
            alone[k] = change[i]
            out.append(_rows(case, {SETTLED: alone}))
    return out


def _rows(case, values):
    """(n,) of a mapping kind -> (k or b, 3); kinds that are left out are zero."""
    names = case.release.names
    out = np.zeros(len(case.rows))
    for i, row in enumerate(case.rows):
        if row.kind in values and not row.kind.startswith(CREEP):
            k = int(row.channel) if row.kind == BASE else names.index(row.channel)
            out[i] = values[row.kind][k, row.axis]
    return out
