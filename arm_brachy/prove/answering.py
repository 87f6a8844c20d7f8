"""The detector's answers: one process a case and mode, run once, failures kept as they are."""

import json
import shutil
import sys

from arm_brachy.prove import sandbox
from arm_brachy.prove.folder import read_json, write_json

# One process each: several cases are answered at a time.
DIAGNOSE = (sys.executable, '-P', '-c', 'from arm_brachy.cli import main; main()', 'diagnose',
            '--jobs', '1')
ABSOLUTE, NULL = 'absolute', 'null'
SUPPLIED = 'supplied'   # both the recording and the one that would decide, of what none can alone
LIMIT = 1800.0      # s of the wall clock, for one answer


def answer_all(folder, jobs, detector, workers, limit, progress):
    """Answer every (mode, case) of `jobs` that has no answer yet; progress(done, of).

    folder : TrialFolder;  detector : words of a command that takes what `arm-brachy diagnose`
    does;  workers : Workers;  limit : [s] for each
    """
    lacking = [job for job in jobs if not folder.answer(*job).is_file()]
    done = len(jobs) - len(lacking)
    progress(done, len(jobs))
    for _ in workers.each(answer_one, [(folder, *job, detector, limit) for job in lacking],
                          waits=True):
        done += 1
        progress(done, len(jobs))


def answer_one(folder, mode, case, detector, limit):
    """Run the detector on one case and keep what came of it; returns the answer's record.

    A run that the trial itself did not live to see the end of is begun again, and `begun` counts
    it; one that ended, in whatever way, never is.
    """
    work, given = folder.work(mode, case), folder.given(case)
    begun = 1 + (read_json(_counter(folder, mode, case)) or 0)
    write_json(_counter(folder, mode, case), begun)
    shutil.rmtree(work, ignore_errors=True)
    readable, bags, without = [given], [given / 'bag'], []
    if mode == SUPPLIED:
        readable.append(folder.supplied(case))
        bags.append(folder.supplied(case) / 'bag')
    if mode == NULL:
        readable.append(folder.sound(case))
        without = ['--null', folder.sound(case) / 'bag']
    command = [*detector, *bags, '--scene', given / 'scene.yaml', '--json', 'answer.json',
               '--out', 'out', *without]
    (folder / 'compiled').mkdir(exist_ok=True)
    ended = sandbox.run([str(word) for word in command], work, readable=readable,
                        writable=[folder / 'compiled'], limit=limit)
    record = {'case': case, 'mode': mode, 'begun': begun, **vars(ended),
              'answer': _answer(work / 'answer.json')}
    if ended.status == sandbox.ANSWERED and record['answer'] is None:
        record['status'] = sandbox.CRASHED
    if record['status'] != sandbox.ANSWERED:
        record['answer'] = None
    _keep_page(work, folder.page(mode, case))
    write_json(folder.answer(mode, case), record)
    return record


def _counter(folder, mode, case):
    return folder / 'begun' / mode / f'{case}.json'


def _answer(path):
    """What the detector wrote; None if that is no JSON object."""
    try:
        found = json.loads(path.read_text(encoding='utf-8'), parse_constant=_refuse)
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _refuse(word):
    raise ValueError(f'{word} is no JSON')


def _keep_page(work, page):
    made = work / 'out' / 'diagnosis.html'
    if made.is_file():
        page.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(made, page)
