"""What jumped together jumped for one reason: markers, pads and forces at the same instant."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.diagnosis.isolation.steps import Jump
from arm_brachy.diagnosis.results.finding import Finding, threshold
from arm_brachy.diagnosis.signals.stream import BASE, EM, FORCE, OPTICAL, TISSUE

TOGETHER = 0.1     # s: steps whose intervals come as near as this may be one event
MOST = 0.6         # of the markers that were there: the tracker or the whole bench jumped
ASIDE = 4.0        # standard deviations across the push that no actuator can make
WEAK = 3.0         # z at which a step counts as a companion of a strong one
NEAR = 0.2         # of the way between two markers, by which both may miss it that exchange names
CLEAR = 3.0        # standard deviations between a pad that moved and one that did not
GROWN = 2.0        # most that tissue moves beside the pad that pushes it; of one press to another
UNDONE = 0.2       # of a step, that one which takes it back may leave
ALONG = 0.9        # cosine between steps of what presses again


@dataclass(frozen=True)
class Event:
    """Jumps at one instant: low <= t <= high [s] is the 90 % interval of the sharpest."""

    t: float
    low: float
    high: float
    jumps: tuple

    def on(self, *bodies):
        """Optical jumps on these bodies."""
        return [j for j in self.jumps if j.kind == OPTICAL and j.body in bodies]

    def of(self, kind):
        """Jumps of one stream."""
        return [j for j in self.jumps if j.kind == kind]


def events_of(found, tests):
    """Group Jumps into Events, sharpest first; of weak jumps only companions of strong ones stay.

    found : Jump each;  tests : number of channels searched
    """
    strong = sorted((j for j in found if j.z > threshold(tests, 3)),
                    key=lambda j: j.step.high - j.step.low)
    weak = [j for j in found if WEAK < j.z <= threshold(tests, 3)]
    events = []
    while strong:
        lead = strong.pop(0)
        group = [lead] + [j for j in (*strong, *weak) if _meets(lead, j)]
        strong = [j for j in strong if j not in group]
        weak = [j for j in weak if j not in group]
        events.append(Event(lead.step.t, lead.step.low, lead.step.high, _one_each(group)))
    return tuple(events)


def _one_each(group):
    """Jumps with those of one channel, parts of one step that took a few samples, added up."""
    channels = {}
    for jump in group:
        channels.setdefault((jump.kind, jump.channel), []).append(jump)
    out = []
    for parts in channels.values():
        lead = max(parts, key=lambda j: j.z)
        size = np.sum([j.step.size for j in parts], axis=0)
        out.append(replace(lead, step=replace(lead.step, size=size)))
    return tuple(out)


def _meets(one, other):
    return (other.step.low - TOGETHER <= one.step.high
            and one.step.low <= other.step.high + TOGETHER)


def event_findings(prepared, events, frames, follows):
    """One Finding per Event: who jumped decides what it was.

    frames : marker on a pad -> (3, 3) frame of its push, `pad_tracking.push_frame`
    follows : (pad, t [s], shortfall [m]) -> (share, error) of the answer that tissue and forces
        show to a pad that stands short, see `consequences`
    Most optical markers, base among them: tracker or bench. A pad's marker along its push, all of
    them where there are several: lost steps if the rest of the body follows, a slipped marker if
    it does not, either if nothing tells; not if a tissue marker jumps by more than twice as much.
    A marker alone: it slipped, unless a later step takes it back. Several tissue markers, or a
    force with them: something touched the body.
    Test: diagnosis/structural/test_events.py
    """
    return _unless_undone([_judge(prepared, event, frames, follows) for event in events])


def _unless_undone(found):
    """Findings with slips that are taken back as what they were: a marker pressed for a while.

    Glue that gave way does not come back: a slip is permanent, a press is undone. What presses
    takes its time, so that either way may be several steps. Where it pressed once, other steps of
    the marker along the same line that are not much larger are of it as well.
    """
    slips = {}
    for one in sorted(found, key=lambda one: one.t_start):
        if one.term == 'marker_slip':
            slips.setdefault(one.channel, []).append(one)
    pressed = {}
    for steps in slips.values():
        pressed |= _pressed(steps)
    return tuple(pressed.get(id(one), one) for one in found)


def _pressed(slips):
    """id -> what it is instead, of slips of one marker, in order, that a press explains."""
    out, first = {}, 0
    while first < len(slips):
        back = next((k for k in range(first + 1, len(slips))
                     if _cancel(slips[first:k + 1])), None)
        if back is None:
            first += 1
            continue
        one, last = slips[first], slips[back]
        text = (f'{one.channel} alone jumps by {1e3 * np.linalg.norm(one.value):.2f} mm at '
                f'{one.t_start:.2f} s and back at {last.t_start:.2f} s: something pressed it for '
                'so long; a marker that slips stays away.')
        out |= {id(part): _as_press(part, text) for part in slips[first:back + 1]}
        first = back + 1
    lines = [one.value for one in slips if id(one) in out]
    for one in slips:
        if id(one) not in out and any(_along(one.value, line) for line in lines):
            out[id(one)] = _as_press(one, (
                f'{one.channel} alone jumps by {1e3 * np.linalg.norm(one.value):.2f} mm at '
                f'{one.t_start:.2f} s, along the line in which something pressed it before or '
                'after.'))
    return out


def _as_press(one, text):
    return replace(one, term=None, parameter='', parameters={}, statement=text,
                   rivals=('external_force',))


def _cancel(steps):
    """True if the last of some Findings takes back what went before, within errors and UNDONE."""
    *before, back = (one.value for one in steps)
    size = max(np.linalg.norm(one) for one in np.cumsum(before, axis=0))
    left = np.linalg.norm(np.sum(before, axis=0) + back)
    errors = np.linalg.norm(np.linalg.norm([one.sd for one in steps], axis=0))
    return left < UNDONE * size + CLEAR * errors and left < size


def _along(one, line):
    """True if a step (3,) goes along that of a press, either way, and is no GROWN larger."""
    size, pressed = np.linalg.norm(one), np.linalg.norm(line)
    return abs(one @ line) > ALONG * size * pressed and size <= GROWN * pressed


def _judge(prepared, event, frames, follows):
    optical, stream = event.of(OPTICAL), prepared.evidence.get(OPTICAL)
    seen = 0 if stream is None else len(stream.names)
    if len(optical) >= max(MOST * seen, 2) and (event.on(BASE) or not _has(prepared, BASE)):
        return _all(prepared, event)
    if len(optical) == 2 and _exchanged(stream, *optical):
        return _finding(prepared, event, max(optical, key=lambda j: j.z), None,
                        f"{_names(event)} jump to each other's place at {event.t:.2f} s: they "
                        'have exchanged names.')
    on_pads = event.on(*prepared.evidence.pads)
    if len({jump.body for jump in on_pads}) == 1 and not event.on(BASE):
        lead = max(on_pads, key=lambda j: j.z)
        if not _drives(event, lead):
            rest = tuple(jump for jump in event.jumps if jump not in on_pads)
            return _judge(prepared, replace(event, jumps=rest), frames, follows)
        if len(on_pads) == 1 and len(stream.on(lead.body)) > 1:
            return _slip(prepared, event, lead)     # the others on its pad do not jump
        return _pad(prepared, event, lead, frames[lead.channel], follows)
    if len(optical) == 1 and not event.of(FORCE):
        return _slip(prepared, event, optical[0])
    if not optical:
        return _not_optical(prepared, event)
    return _finding(prepared, event, max(optical, key=lambda j: j.z), None,
                    f'{_names(event)} jump together at {event.t:.2f} s, the others do not: '
                    'something touched or let go of the body.',
                    ('external_force', 'lost_steps', 'pad_slip', 'obstacle'))


def _drives(event, lead):
    """True if the Jump of a pad's marker may have moved the tissue: pushes spread, few grow."""
    most = GROWN * np.linalg.norm(lead.step.size) + CLEAR * np.linalg.norm(lead.step.sd)
    return all(np.linalg.norm(jump.step.size) <= most for jump in event.on(TISSUE))


