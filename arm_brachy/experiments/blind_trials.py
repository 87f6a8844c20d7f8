"""The READMEs' tables of all blind trials: what every frozen detector scored, best and worst.

Test: experiments/test_readme.py
"""

import json
import textwrap
from dataclasses import dataclass

from scipy.stats import binomtest

# Folders of results/trials: commits of the detector, in order.
TRIALS = ('bc215fd', 'bda5ad8', 'c10f951', '1bd0120', 'fe474c0', 'b6f6b5d',
          '33dd338', 'bb92e09', '6fa7b70', '2bbea98', '4b85996', 'a402a85', '7937077',
          '78420a8', 'ce489a4', '48c99ca', 'b8de038', '0a40ff0', '1cc5144',
          '6204931', 'fd10134', 'da82b91', '97ba29c', 'b4a508b', '3e10884')
# What is counted of the baselines -> of the detector. All of its cases: `supplied` ones as well.
COUNTED = {'top-1, all singles': 'top-1, all singles',
           'false alarms, nulls': 'false alarms, nulls',
           'wrong claims, all cases': 'wrong claims, or no answer',
           'held-out recovery': 'held-out recovery'}
# Whether what is planted follows the registry's law.
FORMS = OWN, OTHER = "the registry's law", 'another law'
OF_LAWS = ('top-1, identifiable singles', 'top-1, all singles', 'wrong claims, or no answer')
HIDES = 'what-hides'      # file of `prove.what_hides`
ALIKE = 'alike'           # file of `prove.alike`
LENGTHS = ('oracle', 'at_states', 'calibrated', 'seen', 'tested')
MODES = 'absolute', 'null'
TOGETHER = 5              # trials of a mode
WIDTH = 105               # columns of a README's text


def markdown(results):
    """Lines of a table: a line per trial and mode, newest first, every goal of theirs a column.

    results : folder with trials/COMMIT/result.json, as `prove.report` writes it. '-' where a
    trial is older than what is counted, or had nothing to count.
    """
    trials = list(_scored(results))[::-1]
    columns = tuple(trials[0].goals)
    lines = [f'| trial | {" | ".join(columns)} |', '|---' * (1 + len(columns)) + '|']
    for one in trials:
        cells = [cell(one.rows[what]) if what in one.rows else '-' for what in columns]
        lines.append(f'| {one.name}, {one.mode}, {one.cases} cases | {" | ".join(cells)} |')
    return '\n'.join(lines)


def scores(results):
    """Lines of a table: what was asked of either mode, the last trial of it, the last TOGETHER.

    Detectors differ from trial to trial: together they say how often these have been right, with
    an interval that one trial has not.
    """
    trials = {mode: [one for one in _scored(results) if one.mode == mode] for mode in MODES}
    last = {mode: some[-1] for mode, some in trials.items()}
    lines = ['| | ' + ' | '.join(
        f'{mode}: goal | {last[mode].name}, {last[mode].cases} cases | '
        f'last {TOGETHER}, {sum(one.cases for one in trials[mode][-TOGETHER:])} cases'
        for mode in MODES) + ' |', '|---' * (1 + 3 * len(MODES)) + '|']
    for what in last[MODES[0]].goals:
        line = [what]
        for mode in MODES:
            each = [one.rows[what] for one in trials[mode] if what in one.rows]
            line += [last[mode].goals[what], cell(each[-1]), cell(_together(each[-TOGETHER:]))]
        lines.append(f'| {" | ".join(line)} |')
    return '\n'.join(lines)


def rate(results):
    """How often the last TOGETHER trials of each mode were right, in two sentences."""
    def share(mode, what):
        rows = [one.rows[what] for one in _scored(results) if one.mode == mode
                and what in one.rows]
        return _together(rows[-TOGETHER:])

    right = {mode: share(mode, 'top-1, identifiable singles') for mode in MODES}
    wrong = {mode: share(mode, 'wrong claims, or no answer') for mode in MODES}
    said = {mode: (f'{one["count"]} of {one["of"]} ({one["share_percent"]:.0f} %, 95 % interval '
                   f'{one["low_percent"]:.0f} to {one["high_percent"]:.0f} %)')
            for mode, one in right.items()}
    return textwrap.fill(
        '**How often the diagnosis is right.** In a blind trial, code that is independent of the '
        'diagnosis simulates recordings with a hidden cause. Over the last five trials, the '
        'diagnosis ranked the right cause first in '
        f'{said["absolute"]} of the recordings with one identifiable cause, and in {said["null"]} '
        'if it also received a recording of the same rig without a fault. It named a wrong cause, '
        f'or gave no answer, in {wrong["absolute"]["count"]} of {wrong["absolute"]["of"]} and '
        f'{wrong["null"]["count"]} of {wrong["null"]["of"]} of all recordings.', WIDTH)


def laws(results):
    """Lines of a table: the registry's law and another apart, of all trials that planted both."""
    lines = [f'| | {" | ".join(f"{mode}: {form}" for mode in MODES for form in FORMS)} |',
             '|---' * (1 + len(MODES) * len(FORMS)) + '|']
    for what in OF_LAWS:
        cells = []
        for mode in MODES:
            planted = [one.rows for one in _scored(results) if one.mode == mode
                       and one.rows.get(f'{what}: {FORMS[1]}', {}).get('of')]
            cells += [cell(_together([rows[f'{what}: {form}'] for rows in planted]))
                      if planted else '-' for form in FORMS]
        lines.append(f'| {what} | {" | ".join(cells)} |')
    return '\n'.join(lines)


