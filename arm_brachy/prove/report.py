"""The report of a trial: one Result, the README's lines, confusion matrices, an index page."""

import html

import numpy as np

from arm_brachy.evaluation.page import number
from arm_brachy.evaluation.result import Result
from arm_brachy.evaluation.style import OURS, Plate, new_figure, styled
from arm_brachy.experiments.blind_trials import cell
from arm_brachy.experiments.diagnosis_score import RECALIBRATED
from arm_brachy.prove import totals
from arm_brachy.prove.answering import ABSOLUTE, SUPPLIED
from arm_brachy.prove.curves import curves_plate
from arm_brachy.prove.folder import write_json
from arm_brachy.prove.outcome import ABSTAINED, FAILED, RIGHT, SILENT, outcome
from arm_brachy.prove.score import first_said, score
from arm_brachy.registry import TERMS

NAME = 'blind-trial'
NOTHING = 'nothing'
OTHERS = 'two or more'
SAYABLE = {term.spec.name for term in TERMS}
LAST = (SILENT, ABSTAINED, FAILED)
PICTURES = {'confusion': 'confusion matrix', 'curves': 'power over size, risk over coverage'}


def report(folder, begun, truths, records, extras, *, frozen, baselines=()):
    """Write result.json, table.md, confusion- and curves-MODE.png, index.html; returns the Result.

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
    tables = [markdown(rows, begun['modes']), *([baseline_lines(baselines)] if baselines else [])]
    (folder / 'table.md').write_text('\n\n'.join(tables) + '\n', encoding='utf-8')
    for mode in begun['modes']:
        cells = confusion(truths, records, mode)
        confusion_plate(cells, mode).save(folder / f'confusion-{mode}.png')
        curves_plate(in_mode(rows, mode), mode).save(folder / f'curves-{mode}.png')
        write_json(folder / f'confusion-{mode}.json',
                   [{'planted': a, 'said': b, 'count': n} for (a, b), n in cells.items()])
    index_page(folder, rows, begun, frozen)
    return result


def as_asked(truth, mode):
    """The truth of a case as it is judged in a mode of answering."""
    return {**truth, 'kind': SUPPLIED, 'alike': [], 'withheld': []} if mode == SUPPLIED else truth


def in_mode(rows, mode):
    """The rows of a mode of the trial; what was supplied belongs to the absolute one."""
    return [row for row in rows if row['mode'] == mode
            or mode == ABSOLUTE and row['mode'] == SUPPLIED]


def _sums(rows, modes):
    for mode in modes:
        some = in_mode(rows, mode)
        for one in (*totals.shares(some), *totals.power(some), *totals.per_term(some),
                    *totals.medians(some), *totals.risk_coverage(some)):
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


def baseline_lines(rows):
    """The README's lines on the baselines, a line each; rows without a share are left out."""
    rows = [row for row in rows if 'count' in row]
    names, counted = ({row[key]: None for row in rows} for key in ('baseline', 'what'))
    cells = {(row['baseline'], row['what']): cell(row) for row in rows}
    return '\n'.join([f'| baseline | {" | ".join(counted)} |', '|---' * (1 + len(counted)) + '|',
                      *(f'| {name} | {" | ".join(cells[name, what] for what in counted)} |'
                        for name in names)])


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


HEAD = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Blind trial</title><style>
body { font: 15px/1.5 system-ui, sans-serif; color: #22303c; max-width: 1120px; margin: 2em auto; }
table { border-collapse: collapse; font-size: 13px; } td, th { padding: 4px 9px; text-align: left;
border-bottom: 1px solid #dde3e8; } img { max-width: 100%; } .wrong, .failed { color: #b3261e; }
</style></head><body>
"""


def index_page(folder, rows, begun, frozen):
    """Write index.html: totals, confusion matrices, and a line for every answer with its page."""
    parts = [HEAD, '<h1>Blind trial</h1>', f'<p>{html.escape(_words(rows, begun, frozen))}</p>']
    table = [line.strip('|').split('|') for line in markdown(rows, begun['modes']).splitlines()]
    parts.append(_table(table[0], [[html.escape(c) for c in line] for line in table[2:]]))
    parts += [f'<p><img src="{name}-{mode}.png" alt="{what}, {mode}"></p>'
              for mode in begun['modes'] for name, what in PICTURES.items()]
    columns = ('case', 'mode', 'planted', 'size', 'outcome', 'said', 'sd', 'page')
    parts.append(_table(columns, [_line(folder, row) for row in rows]))
    path = folder / 'index.html'
    path.write_text('\n'.join([*parts, '</body></html>\n']), encoding='utf-8')
    return path


def _words(rows, begun, frozen):
    open_ = not all(row['confined'] for row in rows)
    begun_again = sum(row['begun'] > 1 for row in rows)
    return ' '.join((
        f'Detector {begun["commit"]}, {begun["machine"]}, {len(rows)} answers.',
        '' if frozen else 'The program changed while answers were given: this is no blind trial.',
        'This kernel has no Landlock: the detector could have looked elsewhere.' if open_ else
        'Each answer was given by a process that could read its case and the program alone.',
        f'{begun_again} answers were begun again after the trial was interrupted.'
        if begun_again else ''))


def _line(folder, row):
    page = folder.page(row['mode'], row['case'])
    there = page.is_file()
    link = f'<a href="{page.relative_to(folder.path)}">page</a>' if there else '-'
    word = row['outcome']
    return [row['case'], row['mode'], html.escape(row['planted']), number(row['size']),
            f'<span class="{word}">{word}</span>', html.escape(row['said']),
            number(row['detectability_sd'], 0), link]


def _table(head, lines):
    cells = ''.join(f'<th>{html.escape(str(c))}</th>' for c in head)
    body = '\n'.join('<tr>' + ''.join(f'<td>{c}</td>' for c in line) + '</tr>' for line in lines)
    return f'<table><tr>{cells}</tr>\n{body}</table>'

