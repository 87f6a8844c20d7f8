"""What findings without a tissue model hand on: terms that are there, when things happened."""

from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.diagnosis.isolation.events import TOGETHER
from arm_brachy.diagnosis.results.finding import ALIKE, sigma
from arm_brachy.registry import by_name

PUT_RIGHT = ('clock_offset',)   # in the states themselves (`recordings.look`)
SEEN_BETTER = ('marker_slip',)  # by a model: how far it went while pads moved, no jump tells


@dataclass(frozen=True)
class Given:
    """Findings of several recordings, sorted by what becomes of them.

    certain : (finding, recording) that name a term and have no rival: the model gets them before
        anything else is looked for
    open : that name a term which has rivals, or which a model sees better: left to the comparison
        with the model
    nameless : that name none, silence of a stream left out: it is no departure from the model
    faint : that name a term and have no rival, but may be chance: as if nothing had been seen
    """

    certain: tuple
    open: tuple
    nameless: tuple
    faint: tuple = ()

    @property
    def terms(self):
        """Terms of the certain findings, one each, but for what the states have right already."""
        return _terms(f for f, _ in self.certain if f.term not in PUT_RIGHT)

    @property
    def open_terms(self):
        """Terms of the open findings, one each."""
        return _terms(f for f, _ in self.open)


def given(recorded, known=(), beside=()):
    """Given of Recorded recordings.

    known : findings of a recording in which nothing is wrong; what it shows too, at least half as
        large, is no fault but the set-up, handed on as a term that is no news
    beside : Recorded of the same set-up; what one of them shows that has no rival there, and as
        large, has none here, and what is a rival of it there is that
    """
    certain, open_, nameless, faint = [], [], [], []
    sure = [f for one in beside for f in one.structure.findings if f.term and not f.rivals]
    for one in recorded:
        for finding in one.structure.findings:
            if any(_no_news(finding, other) for other in known):
                continue
            finding = _settled(finding, sure)
            if finding.term is None:
                nameless += [(finding, one.name)] if finding.nameless else []
            elif finding.term in SEEN_BETTER or finding.rivals:
                open_.append((finding, one.name))
            else:
                (certain if finding.sure else faint).append((finding, one.name))
    return Given(tuple(certain), tuple(open_), tuple(nameless), tuple(faint))


def _settled(finding, sure):
    """The Finding, as those of the set-up that have no rivals tell it from its own."""
    if any(_as_large(finding, other) for other in sure):
        return replace(finding, rivals=())
    told = next((other for other in sure if other.term in finding.rivals and other.onset is None
                 and (other.stream, other.channel) == (finding.stream, finding.channel)), None)
    return finding if told is None else replace(told, t_start=finding.t_start,
                                                t_end=finding.t_end)


def _same(one, other):
    return (one.term, one.stream, one.channel, one.parameter) == (
        other.term, other.stream, other.channel, other.parameter)


def _no_news(one, known):
    """True if a sound recording shows as much, within errors, or at least half of it."""
    more = np.subtract(one.value, known.value)
    return _same(one, known) and (
        sigma(more, np.hypot(one.sd, known.sd)) < ALIKE
        or np.linalg.norm(more) <= np.linalg.norm(known.value))


def _as_large(one, other):
    return _same(one, other) and sigma(np.subtract(one.value, other.value),
                                       np.hypot(one.sd, other.sd)) < ALIKE


def _terms(findings):
    """Terms of findings, each of the same numbers once."""
    kept = {}
    for finding in findings:
        kept.setdefault((finding.term, repr(finding.parameters)), finding)
    return tuple(map(term_of, kept.values()))


def term_of(finding):
    """The term of the registry that a finding.Finding names, as it found it."""
    return by_name(finding.term)(**{
        key: tuple(map(float, value)) if getattr(value, 'ndim', 0) else value
        for key, value in finding.parameters.items()})


def onsets_in(recorded):
    """Middle -> (low, high) [s], 90 %, of when something began in a recordings.Recorded."""
    return {float(sum(finding.onset) / 2.0): finding.onset
            for finding in recorded.structure.findings if finding.onset is not None}


def occasions_of(recorded):
    """candidates.Occasions: when something happened suddenly, in which of them, and rhythms."""
    owners, windows, frequencies, ends = {}, set(), [], []
    for number, one in enumerate(recorded):
        ends.append(float(one.states.t[-1]))
        onsets = sorted(onsets_in(one))
        for onset in onsets:
            owners['onset', onset] = (*owners.get(('onset', onset), ()), number)
        stops = [*onsets, ends[-1]][1:]
        windows |= {(a, b) for a, b in zip(onsets, stops, strict=True) if b > a}
        rhythms = [float(finding.parameters['frequency'])
                   for finding in one.structure.findings if 'frequency' in finding.parameters]
        frequencies += rhythms
        owners |= {('frequency', rhythm): (number,) for rhythm in rhythms}
    onsets = sorted(value for what, value in owners if what == 'onset')
    explained = tuple(pair for one in recorded for pair in _explained(one))
    return Occasions(tuple(onsets), tuple(sorted(windows)), tuple(frequencies), max(ends), owners,
                     explained)


def _explained(recorded):
    """[(marker, (low, high) [s])] of a pad that lost steps: no marker on it slipped as well then.

    Only where tissue or forces told that the pad itself moved; else either is left to the model.
    """
    scene = recorded.prepared.evidence.scene
    return [(marker.name, (finding.onset[0] - TOGETHER, finding.onset[1] + TOGETHER))
            for finding in recorded.structure.findings
            if finding.term == 'lost_steps' and finding.sure and not finding.rivals
            for marker in scene.markers
            if marker.body in {scene.pads[i].name for i in finding.parameters['actuators']}]


@dataclass(frozen=True)
class Occasions:
    """What a caller knows of when something happened.

    onsets : [s] change points;  windows : (start, end) [s] of passing events
    frequencies : [Hz] of rhythms in the residual
    end : [s] of the last recording to end; 0 = not known
    owners : ('onset', [s]) or ('frequency', [Hz]) -> numbers of the recordings that show it
    explained : (marker, (from, to) [s]) of steps of a marker that findings explain
    """

    onsets: tuple = ()
    windows: tuple = ()
    frequencies: tuple = ()
    end: float = 0.0
    owners: dict = field(default_factory=dict)
    explained: tuple = ()

    def is_news(self, place):
        """False if a place, field -> value, is the step of a marker that a finding explains."""
        return not any(place.get('marker') == marker and low <= place.get('onset', -np.inf) <= high
                       for marker, (low, high) in self.explained)
