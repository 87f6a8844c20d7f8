"""What a careful laboratory leaves uncalibrated, as columns beside the nuisances.

Every tolerance of `finding.Calibration` that a term of the registry stands for is that term's
response at the size of the tolerance: what is within it is no cause.
"""

from dataclasses import fields, replace

import numpy as np

from arm_brachy.diagnosis.likelihood.nuisances import Nuisances
from arm_brachy.diagnosis.model.hypothesis import hypothesis, strengths
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.stream import BASE, FORCE, OPTICAL
from arm_brachy.registry import by_name

KNOWN = 0.03        # of its size: how well a finding knows the term that it names
PER_ACTUATOR, PER_PAD, PER_STREAM, PER_WAVE = 'actuators', 'pads', 'stream', 'direction'
# tolerance -> term, its parameters, what each of several is for
TOLERATED = (
    ('gain', 'actuator_gain', ('gain',), PER_ACTUATOR),
    ('play', 'backlash', ('width',), PER_ACTUATOR),
    ('compliance', 'actuator_compliance', ('compliance',), PER_ACTUATOR),
    ('direction', 'pad_misplacement', ('tilt_up', 'tilt_side'), PER_PAD),
    ('scale', 'optical_scale', ('scale',), ''),
    ('force_drift', 'force_drift', ('rate',), PER_PAD),
    ('clock', 'clock_offset', ('delay',), PER_STREAM),
    ('restless', 'breathing', ('amplitude',), PER_WAVE),
)


def tolerances(baseline, calibration=None, rhythm=0.0):
    """Return the Nuisances of a linearised.Baseline that tolerances make, each at one tolerance.

    calibration : finding.Calibration, None = its defaults
    rhythm : [Hz] in which base or tissue are seen to move, 0 = none: what is not seen is no excuse
    """
    calibration, names, parts = calibration or Calibration(), [], []
    for tolerance, term, parameters, each in TOLERATED:
        size = getattr(calibration, tolerance)
        for place in _places(baseline.model.specimen, each, rhythm):
            one = hypothesis(by_name(term), parameters, **place)
            response = respond(baseline, one)
            for k, strength in enumerate(one.strengths):
                factor = size / abs(strength.typical - strength.neutral)
                parts.append({kind: factor * values[..., k:k + 1]
                              for kind, values in response.values.items()})
                names.append('_'.join([tolerance, strength.label, *_said(place)]))
    for name, part in (*_benches(baseline, calibration.base),
                       *_turns(baseline, calibration.sensor_axes)):
        names.append(name)
        parts.append(part)
    kinds = parts[0]
    return Nuisances(tuple(names), {kind: np.concatenate([part[kind] for part in parts], axis=3)
                                    for kind in kinds})


def _benches(baseline, size):
    """(name, values): the markers on the base move by `size` [m] as each pad goes in, and in time.

    A bench gives way under the push, a tracker drifts as it warms up: no model of the tissue moves
    its base.
    """
    specimen, push = baseline.model.specimen, baseline.path.at(baseline.t)
    base = np.array([one == BASE for one in specimen.carriers])
    since = baseline.t - baseline.t[0]
    grown = {'time': since / max(since[-1], 1e-9)} | {
        pad: np.abs(q) / max(np.abs(q).max(), 1e-9)
        for pad, q in zip(specimen.pads, push.T, strict=True)}
    for why, course in grown.items() if base.any() else ():
        for axis, unit in zip('xyz', np.eye(3), strict=True):
            values = {kind: np.zeros((*shown.shape, 1)) for kind, shown in baseline.shown.items()}
            values[OPTICAL][..., 0][:, base] = size * course[:, None, None] * unit
            yield f'base_{why}_{axis}', values


def _turns(baseline, size):
    """(name, values): axes of every force sensor turned by `size` [rad] about each axis.

    Unlike cross-talk, which under an oblique pad is a gain as well.
    """
    force = baseline.shown[FORCE]
    for c, pad in enumerate(baseline.model.specimen.pads):
        for axis, unit in zip('xyz', np.eye(3), strict=True):
            values = {kind: np.zeros((*shown.shape, 1)) for kind, shown in baseline.shown.items()}
            values[FORCE][:, c, :, 0] = size * np.cross(unit, force[:, c])
            yield f'axes_{pad}_{axis}', values


def given_errors(baseline, terms):
    """Nuisances of a linearised.Baseline: terms that it was given are known to a few per cent."""
    names, parts = ['given'], [{kind: np.zeros((*shown.shape, 1)) for kind, shown in
                                baseline.shown.items()}]
    for term in terms:
        for strength, change in _effects(baseline, term):
            parts.append({kind: KNOWN * values for kind, values in change.items()})
            names.append(f'given_{term.spec.name}_{strength.label}')
    return Nuisances(tuple(names), {kind: np.concatenate([part[kind] for part in parts], axis=3)
                                    for kind in parts[0]})


def change_by(baseline, terms):
    """Change of every observable, kind -> (n, c, 3), by terms, whether a Baseline has them or not.

    To first order, by the responses about what is there.
    """
    changes = [change for term in terms for _, change in _effects(baseline, term)]
    return {kind: sum((change[kind][..., 0] for change in changes), np.zeros_like(shown))
            for kind, shown in baseline.shown.items()}


def _effects(baseline, term):
    """(Strength, its effect kind -> (n, c, 3, 1)) of each strength of a term."""
    one = _as_hypothesis(term)
    response = respond(baseline, one)
    for k, strength in enumerate(one.strengths):
        value = getattr(term, strength.name)
        value = value if strength.component is None else value[strength.component]
        size = (value - strength.neutral) / (strength.typical - strength.neutral)
        yield strength, {kind: size * values[..., k:k + 1]
                         for kind, values in response.values.items()}


def _as_hypothesis(term):
    """The Hypothesis of a term where it is, its strengths free."""
    names = {strength.name for strength in strengths(type(term))}
    place = {f.name: getattr(term, f.name) for f in fields(term) if f.name not in names}
    return hypothesis(type(term), **place)


def _places(specimen, each, rhythm):
    waves = [{'frequency': rhythm, 'phase': phase, 'direction': tuple(axis)}
             for phase in (0.0, 0.5 * np.pi) for axis in np.eye(3)] if rhythm else []
    return {PER_ACTUATOR: [{'actuators': (i,)} for i in range(len(specimen.pads))],
            PER_PAD: [{'pads': (name,)} for name in specimen.pads],
            PER_WAVE: waves,
            PER_STREAM: [{'stream': kind} for kind in ('optical', 'em', 'force')],
            '': [{}]}[each]


def _said(place):
    return ['_'.join(map(str, v)) if isinstance(v, tuple) else str(v) for v in place.values()]


def joined(*parts):
    """One Nuisances of several of the same baseline."""
    return replace(parts[0], names=tuple(n for part in parts for n in part.names), values={
        kind: np.concatenate([part.values[kind] for part in parts], axis=3)
        for kind in parts[0].values})
