"""What all answers of the study of the diagnosis make: rows, totals, goals, the README's table.

An oracle has the right cause and the model's mesh: what it leaves held out, in noise floors, is
what the diagnosis leaves where nothing is planted, in the median of the nulls.
"""

import numpy as np
from scipy.stats import binomtest

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import Result, Target, cell_text, commit_of, machine_description
from arm_brachy.experiments.diagnosis_plan import SEED
from arm_brachy.experiments.diagnosis_score import FOUND, INERT, TOLERANCE, score
from arm_brachy.registry import TERMS

NAME = 'diagnosis-terms'
COUNTED = (
    ('named or provable class, typical size', lambda row: row['outcome'] in FOUND),
    ('wrong claims, typical size', lambda row: row['outcome'] == 'wrong'),
    ('named or provable class, a tenth', lambda row: row['outcome'] in FOUND),
    ('wrong claims, a tenth', lambda row: row['outcome'] == 'wrong'),
    ('false alarms, nothing planted', lambda row: row['outcome'] != 'silent'),
    ('right place (10 mm), of those found', lambda row: row['place_right']),
    ('right onset (0.5 s), of those found', lambda row: row['onset_right']),
    ('parameter within 20 %, of those found', lambda row: row['parameter_right']),
    ('parameter in its 90 % interval, of those found', lambda row: row['interval_holds']),
    ("held-out error within 20 % of an oracle's, of those found",
     lambda row: row['error_over_oracle'] <= 1.0 + TOLERANCE))
# The most that is allowed of each, or all of them, or no goal.
GOALS = ('all', 0, None, 0, 1, 'all', 'all', 'all', None, 'all')


def rows_of(index, lines):
    """Rows of all cases that have an answer, order of the index."""
    rows = [score(label, lines[label['name']]) for label in index if label['name'] in lines]
    nulls = [row['error_over_floor'] for row in rows
             if row['term'] == '-' and row['error_over_floor'] is not None]
    for row in rows:
        known = nulls and row['error_over_floor'] is not None
        row['error_over_oracle'] = (
            row['error_over_floor'] / float(np.median(nulls)) if known else None)
    return tuple(rows)


def totals(rows):
    """What counts, over all cases: rows with the share and its 95 % interval (Wilson).

    The interval takes cases for independent, which nulls that share a plant run are not quite.
    """
    def kind(size):
        return [r for r in rows if r['size'] == size and r['term'] not in ('-', *INERT)]

    typical, tenth = kind(1.0), kind(0.1)
    nulls = [r for r in rows if r['term'] in ('-', *INERT)]
    found = [r for r in typical if r['outcome'] in FOUND]
    chosen = (typical, typical, tenth, tenth, nulls, *(
        [row for row in found if row[key] is not None] for key in
        ('place_right', 'onset_right', 'parameter_right', 'interval_holds', 'error_over_oracle')))
    return tuple(_share(what, [row for row in some if counts(row)], some)
                 for (what, counts), some in zip(COUNTED, chosen, strict=True))


def _share(what, true, chosen):
    interval = binomtest(len(true), len(chosen)).proportion_ci(method='wilson') if chosen else None
    low, high = (interval.low, interval.high) if chosen else (np.nan, np.nan)
    return {'what': what, 'count': len(true), 'of': len(chosen),
            'low_percent': 100.0 * float(low), 'high_percent': 100.0 * float(high)}


def result(index, lines, seed=SEED):
    """The Result: a row for every case judged, how many were, the totals, the goals that were set.

    index : labels of all cases of the study; goals stay open until the last one is judged
    """
    rows = rows_of(index, lines)
    sums = totals(rows)
    targets = tuple(_goal(total, limit, len(rows) == len(index))
                    for total, limit in zip(sums, GOALS, strict=True) if limit is not None)
    return Result(NAME, seed, commit_of(share_dir()), str(machine_description()),
                  (*rows, _judged(len(rows), len(index)), *sums), targets)


def _judged(count, of):
    return {'what': 'cases judged, of those planned', 'count': count, 'of': of,
            'low_percent': np.nan, 'high_percent': np.nan}


def _goal(total, limit, whole):
    """Target of a total, open if there is nothing to count or `whole` is False.

    limit : 'all' or the most allowed;  whole : every case was judged
    """
    least = limit == 'all'
    bound = total['of'] if least else limit
    met = total['count'] >= bound if least else total['count'] <= bound
    return Target(total['what'], total['count'], '1', f'{">=" if least else "<="} {bound}',
                  met if whole and total['of'] else None)


def markdown(result):
    """The table of the README from the JSON of a result: a line per term, then the totals.

    The first total says how many of the cases planned were judged.
    """
    rows = [row for row in result['rows'] if 'case' in row]
    lines = ['| term | typical size | place / mm | onset / s | parameter / % | in its interval | '
             'error / oracle | a tenth |', '|---|---|---|---|---|---|---|---|']
    for cls in TERMS:
        by_size = {row['size']: row for row in rows if row['term'] == cls.spec.name}
        if by_size:
            lines.append(_line(cls.spec.name, by_size.get(1.0), by_size.get(0.1)))
    lines += ['', '| over all | count | of | 95 % interval of the share |', '|---|---|---|---|']
    lines += [f'| {t["what"]} | {t["count"]} | {t["of"]} | {_percents(t)} |'
              for t in result['rows'] if 'what' in t]
    return '\n'.join(lines)


def _percents(total):
    low, high = total['low_percent'], total['high_percent']
    return '-' if low is None else f'{low:.0f} to {high:.0f} %'


def _line(term, typical, tenth):
    cells = [f'`{term}`', _words(typical)]
    if typical is None:
        cells += ['-'] * 5
    else:
        place = typical['place_error_mm']
        cells += [cell_text(typical['place_right'] if place is None else round(place, 1)),
                  *(_rounded(typical[key], digits) for key, digits in (
                      ('onset_error_s', 2), ('parameter_error_percent', 0))),
                  cell_text(typical['interval_holds']), _rounded(typical['error_over_oracle'], 2)]
    return '| ' + ' | '.join((*cells, _words(tenth))) + ' |'


def _words(row):
    if row is None:
        return '-'
    plain = row['outcome'] in ('right', 'silent', 'failed')
    return row['outcome'] if plain or not row['said'] else (
        f'{row["outcome"]}: {row["said"].replace("|", "or")}')


def _rounded(value, digits):
    return '-' if value is None else f'{value:.{digits}f}'
