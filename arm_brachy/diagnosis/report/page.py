"""The page of a diagnosis: read in a minute from the top, details below."""

import re
from dataclasses import dataclass
from io import StringIO

from ruamel.yaml import YAML

from arm_brachy.core.config import to_mapping
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.report.curves import curve_plate
from arm_brachy.diagnosis.report.figures import fit_plate, when_plate, where_plate
from arm_brachy.diagnosis.report.misfit_film import MisfitStates, misfit_film, misfit_note
from arm_brachy.diagnosis.report.next_steps import what_next
from arm_brachy.diagnosis.report.partial_residuals import partial_plate
from arm_brachy.diagnosis.results import formatting
from arm_brachy.diagnosis.results.channels import channel
from arm_brachy.diagnosis.results.parts import edge_unit
from arm_brachy.diagnosis.selection.detectability import FAR, SHOWS
from arm_brachy.evaluation.body_place import Body
from arm_brachy.evaluation.page import (
    Cell,
    Column,
    Fact,
    Grid,
    Verdict,
    number,
    pictures,
    write_page,
)
from arm_brachy.viewing.page import film_block

MOODS = {'named': 'bad', 'nothing_missing': 'good', 'equivalent': 'open', 'unexplained': 'open',
         'partial': ''}
MOST_LINES = 6   # places or intervals in words; more do not make the page clearer
EVERY = -1          # index of a pad that stands for all of them
PARAMETERS = (Column('Parameter', numeric=False), Column('Meaning', numeric=False),
              Column('Value'), Column('90 % interval'), Column('Unit', numeric=False))
ALTERNATIVES = (Column('Explanation', numeric=False), Column('Held-out score', 'nat'),
                Column('Why it lost', numeric=False))
SCREEN = (Column('Candidate', numeric=False), Column('Where', numeric=False),
          Column('Size, to first order', numeric=False), Column('Log evidence', 'nat'),
          Column('Held-out score', 'nat'), Column('Log evidence of the full fit', 'nat'))
LIMITS = (Column('Explanation', numeric=False), Column('Parameter', numeric=False),
          Column('From'), Column('Unit', numeric=False), Column('Of what is typical', '%'))
FINDINGS = (Column('Stream', numeric=False), Column('Channel', numeric=False),
            Column('Finding', numeric=False), Column('Size', 'sd'), Column('From', 's'),
            Column('To', 's'))
RECORDINGS = (Column('Recording', numeric=False), Column('Use', numeric=False),
              Column('From', 's'), Column('To', 's'))


@dataclass(frozen=True)
class Shown:
    """What is drawn beside what is said.

    body : Body;  traces : figures.Trace each;  partials : partial_residuals.Partial each
    curves : curves.Curve each;  misfit : misfit_film.MisfitStates, None = no film
    """

    body: Body
    traces: tuple = ()
    partials: tuple = ()
    curves: tuple = ()
    misfit: MisfitStates | None = None


@dataclass(frozen=True)
class _Cause:
    name: str
    summary: str
    applies_to: str
    equation: str
    symbols: str
    parameters: Grid
    leaves_open: str
    source: str


@dataclass(frozen=True)
class _Option:
    heading: str
    causes: tuple


def write_diagnosis(d, shown, out_html):
    """Write Diagnosis `d` as one HTML page that needs no other file; returns its path.

    shown : Shown;  Raises OSError if the page cannot be written.
    Test: diagnosis/test_page.py
    """
    plates = {'where': where_plate(d, shown.body),
              'when': when_plate(d, shown.traces) if shown.traces else None,
              'curves': curve_plate(shown.curves) if shown.curves else None,
              'partial': partial_plate(shown.partials) if shown.partials else None,
              'fit': fit_plate(d) if d.fit else None}
    plates = {name: plate for name, plate in plates.items() if plate is not None}
    drawn = dict(zip(plates, pictures(plates.values()), strict=True))
    source = d.provenance
    return write_page(
        'diagnosis.html.j2', out_html, title=f'{source.name}: diagnosis',
        kind='arm_brachy diagnosis: where simulation and recording differ, and why',
        heading=source.name, verdict=Verdict(MOODS[d.verdict], _typeset(_headline(d)),
                                             _detail(d)),
        facts=_facts(d), where=drawn.get('where'), when=drawn.get('when'), fit=drawn.get('fit'),
        partial=drawn.get('partial'), curves=drawn.get('curves'),
        numbers={name: i + 1 for i, name in enumerate(drawn)},
        place_words=_first([_sentence(one.term, sentences.place(one)) for one in d.where]),
        when_words=_first([_sentence(one.term, sentences.interval(one, source.recordings))
                           for one in d.when]),
        options=_options(d, shown.body), gains=[sentences.improvement(one) for one in d.fit],
        certainty=_typeset(sentences.certainty(d)), nearest=_nearest(d),
        alternatives=_alternative_grid(d), limits=_limit_grid(d),
        what_next=[_typeset(line) for line in what_next(d)], screen=_screen_grid(d),
        moves=_yaml(d.next_experiment), corrected=d.scene,
        corrected_has_causes=any(cause.physical for cause in d.causes),
        recalibrated=_recalibrated_grid(d),
        findings=_finding_grid(d), notes=d.notes, recordings=_recording_grid(source),
        provenance=_provenance(source), command=source.command, scenario='',
        **_film(d, shown.misfit))


