"""The README's table of all blind trials: what every frozen detector scored, best and worst.

Test: experiments/test_readme.py
"""

import json

from arm_brachy.prove import totals
from arm_brachy.prove.answering import ABSOLUTE, NULL

TRIALS = ('bc215fd', 'bda5ad8')     # folders of results/trials: commits of the detector, in order


def markdown(results):
    """Lines of a table: a column per trial and mode, every share and median of theirs a row.

    results : folder with trials/COMMIT/result.json, as `prove.report` writes it. Counted anew from
    the answers, so that all trials are by one rule; '-' where a trial has nothing of the kind.
    """
    columns = {}
    for name in TRIALS:
        path = results / 'trials' / name / 'result.json'
        rows = [row for row in json.loads(path.read_text(encoding='utf-8'))['rows']
                if 'case' in row]
        for mode in (ABSOLUTE, NULL):
            some = totals.in_mode(rows, mode)
            if some:
                cases = len({row['case'] for row in some})
                columns[f'{name}, {mode}, {cases} cases'] = {
                    **{one['what']: totals.cell(one) for one in totals.shares(some)},
                    **{f'{one["what"]}, median': totals.cell(one) for one in totals.medians(some)}}
    counted = next(iter(columns.values()))
    return '\n'.join([f'| over all | {" | ".join(columns)} |', '|---' * (1 + len(columns)) + '|',
                      *(f'| {what} | ' + ' | '.join(cells[what] for cells in columns.values())
                        + ' |' for what in counted)])
