"""What a recording says before any model of the tissue: actuators, clocks, trackers, base, forces.

Everything here holds for any body. Estimates (clocks, play, registration) are handed on to the
model even where they are within calibration and no fault.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from arm_brachy.diagnosis.base_motion import base_findings
from arm_brachy.diagnosis.clocks import Lateness, lateness
from arm_brachy.diagnosis.consequence import share_followed
from arm_brachy.diagnosis.events import event_findings, events_of
from arm_brachy.diagnosis.finding import ALARM, Finding, sigma, threshold
from arm_brachy.diagnosis.force_balance import balance_findings
from arm_brachy.diagnosis.force_zero import force_findings
from arm_brachy.diagnosis.gaps import gap_findings
from arm_brachy.diagnosis.history import play
from arm_brachy.diagnosis.jumps import Jump, jumps
from arm_brachy.diagnosis.merge import merge
from arm_brachy.diagnosis.pad_travel import COMPLIANCE, GAIN, PLAY, pad_travels
from arm_brachy.diagnosis.rest_pose import (
    base_scale,
    em_findings,
    exchanged_findings,
    pad_place_findings,
)
from arm_brachy.diagnosis.rhythm import rhythm_findings
from arm_brachy.diagnosis.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE

TERMS = {GAIN: ('actuator_gain', 'gain', '1'), COMPLIANCE: ('actuator_compliance', 'compliance',
                                                            'm/N'),
         PLAY: ('backlash', 'width', 'm')}
ALIKE = 3.0      # standard deviations within which the gains of all pads are one


@dataclass(frozen=True)
class Structure:
    """What was found in one recording without a tissue model.

    findings : Finding each, faults only, largest z first
    pads : pad_travel.PadTravel of every marker on a moving pad
    clocks : kind of stream -> clocks.Lateness against the encoders
    """

    findings: tuple
    pads: tuple
    clocks: dict

    def late(self, kind):
        """Delay [s] of a stream's stamps against the encoders; 0 where it could not be told."""
        return self.clocks[kind].value if kind in self.clocks else 0.0


def structure_of(prepared):
    """Structure of one prepared.Prepared recording.

    Test: diagnosis/structural/test_structural.py
    """
    found = [*gap_findings(prepared), *exchanged_findings(prepared), *em_findings(prepared),
             *pad_place_findings(prepared), *balance_findings(prepared)]
    pads, clocks, events = (), {}, ()
    if prepared.motion is not None:
        tests = channels(prepared)
        if prepared.registration is not None:
            pads = pad_travels(prepared.evidence, prepared.noise[OPTICAL],
                               prepared.motion.touch, alarm=ALARM / tests)
        travel = played(prepared, pads)
        clocks = clocks_of(prepared, pads, travel)
        found += clock_findings(prepared, clocks)
        found += pad_findings(prepared, pads)
        late = {kind: one.value for kind, one in clocks.items()}
        every = (*_pad_jumps(pads), *jumps(prepared, travel, late, alarm=ALARM / tests))
        events = events_of(every, tests)
        found += event_findings(prepared, events, pads,
                                partial(share_followed, prepared, travel, late))
        times = [event.t for event in events]
        found += force_findings(prepared, times)
        found += rhythm_findings(prepared, travel, late.get(OPTICAL, 0.0), times)
    found += base_findings(prepared, events)
    merged = merge(found, prepared.evidence.pads, [one.pad for one in pads])
    return Structure(tuple(sorted(merged, key=lambda f: -f.z)), pads, clocks)


def channels(prepared):
    """Number of channels that are searched for jumps."""
    return sum(len(s.names) for kind, s in prepared.evidence.streams.items() if kind != ENCODER)


def played(prepared, pads):
    """(t, q (m, p)): the pads' travel by their encoders, less the play that markers prove."""
    t, q = prepared.travel
    q, names = q.copy(), prepared.evidence.get(ENCODER).names
    for one in pads:
        width, sd = one.causes.get(PLAY, (0.0, 1.0))
        if width > 0.0 and sigma(width, sd, prepared.calibration.play) > threshold(len(pads)):
            i = names.index(one.pad)
            q[:, i] = play(q[:, i], width)
    return t, q


def clocks_of(prepared, pads, travel):
    """kind -> Lateness of every stream that follows the pads.

    Markers on pads are rigid and decide over the optical clock; without them tissue does.
    """
    found = {}
    for kind, bodies in ((OPTICAL, prepared.evidence.pads), (OPTICAL, (TISSUE,)),
                         (EM, (TISSUE,)), (FORCE, prepared.evidence.pads)):
        stream, noise = prepared.on(kind, *bodies)
        if stream is not None and kind not in found:
            one = lateness(stream, travel, prepared.motion.touch, noise,
                           memory=not (kind == OPTICAL and pads))
            if one is not None:
                found[kind] = one
    return found


def clock_findings(prepared, clocks):
    """One finding per stream that is late; if all of them are alike, the encoders may be early."""
    slack, limit = prepared.calibration.clock, threshold(3)
    odd = {k: c for k, c in clocks.items() if sigma(c.value, c.sd, slack) > limit}
    common = len(odd) == len(clocks) and _alike(list(odd.values()), slack)
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
            parameters={'stream': kind, 'delay': one.value}))
    return tuple(out)


