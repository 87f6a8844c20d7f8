"""The pages of an opened trial: an index with its goals, and one for every answer.

Test: prove/test_pages.py
"""

import os

from arm_brachy.evaluation.page import (
    Cell,
    Column,
    Fact,
    Grid,
    Picture,
    Verdict,
    number,
    write_page,
)
from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.outcome import ABSTAINED, CLASS, FAILED, PARTLY, RIGHT, SILENT, WIDE, WRONG
from arm_brachy.prove.plan import NULL, STRANGE

WORDS = {
    RIGHT: 'Right: what was planted is what was said',
    CLASS: 'A class: what was planted, or what theory cannot tell from it',
    WIDE: 'A class that is wider than theory asks for',
    PARTLY: 'One of two that were planted, and nothing that was not',
    ABSTAINED: 'Abstained: something differs, and no cause is claimed for it',
    SILENT: 'Silent: nothing missing was said',
    WRONG: 'Wrong: something was claimed that is not there',
    FAILED: 'No answer',
}
PICTURES = {'confusion': 'what was said of what was planted, mode {}',
            'curves': 'power over size, and risk over coverage, mode {}'}
MOODS = {True: 'good', False: 'bad', None: 'open'}
CASES = (Column('case', numeric=False), Column('mode', numeric=False),
         Column('planted', numeric=False), Column('size', 'of the typical'),
         Column('seen', 'sd, by an oracle'), Column('outcome', numeric=False),
         Column('said', numeric=False))
EFFECTS = (Column('effect', numeric=False), Column('size', 'of the typical'),
           Column('parameter', numeric=False), Column('value', numeric=False))
CAUSES = (Column('cause', numeric=False), Column('parameter', numeric=False),
          Column('value', numeric=False), Column('90 % interval', numeric=False))
FIGURES = (('error of place', 'place_error_mm', 'mm', 1),
           ('error of onset', 'onset_error_s', 's', 3),
           ('error of parameters', 'parameter_error_percent', '%', 0),
           ('seen by an oracle', 'detectability_sd', 'sd', 0),
           ('apart from its rival', 'separation_sd', 'sd', 0),
           ('held-out recovery', 'recovery', '', 2), ('time', 'seconds', 's', 0))


def mood_of(row):
    """How an answer is to be taken: 'good', 'bad' or 'open'."""
    word, kind = row['outcome'], row['kind']
    if word in (WRONG, FAILED):
        return 'bad'
    if kind == NULL or kind == STRANGE:
        return 'good' if word == (SILENT if kind == NULL else ABSTAINED) else 'open'
    return 'good' if word in (RIGHT, CLASS) else 'open'


def index_page(folder, rows, begun, frozen, tables, goals):
    """Write index.html: goals, totals, pictures, a line for every answer; returns its path.

    folder : folder.TrialFolder;  rows : of `score`;  begun : as `trial.begin`
    frozen : the program stayed the same;  tables : (heading, markdown) each
    goals : evaluation.result.Target each
    """
    met = [goal.met for goal in goals if goal.met is not None]
    verdict = Verdict('bad' if not frozen else 'good' if met and all(met) else 'open',
                      f'{sum(met)} of {len(met)} goals met', _words(rows, frozen))
    figures = [Picture(f'{name}-{mode}.png', what.format(mode))
               for mode in begun['modes'] for name, what in PICTURES.items()]
    cases = Grid(CASES, tuple((_link(folder, case_file(folder, row)), _line(row)) for row in rows))
    return write_page(
        'trial.html.j2', folder / 'index.html', title='Blind trial', kind='Blind trial',
        heading=f'Detector {begun["commit"]}', verdict=verdict, facts=(), scenario='',
        command=_command(begun),
        provenance=(('Commit', begun['commit']), ('Machine', begun['machine'])),
        goals=_goals(goals), tables=[_grid(*one) for one in tables], figures=figures, cases=cases)


