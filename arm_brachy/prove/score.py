"""One flat row for every answer of a trial."""

import numpy as np

from arm_brachy.experiments.blind_trials import OTHER, OWN
from arm_brachy.experiments.diagnosis_score import RECALIBRATED, explanations
from arm_brachy.prove.detail import EMPTY, details
from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.outcome import (
    ABSTAINED,
    FAILED,
    RIGHT,
    SILENT,
    WRONG,
    confidence,
    modulus_error,
    outcome,
    planted,
    rank,
    ranking,
    true_modulus,
)
from arm_brachy.prove.plan import CONFOUNDED, NULL, STRANGE

SEEN = 5.0      # sd: of the effect, and from every rival, for a case to count as identifiable


EXTRAS = {'detectability_sd': None, 'separation_sd': None, 'rival': '',
          'at_best_detectability_sd': None, 'at_best_separation_sd': None, 'error_base': None,
          'error_tool': None, 'error_oracle': None, 'recovery': None, 'recovery_words': ''}


def score(record, truth, extras=None):
    """The row of one record of `answering`.

    extras : what of EXTRAS is known, from `oracle` and `recovery`
    """
    word = outcome(record, truth)
    place = rank(record, truth, word)
    row = {'case': record['case'], 'mode': record['mode'], 'kind': truth['kind'],
           'planted': ' + '.join(sorted(truth['labels'])) or '-',
           'form': form_of(truth),
           'size': max((e['size'] for e in truth['effects']), default=0.0),
           'solver': truth['solver'], 'outcome': word, 'said': said(record),
           'top_1': _good(word, truth, place == 1), 'top_3': _good(word, truth, bool(place)),
           'one_right': _one_right(record, truth, word), 'wrong': word == WRONG,
           'request': bool(record['answer'] and record['answer'].get('next_experiment')),
           'confidence': confidence(record), 'seconds': record['seconds'],
           'begun': record['begun'], 'confined': record['confined']}
    row |= {**EXTRAS, **(extras or {})}
    row['identifiable'] = _identifiable(row, truth)
    row['identifiable_at_best'] = _identifiable(row, truth, 'at_best_')
    return row | _details(record, truth, word)


def form_of(truth):
    """OWN or OTHER: whether all of the catalogue that was planted has the registry's law; else ''.

    Trials before laws were drawn planted the registry's alone.
    """
    if not truth['effects'] or not truth['in_catalogue']:
        return ''
    own = all(e.get('form', REGISTRY) == REGISTRY for e in truth['effects'])
    return OWN if own else OTHER


def said(record):
    """The causes named, options apart; for a failure why."""
    answer = record['answer']
    if answer is None:
        return record['status']
    return ' | '.join(' + '.join(sorted(one)) for one in explanations(answer) if one)


def first_said(record):
    """What a record says first, one name for a confusion matrix."""
    answer = record['answer']
    if answer is None:
        return FAILED
    if answer['verdict'] == 'unexplained':
        return ABSTAINED
    return ' + '.join(sorted(ranking(answer)[0])) or SILENT


def _good(word, truth, placed):
    """Top of the list: nothing for a null, an abstention for what no catalogue holds."""
    if truth['kind'] == NULL:
        return word == SILENT
    return word == ABSTAINED if truth['kind'] == STRANGE else placed


def _one_right(record, truth, word):
    """At least one of what was planted is named in every option, or the modulus is right."""
    if word in (FAILED, ABSTAINED, SILENT):
        return False
    named = explanations(record['answer'])
    return word == RIGHT or (any(named) and all(one & planted(truth) for one in named))


def _identifiable(row, truth, which=''):
    """None if no oracle looked or the kind has nothing to identify.

    which : prefix of the oracle's columns, see `oracle`
    """
    size, apart = row[which + 'detectability_sd'], row[which + 'separation_sd']
    if size is None or truth['kind'] in (NULL, CONFOUNDED):
        return None
    return size >= SEEN and (apart is None or apart >= SEEN)


def _details(record, truth, word):
    """Where, when, how much, of the first effect that was found; intervals of all that were."""
    answer = record['answer']
    if answer is None or not truth['effects']:
        return dict(EMPTY)
    strange = not truth['in_catalogue']
    if strange and word != ABSTAINED:
        return dict(EMPTY)
    found = [details(answer, e, truth['start_s'], strange=strange) for e in truth['effects']]
    chosen = max(found, key=lambda one: sum(v is not None for v in one.values()))
    chosen = {**chosen, **{key: sum(one[key] for one in found)
                           for key in ('intervals', 'intervals_held')},
              'numbers': [number for one in found for number in one['numbers']]}
    if word == RIGHT and truth['labels'] == [RECALIBRATED]:
        told = answer['recalibrated']['E_kPa']
        low, high = told['interval_90']
        true = true_modulus(truth)
        held = bool((low or -np.inf) <= true <= (high or np.inf))
        chosen = {**chosen, 'parameter_error_percent': 100 * modulus_error(answer, truth),
                  'parameter_right': True, 'interval_holds': held, 'intervals': 1,
                  'intervals_held': int(held)}
    return chosen

