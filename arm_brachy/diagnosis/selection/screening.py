"""All that may be missing, with its response: every term of the registry at every place."""

from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis import forked
from arm_brachy.diagnosis.isolation.handover import Occasions
from arm_brachy.diagnosis.model.condensation import Condensed
from arm_brachy.diagnosis.model.hypothesis import LOOSENING
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.selection.candidates import candidates
from arm_brachy.registry import TERMS
from arm_brachy.tissue.assembly import InvertedElement

HIDDEN = (Stage.SETPOINT, Stage.ENCODER)    # before or at the encoders, which drive the model
RECALIBRATED = ('stiffness_scale',)         # no physics that is missing: the scene's own modulus
INERTIAL = ('damping',)                     # nothing without inertia, which no model here has
HEAVY = ('point_mass',)                     # nothing without gravity


@dataclass(frozen=True)
class Tried:
    """Hypotheses with their responses in every recording.

    hypotheses : Hypothesis each;  responses : one tuple of sensitivities.Response per hypothesis,
        in the order of the recordings
    left_out : term -> why it was not tried
    """

    hypotheses: tuple
    responses: tuple
    left_out: dict = field(default_factory=dict)

    def more(self, other):
        """The Tried with the hypotheses of another on the same recordings."""
        found = {one.name for one in other.hypotheses}
        return Tried((*self.hypotheses, *other.hypotheses), (*self.responses, *other.responses),
                     {name: why for name, why in self.left_out.items() if name not in found})


def triable(cls, remembers=False, heavy=True):
    """'' if a term class can be tried at all, else why not.

    remembers : True beside terms with memory;  heavy : False where nothing has weight
    """
    name = cls.spec.name
    if cls.spec.stage in HIDDEN:
        return 'acts before the encoders, which hide it'
    if name in RECALIBRATED:
        return 'is recalibrated, not missing'
    if name in LOOSENING and remembers:
        return 'asks for full runs beside terms with memory'
    if name in HEAVY and not heavy:
        return 'has no effect at rest without gravity'
    return 'acts on what swings, which is not modelled here' if name in INERTIAL else ''


def try_all(matched, occasions=None, progress=None, terms=TERMS, thin=None, jobs=1):
    """Tried: all terms of the registry on match.Matched recordings of one body.

    occasions : candidates.Occasions;  terms : classes of the registry, where not all
    thin : function from Hypotheses to those of them that are tried, None = all are
    progress : called with candidates done, of all, and the name of the next one; None = nobody is
    jobs : processes at a time (`forked`); with more than one there is no next one
    What happened suddenly in one of several recordings, or in a rhythm, is tried in that one alone
    as well: it need not happen again at the same time. A place at which a term does not fit the
    body, or finds no state, is left out.
    """
    occasions = occasions or Occasions()
    specimen, left_out, found, answers = matched[0].baseline.model.specimen, {}, [], []
    remembers = any(m.baseline.model.remembers or m.baseline.model.timed for m in matched)
    heavy = any(np.any(m.baseline.model.body.gravity) for m in matched)
    whys = {cls.spec.name: triable(cls, remembers, heavy) for cls in terms}
    left_out |= {name: why for name, why in whys.items() if why}
    listed = [cls for cls in terms if cls.spec.name not in left_out]
    options_of = {cls: candidates(cls, specimen, occasions) for cls in listed}
    if thin is not None:
        options_of = {cls: thin(some) for cls, some in options_of.items()}
    outcomes = _outcomes(matched, options_of, progress or (lambda done, of, name: None), jobs)
    for cls, options in options_of.items():
        why = '' if options else 'nothing here says when or where'
        for one, (responses, none) in zip(options, outcomes[cls], strict=True):
            why = none or why
            for way, its in _ways(one, responses, occasions):
                found.append(way)
                answers.append(its)
        if not any(one.cls is cls for one in found):
            left_out[cls.spec.name] = why
    return Tried(tuple(found), tuple(answers), left_out)


def _outcomes(matched, options_of, progress, jobs):
    """Class -> [`_outcome` of each of its Hypotheses], which `options_of` has by their class."""
    jobs = forked.processes(jobs)
    if jobs > 1:
        return _outcomes_at_once(matched, options_of, progress, jobs)
    total, number = sum(map(len, options_of.values())), count()

    def outcome(one):
        progress(next(number), total, one.name)
        return _outcome(matched, one)

    return {cls: list(map(outcome, options)) for cls, options in options_of.items()}


def _outcomes_at_once(matched, options_of, progress, jobs):
    """`_outcomes` by so many processes; one does a class, whose Hypotheses share what they ask."""
    left, total = dict(options_of), sum(map(len, options_of.values()))

    def work(cls):
        return ([_outcome(matched, one) for one in options_of[cls]],
                [_noted(m.baseline) for m in matched])

    def done(cls):
        del left[cls]
        progress(total - sum(map(len, left.values())), total, '')

    progress(0, total, '')
    found = forked.each(work, tuple(options_of), jobs, lambda cls: _cost(options_of[cls]), done)
    for _, notes in found:
        for m, noted in zip(matched, notes, strict=True):
            _note(m.baseline, *noted)
    return {cls: outcomes for cls, (outcomes, _) in zip(options_of, found, strict=True)}


def _noted(baseline):
    """What answers at a Baseline leave to later ones, which would not find it alike by themselves.

    What a class does to supports is asked of its first Hypothesis; and a Baseline at some of the
    states takes over where the whole one was condensed.
    """
    return baseline.restructures, baseline.condensed is not None


def _note(baseline, restructures, condensed):
    """Leave at a Baseline what `_noted` says of a fork's copy of it."""
    baseline.restructures.update(restructures)
    if condensed and baseline.condensed is None:
        baseline.condensed = Condensed(baseline)


def _cost(options):
    """What orders classes by the time that their Hypotheses take: roughly, it decides nothing."""
    return any(one.name in LOOSENING for one in options), len(options)


def _outcome(matched, one):
    """(Responses in all recordings, '') of a Hypothesis;  ((), why) of one that is left out."""
    try:
        responses = tuple(respond(m.baseline, one) for m in matched)
    except (InputError, InvertedElement, NotConverged) as error:
        return (), str(error)
    if all(_whole(r) for r in responses):
        return responses, ''
    return (), 'the model finds no state with it'


def _ways(one, responses, occasions):
    """(Hypothesis, Responses) of a Hypothesis in all recordings and in each alone; () of none."""
    if not responses:
        return ()
    # What another process returns is of a copy; a hypothesis is known by which object it is.
    responses = tuple(replace(r, hypothesis=one) for r in responses)
    return ((one, responses), *_in_one_alone(one, responses, occasions))


def _in_one_alone(one, responses, occasions):
    """(Hypothesis, Responses) for each of several recordings that shows its onset or rhythm."""
    owners = {owner for place in one.place.items() if place[0] in ('onset', 'frequency')
              for owner in occasions.owners.get(place, ())} if len(responses) > 1 else ()
    for owner in sorted(owners):
        alone = replace(one, only=owner)
        yield alone, tuple(r if number == owner else replace(r, values={
            kind: np.zeros_like(values) for kind, values in r.values.items()})
            for number, r in enumerate(responses))


def _whole(response):
    return all(np.isfinite(values).all() for values in response.values.values())
