"""What a diagnosis says to a person: verdict, place, time, doubt, request, each in plain words.

Sentences carry the numbers and nothing that the numbers do not.
"""

from arm_brachy.core.quantity import UNITS
from arm_brachy.diagnosis.results.formatting import (
    STREAMS,
    figures,
    listed,
    parameter,
    percent,
    share,
    spoken,
)
from arm_brachy.diagnosis.results.parts import SEEN, edge_unit
from arm_brachy.diagnosis.settings import Rules

REGIMES = {'rest': 'at rest', 'hold': 'in holds', 'load': 'while loading',
           'unload': 'while unloading', 'rate': 'growing with speed',
           'amplitude': 'growing with depth',
           'direction': 'depending on the direction of motion',
           'past_maximum': 'depending on the deepest push before'}
TIMES = {1: 'once', 2: 'twice'}
MISSING = 'Missing from the model'
MM = 1e3


def verdict(diagnosis):
    """The verdict of a Diagnosis in one sentence, and one for each finding without a name."""
    line = {'named': _named, 'nothing_missing': _nothing, 'equivalent': _equivalent,
            'unexplained': _unexplained, 'partial': _partial}[diagnosis.verdict](diagnosis)
    if diagnosis.verdict == 'nothing_missing':      # a sound recording shows them as well
        return line
    return ' '.join([line, *dict.fromkeys(
        one.statement for one in diagnosis.findings if one.nameless)])


def _named(d):
    found = '; '.join(_cause_at(d, cause) for cause in d.causes)
    if not any(cause.physical for cause in d.causes):
        return f'The mesh is at fault, not the physics: {found}.'
    return f'{MISSING}: {found}.'


def _nothing(d):
    if not d.fit:
        return 'Nothing is missing from the model that these recordings could show.'
    seen = ' that this mesh lets show' if any(one.blurred for one in d.fit) else ''
    return f'Nothing is missing{seen}: held out, {listed([_floor(one) for one in d.fit])}.'


def _floor(one):
    unit, scale = edge_unit(one.stream)
    error, floor, *blur = figures(tuple(value / scale for value in (
        one.reached, one.noise_floor, *([one.mesh] if one.blurred else []))))
    return (f'the error of the {STREAMS[one.stream][0]} is {error} {unit} (noise alone: '
            f'{floor} {unit}{"".join(f", mesh: up to {value} {unit}" for value in blur)})')


def _equivalent(d):
    options = d.options()
    sure = options.pop(0, ())
    places = {_at(d, cause) for causes in options.values() for cause in causes}
    shared = places.pop() if len(places) == 1 else None
    named = set()

    def speak(cause):
        what = spoken(cause.term) if cause.term in named else title(cause)
        named.add(cause.term)
        return what if shared is not None else f'{what}{_at(d, cause)}'

    either = ' or '.join(' with '.join(map(speak, causes)) for causes in options.values())
    line = f'{MISSING}: either {either}{shared or ""}; these recordings cannot tell which'
    if sure:
        line += f'. In any case {listed([_cause_at(d, cause) for cause in sure])}'
    return line + '.'


def _unexplained(d):
    # Nothing is left, and another recording was asked for: more than one thing would explain it.
    open_ = d.next_experiment is not None and (d.chance or 0.0) >= Rules().alarm
    line = 'Something is missing that ' + ('these recordings cannot name' if open_
                                           else 'no term of the catalogue explains')
    if d.where:
        line += f', most clearly {place(_unnamed(d.where))}'
    if d.when:
        most = '' if d.where else 'most clearly '
        line += f', {most}{interval(_unnamed(d.when), d.provenance.recordings)}'
    if d.causes:
        line += f', besides {listed([_cause_at(d, cause) for cause in d.causes])}'
    return line + '.'


def _partial(d):
    why = {'interrupted': f'interrupted after {d.unfinished.seconds:.0f} s',
           'time_limit': f'the time limit ended it after {d.unfinished.seconds:.0f} s',
           'quick': 'this is a quick look'}[d.unfinished.why]
    done, left = ', '.join(d.unfinished.done) or 'nothing', ', '.join(d.unfinished.left)
    found = (f' Found in the signals without a tissue model: '
             f'{"; ".join(_cause_at(d, cause) for cause in d.causes)}.' if d.causes else '')
    return f'No verdict: {why}. Done: {done}. Not done: {left}.{found}{_screened(d)}'


def _screened(d):
    """Whether the misfit of a partial answer is more than noise, and what may explain it."""
    if d.chance is None:
        return ''
    if d.chance >= Rules().alarm:
        line = ' Structured tests find no pattern in the misfit without any term'
    else:
        line = ' Structured tests find a pattern in the misfit without any term'
    if not d.screen or d.screen[0].evidence < Rules().evidence:
        return f'{line}; no candidate stands out in the linear screen.' if d.screen else f'{line}.'
    first, *others = d.screen
    ahead = f', ahead of {spoken(others[0].term)} by {_nats(first, others[0])}' if others else ''
    return (f'{line}; the linear screen ranks {spoken(first.term)} first (log evidence '
            f'{first.evidence:+.0f}{ahead}), which is no proof of it.')


def screened(one):
    """A Screened candidate in one line."""
    size = f', {one.size}' if one.size else ''
    where = f' ({one.variant})' if one.variant else ''
    full = '' if one.full_fit is None else f', by a full fit {one.full_fit:+.1f}'
    return (f'{spoken(one.term)}{where}{size}: log evidence {one.evidence:+.1f}{full}, held out '
            f'{one.held_out:+.1f}')


def _nats(one, other):
    return f'{one.evidence - other.evidence:.0f}'


