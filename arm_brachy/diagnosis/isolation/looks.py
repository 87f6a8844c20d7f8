"""Recordings of one cell, looked at without a tissue model, with the noise that they share.

Noise that outlasts a rest shows between rests, where it cannot be told from what an event sets
off; events are found against the noise. So both are done twice where something happened.
Test: diagnosis/structural/test_looks.py
"""

import numpy as np

from arm_brachy.diagnosis.isolation.handover import SEEN_BETTER
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.signals.load_states import LIMIT
from arm_brachy.diagnosis.signals.shared_noise import shared_noise

FEWEST = 12         # states of a recording that are worth comparing
MOST = 200          # states of all recordings of a group together


def look_at(groups, calibration=None, say=lambda share: None, most=MOST):
    """((Recorded each, notes) of every group of loading.Evidence, all of one cell).

    calibration : finding.Calibration;  say : told the share done
    most : load states of all recordings of a group together
    Too many recordings of a group share the states that can be afforded.
    Raises what `recordings.look` raises.
    """
    kept = [_affordable(some) for some in groups]
    every = [one for some in kept for one in some]
    limits = [_limit(group, most) for group, some in zip(groups, kept, strict=True) for _ in some]
    noise = shared_noise(every)
    recorded = []
    for one, its, limit in zip(every, noise, limits, strict=True):
        recorded.append(look(one, limit=limit, calibration=calibration, noise=its))
        say(len(recorded) / len(every))
    events = [sudden(one.structure.findings) for one in recorded]
    if any(events):
        for i, better in enumerate(shared_noise(every, events)):
            if not _alike(noise[i], better):
                recorded[i] = look(every[i], limit=limits[i], calibration=calibration,
                                   noise=better)
    rest = iter(recorded)
    return tuple((tuple(next(rest) for _ in some), _notes(group, some))
                 for group, some in zip(groups, kept, strict=True))


def sudden(findings):
    """Times [s] from which on a whole stream, or all of them, shows something else.

    findings : Finding each. A marker that slips sets off no other, and noise is judged by many.
    """
    return tuple(sum(one.onset) / 2.0 for one in findings
                 if one.onset is not None and one.term not in (None, *SEEN_BETTER))


def _alike(one, other):
    """True if the Noise of every kind has the same colour and doubt."""
    return all((one[kind].colour, one[kind].doubt) == (other[kind].colour, other[kind].doubt)
               for kind in one)


def _limit(group, most):
    """Load states of each recording of a group, at most."""
    return min(LIMIT, max(FEWEST, most // max(len(group), 1)))


def _affordable(group):
    """Those of a group that are compared: MOST // FEWEST at most, evenly chosen."""
    most = MOST // FEWEST
    if len(group) <= most:
        return group
    return tuple(group[i] for i in np.unique(
        np.linspace(0, len(group) - 1, most).round().astype(int)))


def _notes(group, kept):
    if len(kept) == len(group):
        return ()
    return (f'Of {len(group)} recordings {len(kept)}, evenly chosen, were compared with the '
            'model.',)
