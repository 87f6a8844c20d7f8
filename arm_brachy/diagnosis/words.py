"""What a diagnosis says to a person: verdict, place, time, doubt, request, each in plain words.

Sentences carry the numbers and nothing that the numbers do not.
"""

import math

import numpy as np

from arm_brachy.core.quantity import UNITS
from arm_brachy.diagnosis.statements import edge_unit

STREAMS = {'optical': ('optical markers', 'marker'), 'em': ('EM tracker', 'tool'),
           'force': ('pad forces', 'pad'), 'encoder': ('encoders', 'pad')}
REGIMES = {'rest': 'at rest', 'hold': 'in holds', 'load': 'while loading',
           'unload': 'while unloading', 'rate': 'growing with speed',
           'amplitude': 'growing with depth',
           'direction': 'depending on the direction of motion',
           'past_maximum': 'depending on the deepest push before'}
TIMES = {0: 'once', 1: 'once', 2: 'twice'}
MISSING = 'Missing from the model'
MM = 1e3


def verdict(diagnosis):
    """The verdict of a Diagnosis in one sentence."""
    return {'named': _named, 'nothing_missing': _nothing, 'equivalent': _equivalent,
            'unexplained': _unexplained}[diagnosis.verdict](diagnosis)


def _named(d):
    found = listed([_cause_at(d, cause) for cause in d.causes])
    if not any(cause.physical for cause in d.causes):
        return f'The mesh is at fault, not the physics: {found}.'
    return f'{MISSING}: {found}.'


def _nothing(d):
    if not d.fit:
        return 'Nothing is missing from the model that these recordings could show.'
    return f'Nothing is missing: held out, {listed([_floor(one) for one in d.fit])}.'


def _floor(one):
    unit, scale = edge_unit(one.stream)
    error, floor = figures((one.reached / scale, one.noise_floor / scale))
    return (f'the error of the {STREAMS[one.stream][0]} is {error} {unit} (noise alone: '
            f'{floor} {unit})')


def _equivalent(d):
    options = d.options()
    sure = options.pop(0, ())
    places = {_at(d, cause) for causes in options.values() for cause in causes}
    shared = places.pop() if len(places) == 1 else None
    speak = title if shared is not None else lambda cause: f'{title(cause)}{_at(d, cause)}'
    either = ' or '.join(' with '.join(speak(cause) for cause in causes)
                         for causes in options.values())
    line = f'{MISSING}: either {either}{shared or ""}; these recordings cannot tell which'
    if sure:
        line += f'. In any case {listed([_cause_at(d, cause) for cause in sure])}'
    return line + '.'


def _unexplained(d):
    line = 'Something is missing that no term of the catalogue explains'
    if d.where:
        line += f', most clearly {place(d.where[0])}'
    if d.when:
        line += f'{", " if d.where else ", most clearly "}{interval(d.when[0], d.provenance.recordings)}'
    if d.causes:
        line += f', besides {listed([_cause_at(d, cause) for cause in d.causes])}'
    return line + '.'


def _cause_at(d, cause):
    return f'{title(cause)}{_at(d, cause)}'


def _at(d, cause):
    where = d.place_of(cause)
    return '' if where is None else f' {place(where)}'


def title(cause):
    """A cause by name, and what that is: 'backlash (the pad lags ...)'."""
    return f'{spoken(cause.term)} ({cause.spec.summary})'


def spoken(term):
    """A term's or a pair's registry name as it is spoken."""
    return term.replace('_', ' ')


def place(where):
    """A Place, with its preposition."""
    if where.stream:
        words, carrier = STREAMS[where.stream]
        return f'in the {words}' + (f' ({carrier} {where.channel})' if where.channel else '')
    if where.actuator:
        return f'at the actuator of {where.actuator}'
    at = '' if where.position is None else point(where.position)
    around = '' if where.position is None else f'90 % region: {where.radius * MM:.1f} mm around it'
    if where.boundary:
        return f'on the boundary ({where.boundary}{f", {at}; {around}" if at else ""})'
    return f'at {at} ({around})'


def point(position):
    """Coordinates (3,) [m] in mm, world frame."""
    numbers = ', '.join(f'{axis} = {round(value * MM, 1) + 0.0:.1f}'
                        for axis, value in zip('xyz', position, strict=True))
    return f'{numbers} mm'


def interval(when, recordings=()):
    """An Interval: from when to when, in which recording, in what regime.

    recordings : statements.Recording; an interval that covers one of them is 'throughout' it
    """
    begins = f'from {when.t_start:.2f} to {when.t_end:.2f} s of {when.recording}'
    if any(r.name == when.recording and when.t_start <= r.t_start and r.t_end <= when.t_end
           for r in recordings):
        begins = f'throughout {when.recording}'
    regime = f', {REGIMES[when.regime]}' if when.regime else ''
    if when.onset is None:
        return begins + regime
    low, high = when.onset
    return f'{begins}{regime}, beginning suddenly between {low:.2f} and {high:.2f} s (90 %)'


def parameter(name, unit, value, low, high):
    """One fitted parameter: name, value, unit and 90 % interval, in edge units."""
    return f'{spoken(name)} {amount(unit, value, low, high)}, {bounds(unit, value, low, high)}'