@dataclass(frozen=True)
class Scored:
    """A trial in one mode.

    name : commit;  cases : how many;  rows : what -> row;  goals : what -> goal in words
    """

    name: str
    mode: str
    cases: int
    rows: dict
    goals: dict


def _scored(results):
    """The Scored of every trial and mode, in order."""
    for name in TRIALS:
        path = results / 'trials' / name / 'result.json'
        body = json.loads(path.read_text(encoding='utf-8'))
        rows = body['rows']
        for mode in dict.fromkeys(row['over_all'] for row in rows if 'over_all' in row):
            yield Scored(name, mode, sum('case' in row and row['mode'] == mode for row in rows), {
                row['what'] + ', median' * ('median' in row): row for row in rows
                if row.get('over_all') == mode and 'what' in row}, {
                target['name'].partition(': ')[2]: f'{target["goal"]}{_unit(target)}'
                for target in body['targets'] if target['name'].startswith(f'{mode}: ')})


def _together(rows):
    """The share of several trials as one, with Wilson's interval; medians have none: '-'."""
    hits, of = (sum(row.get(key, 0) for row in rows) for key in ('count', 'of'))
    if not of or 'median' in rows[-1]:
        return {'of': 0}
    ends = binomtest(hits, of).proportion_ci(method='wilson')
    return {'count': hits, 'of': of, 'share_percent': 100.0 * hits / of,
            'low_percent': 100.0 * ends.low, 'high_percent': 100.0 * ends.high}


def _unit(row):
    return '' if row['unit'] == '1' else f' {row["unit"]}'


def baselines(results):
    """Lines of a table: the baselines of the last trial that has them, and the detector of it."""
    for name in reversed(TRIALS):
        path = results / 'trials' / name / 'result.json'
        rows = json.loads(path.read_text(encoding='utf-8'))['rows']
        simple = [row for row in rows if 'baseline' in row]
        if simple:
            own = {row['what']: row for row in rows if row.get('over_all') == 'absolute'
                   and 'what' in row}
            return baseline_lines([*simple, *({**own[of], 'baseline': f'the diagnosis, {name}',
                                               'what': what} for what, of in COUNTED.items())])
    return ''


def hidden(results):
    """Lines of a table: of cases of a trial, how much of what was planted could be seen."""
    return hidden_lines(json.loads((results / f'{HIDES}.json').read_text(encoding='utf-8')))


def hidden_lines(found):
    """Lines of a table of what `prove.what_hides` writes."""
    heads = ('case', 'planted', 'size', 'all samples, beside calibration', 'at the states',
             'beside calibration', 'and the mesh', 'in one test', 'said')
    rows = (' | '.join([row['case'], f'`{row["planted"]}`', f'{row["size"]:.2f}',
                        *(f'{row[key]:.1f}' for key in LENGTHS), row['outcome']])
            for row in found['rows'])
    return '\n'.join([f'| {" | ".join(heads)} |', '|---' * len(heads) + '|',
                      *(f'| {row} |' for row in rows)])


def alike(results):
    """Lines of a table: of every file of `prove.alike` how far the generator's effects and the
    registry's are apart."""
    return alike_lines(*(json.loads(path.read_text(encoding='utf-8'))
                         for path in sorted(results.glob(f'{ALIKE}-*.json'))))


def alike_lines(*found):
    """Lines of a table of what `prove.alike` writes: a column of each, shares of what shows."""
    rows = {}
    for column, one in enumerate(found):
        for row in one['rows']:
            apart, of = row['apart'], row['planted']
            cells = rows.setdefault(row['effect'], ['-'] * len(found))
            cells[column] = f'{apart:.1f} of {of:.1f} ({apart / of:.0%})'
    head = [f'{one["trial"]} {one["case"]}, sd' for one in found]
    lines = [[f'`{effect}`', *cells] for effect, cells in rows.items()]
    return '\n'.join([f'| effect | {" | ".join(head)} |', '|---' * (1 + len(found)) + '|',
                      *(f'| {" | ".join(line)} |' for line in lines)])


def baseline_lines(rows):
    """Lines of a table: a line a baseline; '-' where a baseline has nothing to count."""
    names, counted = ({row[key]: None for row in rows} for key in ('baseline', 'what'))
    cells = {(row['baseline'], row['what']): cell(row) for row in rows}
    lines = [[name, *(cells.get((name, what), '-') for what in counted)] for name in names]
    head = [f'| baseline | {" | ".join(counted)} |', '|---' * (1 + len(counted)) + '|']
    return '\n'.join([*head, *(f'| {" | ".join(line)} |' for line in lines)])


def cell(row):
    """A share with its 95 % interval (Wilson) or a median, as `prove.totals` makes them.

    '-' where there was nothing to count.
    """
    if not row['of']:
        return '-'
    if 'median' in row:
        return f'{row["median"]:.2g}{_unit(row)} (of {row["of"]})'
    return (f'{row["count"]} of {row["of"]}: {row["share_percent"]:.0f} % '
            f'({row["low_percent"]:.0f} to {row["high_percent"]:.0f})')