def _film(d, misfit):
    """The film of the misfit and what it shows; empty without one."""
    if misfit is None:
        return {'film': '', 'film_note': ''}
    return {'film': film_block('misfit', misfit_film(misfit, d.where)),
            'film_note': misfit_note(misfit)}


def _headline(d):
    """The verdict, and how large the misfit still is beside the noise."""
    if d.verdict == 'partial':
        return d.sentence.partition('. ')[0] + '.'
    return ' '.join(filter(None, (d.sentence, sentences.remaining(d))))


def _detail(d):
    """Second sentence: how much of what was found, or what would decide it."""
    if d.verdict == 'partial':
        return _typeset(' '.join(filter(None, (d.sentence.partition('. ')[2],
                                               sentences.remaining(d)))))
    if d.next_experiment is not None:
        return f'To decide it: {sentences.request(d.next_experiment)}'
    return _typeset(' '.join(f'{_capital(numbers)}.' for numbers in sentences.numbers(d)))


def _nearest(d):
    """What comes nearest, and its numbers; '' if nothing does."""
    if d.nearest is None:
        return ''
    values = [f'{formatting.spoken(name)} {_typeset(formatting.amount(unit, value, value, value))}'
              for cause in d.nearest.causes for name, _, unit, value, *_ in cause.shown()]
    return _typeset(f'{sentences.nearest(d)} Its numbers: {formatting.listed(values)}.')


def _facts(d):
    facts = []
    if d.fit:
        worst = max(d.fit, key=lambda one: one.times_noise)
        facts.append(Fact(f'Remaining misfit, {worst.stream}', number(worst.times_noise, 1),
                          'times the noise'))
    if d.verdict == 'named':
        facts.append(Fact('Probability among the terms tried',
                          formatting.percent(min(c.probability for c in d.causes))))
    for one in d.fit:
        unit, scale = edge_unit(one.stream)
        stages = [one.as_given, one.recalibrated, *([] if one.named is None else [one.named])]
        *shown, floor = formatting.figures(tuple(v / scale for v in (*stages, one.noise_floor)))
        facts.append(Fact(f'Held-out error, {one.stream}: as given, recalibrated'
                          + ('' if one.named is None else ', with what was found'),
                          ' → '.join(shown), f'{unit} (noise {floor})'))
    if d.where and d.where[0].term and d.where[0].position is not None:
        facts.append(Fact('Place known within', number(d.where[0].radius * sentences.MM, 1),
                          'mm (90 %)'))
    if d.apart is not None:
        label = 'Options apart' if d.verdict == 'equivalent' else 'From the nearest rival'
        facts.append(Fact(label, number(d.apart, 1), 'standard deviations'))
    return facts


def _first(lines):
    left = len(lines) - MOST_LINES
    return lines if left <= 0 else [*lines[:MOST_LINES], f'And {left} more.']


def _sentence(term, said):
    return _typeset(_capital(f'{formatting.spoken(term)} {said}.'.lstrip()))


def _typeset(text):
    """Proper minus signs in front of numbers; per cents stay on the line of their number."""
    return re.sub(r'(?<=\d) %', '\N{NO-BREAK SPACE}%', re.sub(r'(?<!\w)-(?=\d)', '−', text))


def _capital(text):
    return text[:1].upper() + text[1:]


