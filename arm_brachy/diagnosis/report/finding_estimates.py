"""A finding that needed no tissue model, as parts of the answer: cause, place and interval."""

from dataclasses import fields, replace

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantities
from arm_brachy.core.term import Kind
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.parts import Interval, Place
from arm_brachy.diagnosis.statistics.linear_gaussian import TO_90
from arm_brachy.registry import by_name

BEGINNINGS = {'start'}      # of a play: parameters that say how a term begins, not how much of it


def cause_of(finding, probability, option=0):
    """Cause of a finding.Finding that names a term.

    The parameters that were estimated get value -+ 1.64 sd, that of calibration in it, an onset
    its own interval; of others the finding knows no error, and their interval is unbounded.
    Raises InputError if the finding names no term.
    """
    if finding.term is None:
        raise InputError(f'finding {finding.statement!r} names no term; it is a place and a time '
                         'without a cause')
    scaled = quantities(by_name(finding.term))
    estimates = {name: _estimate(finding, name, value)
                 for name, value in finding.parameters.items() if name in scaled}
    chosen = {name: value for name, value in finding.parameters.items() if name not in scaled}
    return Cause(finding.term, estimates, chosen, probability, option)


def merged(finding, beside):
    """One Cause of two alike: of a finding, which the model had, and of what was found beside it.

    Numbers that both have add up, their intervals with them in quadrature, but for a state at
    the beginning, which is the finding's. None where the causes are not of one term in one place,
    or a number of it does not count from zero.
    """
    if (finding.term, finding.applies_to, finding.option) != (
            beside.term, beside.applies_to, beside.option):
        return None
    infos = quantities(by_name(finding.term))
    both = set(finding.parameters) & set(beside.parameters) - BEGINNINGS
    if any(infos[name].neutral != 0.0 for name in both):
        return None
    sums = {name: _sum(finding.parameters[name], beside.parameters[name]) for name in both}
    began = {name: finding.parameters[name] for name in BEGINNINGS & set(finding.parameters)}
    return replace(finding, probability=max(finding.probability, beside.probability),
                   parameters={**finding.parameters, **beside.parameters, **sums, **began})


def _sum(one, other):
    """Estimate of the sum of two; an end that is open in one is as far as in the other."""
    value = np.add(one.value, other.value)
    low, high = (_together(np.subtract(a, one.value), np.subtract(b, other.value))
                 for a, b in ((one.low, other.low), (one.high, other.high)))
    return Estimate(*(_plain(v) for v in (value, value - low, value + high)))


def _together(one, other):
    known = [np.where(np.isfinite(d), d, 0.0) for d in (one, other)]
    return np.where(np.isinf(one) & np.isinf(other), np.inf, np.hypot(*known))


def options_of(finding, rivals, probability):
    """(Cause, Finding) of a finding.Finding and of each of some rivals: options 1, 2 and so on.

    probability : that one of them holds, shared evenly. A rival's parameters are not known, but
    for those in `Finding.ways`, where an option may be several causes together.
    """
    share = probability / (1 + len(rivals))
    options = [(cause_of(finding, share, 1), finding)]
    for number, rival in enumerate(rivals, start=2):
        scaled = set(quantities(by_name(rival)))
        names = set(f.name for f in fields(by_name(rival))) - scaled
        own = {k: v for k, v in finding.parameters.items() if k in names}
        for way in finding.ways.get(rival, (own,)):
            said = replace(finding, term=rival, parameters=way,
                           stream=way.get('stream', finding.stream),
                           parameter=next((name for name in way if name in scaled), ''))
            options.append((cause_of(said, share, number), said))
    return options


def _estimate(finding, name, value):
    value = np.asarray(value, dtype=float)
    if name == 'onset' and finding.onset is not None:
        low, high = finding.onset
        return Estimate(float(value), min(low, float(value)), max(high, float(value)))
    known = {**finding.errors, finding.parameter: finding.sd}
    reach = np.inf
    if name in known:
        reach = TO_90 * np.hypot(np.asarray(known[name], dtype=float), finding.slack)
    return Estimate(*(_plain(v) for v in (value, value - reach, value + reach)))


def _plain(value):
    return tuple(float(v) for v in value) if np.ndim(value) else float(value)


def place_of(finding, scene, option=0):
    """Place of a finding; scene : core.scene.Scene whose pads the actuators move.

    A fault of a single actuator is at that actuator, one of a body that is none of the stream's
    channels at that body, all others in their stream.
    """
    term = finding.term or ''
    kind = by_name(term).spec.kind if term else None
    actuators = finding.parameters.get('actuators', ())
    if kind is Kind.ACTUATION and len(actuators) == 1:
        return Place(actuator=scene.pads[actuators[0]].name, term=term, option=option)
    known = {item.name for item in (*scene.markers, *scene.targets, *scene.pads)}
    if kind is Kind.BOUNDARY and finding.channel and finding.channel not in known:
        return Place(boundary=finding.channel, term=term, option=option)
    return Place(stream=finding.stream, channel=finding.channel, term=term, option=option)


def interval_of(finding, recording):
    """Interval of a finding in the recording of that name."""
    return Interval(recording, finding.t_start, finding.t_end, onset=finding.onset,
                    term=finding.term or '')
