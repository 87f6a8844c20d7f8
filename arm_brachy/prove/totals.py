"""What all answers of a trial make: shares with Wilson's intervals, medians, curves, goals."""

import numpy as np
from scipy.stats import binomtest

from arm_brachy.evaluation.result import Target
from arm_brachy.experiments.blind_trials import FORMS
from arm_brachy.prove.answering import ABSOLUTE, SUPPLIED
from arm_brachy.prove.outcome import ABSTAINED, FAILED, RIGHT, SILENT
from arm_brachy.prove.plan import CONFOUNDED, NULL, PAIR, SINGLE, STRANGE

BINS = ((0.2, 0.5), (0.5, 1.0), (1.0, 2.0))     # of the typical size
LIKELY = 0.95                                   # of the intervals


def share(what, rows, counts):
    """How many of rows count, with Wilson's 95 % interval of the share; None where there are none.

    counts : function of a row.  The interval takes cases for independent; those that share a body
    are not quite.
    """
    hits, of = sum(bool(counts(row)) for row in rows), len(rows)
    if not of:
        return {'what': what, 'count': 0, 'of': 0, 'share_percent': None, 'low_percent': None,
                'high_percent': None}
    ends = binomtest(hits, of).proportion_ci(LIKELY, method='wilson')
    return {'what': what, 'count': hits, 'of': of, 'share_percent': 100.0 * hits / of,
            'low_percent': 100.0 * float(ends.low), 'high_percent': 100.0 * float(ends.high)}


def in_mode(rows, mode):
    """The rows of a mode of the trial; what was supplied belongs to the absolute one."""
    return [row for row in rows if row['mode'] == mode
            or mode == ABSOLUTE and row['mode'] == SUPPLIED]


def of_kind(rows, *kinds):
    """The rows of these kinds of case."""
    return [row for row in rows if row['kind'] in kinds]


def shares(rows):
    """Every share that is counted, of the rows of one mode, in the order of the table."""
    singles, pairs = of_kind(rows, SINGLE), of_kind(rows, PAIR)
    sharp = [row for row in singles if row['identifiable']]
    strange = of_kind(rows, STRANGE)
    confounded = of_kind(rows, CONFOUNDED)
    found = [row for row in (*singles, *pairs) if row['one_right']]

    def told(key):
        return [row for row in found if row[key] is not None]

    return tuple(share(*one) for one in (
        ('top-1, identifiable singles', sharp, lambda r: r['top_1']),
        ('top-3, identifiable singles', sharp, lambda r: r['top_3']),
        ('top-1, singles identifiable if nothing were left uncalibrated', [
            row for row in singles if row.get('identifiable_at_best')], lambda r: r['top_1']),
        ('top-1, all singles', singles, lambda r: r['top_1']),
        ('top-3, all singles', singles, lambda r: r['top_3']),
        ('false alarms, nulls', of_kind(rows, NULL), lambda r: r['outcome'] != SILENT),
        ('wrong claims, or no answer', rows, lambda r: r['wrong'] or r['outcome'] == FAILED),
        ('pairs, both', pairs, lambda r: r['outcome'] == RIGHT),
        ('pairs, at least one', pairs, lambda r: r['one_right']),
        ('out of catalogue, abstains', strange, lambda r: r['outcome'] == ABSTAINED),
        ('out of catalogue, in the right place and time', strange, _abstains_rightly),
        ('confounded, class holds it and names a recording', confounded,
         lambda r: r['outcome'] == RIGHT and r['request']),
        ('confounded, told apart with the recording that decides', of_kind(rows, SUPPLIED),
         lambda r: r['outcome'] == RIGHT),
        ('right place, of those found', told('place_right'), lambda r: r['place_right']),
        ('right onset (0.5 s), of those found', told('onset_right'), lambda r: r['onset_right']),
        ('parameter within 20 %, of those found', told('parameter_right'),
         lambda r: r['parameter_right']),
        ('all parameters in their 90 % intervals, of those found', told('interval_holds'),
         lambda r: r['interval_holds']),
        (COVERED, [i < row['intervals_held'] for row in found
                   for i in range(row.get('intervals', 0))], bool),
        ('no answer: crashed or timed out', rows, lambda r: r['outcome'] == FAILED)))


def _abstains_rightly(row):
    """Unexplained, and neither place nor time, where the effect has one, is told wrongly."""
    return row['outcome'] == ABSTAINED and False not in (row['place_right'], row['onset_right'])


def medians(rows):
    """Median errors of what was found: place, onset, parameter; None where nothing was told."""
    found = [row for row in rows if row['one_right']]
    return tuple({'what': what, 'median': _median(found, key), 'unit': unit,
                  'of': sum(row[key] is not None for row in found)}
                 for what, key, unit in (('error of place', 'place_error_mm', 'mm'),
                                         ('error of onset', 'onset_error_s', 's'),
                                         ('error of parameters', 'parameter_error_percent', '%'))
                 ) + (_recovery(rows),)


