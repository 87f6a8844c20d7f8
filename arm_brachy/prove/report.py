"""The report of a trial: one Result, the README's lines, confusion matrices, pages."""

import numpy as np

from arm_brachy.evaluation.result import Result
from arm_brachy.evaluation.style import OURS, Plate, new_figure, styled
from arm_brachy.experiments.blind_trials import baseline_lines, cell
from arm_brachy.experiments.diagnosis_score import RECALIBRATED
from arm_brachy.prove import totals
from arm_brachy.prove.answering import SUPPLIED
from arm_brachy.prove.curves import curves_plate
from arm_brachy.prove.folder import write_json
from arm_brachy.prove.outcome import ABSTAINED, FAILED, RIGHT, SILENT, outcome
from arm_brachy.prove.pages import case_page, index_page
from arm_brachy.prove.score import first_said, score
from arm_brachy.prove.totals import in_mode
from arm_brachy.registry import TERMS

NAME = 'blind-trial'
NOTHING = 'nothing'
OTHERS = 'two or more'
SAYABLE = {term.spec.name for term in TERMS}
LAST = (SILENT, ABSTAINED, FAILED)


def report(folder, begun, truths, records, extras, *, frozen, baselines=()):
    """Write result.json, table.md, confusion- and curves-MODE.png, pages; returns the Result.

    folder : TrialFolder;  begun : as `trial.begin`;  truths, records : as `trial.run`
    extras : (mode, case) -> columns of score.EXTRAS;  frozen : the program stayed the same
    baselines : rows of `rivals.rows`
    """
    rows = tuple(score(record, as_asked(truths[case], mode), extras.get((mode, case)))
                 for (mode, case), record in records.items())
    result = Result(NAME, 0, begun['commit'], begun['machine'],
                    (*rows, *_sums(rows, begun['modes']), *baselines),
                    _targets(rows, begun['modes']))
    result.to_json(folder / 'result.json')
    tables = [('Over all, with 95 % intervals (Wilson)', markdown(rows, begun['modes']))]
    if baselines:
        tables.append(('Five simple ways to answer, on the same cases', baseline_lines(baselines)))
    (folder / 'table.md').write_text('\n\n'.join(text for _, text in tables) + '\n',
                                     encoding='utf-8')
    for mode in begun['modes']:
        cells = confusion(truths, records, mode)
        confusion_plate(cells, mode).save(folder / f'confusion-{mode}.png')
        curves_plate(in_mode(rows, mode), mode).save(folder / f'curves-{mode}.png')
        write_json(folder / f'confusion-{mode}.json',
                   [{'planted': a, 'said': b, 'count': n} for (a, b), n in cells.items()])
    for row in rows:
        case_page(folder, row, begun, as_asked(truths[row['case']], row['mode']),
                  records[row['mode'], row['case']])
    index_page(folder, rows, begun, frozen, tables, result.targets)
    return result


def as_asked(truth, mode):
    """The truth of a case as it is judged in a mode of answering."""
    return {**truth, 'kind': SUPPLIED, 'alike': [], 'withheld': []} if mode == SUPPLIED else truth


def _sums(rows, modes):
    for mode in modes:
        some = in_mode(rows, mode)
        for one in (*totals.shares(some), *totals.power(some), *totals.per_term(some),
                    *totals.per_form(some), *totals.per_solver(some), *totals.medians(some),
                    *totals.risk_coverage(some)):
            yield {'over_all': mode, **one}


def _targets(rows, modes):
    return tuple(goal for mode in modes for goal in totals.targets(in_mode(rows, mode), mode))


def markdown(rows, modes):
    """The lines of the README: every share in every mode, with its 95 % interval (Wilson)."""
    tables = [totals.shares(in_mode(rows, mode)) for mode in modes]
    middles = [totals.medians(in_mode(rows, mode)) for mode in modes]
    lines = ['| over all | ' + ' | '.join(modes) + ' |', '|---' * (len(modes) + 1) + '|']
    lines += [f'| {some[0]["what"]} | ' + ' | '.join(map(cell, some)) + ' |'
              for some in zip(*tables, strict=True)]
    lines += [f'| {some[0]["what"]}, median | ' + ' | '.join(map(cell, some)) + ' |'
              for some in zip(*middles, strict=True)]
    return '\n'.join(lines)


def confusion(truths, records, mode):
    """(planted, said first) -> how often, of cases with nothing or one effect planted.

    A modulus is told by a number, not by a name; where that is right it counts as said.
    """
    cells = {}
    for (which, case), record in records.items():
        labels = truths[case]['labels']
        if which == mode and len(labels) < 2:
            heard = first_said(record)
            if labels == [RECALIBRATED] and outcome(record, truths[case]) == RIGHT:
                heard = RECALIBRATED
            cell = (labels[0] if labels else NOTHING, OTHERS if ' + ' in heard else heard)
            cells[cell] = cells.get(cell, 0) + 1
    return cells


@styled
def confusion_plate(cells, mode):
    """The confusion matrix as a style.Plate: planted down, said across."""
    rows = sorted({planted for planted, _ in cells}, key=lambda one: (one != NOTHING, one))
    columns = [c for c in rows if c in SAYABLE]
    columns += sorted({said for _, said in cells} - {*columns, *LAST}) + list(LAST)
    counts = np.array([[cells.get((a, b), 0) for b in columns] for a in rows], dtype=float)
    figure = new_figure(2.6 + 0.25 * len(columns), 2.2 + 0.22 * len(rows))
    axes = figure.add_subplot()
    axes.grid(visible=False)
    shown = counts / counts.sum(axis=1, keepdims=True)
    axes.imshow(shown, cmap='Blues', vmin=0.0, vmax=1.0, aspect='auto')
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    for i, j in np.argwhere(counts > 0):
        axes.text(j, i, f'{counts[i, j]:.0f}', ha='center', va='center', fontsize=7,
                  color='white' if shown[i, j] > 0.5 else OURS)
    axes.set_xlabel('said first')
    axes.set_ylabel('planted')
    axes.set_title(f'Blind trial, mode {mode}')
    return Plate(f'confusion-{mode}', figure, 'Numbers are cases; shades are shares of a line.')
