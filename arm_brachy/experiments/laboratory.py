"""What studies of another laboratory's recordings share: import, diagnosis, rows and their table.

Answers are kept in a folder, so that a study that was ended goes on where it was.
Test: experiments/gel_block/test_study.py, experiments/half_cylinder/test_study.py
"""

import json
import sys
import tempfile
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path

from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.experiments.answers import diagnosed, keep
from arm_brachy.experiments.diagnosis_cases import hasty_pool
from arm_brachy.experiments.ray import PLAIN
from arm_brachy.experiments.told import errors, interval, sized, three, told, verdict
from arm_brachy.recording.import_csv import import_csv


@dataclass(frozen=True)
class Case:
    """One recording; a laboratory's own adds `modulus_kPa`, the Young's modulus that is true.

    name : of the case;  setup : what its recorder takes;  body : of the laboratory's bodies
    term : of the registry that it amounts to, told.OUTSIDE, None = nothing is missing
    truth : parameters of the term as an answer spells them, in its units; the first is shown.
        Left out: what the term does not have, as the radius of a straight edge
    place : fields of the term that select, as in an answer
    """

    name: str
    setup: object
    body: str = PLAIN
    term: str | None = None
    truth: dict = field(default_factory=dict)
    place: dict = field(default_factory=dict)


def answered(name, seed, cases, folder, answer_one, *, truth=None, beside=()):
    """Answer what `folder` lacks, a process per core; returns evaluation.result.Result.

    name, seed : of the experiment;  folder : its answers/ keeps JSON and a page per case
    answer_one : (case, folder), of a module: has `answer` leave what it says of a case
    truth : case -> parameters that an answer should find;  None = those of the case
    beside : as `told` takes it
    """
    (folder / 'answers').mkdir(exist_ok=True)
    lacking = [case for case in cases if not _answer_file(folder, case).is_file()]
    with hasty_pool(len(lacking)) as pool:
        for case, _ in zip(lacking, pool.map(answer_one, lacking, repeat(folder)), strict=True):
            print(f'{name}: {case.name}', file=sys.stderr, flush=True)
    rows = tuple(row(case, json.loads(_answer_file(folder, case).read_text(encoding='utf-8')),
                     None if truth is None else truth(case), beside=beside) for case in cases)
    return Result(name, seed, commit_of(share_dir()), str(machine_description()), rows)


def _answer_file(folder, case):
    return folder / 'answers' / f'{case.name}.json'


def answer(case, folder, scene, columns, seed):
    """Import and diagnose a recording of a case; leaves its answer and page in `folder`.

    scene, columns : paths of the scene file and of the column map
    The file holds {'cpu_s', 'answer'}: CPU time of the diagnosis, and it as JSON or {'error'}.
    """
    path = _answer_file(folder, case)
    with tempfile.TemporaryDirectory() as scratch:
        import_csv(columns, Path(scratch) / case.name)
        keep(path, lambda: _diagnosed(Path(scratch) / case.name, scene,
                                      path.with_suffix('.html'), seed))


def _diagnosed(bag, scene, page, seed):
    """The answer as JSON holds it; its page is written to `page`."""
    return diagnosed(load_evidence((bag,), load_scene(scene)), bag.name, scene.name, page,
                     seed=seed)


def row(case, line, truth=None, *, beside=()):
    """One row of the table, flat, from a case and what `answer` left; None = not said.

    truth, beside : as `told` takes them
    """
    said = line['answer']
    return {'case': case.name, **told(case, said, truth, beside=beside),
            **_modulus(case, said), **errors(said), 'cpu_s': line['cpu_s']}


def _modulus(case, said):
    told = said.get('recalibrated', {}).get('E_kPa')
    low, high = (None, None) if told is None else told['interval_90']
    return {'E_true_kPa': case.modulus_kPa, 'E_kPa': None if told is None else told['value'],
            'E_low_kPa': low, 'E_high_kPa': high}


def markdown(body):
    """The README's table of a Result as mapping; errors: recalibrated, with the causes, noise."""
    lines = ['| case | planted | said | right | planted, found (90 %) | modulus / kPa: planted, '
             'found (90 %) | optical / mm | force / N | CPU s |',
             '|---|---|---|---|---|---|---|---|---|']
    for one in body['rows']:
        modulus = f'{one["E_true_kPa"]:.3g}, ' + interval(one['E_kPa'], one['E_low_kPa'],
                                                          one['E_high_kPa'])
        cells = (one['case'], '-' if one['planted'] == '-' else f'`{one["planted"]}`',
                 verdict(one), 'yes' if one['right'] else '**no**', sized(one), modulus,
                 three(one, 'optical'), three(one, 'force'), f'{one["cpu_s"]:.0f}')
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)