def _exchanged(stream, one, other):
    """True if two Jumps take two markers of the stream each to where the other one was, or back.
    """
    return any(_leads(stream, one, other.channel, sign)
               and _leads(stream, other, one.channel, sign) for sign in (1.0, -1.0))


def _leads(stream, jump, name, sign):
    """True if a Jump leads to where the marker `name` is; with sign -1, if it leads back."""
    way = stream.rest[stream.names.index(name)] - stream.rest[stream.names.index(jump.channel)]
    return np.linalg.norm(jump.step.size - sign * way) < NEAR * np.linalg.norm(way)


def takes_over(stream, jump):
    """True if a Jump takes its marker to where another one of the Stream is, or back."""
    others = [name for name in stream.names if name != jump.channel]
    return any(_leads(stream, jump, name, sign) for name in others for sign in (1.0, -1.0))


def _has(prepared, body):
    return prepared.on(OPTICAL, body)[0] is not None


def _all(prepared, event):
    size = np.mean([j.step.size for j in event.of(OPTICAL)], axis=0)
    lead = max(event.of(OPTICAL), key=lambda j: j.z)
    return _finding(prepared, event, Jump(OPTICAL, '', '', lead.step, lead.z), None,
                    f'All optical markers jump at {event.t:.2f} s by about '
                    f'{1e3 * np.linalg.norm(size):.2f} mm: tracker or bench was knocked.')