def remaining(d):
    """How large the misfit of Diagnosis `d` still is, as a multiple of the noise; '' if not known.

    All streams, the largest first where it is more than twice the noise.
    """
    if not d.fit:
        return ''
    worst = max(d.fit, key=lambda one: one.times_noise)
    if worst.times_noise <= SEEN:
        return f'The remaining misfit is {worst.times_noise:.1f} times the noise or less.'
    unit, scale = edge_unit(worst.stream)
    error, floor, *blur = figures(tuple(value / scale for value in (
        worst.reached, worst.noise_floor, *([worst.mesh] if worst.blurred else []))))
    mesh = f'; the mesh may account for {blur[0]} {unit} of it' if blur else ''
    others = [f'{STREAMS[one.stream][0]} {one.times_noise:.1f}' for one in d.fit
              if one is not worst]
    rest = f' ({", ".join(others)} times)' if others else ''
    return (f'Not all of the misfit is explained: that of the {STREAMS[worst.stream][0]} is still '
            f'{worst.times_noise:.1f} times the noise, {error} over {floor} {unit}{mesh}{rest}.')


def _unnamed(found):
    """The first Place or Interval that belongs to no cause; else the first."""
    return next((one for one in found if not one.term), found[0])


def _cause_at(d, cause):
    return f'{title(cause)}{_at(d, cause)}'


def _at(d, cause, *, region=True):
    """Where a cause is, of those in `where` of a Diagnosis or a Nearest."""
    where = next((p for p in d.where if p.option == cause.option and p.term == cause.term), None)
    return '' if where is None else f' {place(where, region=region)}'


def title(cause):
    """A cause by name, and what that is: 'backlash (the pad lags ...)'."""
    return f'{spoken(cause.term)} ({cause.spec.summary})'


def numbers(d):
    """Of every cause of Diagnosis `d` that has parameters, these with their intervals."""
    found = [(cause.term, cause.shown()) for cause in d.causes]
    return [f'{spoken(term)}: '
            + '; '.join(parameter(name, unit, *values) for name, _, unit, *values in rows)
            for term, rows in found if rows]


def place(where, *, region=True):
    """A Place, with its preposition; region : with the region around it."""
    if where.stream:
        words, carrier = STREAMS[where.stream]
        return f'in the {words}' + (f' ({carrier} {where.channel})' if where.channel else '')
    if where.actuator:
        return f'at the actuator of {where.actuator}'
    at = '' if where.position is None else point(where.position)
    if at and region:
        radius = f'{where.radius * MM:.1f} mm'
        at += f' (90 % region: {radius} around it)' if where.term else f' (within {radius} of it)'
    if where.boundary:
        return f'on the {where.boundary}{f", at {at}" if at else ""}'
    return f'at {at}'


def point(position):
    """Coordinates (3,) [m] in mm, world frame."""
    numbers = ', '.join(f'{axis} = {round(value * MM, 1) + 0.0:.1f}'
                        for axis, value in zip('xyz', position, strict=True))
    return f'{numbers} mm'


def interval(when, recordings=()):
    """An Interval: from when to when, in which recording, in what regime.

    recordings : parts.Recording; an interval that covers one of them is 'throughout' it
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


def nearest(d):
    """What comes nearest to what is unexplained, what it gains, and that it is not all of it."""
    one = d.nearest
    found = listed([title(cause) + _at(one, cause, region=False) for cause in one.causes])
    gains = f': held out, {listed([_gain(f) for f in one.fit])}' if one.fit else (
        ', by its linear answer: its full fit did not settle')
    return (f'What comes nearest is {found}{gains}. It is not claimed: what it leaves is more '
            'than noise.')


def _gain(one):
    unit, scale = edge_unit(one.stream)
    before, after, floor = figures((one.recalibrated / scale, one.named / scale,
                                    one.noise_floor / scale))
    return (f'the error of the {STREAMS[one.stream][0]} goes from {before} to {after} {unit} '
            f'(noise alone: {floor} {unit})')


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
        parts.append(_left_by_chance(d))
    return ' '.join(parts)


def _left_by_chance(d):
    """Whether the residual has structure beyond noise, and how often noise alone has as much."""
    noise = 'noise alone' if not any(one.blurred for one in d.fit) else (
        'noise and the error of the mesh')
    how = (f'structure as strong as in the residual would come from {noise} in '
           f'{share(d.chance)} of repeated recordings')
    if d.chance >= Rules().alarm:
        return f'The residual shows no structure beyond noise: {how}.'
    return f'The residual still has structure: {how}.'


def why_not(one, d):
    """Why an Alternative lost, or that it is not ruled out."""
    if one.why:
        return one.why
    if d.nearest is not None and set(one.terms) == {cause.term for cause in d.nearest.causes}:
        return 'comes nearest, but leaves more than noise'
    if not one.visible:
        return 'not ruled out: these recordings could not have shown it'
    if one.held_out <= 0.0:
        return 'predicts what was held out no better than no new physics'
    if d.causes and d.held_out is not None and one.held_out >= d.held_out:
        return 'predicts what was held out as well, but all data together less well'
    if d.causes:
        return 'predicts what was held out less well than what is named'
    if d.verdict == 'unexplained' and one.held_out >= Rules().held_out:
        return 'explains a part at most'
    return 'gains too little on what was held out'


def request(one):
    """A NextExperiment: what to record, and what that decides."""
    steps = [one.instruction] if one.instruction else []
    if one.record:
        added = listed([STREAMS[stream][0] for stream in one.record])
        steps.append(f'Record the {added} as well.')
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