def _recovery(rows):
    """Over all cases that an oracle gains from, silence included, not those found alone."""
    told = [row['recovery'] for row in rows if row['recovery'] is not None]
    return {'what': 'held-out recovery', 'median': float(np.median(told)) if told else None,
            'unit': '1', 'of': len(told)}


def _median(rows, key):
    told = [abs(row[key]) for row in rows if row[key] is not None]
    return float(np.median(told)) if told else None


def power(rows):
    """Power over size: of singles, how many are noticed at all and how many named, per bin."""
    singles, lines = of_kind(rows, SINGLE), []
    for low, high in BINS:
        some = [row for row in singles if low <= row['size'] < high or row['size'] == high == 2.0]
        for what, counts in (('noticed', lambda r: r['outcome'] not in (SILENT, FAILED)),
                             ('named', lambda r: r['top_1'])):
            lines.append(share(f'{what}, {low:g} to {high:g} of the typical size', some, counts))
    return tuple(lines)


def per_term(rows):
    """Per planted term, how many singles were named; alphabetical."""
    singles = of_kind(rows, SINGLE)
    return tuple(share(f'named: {name}', [r for r in singles if r['planted'] == name],
                       lambda r: r['top_1'])
                 for name in sorted({row['planted'] for row in singles}))


def per_form(rows):
    """What depends on whether the truth has the registry's law: named singles and wrong claims."""
    singles = of_kind(rows, SINGLE)
    planted = of_kind(rows, SINGLE, PAIR, CONFOUNDED, SUPPLIED)
    sharp = [row for row in singles if row['identifiable']]
    for what, some, counts in (
            ('top-1, identifiable singles', sharp, lambda r: r['top_1']),
            ('top-1, all singles', singles, lambda r: r['top_1']),
            ('wrong claims, or no answer', planted,
             lambda r: r['wrong'] or r['outcome'] == FAILED)):
        for form in FORMS:
            yield share(f'{what}: {form}', [r for r in some if r.get('form') == form], counts)


def per_solver(rows):
    """What depends on who made the truth: named singles and alarms of nulls, per truth solver."""
    solvers = sorted({row['solver'] for row in rows})
    for what, kind, counts in (('top-1, all singles', SINGLE, lambda r: r['top_1']),
                               ('false alarms, nulls', NULL, lambda r: r['outcome'] != SILENT)):
        for solver in solvers:
            some = [row for row in of_kind(rows, kind) if row['solver'] == solver]
            yield share(f'{what}: truth by {solver}', some, counts)


def risk_coverage(rows):
    """Rows of coverage and risk: claims in order of confidence, share of them that are wrong.

    Silence and abstention claim nothing and are no part of it.
    """
    claims = sorted((r for r in rows if r['outcome'] not in (SILENT, ABSTAINED, FAILED)),
                    key=lambda r: -r['confidence'])
    wrong = np.cumsum([row['wrong'] for row in claims])
    return tuple({'coverage_percent': 100.0 * (k + 1) / len(rows),
                  'risk_percent': 100.0 * float(wrong[k]) / (k + 1),
                  'confidence': row['confidence']} for k, row in enumerate(claims))


# what -> goal in percent: (absolute, null), and whether it is the least or the most
GOALS = {
    'top-1, identifiable singles': (90.0, 95.0, True),
    'false alarms, nulls': (2.0, 1.0, False),
    'wrong claims, or no answer': (3.0, 2.0, False),
    'pairs, at least one': (93.0, 97.0, True),
    'out of catalogue, in the right place and time': (70.0, 80.0, True),
    'confounded, class holds it and names a recording': (90.0, 95.0, True),
}
LIMITS = {'error of place': (6.0, 4.0, False), 'error of parameters': (20.0, 10.0, False),
          'held-out recovery': (0.8, 0.9, True)}
COVERED = '90 % intervals that hold the truth, of those found'
COVERAGE = (85.0, 95.0)


def targets(rows, mode):
    """Every goal that was set, beside what came out; open where there was nothing to count."""
    second = int(mode == 'null')
    by_name = {one['what']: one for one in shares(rows)}
    found = []
    for what, (*goals, least) in GOALS.items():
        found.append(_goal(mode, what, by_name[what]['share_percent'], goals[second], '%', least))
    for one in medians(rows):
        if one['what'] in LIMITS:
            *goals, least = LIMITS[one['what']]
            found.append(_goal(mode, f'{one["what"]}, median', one['median'], goals[second],
                               one['unit'], least))
    value = by_name[COVERED]['share_percent']
    met = None if value is None else COVERAGE[0] <= value <= COVERAGE[1]
    found.append(Target(f'{mode}: {COVERED}', np.nan if value is None else value, '%',
                        '{:g} to {:g}'.format(*COVERAGE), met))
    return tuple(found)


def _goal(mode, what, value, goal, unit, least):
    met = None if value is None else (value >= goal if least else value <= goal)
    return Target(f'{mode}: {what}', np.nan if value is None else value, unit,
                  f'{">=" if least else "<="} {goal:g}', met)
