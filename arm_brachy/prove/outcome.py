"""What one answer of a trial is worth beside its truth.

- right: names what was planted and nothing else; of a case that theory cannot decide, the class
  that holds it. class, wide: as in experiments.diagnosis_score. partly: one of two.
- wrong: a claim of something that is not there, also beside what is; for an effect of no
  catalogue any claim. abstained: 'unexplained' without a wrong cause. silent: nothing is missing.
- failed: no answer, for whatever reason.
"""

from arm_brachy.experiments.diagnosis_score import (
    CONFOUNDED,
    MESH,
    RECALIBRATED,
    TOLERANCE,
    explanations,
)

RIGHT, CLASS, WIDE, PARTLY = 'right', 'class', 'wide', 'partly'
WRONG, ABSTAINED, SILENT, FAILED = 'wrong', 'abstained', 'silent', 'failed'
WORDS = (RIGHT, CLASS, WIDE, PARTLY, ABSTAINED, SILENT, WRONG, FAILED)
MOST = 3    # how far down a list is looked


def planted(truth):
    """Names of the catalogue that would be right, as a set; empty for what is in none."""
    return frozenset(truth['labels']) if truth['in_catalogue'] else frozenset()


def outcome(record, truth):
    """What a record of `answering` is worth, one of WORDS."""
    answer = record['answer']
    if answer is None:
        return FAILED
    wanted = planted(truth)
    said = explanations(answer)
    if answer['verdict'] == 'unexplained':
        return ABSTAINED if all(one <= wanted for one in said) else WRONG
    if RECALIBRATED in wanted:      # a modulus is no cause: it is told by a number
        wanted -= {RECALIBRATED}
        if not any(said):
            good = modulus_error(answer, truth)
            found = good is not None and good <= TOLERANCE
            return (PARTLY if wanted else RIGHT) if found else SILENT
    if not any(said):
        return SILENT
    return _claim(said, wanted, frozenset(truth['alike']))


def _claim(said, wanted, alike):
    """Worth of sets of causes of which one is claimed to hold."""
    if wanted not in said:
        partly = wanted and all(one <= wanted for one in said)
        return PARTLY if partly else WRONG
    others = [one for one in said if one != wanted]
    if alike:
        within = alike <= frozenset().union(*said) and all(one <= alike for one in said)
        return RIGHT if within else WIDE
    if not others:
        return RIGHT
    known = all(len(one) == 1 and one | wanted in CONFOUNDED for one in others)
    return CLASS if known else WIDE


def modulus_error(answer, truth):
    """Error of the recalibrated modulus over its departure from the label; None if not told."""
    told = answer['recalibrated'].get('E_kPa')
    if told is None:
        return None
    true = true_modulus(truth)
    return abs(told['value'] - true) / max(abs(true - truth['E_kPa']), 1e-12)


def true_modulus(truth):
    """Young's modulus as it was [kPa]; `E_kPa` of the truth is that on the body's label."""
    factor = truth['nuisances']['modulus_factor']
    for effect in truth['effects']:
        if effect['name'] == RECALIBRATED:
            factor *= effect['values']['factor']
    return truth['E_kPa'] * factor


def ranking(answer):
    """Sets of causes in the order in which an answer holds them likely: options, then losers."""
    options = {}
    for cause in answer['causes']:
        options.setdefault(cause['option'], []).append(cause)
    always = frozenset(c['term'] for c in options.pop(0, ()))
    likely = sorted(options.values(), key=lambda some: -max(c['probability'] for c in some))
    first = [always | {c['term'] for c in some} for some in likely] or [always]
    lost = [frozenset(one['terms']) for one in answer['alternatives']]
    return list(dict.fromkeys(one - {MESH} for one in (*first, *lost)))


def rank(record, truth, word):
    """1, 2 .. MOST if what was planted has that place in the answer's order, else None."""
    if word == FAILED:
        return None
    if word == RIGHT:
        return 1
    wanted = planted(truth) - {RECALIBRATED}
    order = ranking(record['answer'])[:MOST]
    return 1 + order.index(wanted) if wanted and wanted in order else None


def confidence(record):
    """Probability that an answer gives to what it says first, or to there being nothing."""
    answer = record['answer']
    if answer is None:
        return 1.0
    likely = [c['probability'] for c in answer['causes'] if c['probability'] is not None]
    if likely:
        return float(max(likely))
    chance = answer.get('chance_of_what_is_left')
    return 1.0 if chance is None else float(chance)