def case_page(folder, row, begun, truth, record):
    """Write the page of one answer beside its truth; returns its path.

    folder, begun : as for `index_page`;  row : of `score`;  truth : of the case as it is judged
    record : as `answering.answer_one`
    """
    path, answer = case_file(folder, row), record['answer']
    path.parent.mkdir(parents=True, exist_ok=True)
    facts = tuple(Fact(label, number(row[key], digits), unit)
                  for label, key, unit, digits in FIGURES if row[key] is not None)
    page = folder.page(row['mode'], row['case'])
    return write_page(
        'trial_case.html.j2', path, title=row['case'], kind=f'Blind trial, mode {row["mode"]}',
        heading=f'{row["case"]}: {_planted(row)}',
        verdict=Verdict(mood_of(row), WORDS[row['outcome']],
                        f'It said: {row["said"] or "nothing is missing"}.'),
        facts=facts, command=_command(begun), scenario='',
        provenance=(('Commit', begun['commit']), ('Machine', begun['machine'])),
        planted=Grid(EFFECTS, tuple(_effects(truth))), body=_body(truth),
        sentence=record['status'] if answer is None else answer['sentence'],
        told=Grid(CAUSES, tuple(_causes(answer))),
        page=os.path.relpath(page, path.parent) if page.is_file() else '')


def case_file(folder, row):
    """Where the page of an answer lies."""
    return folder / 'cases' / row['mode'] / f'{row["case"]}.html'


def _command(begun):
    """What to type, at the commit of the detector, for the same cases."""
    modes = 'both' if len(begun['modes']) > 1 else begun['modes'][0]
    return (f'arm-brachy prove --cases {begun["cases"]} --mode {modes} '
            f'--beacon {begun["beacon"]}')


def _link(folder, path):
    return path.relative_to(folder.path)


def _planted(row):
    return 'nothing planted' if row['planted'] == '-' else row['planted']


def _words(rows, frozen):
    closed = all(row['confined'] for row in rows)
    again = sum(row['begun'] > 1 for row in rows)
    return ' '.join(words for words in (
        f'{len(rows)} answers.',
        '' if frozen else 'The program changed while answers were given: this is no blind trial.',
        'Each was given by a process that could read its case and the program alone.' if closed
        else 'This kernel has no Landlock: the detector could have looked elsewhere.',
        f'{again} were begun again after the trial was interrupted.' if again else '') if words)


def _goals(goals):
    columns = (Column('goal', numeric=False), Column('came out'), Column('wanted'))
    return Grid(columns, tuple((Cell(goal.name), Cell(_came_out(goal), MOODS[goal.met]),
                                Cell(goal.goal)) for goal in goals))


def _came_out(goal):
    unit = '' if goal.met is None or goal.unit == '1' else f' {goal.unit}'
    return number(goal.value, 2 if goal.unit == '1' else 1) + unit


def _grid(heading, text):
    """A table of markdown as a Grid."""
    head, _, *lines = ([cell.strip() for cell in line.strip('|').split('|')]
                       for line in text.splitlines())
    return Grid(tuple(Column(title, numeric=False) for title in head),
                tuple(tuple(map(Cell, line)) for line in lines), heading)


def _line(row):
    return (Cell(row['case']), Cell(row['mode']), Cell(_planted(row)), Cell(number(row['size'])),
            Cell(number(row['detectability_sd'], 0)), Cell(row['outcome'], mood_of(row)),
            Cell(row['said']))


def _effects(truth):
    for effect in truth['effects']:
        told = {key: value for key, value in effect['values'].items() if value is not None}
        for i, (key, value) in enumerate(told.items() or (('-', '-'),)):
            yield (Cell('' if i else _law(effect)), Cell('' if i else number(effect['size'])),
                   Cell(key), Cell(_text(value)))
        if effect['onset_s'] is not None:
            yield (Cell(''), Cell(''), Cell('onset in the bag'),
                   Cell(f'{effect["onset_s"] + truth["start_s"]:.3f} s'))


def _law(effect):
    """Name of a planted effect, with that of its law where it is not the registry's."""
    form = effect.get('form', REGISTRY)
    return effect['name'] if form == REGISTRY else f'{effect["name"]} ({form})'


def _causes(answer):
    for cause in () if answer is None else answer['causes']:
        name = f'{cause["term"]} (or)' if cause['option'] else cause['term']
        told = cause['parameters'] or {'-': {'value': '-', 'interval_90': None}}
        for i, (key, one) in enumerate(told.items()):
            interval = one['interval_90']
            yield (Cell('' if i else name), Cell(key), Cell(_text(one['value'])),
                   Cell('-' if interval is None else ' to '.join(map(_text, interval))))


def _text(value):
    """A value of a truth or an answer in few digits; an open end of an interval as 'open'."""
    if value is None:
        return 'open'
    if isinstance(value, (list, tuple)):
        return ', '.join(map(_text, value))
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def _body(truth):
    factor = truth['nuisances']['modulus_factor']
    return (f'Truth by the solver {truth["solver"]}; modulus on the label '
            f'{_text(truth["E_kPa"])} kPa, times {_text(factor)} in fact.')
