"""The answer of a diagnosis: everything that is said, in one object that checks itself."""

import dataclasses
import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from arm_brachy.core.config import to_mapping
from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.core.scene import Material
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.report.next_steps import what_next
from arm_brachy.diagnosis.results.parts import edge_unit

VERDICTS = ('named', 'nothing_missing', 'equivalent', 'unexplained', 'partial')
RECALIBRATED = ('E', 'nu')   # fields of core.scene.Material that an overlay can carry


@dataclass(frozen=True)
class Provenance:
    """How to get the answer again.

    name : of the diagnosis;  command : as typed;  scene : path of the scene that was given
    recordings : parts.Recording each
    """

    name: str
    seed: int
    commit: str
    machine: str
    scene: str
    recordings: tuple
    command: str = ''


@dataclass(frozen=True)
class Diagnosis:
    """What `diagnose` says of recordings beside a scene.

    verdict : 'named', 'nothing_missing', 'equivalent' (the options cannot be told apart),
        'unexplained' (something is left that no term explains) or 'partial' (no verdict: the
        diagnosis did not run to its end)
    causes : cause.Cause;  option 0 holds in any case, of the other options one
    where, when : parts.Place and parts.Interval, most certain first
    alternatives : parts.Alternative that were considered and lost, best first
    limits : parts.Limit of what was tried;  () = not known
    fit : parts.StreamFit per stream, on what was held out
    next_experiment : parts.NextExperiment or None
    recalibrated : 'E', 'nu' -> cause.Estimate [Pa, 1], fitted whatever else was found
    scene : path of the corrected scenario, None if none was written
    evidence : gain in log evidence [nats] of what is named, over no cause; None = nothing is
    held_out : gain on what was held out of what is named, as an Alternative's; None = not scored
    chance : that noise alone leaves as much as is left, by structured tests; None = not tested
    apart : separation of what is named from the nearest rival [sd];  None = no rival
    nearest : parts.Nearest, of a verdict 'unexplained' if anything stands out; else None
    findings : finding.Finding, what needs no tissue model;  notes : sentences
    unfinished : parts.Unfinished of a verdict 'partial', else None
    screen : parts.Screened, best first, of a verdict 'partial'
    Raises InputError if verdict and causes contradict each other.
    Test: diagnosis/test_diagnosis.py
    """

    verdict: str
    provenance: Provenance
    causes: tuple = ()
    where: tuple = ()
    when: tuple = ()
    alternatives: tuple = ()
    fit: tuple = ()
    next_experiment: object = None
    recalibrated: dict = field(default_factory=dict)
    scene: str | None = None
    evidence: float | None = None
    held_out: float | None = None
    chance: float | None = None
    apart: float | None = None
    nearest: object = None
    findings: tuple = ()
    notes: tuple = ()
    limits: tuple = ()
    unfinished: object = None
    screen: tuple = ()

    def __post_init__(self):
        if self.verdict not in VERDICTS:
            raise InputError(f'verdict {self.verdict!r}; must be one of {", ".join(VERDICTS)}')
        options = {cause.option for cause in self.causes}
        if self.verdict == 'equivalent':
            if len(options - {0}) < 2:
                raise InputError(f'verdict equivalent with options {sorted(options)}; must have '
                                 'at least two that are not 0')
        elif options - {0}:
            raise InputError(f'verdict {self.verdict} with options {sorted(options)}; every cause '
                             'must have option 0: it holds')
        if self.verdict == 'named' and not self.causes:
            raise InputError('verdict named without a cause; must name one')
        if self.verdict == 'nothing_missing' and self.causes:
            raise InputError(f'verdict nothing_missing with {len(self.causes)} causes; must have '
                             'none')
        if self.verdict == 'unexplained' and not (self.where or self.when):
            raise InputError('verdict unexplained without where or when; must have one of them')
        if self.nearest is not None and self.verdict != 'unexplained':
            raise InputError(f'verdict {self.verdict} with what comes nearest; only what is '
                             'unexplained can have it')
        if (self.verdict == 'partial') != (self.unfinished is not None):
            raise InputError(f'verdict {self.verdict} {"with" if self.unfinished else "without"} '
                             'a reason why it is not finished; only a partial one has it')
        if odd := set(self.recalibrated) - set(RECALIBRATED):
            raise InputError(f'recalibrated {", ".join(sorted(odd))}; must be of '
                             f'{", ".join(RECALIBRATED)}: what a scenario can carry')

    @property
    def sentence(self):
        """The verdict in one sentence."""
        return sentences.verdict(self)

    def options(self):
        """Map option -> tuple of its causes, most probable first; 0 (in any case) leads."""
        found = {}
        for cause in self.causes:
            found.setdefault(cause.option, []).append(cause)
        return {o: tuple(found[o]) for o in
                sorted(found, key=lambda o: (o != 0, -max(c.probability for c in found[o])))}

    def likeliest(self):
        """The causes that hold if the most probable option does."""
        options = self.options()
        free = [o for o in options if o != 0]
        return (*options.get(0, ()), *(options[free[0]] if free else ()))

    def fitted_anyway(self):
        """(name, meaning, unit, value, low, high) in edge units of what was recalibrated."""
        infos = quantities(Material)
        return [(name, infos[name].text, UNITS[infos[name].unit][1],
                 *(infos[name].to_edge(v) for v in (one.value, one.low, one.high)))
                for name, one in self.recalibrated.items()]

    def to_json(self, path=None):
        """The answer as JSON text; also written to `path` if given. NaN and infinity are null."""
        text = json.dumps(_plain(_body(self)), indent=2, allow_nan=False, ensure_ascii=False)
        if path is not None:
            Path(path).write_text(text + '\n', encoding='utf-8')
        return text + '\n'


