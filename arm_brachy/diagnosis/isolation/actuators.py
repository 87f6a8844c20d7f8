"""What the markers on the pads say against actuators and tracker, weighed against each other."""

import numpy as np

from arm_brachy.diagnosis.isolation.pad_tracking import COMPLIANCE, GAIN, PLAY
from arm_brachy.diagnosis.isolation.sensor_offsets import base_scale
from arm_brachy.diagnosis.results.finding import (
    ALIKE,
    Finding,
    alike,
    sigma,
    threshold,
    weighted_mean,
)
from arm_brachy.diagnosis.signals.regressors import play
from arm_brachy.diagnosis.signals.stream import ENCODER, OPTICAL

# cause -> term, parameter, SI unit
TERMS = {GAIN: ('actuator_gain', 'gain', '1'),
         COMPLIANCE: ('actuator_compliance', 'compliance', 'm/N'),
         PLAY: ('backlash', 'width', 'm')}


def played(prepared, pads):
    """(t, q (m, p)): the pads' travel by their encoders, less the play that markers prove."""
    t, q = prepared.travel
    q, names = q.copy(), prepared.evidence.get(ENCODER).names
    for one in pads:
        width, sd = one.causes.get(PLAY, (0.0, 1.0))
        if width > 0.0 and sigma(width, sd, _slack(prepared)[PLAY]) > threshold(len(pads)):
            i = names.index(one.pad)
            q[:, i] = play(q[:, i], width, one.start[0])
    return t, q


def actuator_findings(prepared, pads):
    """Findings about actuators, from the markers on the pads.

    A gain that all pads share is weighed against the scale of the tracker, which the distances on
    the base tell; a motion across the push is a direction that the scene has wrong.
    """
    slack = _slack(prepared)
    limit = threshold(len(pads) * len(slack))
    out, gains = [], {}
    for one in pads:
        for cause, (value, sd) in one.causes.items():
            value = _along_its_way(one, value) if cause == GAIN else value
            z = sigma(value, sd, slack[cause]) if cause in slack else 0.0
            if cause == GAIN:
                gains[one.marker] = (one, value, sd, z)
            elif z > limit:
                out.append(_actuator(prepared, one, cause, value, sd, z))
        out += [*_tilt(prepared, one, len(pads)), *_uneven(prepared, one)]
    return (*out, *_gain_findings(prepared, gains, pads, limit))


def _along_its_way(one, gain):
    """Gain of a pad along the way that it goes, of one along the push in the scene."""
    return float(np.hypot(1.0 + gain, np.linalg.norm(one.tilt)) - 1.0)


def _slack(prepared):
    optical = prepared.noise.get(OPTICAL)
    counts = 0.0 if optical is None else optical.rounding
    return {GAIN: prepared.calibration.gain, COMPLIANCE: prepared.calibration.compliance,
            PLAY: float(np.hypot(prepared.calibration.play, counts))}


def _actuator(prepared, one, cause, value, sd, z, more=()):
    term, parameter, unit = TERMS[cause]
    shown = {GAIN: f'{100.0 * value:.1f} % of its travel', PLAY: f'{1e3 * value:.2f} mm of play',
             COMPLIANCE: f'{1e3 * value:.3f} mm of yield per newton'}[cause]
    rivals = tuple(TERMS[c][0] for c in one.rivals.get(cause, ()) if c in TERMS) + tuple(more)
    start, error = one.start if cause == PLAY else (0.0, 0.0)
    return Finding(ENCODER, one.pad, term, parameter, value, unit, sd, z,
                   *map(float, prepared.evidence.span),
                   f'The marker on {one.pad} departs from the encoder by {shown}.', rivals,
                   parameters={
                       parameter: value, 'actuators': (prepared.evidence.pads.index(one.pad),),
                       **({'start': start} if error else {})},
                   slack=_slack(prepared)[cause], errors={'start': error} if error else {})


def _gain_findings(prepared, gains, pads, limit):
    """Gains of single pads are their actuators'; one that all share may be the tracker's scale."""
    shared, base = _shared_gain(prepared, pads), base_scale(prepared)
    agree = shared is not None and (base is None or abs(base.value - shared[0])
                                    <= ALIKE * np.hypot(base.sd, shared[1]))
    if agree and base is not None and (found := _scale(prepared, base, shared)):
        return found
    rivals = ('optical_scale',) if agree and len(gains) == len(pads) else ()
    return [_actuator(prepared, g[0], GAIN, *g[1:], more=(*rivals, *_unmeasured(*g[:2])))
            for g in gains.values() if g[3] > limit]


def _unmeasured(one, gain):
    """Rivals of a gain that only a force tells from it: a pad that falls short may yield."""
    return (TERMS[COMPLIANCE][0],) if one.stiffness == 0.0 and gain < 0.0 else ()


def _shared_gain(prepared, pads):
    """(value, sd) of the gain that all pads have; None with one pad, or where they are not alike.

    Actuators of one make may yield alike: that is in its error.
    """
    if len({one.pad for one in pads}) < 2:
        return None
    calibration = prepared.calibration
    every = [one.gain for one in pads]
    if not alike(every, calibration.gain):
        return None
    mean, sd = weighted_mean(every, calibration.gain)
    return mean, float(np.hypot(sd, calibration.compliance * np.mean(
        [one.stiffness for one in pads])))


def _scale(prepared, base, shared):
    """The finding that the tracker's scale is off, by base and pads together, if it is."""
    scale, sd = weighted_mean([shared, (base.value, base.sd)])
    z = sigma(scale, sd, prepared.calibration.scale)
    if z <= threshold(1):
        return []
    told = sigma(base.value, base.sd) > ALIKE
    return [Finding(OPTICAL, '', 'optical_scale', 'scale', scale, '1', sd, z,
                    *map(float, prepared.evidence.span),
                    f'Every pad travels {100.0 * shared[0]:+.2f} % against its encoder and the '
                    f'distances on the base are {100.0 * base.value:+.2f} % off: the scale of the '
                    'tracker.',
                    () if told else ('actuator_gain',), parameters={'scale': scale},
                    slack=prepared.calibration.scale)]


def _tilt(prepared, one, tests):
    """A push that goes another way than the scene says."""
    z = sigma(one.tilt, one.tilt_sd, prepared.calibration.direction)
    if z <= threshold(tests, 2):
        return []
    up, side = np.arctan(one.tilt / (1.0 + one.gain[0]))
    return [Finding(OPTICAL, one.marker, 'pad_misplacement', 'tilt_up', float(up), 'rad',
                    float(one.tilt_sd[0]), z, *map(float, prepared.evidence.span),
                    f'The marker on {one.pad} moves {np.degrees(np.hypot(up, side)):.1f} deg '
                    'aside of the push direction in the scene.',
                    parameters={'tilt_up': float(up), 'tilt_side': float(side),
                                'pads': (one.pad,)},
                    slack=prepared.calibration.direction,
                    errors={'tilt_side': float(one.tilt_sd[1])})]


def _uneven(prepared, one):
    """An actuator that errs from place to place: no term says it."""
    if one.course is None:
        return []
    return [Finding(ENCODER, one.pad, None, '', one.course.rms, 'm', 0.0,
                    float(np.sqrt(one.course.statistic)), *map(float, prepared.evidence.span),
                    f'The marker on {one.pad} departs from the encoder by '
                    f'{1e3 * one.course.rms:.2f} mm (rms) that follows where the pad stands, as '
                    'no gain, yield or play does: a screw, a gear or a scale that is not even. '
                    'The model was driven by the encoder put right by it.')]
