"""Does the base stand still? Its markers as a rigid body: under load, over time, in rhythm."""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.results.finding import Finding, sigma, threshold
from arm_brachy.diagnosis.signals.preparation import rigid_motion
from arm_brachy.diagnosis.signals.regressors import moving
from arm_brachy.diagnosis.signals.stream import BASE, OPTICAL
from arm_brachy.diagnosis.statistics.gls import regress
from arm_brachy.diagnosis.statistics.noise_process import residual_colour

TESTS = 4       # load, drift, shape of the base, motion without pads
SHORTEST = 2.0  # s


def base_findings(prepared, events=()):
    """Findings about the base: gives way under load, drifts, is no rigid body.

    events : events.Event each; a base marker that jumped alone is left out, jumps that all made
        are fitted beside the rest
    Of a body without pads any motion of the base counts.
    Test: diagnosis/structural/test_rest.py
    """
    stream, noise = prepared.on(OPTICAL, BASE)
    if stream is None or stream.t[-1] - stream.t[0] < SHORTEST:
        return ()
    stream, noise, jumps = _sound(stream, noise, events)
    if not len(stream.names):
        return ()
    rest = np.nanmean(stream.values, axis=0)
    motion, left, lever = rigid_motion(rest, stream.values - rest, stream.valid)
    sd = float(noise.sd.mean()) / np.sqrt(len(rest))
    valid = np.isfinite(motion).all(axis=1)
    if valid.sum() < 100:
        return ()
    if prepared.motion is None:
        found = _free(prepared, stream, motion, valid, sd)
    else:
        found = _loaded(prepared, stream, motion, valid, noise, sd, jumps)
    return tuple(found) + _shape(prepared, stream, left, noise)


def _sound(stream, noise, events):
    """Channels that did not jump alone, their noise, and the times [s] at which all jumped."""
    odd, together = set(), []
    for event in events:
        names = {jump.channel for jump in event.on(BASE)}
        if names and len(names) > len(stream.names) / 2:
            together.append(event.t)
        else:
            odd |= names
    keep = np.array([k for k, name in enumerate(stream.names) if name not in odd], dtype=int)
    return stream.channels(keep), replace(noise, sd=noise.sd[keep]), together


def _loaded(prepared, stream, motion, valid, noise, sd, jumps):
    """Motion in proportion to the pushes, and with time."""
    t, (tt, q) = stream.t, prepared.travel
    pads = [i for i in moving(q, prepared.motion.touch)
            if np.ptp(q[:, i]) > prepared.motion.touch]   # not one that rests pushed in
    columns = {'1': np.ones(len(t)), 'time': (t - t[0]) / (t[-1] - t[0])}
    columns |= {f'q{i}': np.interp(t, tt, q[:, i]) / np.ptp(q[:, i]) for i in pads}
    columns |= {f'jump {time}': (t >= time).astype(float) for time in jumps}
    fit = regress(t, motion, columns, valid, noise.colour, np.full(6, sd))
    colour, louder = residual_colour(t, fit.residual, valid, noise.colour, sd)
    fit = regress(t, motion, columns, valid, colour, louder)
    slack, limit = prepared.calibration.base, threshold(TESTS * (1 + len(pads)), 6)
    out = []
    for i in pads:
        value, error = fit.of(f'q{i}')
        z = sigma(value, error, slack)
        if z > limit:
            name = prepared.evidence.get('encoder').names[i]
            out.append(_finding(stream, value, error, z, f'The base moves by '
                                f'{1e3 * np.linalg.norm(value[:3]):.2f} mm while {name} pushes: '
                                'what carries it gives way.'))
    value, error = fit.of('time')
    z = sigma(value, error, slack)
    if z > limit:
        out.append(_finding(stream, value, error, z, 'Base or tracker drift by '
                            f'{1e3 * np.linalg.norm(value[:3]):.2f} mm over the recording.'))
    return out


def _free(prepared, stream, motion, valid, sd):
    """Largest smoothed departure of the base of a body without pads from its mean."""
    largest = np.nanmax(np.abs(motion[valid]), axis=0)
    z = sigma(largest, np.full(6, sd), prepared.calibration.base)
    if z <= np.sqrt(6.0) * threshold(TESTS * len(motion), 1):
        return []
    return [_finding(stream, largest, np.full(6, sd), z, 'The base moves by up to '
                     f'{1e3 * np.linalg.norm(largest[:3]):.2f} mm while the body swings: what '
                     'carries it gives way.')]


def _shape(prepared, stream, left, noise):
    """Markers on the base that move against each other; needs three and pads that tell when."""
    if len(stream.names) < 3 or prepared.motion is None:
        return ()
    t, (tt, q) = stream.t, prepared.travel
    span = (t - t[0]) / (t[-1] - t[0])
    columns = {'1': np.ones(len(t)), 'time': span, 'push': np.interp(t, tt, q.sum(axis=1))
               / max(float(np.ptp(q.sum(axis=1))), 1e-9)}
    valid = stream.valid.all(axis=1)
    out = []
    for k, name in enumerate(stream.names):
        fit = regress(t, left[:, k], columns, valid, noise.colour, noise.sd[k])
        value, error = fit.of('push')
        z = sigma(value, error, prepared.calibration.base)
        if z > threshold(TESTS * len(stream.names), 3):
            out.append(Finding(OPTICAL, name, None, '', value, 'm', error, z, float(t[0]),
                               float(t[-1]), f'{name} moves by {1e3 * np.linalg.norm(value):.2f} '
                               'mm against the other markers of the base while pads push.'))
    return tuple(out)


def _finding(stream, value, error, z, statement):
    return Finding(OPTICAL, BASE, None, '', value[:3], 'm', error[:3], z, float(stream.t[0]),
                   float(stream.t[-1]), statement)
