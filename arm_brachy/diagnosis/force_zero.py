"""Pad forces where they should be none: zero of the sensors, and its drift."""

import numpy as np

from arm_brachy.diagnosis.finding import Finding, sigma, threshold
from arm_brachy.diagnosis.history import MEMORIES, memories, moving
from arm_brachy.diagnosis.regression import regress
from arm_brachy.diagnosis.stream import FORCE

SETTLED = 0.2    # s after a motion before a sample counts as unloaded
FEWEST = 100     # unloaded samples
TESTS = 2        # zero and drift


def force_findings(prepared, jumps=()):
    """Findings about the zero of every pad's force sensor, from the times without a push.

    jumps : times [s] of sudden events, after which the force at rest may be another
    What the tissue remembers of earlier pushes is fitted beside it (exponential memories), so that
    recovery is no drift.
    Test: diagnosis/structural/test_force_zero.py
    """
    force = prepared.evidence.get(FORCE)
    if force is None or prepared.motion is None:
        return ()
    rows = unloaded(prepared, force.t)
    if rows.sum() < FEWEST:
        return ()
    t, (tt, q) = force.t, prepared.travel
    pads = moving(q, prepared.motion.touch)
    columns = {'zero': np.ones(len(t)), 'drift': t - t[0]}
    for time in MEMORIES[1:]:
        past = memories(t, tt, q[:, pads] / float(np.ptp(q)), time)
        columns |= {f'm{i}_{time}': past[:, j] for j, i in enumerate(pads)}
    columns |= {f'jump {time}': (t >= time).astype(float) for time in jumps}
    noise, out = prepared.noise[FORCE], []
    for k, pad in enumerate(force.names):
        valid = rows & force.valid[:, k]
        if valid.sum() >= FEWEST:
            fit = regress(t, force.values[:, k], columns, valid, noise.colour, noise.sd[k])
            out += _findings(prepared, pad, fit, t, TESTS * len(force.names))
    return tuple(out)


def _findings(prepared, pad, fit, t, tests):
    limit, span, found = threshold(tests, 3), (float(t[0]), float(t[-1])), []
    rate, rate_sd = fit.of('drift')
    z = sigma(rate, rate_sd, prepared.calibration.force_drift)
    drifts = z > limit
    if drifts:
        found.append(Finding(
            FORCE, pad, 'force_drift', 'rate', rate, 'N/s', rate_sd, z, *span,
            f'The force on {pad} drifts by {60.0 * np.linalg.norm(rate):.2f} N a minute while '
            'nothing pushes.', rivals=('swelling_drift',),
            parameters={'rate': tuple(rate), 'pads': (pad,)}))
    zero, zero_sd = fit.of('zero')
    z = sigma(zero, zero_sd, prepared.calibration.force_zero)
    if z > limit:
        found.append(Finding(
            FORCE, pad, 'force_drift', 'bias', zero, 'N', zero_sd, z, *span,
            f'The force on {pad} reads {np.linalg.norm(zero):.2f} N at the start while nothing '
            'pushes.', rivals=('actuator_gain',),
            parameters={'rate': (0.0, 0.0, 0.0), 'bias': tuple(zero), 'pads': (pad,)}))
    return found


def unloaded(prepared, t):
    """(n,) True where no pad pushes and none has moved for a while."""
    rows = np.zeros(len(t), dtype=bool)
    for start, end, pushed in prepared.motion.stills():
        if not pushed:
            first = start if start == prepared.motion.t[0] else start + SETTLED
            rows |= (t >= first) & (t <= end)
    return rows
