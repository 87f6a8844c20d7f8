"""What an answer of the diagnosis says of a case whose truth is known, for the rows of a table.

An answer is a answer.Diagnosis as JSON holds it, or {'error': text}. A case is anything with
`term` (of the registry, None = nothing is missing), `truth` (its parameters as an answer spells
them, the first is shown) and `place` (fields of the term that select, as in an answer). Right is
the planted term named alone, or at the head of a class; where nothing was planted,
`nothing_missing`. What the registry has no term for has the term OUTSIDE: right is `unexplained`
without a cause, `place` is then of parts.Place and `truth` has at most the onset. Where a
laboratory leaves clocks or frames off by more than others do, to say so is never wrong: `beside`
has the terms that it amounts to.
"""

import numpy as np

from arm_brachy.diagnosis.results.formatting import spoken
from arm_brachy.experiments.diagnosis_score import MESH, all_hold, explanations

STREAMS = {'optical': 'mm', 'em': 'mm', 'force': 'N'}
OUTSIDE = 'outside the catalogue'
ONSET = 'onset_s'
ERRORS = ('as_given', 'recalibrated', 'with_the_causes', 'noise_floor')


def told(case, answer, truth=None, *, beside=()):
    """Columns of a row: what was planted, what was said, and where and how large.

    truth : where it is not all that the case has;  None = that of the case
    beside : terms that may be named besides, see the head of this file
    """
    cause = _cause(case, answer)
    place = None if cause is None or not case.place else cause['applies_to'] == case.place
    outside = case.term == OUTSIDE and 'where' in answer
    return {'planted': case.term or '-', 'right': right(case, answer, beside),
            'verdict': answer.get('verdict', 'none'), 'said': _said(answer),
            'place_right': _there(case.place, answer) if outside and case.place else place,
            **_parameter(case.truth if truth is None else truth,
                         _onset(answer) if outside else cause)}


def _there(place, answer):
    """Whether one of the places that an answer gives has all fields of `place`."""
    return any(place.items() <= one.items() for one in answer['where'])


def _onset(answer):
    """First onset that an answer gives of what has no term, in the form of a cause; or None."""
    first = min((one[ONSET] for one in answer['when'] if ONSET in one and 'term' not in one),
                default=None)
    return None if first is None else {'parameters': {
        ONSET: {'value': sum(first) / 2.0, 'interval_90': first}}}


def right(case, answer, beside=()):
    """Whether an answer (as JSON) says what was planted in a Case, see the head of this file."""
    verdict = answer.get('verdict')
    if verdict in (None, 'nothing_missing'):
        return verdict is not None and case.term is None
    claimed = _leading(answer) - set(beside)
    if verdict == 'unexplained':
        return case.term == OUTSIDE and not claimed
    return claimed == {case.term} or (bool(beside) and case.term is None and not claimed)


def _leading(answer):
    """Terms that hold if the most probable option does, but for a mesh at fault."""
    causes = answer['causes']
    best = max((c for c in causes if c['option']), key=lambda c: c['probability'],
               default={'option': 0})['option']
    return {c['term'] for c in causes if c['option'] in (0, best)} - {MESH}


def _said(answer):
    if 'error' in answer:
        return answer['error']
    return ' or '.join(' + '.join(map(spoken, sorted(one))) for one in explanations(answer) if one)


def _cause(case, answer):
    return max((c for c in answer.get('causes', ()) if c['term'] == case.term),
               key=lambda c: c['probability'], default=None)


def _parameter(true, cause):
    """The first of the parameters, of a vector the largest component; all intervals."""
    out = dict.fromkeys(('parameter', 'true', 'found', 'low', 'high', 'intervals_hold'))
    if not true:
        return out
    key, value = next(iter(true.items()))
    axis = int(np.argmax(np.abs(value)))
    out |= {'parameter': key + (' ' + 'xyz'[axis] if np.ndim(value) else ''),
            'true': float(np.atleast_1d(value)[axis])}
    if cause is None:
        return out
    said = cause['parameters']
    found = {name: _component(said[key], end, axis)
             for name, end in (('found', 0), ('low', 1), ('high', 2))} if key in said else {}
    return out | found | {'intervals_hold': all_hold(
        {name: one['interval_90'] for name, one in said.items()}, true)}


def _component(estimate, end, axis):
    """Value (0), lower (1) or upper end (2) of an estimate; an end that is not known is None."""
    value = (estimate['value'], *estimate['interval_90'])[end]
    return value[axis] if isinstance(value, list) else value


def errors(answer):
    """Root mean square errors per axis held out, of all streams: absent ones are None."""
    fits = {fit['stream']: fit for fit in answer.get('fit', ())}
    return {f'{stream}_{which}_{unit}': fits.get(stream, {}).get(which)
            for stream, unit in STREAMS.items() for which in ERRORS}


def sized(row):
    """The parameter of a row: planted, and found with its interval; '-' if none was planted."""
    return '-' if row['parameter'] is None else (
        f'`{row["parameter"]}` {row["true"]:.3g}, '
        + interval(row['found'], row['low'], row['high']))


def verdict(row):
    """Verdict of a row and what was said, for a cell of a table."""
    return f'`{row["verdict"]}`' + (f': {row["said"]}' if row['said'] else '')


def interval(value, low, high):
    """A number with its ends; '-' if there is none."""
    return '-' if value is None else (f'{value:.3g} ({_number(low, ".3g")} to '
                                      f'{_number(high, ".3g")})')


def three(one, stream):
    """Errors of a stream in a row, held out: recalibrated, with the causes, noise alone."""
    unit = STREAMS[stream]
    return ', '.join(_number(one[f'{stream}_{which}_{unit}'], '.3f') for which in ERRORS[1:])


def _number(value, form):
    return '-' if value is None else f'{value:{form}}'
