"""Whose clock is off: every stream's lateness against the encoders, weighed together."""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.results.finding import Finding, alike, sigma, threshold, weighted_mean
from arm_brachy.diagnosis.signals.clock_alignment import FINE
from arm_brachy.diagnosis.signals.delay import Lateness, lateness
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.subset_selection import INDISTINCT

LIMIT = threshold(3)    # standard deviations from which one of three clocks is at fault


def clocks_of(prepared, pads, travel):
    """kind -> Lateness of every stream that follows the pads.

    Markers on pads are rigid and decide over the optical clock; without them tissue does.
    """
    found = {}
    shown = {one.pad for one in pads}
    lost = tuple(i for i, pad in enumerate(prepared.evidence.pads) if pad not in shown)
    for kind, bodies in ((OPTICAL, prepared.evidence.pads), (OPTICAL, (TISSUE,)),
                         (EM, (TISSUE,)), (FORCE, prepared.evidence.pads)):
        stream, noise = prepared.on(kind, *bodies)
        if stream is not None and kind not in found:
            one = lateness(stream, travel, prepared.motion.touch, noise,
                           memory=not (kind == OPTICAL and pads), lost=lost)
            if one is not None:
                found[kind] = one
    return found


def believed(clocks, slack):
    """kind -> Lateness by which states are taken, of those that were found.

    What is no fault is drawn towards zero by the slack [s] that calibration leaves a clock.
    """
    return {kind: _towards_zero(one, slack) for kind, one in clocks.items()}


def _towards_zero(one, slack):
    """A Lateness: a fault as it is, another's posterior beside a clock right to slack [s]."""
    if sigma(one.value, one.sd, slack) > LIMIT:
        return one
    trust = slack**2 / (slack**2 + one.sd**2)
    return replace(one, value=trust * one.value, sd=float(np.sqrt(trust)) * one.sd)


def clock_findings(prepared, clocks):
    """One finding per stream that is late; one for all of them together where they are alike.

    What was far off is set back already (`loading.Evidence.late`) and counts here as well.
    """
    slack, back = prepared.calibration.clock, prepared.evidence.late
    clocks = {kind: Lateness(0.0, FINE, ()) for kind in back} | clocks
    clocks = {kind: replace(one, value=one.value + back.get(kind, 0.0))
              for kind, one in clocks.items()}
    odd = {k: c for k, c in clocks.items() if sigma(c.value, c.sd, slack) > LIMIT}
    shared, sole = _shared(clocks, odd, slack)
    if sole and shared[0] > 0.0:
        return (_pads_late(prepared, clocks, shared, slack),)
    return tuple(_late(prepared, kind, one, shared, slack) for kind, one in odd.items())


def _shared(clocks, odd, slack):
    """((value, sd) [s] by which all streams may be late, None = they are not; is it no other?).

    clocks : kind -> Lateness of all streams;  odd : of those at fault
    One number for all is simpler than one each. Of a single stream at fault, the others have to
    be late too: by chi^2 of theirs, where that is as well as where it is not.
    """
    every = [(one.value, one.sd) for one in clocks.values()]
    if not odd or len(every) < 2 or not alike(every, slack):
        return None, False
    mean, sd = weighted_mean(every, slack)
    apart = sum(sigma(v - mean, e, slack)**2 for v, e in every)
    alone = sum(sigma(c.value, c.sd, slack)**2 for k, c in clocks.items() if k not in odd)
    if len(odd) == 1 and apart - alone > INDISTINCT:
        return None, False
    return (mean, sd), len(odd) > 1 or alone - apart > INDISTINCT


def _pads_late(prepared, clocks, shared, slack):
    """The finding that every stream is late alike, by `shared` (value, sd) [s].

    clocks : kind -> Lateness of all of them. Its rival is that all their clocks are off.
    """
    value, sd = shared
    return Finding(
        ENCODER, '', 'actuator_lag', 'time_constant', value, 's', sd, sigma(value, sd, slack),
        *map(float, prepared.evidence.span),
        f'All other streams are {1e3 * value:.1f} ms late against the encoders: the pads lag '
        'behind their encoders, or the stamps of the encoders are early.', ('clock_offset',),
        parameters={'time_constant': value}, slack=slack,
        ways={'clock_offset': tuple({'stream': kind, 'delay': value} for kind in clocks)})


def _late(prepared, kind, one, shared, slack):
    """The finding that one stream is late; shared : (value, sd) [s] that all may have, or None."""
    rivals = ('actuator_lag',) if shared is not None and one.value > 0.0 else ()
    if kind == FORCE:
        rivals += ('viscoelasticity',)
    stream = prepared.evidence.get(kind)
    late = 'late' if one.value > 0.0 else 'early'
    return Finding(
        kind, '', 'clock_offset', 'delay', one.value, 's', one.sd,
        sigma(one.value, one.sd, slack), float(stream.t[0]), float(stream.t[-1]),
        f'The stamps of {kind} are {abs(one.value) * 1e3:.1f} ms {late} against the '
        'encoders' + (', as may be those of every other stream.' if shared else '.'), rivals,
        parameters={'stream': kind, 'delay': one.value}, slack=slack)
