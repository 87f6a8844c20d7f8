"""How hard a probe pressed, less its goal: as its own sensor has it, and truly.

The sensor's zero drifts, which neither it nor the controller can see. Measured is the force of
every period of the controller; true is what the tissue answers along the probe's true axis, every
tick.
    rms, peak        from the moment the force has first come within SETTLED of its goal, over
                     INSERTING and DWELLING
    steady           mean over the last STEADY_WINDOW of DWELLING
    overshoot        largest force from first touch until the probe retracts, less the largest
                     goal in that time
Test: evaluation/test_procedure_metrics.py
"""

import numpy as np

from arm_brachy.evaluation.procedure_data import sampled
from arm_brachy.evaluation.timeseries import Series

SETTLED = 0.3        # N: the force has come within it of its goal
STEADY_WINDOW = 1.0  # s at the end of the dwell


def force_figures(data, inserting, dwelling):
    """Return force_rms, _steady, _peak, _overshoot [N] and true_force_... as far as known.

    data : ProcedureData;  inserting, dwelling : (start, end) [s] or None
    """
    out = {}
    for name, force in (('', data.force), ('true_', true_force(data))):
        if force is not None and data.state is not None:
            found = _overshoot(data, force) | _followed(data, force, inserting, dwelling)
            out |= {name + key: value for key, value in found.items()}
    return out


def true_force(data):
    """Series (n,) [N] with which the probe truly presses, None of a run without truth."""
    if data.contact is None or data.probe is None:
        return None
    axes = sampled(data.probe, data.contact.t)[:, 2:9:3]
    return Series(data.contact.t, -np.einsum('ni,ni->n', data.contact.values, axes))


def _followed(data, force, inserting, dwelling):
    if inserting is None:
        return {}
    last = inserting[1] if dwelling is None else dwelling[1]
    force = force.between(inserting[0], last)
    if not len(force.t):
        return {}
    error = force.values - sampled(data.state, force.t)[:, 2]
    there = np.flatnonzero(np.abs(error) <= SETTLED)
    if not len(there):
        return {'force_peak': float(np.abs(error).max())}
    error, t = error[there[0]:], force.t[there[0]:]
    out = {'force_rms': float(np.sqrt(np.mean(error**2))),
           'force_peak': float(np.abs(error).max())}
    if dwelling is not None:
        calm = t >= min(dwelling[1], t[-1]) - STEADY_WINDOW
        out['force_steady'] = float(abs(error[calm].mean()))
    return out


def _overshoot(data, force):
    approaching, retracting = data.when('approaching'), data.when('retracting')
    if approaching is None:
        return {}
    window = approaching[0], np.inf if retracting is None else retracting[0]
    state, force = data.state.between(*window), force.between(*window)
    touched = state.values[:, 1] > 0.0
    if not touched.any() or not len(force.t):
        return {}
    # The goal that a tick ends with: before contact it is of no force yet.
    return {'force_overshoot': float(force.values.max() - state.values[touched, 2].max())}
