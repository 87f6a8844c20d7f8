"""Mistakes of an import that would pass for physics: signs, exchanged pads, clocks far apart.

A marker on a pad follows its encoder along the push, the force on a pad opposes its own push
most. Where all pads do the opposite, or two do as the other should, no actuator is worn and
nothing slipped: it is refused with what is to be mended. Pads that only ever moved together are
not told apart.
Test: diagnosis/structural/test_wiring.py
"""

from itertools import combinations

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.clocks import WIDEST
from arm_brachy.diagnosis.history import moving
from arm_brachy.diagnosis.stream import ENCODER, FORCE, OPTICAL

FEWEST = 50         # samples of a channel
FOLLOWS = 0.5       # of its variance that the pads' travel explains, for a channel to tell
LITTLE = 0.6        # of what it owes to another pad's push, that a channel owes to its own: of
                    # forces on a cylinder, exchanged, 0.3 to 0.4, as they were 2 and more
MOVES = 0.5         # of a pad's travel, that its marker goes at least if it is there
BACKWARDS = -0.5    # travel of a marker on a pad over that by the encoder


def refuse_miswired(name, evidence, touch):
    """Raise RecordingError if encoders, forces or markers on pads are of other signs or pads.

    evidence : Evidence with encoders, optical positions in the world frame
    touch : [m] pads that never push further tell nothing
    """
    optical, force = (_followed(evidence, kind, touch) for kind in (OPTICAL, FORCE))
    strange = [] if optical else _moved(evidence, touch)
    if len(strange) > 1:
        raise RecordingError(
            f'{name}: markers on {", ".join(strange)} move, but not with their encoders, nor up '
            f'to {WIDEST:g} s before or after: bring both on one clock before the import')
    along = {pad: slopes[pad] @ way for pad, (slopes, way) in optical.items()}
    if along and max(along.values()) < BACKWARDS:
        raise RecordingError(
            f'{name}: markers on {", ".join(along)} move against their encoders; travel must '
            'grow as a pad is pushed in: mend the sign of the encoders at the import')
    for kind, slopes in (('marker on', optical), ('force on', force)):
        for one, two in combinations(slopes, 2):
            if _owes(slopes, one, two) and _owes(slopes, two, one):
                raise RecordingError(
                    f'{name}: the {kind} {one} goes with the encoder of {two}, and the other way '
                    'round: two pads are exchanged; mend the names at the import')
    if force and min(slopes[pad] @ way for pad, (slopes, way) in force.items()) > 0.0:
        raise RecordingError(
            f'{name}: the forces on {", ".join(force)} pull where the pads are pushed in; must be '
            'those of the tissue on the tool: mend `sign` at the import')


def _moved(evidence, touch):
    """Pads that push and whose marker moves by much of their travel, whenever."""
    encoder, stream, out = evidence.get(ENCODER), evidence.get(OPTICAL), []
    for i in () if stream is None else moving(encoder.values[..., 0], touch):
        for channel in stream.on(encoder.names[i])[:1]:
            way = np.linalg.norm(np.nan_to_num(np.nanmax(stream.values[:, channel], axis=0)
                                               - np.nanmin(stream.values[:, channel], axis=0)))
            if way > MOVES * np.nanmax(np.abs(encoder.values[:, i])):
                out.append(encoder.names[i])
    return out


def _owes(slopes, one, two):
    own, other = (np.linalg.norm(slopes[one][0][pad]) for pad in (one, two))
    return own < LITTLE * other


def _followed(evidence, kind, touch):
    """Pad -> ({pad: (3,) change of its channel per travel of each}, direction of its push).

    Of pads that push, and channels that follow the encoders; by least squares, without a past.
    """
    encoder, stream = evidence.get(ENCODER), evidence.get(kind)
    if encoder is None or stream is None:
        return {}
    q = encoder.at(stream.t)[..., 0]
    pushed = moving(q, touch)
    names = [encoder.names[i] for i in pushed]
    X = np.column_stack([np.ones(len(q)), q[:, pushed]])
    out = {}
    for pad in names:
        for channel in stream.on(pad)[:1]:
            rows = stream.valid[:, channel] & np.isfinite(X).all(axis=1)
            slopes = _slopes(X[rows], stream.values[rows, channel])
            if slopes is not None:
                out[pad] = (dict(zip(names, slopes, strict=True)),
                            evidence.directions[evidence.pads.index(pad)])
    return out


def _slopes(X, values):
    """(p, 3) slopes of values (n, 3) in columns of X (n, 1 + p); None if they do not follow."""
    if len(values) < FEWEST:
        return None
    found = np.linalg.lstsq(X, values, rcond=1e-6)[0]
    left = np.sum((values - X @ found)**2)
    whole = np.sum((values - values.mean(axis=0))**2)
    return found[1:] if left < (1.0 - FOLLOWS) * whole else None