def _options(d, body):
    shared = 0 in d.options()
    found = []
    for option, causes in d.options().items():
        heading = ''
        if d.verdict == 'equivalent':
            chance = formatting.percent(min(c.probability for c in causes))
            heading = 'In any case' if option == 0 else (
                f'Option {len(found) + (0 if shared else 1)}, probability {chance}')
        found.append(_Option(heading, tuple(_cause(cause, body) for cause in causes)))
    return tuple(found)


def _cause(cause, body):
    pads = [pad.name for pad in body.pads]
    chosen = [channel(key, value, pads) for key, value in cause.applies_to.items()
              if value not in ((), '', EVERY)]
    return _Cause(_capital(formatting.spoken(cause.term)), cause.spec.summary,
                  f' ({", ".join(chosen)})' if chosen else '', cause.spec.equation, cause.symbols,
                  _parameter_grid(cause.shown()), cause.spec.leaves_open,
                  f'Source: {cause.spec.source}.')


def _parameter_grid(rows, note=''):
    return Grid(PARAMETERS, tuple(
        (Cell(formatting.spoken(name)), Cell(text),
         Cell(_typeset(formatting.amount('1', *values))),
         Cell(_typeset(formatting.ends(*values))),
         Cell('' if unit == '1' else unit))
        for name, text, unit, *values in rows), note)


def _recalibrated_grid(d):
    return _parameter_grid(d.fitted_anyway(), 'Fitted whatever else was found; they are '
                                              'parameters of the scene, not missing physics.')


def _alternative_grid(d):
    if not d.alternatives:
        return Grid()
    named = [] if d.held_out is None else [
        (_terms([cause.term for cause in d.likeliest()]), Cell(number(d.held_out, 1), 'good'),
         Cell('named' if d.verdict == 'named' else 'the most probable option', 'good'))]
    lost = [(_terms(one.terms), Cell(number(one.held_out, 1)),
             Cell(sentences.why_not(one, d)))
            for one in d.alternatives]
    return Grid(ALTERNATIVES, (*named, *lost), (
        'Score: gain in the natural logarithm of the probability of what was held out, over the '
        'recalibrated model without new physics; below zero it predicts worse.'))


def _screen_grid(d):
    return Grid(SCREEN, tuple(
        (_terms((one.term,)), Cell(one.variant), Cell(_typeset(one.size)),
         Cell(number(one.evidence, 1)), Cell(number(one.held_out, 1)),
         Cell(number(one.full_fit, 1))) for one in d.screen), (
        'By sensitivities alone: how much likelier each candidate makes the data, to first order, '
        'than the recalibrated model without it. A ranking, not a finding: candidates are not '
        'compared with each other, and a large effect is not in proportion to its sensitivity.'))


def _limit_grid(d):
    return Grid(LIMITS, tuple(
        (_terms((one.term,)), Cell(formatting.spoken(one.parameter)),
         Cell(_typeset(f'{one.value:.2g}')), Cell('' if one.unit == '1' else one.unit),
         Cell(f'{100.0 * one.typical_sizes:.2g}')) for one in d.limits), (
        f'Where it would make {SHOWS:g} standard deviations beside all that is recalibrated, at '
        'half of the places tried or more. In proportion to what it does at about its typical '
        'size: what gives way shows earlier. What is not listed was not tried, or would not show '
        f'at {FAR:g} times its typical size.'))


def _terms(terms):
    return Cell(' + '.join(formatting.spoken(term) for term in terms))


def _finding_grid(d):
    return Grid(FINDINGS, tuple(
        (Cell(one.stream), Cell(one.channel or 'all'), Cell(one.statement), Cell(number(one.z, 1)),
         Cell(number(one.t_start)), Cell(number(one.t_end))) for one in d.findings), (
        'What the streams say among themselves. Size: in standard deviations of its error and of '
        'what a careful laboratory leaves uncalibrated, together.'))


def _recording_grid(source):
    return Grid(RECORDINGS, tuple(
        (Cell(r.name), Cell(r.role), Cell(number(r.t_start)), Cell(number(r.t_end)))
        for r in source.recordings))


def _yaml(request):
    if request is None or not request.moves:
        return ''
    stream, yaml = StringIO(), YAML(typ='safe')
    yaml.sort_base_mapping_type_on_output = False
    yaml.dump({'moves': [to_mapping(move) for move in request.moves]}, stream)
    return stream.getvalue().rstrip()


def _provenance(source):
    pairs = (('Scene', source.scene), ('Seed', str(source.seed)), ('Commit', source.commit),
             ('Machine', source.machine))
    return tuple((name, text) for name, text in pairs if text)
