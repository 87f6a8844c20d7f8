"""Whose clock is off: every stream's lateness against the encoders, weighed together."""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.results.finding import Finding, alike, sigma, threshold
from arm_brachy.diagnosis.signals.clock_alignment import FINE
from arm_brachy.diagnosis.signals.delay import Lateness, lateness
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL, TISSUE

LIMIT = threshold(3)    # standard deviations from which one of three clocks is at fault


def clocks_of(prepared, pads, travel):
    """kind -> Lateness of every stream that follows the pads.

    Markers on pads are rigid and decide over the optical clock; without them tissue does. What is
    no fault is drawn towards zero by what calibration leaves: states are taken by these clocks.
    """
    found, slack = {}, prepared.calibration.clock
    shown = {one.pad for one in pads}
    lost = tuple(i for i, pad in enumerate(prepared.evidence.pads) if pad not in shown)
    for kind, bodies in ((OPTICAL, prepared.evidence.pads), (OPTICAL, (TISSUE,)),
                         (EM, (TISSUE,)), (FORCE, prepared.evidence.pads)):
        stream, noise = prepared.on(kind, *bodies)
        if stream is not None and kind not in found:
            one = lateness(stream, travel, prepared.motion.touch, noise,
                           memory=not (kind == OPTICAL and pads), lost=lost)
            if one is not None:
                found[kind] = _believed(one, slack)
    return found


def _believed(one, slack):
    """A Lateness, unless it is a fault its posterior given a clock right to slack [s]."""
    if sigma(one.value, one.sd, slack) > LIMIT:
        return one
    trust = slack**2 / (slack**2 + one.sd**2)
    return replace(one, value=trust * one.value, sd=float(np.sqrt(trust)) * one.sd)


def clock_findings(prepared, clocks):
    """One finding per stream that is late; if all of them are alike, the encoders may be early.

    What was far off is set back already (`loading.Evidence.late`) and counts here as well.
    """
    slack, back = prepared.calibration.clock, prepared.evidence.late
    clocks = {kind: Lateness(0.0, FINE, ()) for kind in back} | clocks
    clocks = {kind: replace(one, value=one.value + back.get(kind, 0.0))
              for kind, one in clocks.items()}
    odd = {k: c for k, c in clocks.items() if sigma(c.value, c.sd, slack) > LIMIT}
    common = bool(odd) and len(odd) == len(clocks) and alike(
        [(one.value, one.sd) for one in odd.values()], slack)
    out = []
    for kind, one in odd.items():
        rivals = ('actuator_lag',) if common else ()
        if kind == FORCE:
            rivals += ('viscoelasticity',)
        stream = prepared.evidence.get(kind)
        late = 'late' if one.value > 0.0 else 'early'
        out.append(Finding(
            kind, '', 'clock_offset', 'delay', one.value, 's', one.sd,
            sigma(one.value, one.sd, slack), float(stream.t[0]), float(stream.t[-1]),
            f'The stamps of {kind} are {abs(one.value) * 1e3:.1f} ms {late} against the '
            'encoders' + (', as are those of every other stream.' if common else '.'), rivals,
            parameters={'stream': kind, 'delay': one.value}, slack=slack))
    return tuple(out)