def _pad(prepared, event, jump, frame, follows):
    local = frame @ jump.step.size
    aside = float(np.hypot(*(local[1:] / jump.step.sd[1:])))
    if aside > ASIDE and np.hypot(*local[1:]) > 0.1 * abs(local[0]):
        return _slip(prepared, event, jump)
    short = -float(local[0])
    text = (f'From {event.t:.2f} s on the marker on {jump.body} stands {1e3 * abs(short):.2f} mm '
            f'{"short of" if short > 0 else "beyond"} the encoder')
    share, error = follows(jump.body, event.t, short)
    moved, still = abs(share - 1.0) < CLEAR * error, abs(share) < CLEAR * error
    if error < 1.0 / CLEAR and still and not moved:
        return _slip(prepared, event, jump, text + ', but tissue and forces show no such step: '
                     'it slipped.')
    told = error < 1.0 / CLEAR and not still
    text += ', and tissue and forces follow: the pad itself moved.' if told else '.'
    rivals = () if told else ('marker_slip',)
    actuators = (prepared.evidence.pads.index(jump.body),)
    return _finding(prepared, event, jump, 'lost_steps', text, rivals, short,
                    {'onset': event.t, 'shortfall': short, 'actuators': actuators})


def _slip(prepared, event, jump, text=''):
    size = 1e3 * np.linalg.norm(jump.step.size)
    text = text or f'{jump.channel} alone jumps by {size:.2f} mm at {event.t:.2f} s: it slipped.'
    return _finding(prepared, event, jump, 'marker_slip', text, parameters={
        'marker': jump.channel, 'onset': event.t, 'offset': tuple(jump.step.size)})


def _not_optical(prepared, event):
    lead = max(event.jumps, key=lambda j: j.z)
    if event.of(FORCE) and event.of(EM):
        return _finding(prepared, event, lead, None, f'{_names(event)} jump together at '
                        f'{event.t:.2f} s.', ('external_force', 'lost_steps', 'pad_slip'))
    what = 'force' if lead.kind == FORCE else 'EM position'
    return _finding(prepared, event, lead, None, f'The {what} of {_names(event)} jumps at '
                    f'{event.t:.2f} s, no marker does.',
                    ('force_drift', 'external_force') if lead.kind == FORCE else ('em_offset',))


def _names(event):
    return ', '.join(dict.fromkeys(j.channel for j in event.jumps))


def _finding(prepared, event, jump, term, statement, rivals=(), value=None, parameters=None):
    stream = prepared.evidence.get(jump.kind)
    sd = jump.step.sd if value is None else float(jump.step.sd[0])
    value = jump.step.size if value is None else value
    parameter = {'lost_steps': 'shortfall', 'marker_slip': 'offset'}.get(term, '')
    return Finding(jump.kind, jump.channel, term, parameter, value,
                   'N' if jump.kind == FORCE else 'm', sd, jump.z, event.t, float(stream.t[-1]),
                   statement, rivals, (event.low, event.high), parameters or {})