def amount(unit, value, low, high):
    """A fitted value with its unit as printed, to the digits that its interval deserves."""
    return f'{_joined([p[0] for p in _parts(value, low, high)], value)}{_unit(unit)}'


def bounds(unit, value, low, high):
    """The 90 % interval of a fitted value, per axis for a vector."""
    ends = [f'{p[1]} to {p[2]}' for p in _parts(value, low, high)]
    return f'90 % interval {_joined(ends, value)}{_unit(unit)}'


def _parts(value, low, high):
    """(value, low, high) as texts, per component."""
    return [figures((v, a, b), b - a)
            for v, a, b in zip(*(np.atleast_1d(x) for x in (value, low, high)), strict=True)]


def _joined(texts, value):
    return f'({", ".join(texts)})' if np.ndim(value) else texts[0]


def _unit(unit):
    return '' if unit == '1' else f' {unit}'


def figures(values, width=None):
    """Numbers with the decimals that `width` deserves (two digits of it), as texts.

    width : of an interval; None or 0 = the smallest of the numbers that is not zero
    """
    sizes = [abs(v) for v in values if v and math.isfinite(v)]
    scale = width or min(sizes, default=1.0)
    decimals = max(0, 1 - math.floor(math.log10(scale))) if math.isfinite(scale) else 2
    return tuple('unbounded' if math.isinf(v) else f'{v:z.{decimals}f}' for v in values)


def improvement(one):
    """What a StreamFit shows: the held-out error before, after, and what noise leaves."""
    unit, scale = edge_unit(one.stream)
    given, fitted, floor = (v / scale for v in (one.as_given, one.recalibrated, one.noise_floor))
    after = [] if one.named is None else [one.named / scale]
    given, fitted, floor, *after = figures((given, fitted, floor, *after))
    named = f', {after[0]} {unit} with what was found' if after else ''
    held_out = f' (held out: {one.held_out})' if one.held_out else ''
    return (f'Error of the {STREAMS[one.stream][0]}{held_out}: {given} {unit} as given, '
            f'{fitted} {unit} recalibrated{named}; noise alone leaves {floor} {unit}.')


def certainty(d):
    """How sure: probability, distance from the nearest rival, what is left."""
    parts = []
    for option, causes in d.options().items():
        whose = listed([spoken(cause.term) for cause in causes])
        chance = min(cause.probability for cause in causes)
        if d.verdict != 'equivalent' or option:
            parts.append(f'Probability of {whose}: {percent(chance)}.')
    if d.apart is not None:
        parts.append(f'The options are {d.apart:.1f} standard deviations apart.'
                     if d.verdict == 'equivalent' else
                     f'The nearest rival is {d.apart:.1f} standard deviations away.')
    if d.chance is not None:
        parts.append(f'Noise alone would leave as much as is left in {share(d.chance)} of '
                     'recordings.')
    return ' '.join(parts)


def percent(chance):
    """A probability; what rounds to certainty is a bound."""
    if chance > 0.999:
        return 'above 99.9 %'
    if chance < 0.001:
        return 'below 0.1 %'
    return f'{100.0 * chance:.{1 if chance > 0.99 or chance < 0.01 else 0}f} %'


def share(chance):
    """A share of cases, small ones in powers of ten."""
    return percent(chance) if chance >= 1e-3 else f'less than {_power(chance)}'


def _power(chance):
    exponent = math.ceil(math.log10(max(chance, 1e-12)))
    return f'1 in {10 ** -exponent:,}'.replace(',', ' ')


def why_not(one, d):
    """Why an Alternative lost, or that it is not ruled out."""
    if one.why:
        return one.why
    if not one.visible:
        return 'not ruled out: these recordings could not have shown it'
    if one.held_out <= 0.0:
        return 'predicts what was held out no better than no new physics'
    if d.causes:
        return 'predicts what was held out less well than what is named'
    return 'gains too little on what was held out'


def request(one):
    """A NextExperiment: what to record, and what that decides."""
    steps = [one.instruction] if one.instruction else []
    if one.record:
        steps.append(f'Record the {listed([STREAMS[stream][0] for stream in one.record])} as well.')
    steps += [move(m) for m in one.moves]
    if one.splits:
        pairs = listed([f'{spoken(a)} from {spoken(b)}' for a, b in one.splits])
        sure = '' if one.separation is None else (
            f', by at least {one.separation:.1f} standard deviations')
        steps.append(f'This is expected to tell {pairs}{sure}.')
    return ' '.join(steps)


def move(m):
    """A Move as an instruction."""
    others = '; the others go home' if m.others == 'home' else ''
    if not m.pads:
        return f'All pads {"go home" if m.others == "home" else "stand"}, for {m.hold:g} s.'
    targets = listed([f'{pad.name} to {pad.position * MM:g} mm' for pad in m.pads])
    way = f'Push {targets} at {m.speed / UNITS["mm_s"][0]:g} mm/s, hold {m.hold:g} s'
    if not m.cycles:
        return f'{way}{others}.'
    times = TIMES.get(m.cycles, f'{m.cycles} times')
    return f'{way}, back, hold {m.hold:g} s; {times}{others}.'


def listed(items):
    """'a', 'a and b', 'a, b and c'."""
    items = list(items)
    return items[0] if len(items) == 1 else f'{", ".join(items[:-1])} and {items[-1]}'
