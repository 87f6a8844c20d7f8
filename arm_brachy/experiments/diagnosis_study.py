"""How often the diagnosis is right: every term planted at its typical size and at a tenth, nulls.

What is planted, where and with which nuisances: `diagnosis_plan`. What an answer is worth:
`diagnosis_score`. Every answer is kept as a line of answers.jsonl as it comes, so that a study
that was ended goes on where it was, and is scored from there.

`python -m arm_brachy.experiments.diagnosis_study [FOLDER] [--only FIRST:END]` makes the recordings
that FOLDER lacks, diagnoses those without an answer, prints the README's table and writes
FOLDER/diagnosis-terms.json. After a change of the detector, delete FOLDER/answers.jsonl. One
process a folder at a time.
"""

import argparse
import json
import sys
import time
from concurrent.futures import as_completed
from pathlib import Path

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import run_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.pipeline import diagnose
from arm_brachy.diagnosis.report.answer import Provenance
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.experiments.diagnosis_cases import ALL, hasty_pool, load, make
from arm_brachy.experiments.diagnosis_plan import SCENE, SEED, plan
from arm_brachy.experiments.diagnosis_totals import NAME, markdown, result


def absolute(evidences, scene, *, seed):
    """The diagnosis that is judged: recordings and the path of their scene, no null recording."""
    source = Provenance(NAME, seed, commit_of(share_dir()), str(machine_description()),
                        str(scene), ())
    return diagnose(evidences, source).diagnosis


def answer_all(folder, index, detector=absolute, scene=SCENE, seed=SEED):
    """Diagnose every case of `index` in `folder` that answers.jsonl lacks; returns all lines.

    detector : called as `absolute` is, in processes of its own: a function of a module
    A line is {'name', 'cpu_s', 'answer'}; an answer that failed is {'error': text}. A bug in the
    detector ends the study; what was answered until then is kept.
    """
    path = Path(folder) / 'answers.jsonl'
    lines = _read(path)
    jobs = [label for label in index if label['name'] not in lines]
    with hasty_pool(len(jobs)) as pool, path.open('a', encoding='utf-8') as file:
        waiting = [pool.submit(answer_one, Path(folder) / label['file'], detector, scene, seed)
                   for label in jobs]
        for done, future in enumerate(as_completed(waiting), start=1):
            line = future.result()
            lines[line['name']] = line
            print(json.dumps(line), file=file, flush=True)
            print(f'{NAME}: {done} of {len(jobs)}: {line["name"]}, {line["cpu_s"]:.1f} CPU s',
                  file=sys.stderr, flush=True)
    return lines


def answer_one(file, detector, scene, seed):
    """Diagnose one recording alone, in absolute mode; returns its line."""
    start = time.process_time()
    try:
        evidence = evidence_of(load(file), load_scene(scene))
        answer = json.loads(detector((evidence,), scene, seed=seed).to_json())
    except ArmBrachyError as error:
        answer = {'error': str(error)}
    return {'name': file.stem, 'cpu_s': time.process_time() - start, 'answer': answer}


def _read(path):
    """Name -> line; a line that an interruption cut short is left out."""
    lines = {}
    if path.is_file():
        whole = path.read_text(encoding='utf-8')
        kept = whole[:whole.rfind('\n') + 1]
        path.write_text(kept, encoding='utf-8')
        lines = {line['name']: line for line in map(json.loads, kept.splitlines())}
    return lines


def reproduce(out_dir, folder=None, detector=absolute, only=ALL):
    """Make and diagnose every case, score what was answered; what `folder` holds is kept.

    out_dir : receives diagnosis-terms.json;  folder : of recordings and answers, default
        diagnosis-terms/ among the runs;  detector : see `answer_all`
    only : slice of the plan to make and diagnose now; earlier answers to other cases count
    Returns Result.
    """
    folder = run_dir() / NAME if folder is None else Path(folder)
    index = make(folder, only=only)
    found = result(index, answer_all(folder, index[only], detector))
    found.to_json(Path(out_dir) / f'{NAME}.json')
    return found


def stretch(text):
    """The slice of the plan that `FIRST:END` means; ArgumentTypeError if it has no such cases."""
    first, _, end = text.partition(':')
    planned = len(plan())
    if not (first.isdecimal() and end.isdecimal() and int(first) < int(end) <= planned):
        raise argparse.ArgumentTypeError(
            f'{text}; must be FIRST:END with 0 <= FIRST < END <= {planned}, e.g. 0:45')
    return slice(int(first), int(end))


def main():
    """Run the study, or a stretch of it, in a folder of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('folder', type=Path, nargs='?', default=run_dir() / NAME, metavar='FOLDER',
                        help='of recordings, answers and result; default: %(default)s')
    parser.add_argument('--only', type=stretch, default=ALL, metavar='FIRST:END',
                        help='these cases alone, counted from 0, END left out; default: all')
    given = parser.parse_args()
    found = reproduce(given.folder, given.folder, only=given.only)
    print(markdown(json.loads(found.to_json())))


if __name__ == '__main__':
    main()
