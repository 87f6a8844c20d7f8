"""The gel block's recordings through import and diagnosis: what is said of each, and is it right.

Nothing is told but the scene file: no null recording, no calibration. `cases` says what was
planted, `told` what counts as right. What is solved and answered is kept in a folder, so that a
study that was ended goes on where it was. After a change of the block, the recorder or the
detector, delete that folder, or of it what would be another.
"""

import json
import sys
import tempfile
from itertools import repeat
from pathlib import Path

from arm_brachy.core.paths import run_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.evidence import load_evidence
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.experiments.answers import diagnosed, keep
from arm_brachy.experiments.diagnosis_cases import hasty_pool
from arm_brachy.experiments.gel_block.bodies import load_rays, solve_all
from arm_brachy.experiments.gel_block.cases import CASES
from arm_brachy.experiments.gel_block.recorder import (
    FORCES,
    OPTICAL,
    Recorder,
    lateness,
    write_recording,
)
from arm_brachy.experiments.gel_block.scene import write_scene
from arm_brachy.experiments.told import errors, interval, sized, three, told, verdict
from arm_brachy.recording.import_csv import import_csv

NAME = 'gel-block'
SEED = 0
DEVICE = {'optical': OPTICAL, 'force': FORCES}      # of a stream as a clock_offset calls it


def reproduce(out_dir, folder=None, cases=CASES):
    """Solve, record, import and diagnose every case; write gel-block.json into `out_dir`.

    folder : keeps states/, recordings/ (CSV), answers/ (JSON and a page each); default gel-block/
        among the runs;  cases : cases.Case each
    Returns evaluation.result.Result, a row per case. No goals are set. Raises NotConverged if a
    state of the block cannot be solved.
    """
    folder = run_dir() / NAME if folder is None else Path(folder)
    solve_all(folder / 'states', {case.body for case in cases})
    (folder / 'answers').mkdir(exist_ok=True)
    lacking = [case for case in cases if not _answer_file(folder, case).is_file()]
    with hasty_pool(len(lacking)) as pool:
        for case, _ in zip(lacking, pool.map(answer_one, lacking, repeat(folder)), strict=True):
            print(f'{NAME}: {case.name}', file=sys.stderr, flush=True)
    rows = tuple(row(case, json.loads(_answer_file(folder, case).read_text(encoding='utf-8')))
                 for case in cases)
    result = Result(NAME, SEED, commit_of(share_dir()), str(machine_description()), rows)
    result.to_json(Path(out_dir) / f'{NAME}.json')
    return result


def _answer_file(folder, case):
    return folder / 'answers' / f'{case.name}.json'


def record(case, folder):
    """Write the scene file and the CSV files of a case; returns (scene, column map), paths."""
    place = folder / 'recordings' / case.name
    recorder = Recorder(load_rays(folder / 'states', case.body), case.setup, SEED, case.name)
    columns = write_recording(recorder.record(), place, case.name)
    write_scene(place / 'scene.yaml', poor=case.setup.poor)
    return place / 'scene.yaml', columns


def answer_one(case, folder):
    """Record and diagnose a case whose states are in `folder`; leaves its answer there.

    The file holds {'cpu_s', 'answer'}: CPU time of the diagnosis, and it as JSON or {'error'}.
    """
    scene, columns = record(case, folder)
    path = _answer_file(folder, case)
    with tempfile.TemporaryDirectory() as scratch:
        import_csv(columns, Path(scratch) / case.name)
        keep(path, lambda: _diagnosed(Path(scratch) / case.name, scene,
                                      path.with_suffix('.html')))


def _diagnosed(bag, scene, page):
    """The answer as JSON holds it; its page is written to `page`."""
    return diagnosed(load_evidence((bag,), load_scene(scene)), bag.name, scene.name, page,
                     seed=SEED)


def row(case, line):
    """One row of the table, flat, from a Case and what `answer_one` left; None = not said."""
    answer = line['answer']
    return {'case': case.name, **told(case, answer, truth(case)), **_modulus(case, answer),
            **errors(answer), 'cpu_s': line['cpu_s']}


def truth(case):
    """Parameters that an answer to a Case should find; a delay includes what the clock is off."""
    if case.term != 'clock_offset':
        return case.truth
    late = lateness(case.setup, SEED, case.name)[DEVICE[case.place['stream']]]
    return {'delay_ms': 1e3 * late}


def _modulus(case, answer):
    told = answer.get('recalibrated', {}).get('E_kPa')
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