def _alike(estimates, slack):
    """True if (value, sd) pairs or Lateness agree within their errors."""
    pairs = [(e.value, e.sd) if isinstance(e, Lateness) else e for e in estimates]
    mean, _ = _mean(pairs, slack)
    return all(sigma(value - mean, sd, slack) < ALIKE for value, sd in pairs)


def pad_findings(prepared, pads):
    """Findings about actuators, from the markers on the pads.

    A gain that all pads share is weighed against the scale of the tracker, which the distances on
    the base tell; a motion across the push is a direction that the scene has wrong.
    """
    slack = {GAIN: prepared.calibration.gain, COMPLIANCE: prepared.calibration.compliance,
             PLAY: prepared.calibration.play}
    limit = threshold(len(pads) * len(slack))
    out, gains = [], {}
    for one in pads:
        for cause, (value, sd) in one.causes.items():
            z = sigma(value, sd, slack[cause]) if cause in slack else 0.0
            if cause == GAIN:
                gains[one.marker] = (one, value, sd, z)
            elif z > limit:
                out.append(_actuator(prepared, one, cause, value, sd, z))
        out += _tilt(prepared, one, len(pads))
    return (*out, *_gain_findings(prepared, gains, pads, limit))


def _actuator(prepared, one, cause, value, sd, z, more=()):
    term, parameter, unit = TERMS[cause]
    shown = {GAIN: f'{100.0 * value:.1f} % of its travel', PLAY: f'{1e3 * value:.2f} mm of play',
             COMPLIANCE: f'{1e3 * value:.3f} mm of yield per newton'}[cause]
    rivals = tuple(TERMS[c][0] for c in one.rivals.get(cause, ()) if c in TERMS) + tuple(more)
    return Finding(ENCODER, one.pad, term, parameter, value, unit, sd, z,
                   *map(float, prepared.evidence.span),
                   f'The marker on {one.pad} departs from the encoder by {shown}.', rivals,
                   parameters={
                       parameter: value, 'actuators': (prepared.evidence.pads.index(one.pad),)})


def _gain_findings(prepared, gains, pads, limit):
    """Gains of single pads are their actuators'; one that all share may be the tracker's scale."""
    strong = [g for g in gains.values() if g[3] > limit]
    common = len({one.pad for one in pads}) > 1 and len(gains) == len(pads) and _alike(
        [(value, sd) for _, value, sd, _ in gains.values()], prepared.calibration.gain)
    if not common:
        return [_actuator(prepared, g[0], GAIN, *g[1:]) for g in strong]
    mean, sd = _mean([(value, sd) for _, value, sd, _ in gains.values()],
                     prepared.calibration.gain)
    base = base_scale(prepared)
    if base is None:
        rivals = ('optical_scale',)
        return [_actuator(prepared, g[0], GAIN, *g[1:], more=rivals) for g in strong]
    if abs(base.value - mean) > ALIKE * np.hypot(base.sd, sd):
        return [_actuator(prepared, g[0], GAIN, *g[1:]) for g in strong]
    scale, sd = _mean([(mean, sd), (base.value, base.sd)])
    z = sigma(scale, sd, prepared.calibration.scale)
    if z <= threshold(1):
        return []
    told = sigma(base.value, base.sd) > ALIKE
    return [Finding(OPTICAL, '', 'optical_scale', 'scale', scale, '1', sd, z,
                    *map(float, prepared.evidence.span),
                    f'Every pad travels {100.0 * mean:+.2f} % against its encoder and the '
                    f'distances on the base are {100.0 * base.value:+.2f} % off: the scale of the '
                    'tracker.',
                    () if told else ('actuator_gain',), parameters={'scale': scale})]


def _mean(estimates, slack=0.0):
    """Weighted mean of (value, sd) pairs and its error."""
    values, errors = (np.array(x) for x in zip(*estimates, strict=True))
    weight = 1.0 / (errors ** 2 + slack ** 2)
    return float(np.sum(weight * values) / weight.sum()), float(weight.sum() ** -0.5)


def _tilt(prepared, one, tests):
    """A push that goes another way than the scene says."""
    z = sigma(one.tilt, one.tilt_sd, prepared.calibration.direction)
    if z <= threshold(tests, 2):
        return []
    up, side = np.arctan(one.tilt)
    return [Finding(OPTICAL, one.marker, 'pad_misplacement', 'tilt_up', float(up), 'rad',
                    float(one.tilt_sd[0]), z, *map(float, prepared.evidence.span),
                    f'The marker on {one.pad} moves {np.degrees(np.hypot(up, side)):.1f} deg '
                    'aside of the push direction in the scene.',
                    parameters={'tilt_up': float(up), 'tilt_side': float(side),
                                'pads': (one.pad,)})]


def _pad_jumps(pads):
    """Steps of the markers on pads as Jumps, in the world frame."""
    return tuple(Jump(OPTICAL, one.marker, one.pad, _in_world(step, one.frame),
                      sigma(step.size, step.sd)) for one in pads for step in one.steps)


def _in_world(step, frame):
    size = frame.T @ step.size
    return type(step)(step.t, step.low, step.high, size, step.sd, step.statistic, step.chance)