def _body(d):
    return {
        'verdict': d.verdict,
        'sentence': d.sentence,
        'where': [_place(place) for place in d.where],
        'when': [_interval(interval) for interval in d.when],
        'causes': [_cause(cause) for cause in d.causes],
        'alternatives': [_alternative(d, one) for one in d.alternatives],
        'would_have_shown_from': [dataclasses.asdict(one) for one in d.limits],
        'fit': [_fit(one) for one in d.fit],
        'next_experiment': None if d.next_experiment is None else _next(d.next_experiment),
        'scene': d.scene,
        'recalibrated': _estimates(Material, d.recalibrated),
        'evidence_nats': d.evidence,
        'held_out_score': d.held_out,
        'chance_of_what_is_left': d.chance,
        'separation_sd': d.apart,
        'nearest': None if d.nearest is None else _nearest(d),
        'findings': [_finding(one) for one in d.findings],
        'notes': list(d.notes),
        'provenance': _provenance(d.provenance),
        'remaining_misfit': [_remaining(one) for one in d.fit],
        'what_next': list(what_next(d)),
        'unfinished': None if d.unfinished is None else dataclasses.asdict(d.unfinished),
        'linear_screen': [dataclasses.asdict(one) for one in d.screen],
    }


def _place(place):
    out = {key: getattr(place, key) for key in ('stream', 'channel', 'actuator', 'boundary')
           if getattr(place, key)}
    if place.position is not None:
        out |= {'position_m': place.position, 'radius_m': place.radius}
    if place.term:
        out |= {'term': place.term, 'option': place.option}
    return out


def _interval(interval):
    out = {'recording': interval.recording, 't_start_s': interval.t_start,
           't_end_s': interval.t_end, 'regime': interval.regime}
    if interval.onset is not None:
        out['onset_s'] = interval.onset
    if interval.term:
        out['term'] = interval.term
    return out


def _cause(cause):
    return {'term': cause.term, 'parameters': _estimates(cause.declared, cause.parameters),
            'applies_to': cause.applies_to, 'probability': cause.probability,
            'option': cause.option, **({'scenes': cause.scenes} if cause.scenes else {})}


def _estimates(declared, estimates):
    """Parameters in the unit of their declaration, which the key ends in."""
    infos = quantities(declared)
    return {infos[name].key(name): {
        'value': infos[name].to_edge(one.value),
        'interval_90': [infos[name].to_edge(one.low), infos[name].to_edge(one.high)],
        'unit': UNITS[infos[name].unit][1]} for name, one in estimates.items()}


def _nearest(d):
    causes = [{key: value for key, value in _cause(cause).items()
               if key not in ('probability', 'option')} for cause in d.nearest.causes]
    for value in (one for cause in causes for one in cause['parameters'].values()):
        del value['interval_90']    # of a model that does not hold
    return {'words': sentences.nearest(d), 'causes': causes,
            'where': [{key: value for key, value in _place(place).items() if key != 'radius_m'}
                      for place in d.nearest.where],
            'fit': [_fit(one) for one in d.nearest.fit]}


def _alternative(d, one):
    return {'terms': one.terms, 'held_out_score': one.held_out, 'visible': one.visible,
            'why': sentences.why_not(one, d)}


def _fit(one):
    unit, scale = edge_unit(one.stream)
    rmse = {key: None if value is None else value / scale for key, value in (
        ('as_given', one.as_given), ('recalibrated', one.recalibrated),
        ('with_the_causes', one.named), ('noise_floor', one.noise_floor), ('mesh', one.mesh))}
    return {'stream': one.stream, 'unit': unit, **rmse, 'held_out': one.held_out}


def _remaining(one):
    return {'stream': one.stream, 'times_noise': one.times_noise}


def _next(one):
    return {'words': sentences.request(one), 'moves': [to_mapping(move) for move in one.moves],
            'record': one.record, 'splits': one.splits, 'separation_sd': one.separation}


def _finding(one):
    return {'stream': one.stream, 'channel': one.channel, 'term': one.term,
            'statement': one.statement, 'size_sd': one.z, 't_start_s': one.t_start,
            't_end_s': one.t_end, 'rivals': one.rivals}


def _provenance(source):
    return {'name': source.name, 'seed': source.seed, 'commit': source.commit,
            'machine': source.machine, 'scene': source.scene, 'command': source.command,
            'recordings': [{'name': r.name, 'role': r.role, 't_start_s': r.t_start,
                            't_end_s': r.t_end} for r in source.recordings]}


def _plain(value):
    """numpy and tuples -> what JSON holds; NaN and infinity -> None."""
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
