"""The sealed blind trial: draw, make, publish, answer, open, score, each stage resumable.

What makes it blind: the cases follow from SHA256(detector's commit || beacon), the beacon drawn
after the commit; hashes of the truth are published before the detector runs and of its answers
before the truth is opened; the detector runs as a process that can read one case and itself.
Test: prove/test_trial.py
"""

import secrets
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.prove import plan, seal
from arm_brachy.prove.answering import ABSOLUTE, DIAGNOSE, LIMIT, NULL, SUPPLIED, answer_all
from arm_brachy.prove.folder import TrialFolder, read_json, write_json
from arm_brachy.prove.making import make_case, prepare_body
from arm_brachy.prove.workers import Workers

MODES = (ABSOLUTE, NULL)
UNSALTED = ''       # answers are published with their hashes, and hide nothing


@dataclass(frozen=True)
class Setup:
    """What is asked for: what a folder was begun with it goes on with.

    modes : of MODES;  beacon : public text, '' = 32 fresh random bytes
    workers : Workers;  limit : [s] an answer
    detector : words of a command that takes what `arm-brachy diagnose` does
    """

    cases: int = 60
    modes: tuple = MODES
    beacon: str = ''
    workers: Workers = Workers(2)
    limit: float = LIMIT
    detector: tuple = DIAGNOSE


def run(setup, folder, source, progress=lambda stage, done, of: None):
    """Go through the stages that `folder` lacks; returns (jobs, truths, records).

    source : name of a module as `prove.source`;  progress(stage, done, of)
    truths : case -> dict;  records : (mode, case) -> dict as `answering.answer_one`
    Raises InputError if the folder was begun with another set-up, ArmBrachyError if what was
    published and what is there differ.
    """
    folder = TrialFolder(Path(folder).resolve())
    begun = begin(setup, folder)
    jobs = plan.draw(seal.seed_of(begun['commit'], begun['beacon']), setup.cases,
                     import_module(source).WISHES)
    make_all(folder, begun, jobs, setup, source, progress)
    publish(folder, begun, jobs)
    asked = [(mode, job.name) for mode in (*setup.modes, SUPPLIED) for job in jobs
             if mode in modes_of(setup, job)]
    answer_all(folder, asked, setup.detector, setup.workers, setup.limit,
               lambda done, of: progress('answering', done, of))
    records = publish_answers(folder, asked)
    truths = open_truth(folder, begun, jobs, source)
    made = tuple(replace(job, **{name: truths[job.name][name] for name in
                                 ('attempt', 'body_attempt')}) for job in jobs)
    return made, truths, records


def modes_of(setup, job):
    """Modes in which a job is answered: what none can decide also with what would decide it."""
    decided = job.kind == plan.CONFOUNDED and ABSOLUTE in setup.modes
    return (*setup.modes, SUPPLIED) if decided else setup.modes


def begin(setup, folder):
    """Draw beacon and key, or read those the folder was begun with; returns them with the rest."""
    asked = {'cases': setup.cases, 'modes': list(setup.modes), 'detector': list(setup.detector),
             'limit_s': setup.limit}
    begun = read_json(folder / 'secret.json')
    if begun is None:
        begun = {**asked, 'commit': commit_of(share_dir()), 'program': seal.program(),
                 'machine': machine_description(),
                 'beacon': setup.beacon or secrets.token_hex(32), 'key': secrets.token_hex(32)}
        write_json(folder / 'secret.json', begun)
        (folder / 'secret.json').chmod(0o600)
    for name, value in {**asked, 'beacon': setup.beacon or begun['beacon']}.items():
        if begun[name] != value:
            raise InputError(f'{folder.path}: begun with {name} {begun[name]!r}, not {value!r}; '
                             'go on with the same or name another folder with --out')
    return begun


def make_all(folder, begun, jobs, setup, source, progress):
    """Make every recording that the folder lacks: bodies first, since cases share them.

    Raises InputError if the program, generator included, is not the one that was begun with.
    """
    if read_json(folder / 'published.json'):
        return
    if begun['program'] != seal.program():
        raise InputError(f'{folder.path}: the program was changed since this trial was begun and '
                         'before its cases were made; begin another one with --out')
    key, one_a_body = begun['key'], {job.body: job for job in jobs}
    (folder / 'cache').mkdir(exist_ok=True)
    attempts = _all_done(setup.workers, 'bodies', prepare_body,
                         [(source, job, folder) for job in one_a_body.values()], progress)
    attempts = dict(zip(one_a_body, attempts, strict=True))
    jobs = [replace(job, body_attempt=attempts[job.body]) for job in jobs]
    _all_done(setup.workers, 'recordings', make_case,
              [(source, job, folder, folder.sealed(key, job.name),
                modes_of(setup, job)) for job in jobs],
              progress)


def _all_done(workers, stage, work, tasks, progress):
    """What work(*task) returns for every task."""
    progress(stage, 0, len(tasks))
    found = []
    for one in workers.each(work, tasks):
        found.append(one)
        progress(stage, len(found), len(tasks))
    return found


def publish(folder, begun, jobs):
    """Write the hashes of all truths and their root: from here on nothing can be changed."""
    if read_json(folder / 'published.json') is None:
        leaves = [seal.commitment(_salt(begun, job.name), _truth(folder, begun, job.name))
                  for job in jobs]
        write_json(folder / 'published.json', {
            'what': 'commitments to what is concealed: SHA256(0x00 || salt || canonical JSON)',
            'commit': begun['commit'], 'program': begun['program'],
            'machine': begun['machine'], 'root': seal.root(leaves),
            'cases': dict(zip((job.name for job in jobs), leaves, strict=True))})


def publish_answers(folder, asked):
    """Write the hashes of all answers and their root; returns (mode, case) -> record."""
    records = {one: read_json(folder.answer(*one)) for one in asked}
    leaves = {'/'.join(one): seal.commitment(UNSALTED, record) for one, record in records.items()}
    held = read_json(folder / 'answers.json')
    found = {'root': seal.root(list(leaves.values())), 'answers': leaves,
             'program': seal.program()}
    if held is None:
        write_json(folder / 'answers.json', found)
    elif held['answers'] != leaves:
        wrong = [name for name in leaves if held['answers'].get(name) != leaves[name]]
        raise ArmBrachyError(f'{folder.path}: the answer to {wrong[0]} is not the one whose hash '
                             'was published; this trial is void')
    return records


def open_truth(folder, begun, jobs, source):
    """Write truths, salts and proofs to opened.json, with what was wished for, and verify them.

    Returns case -> truth.
    """
    opened = {job.name: {'salt': _salt(begun, job.name),
                         'truth': _truth(folder, begun, job.name)} for job in jobs}
    published = read_json(folder / 'published.json')
    leaves = [published['cases'][job.name] for job in jobs]
    for i, job in enumerate(jobs):
        opened[job.name]['proof'] = seal.proof(leaves, i)
    write_json(folder / 'opened.json', {'beacon': begun['beacon'], 'commit': begun['commit'],
                                        'wishes': import_module(source).WISHES,
                                        'cases': opened})
    verify(folder)
    return {name: one['truth'] for name, one in opened.items()}


def verify(folder):
    """Hold an opened trial to what was published; anybody can.

    folder : TrialFolder. Raises ArmBrachyError naming the first case that is not what was
    published, and if cases were published that were not opened.
    """
    opened, published = (read_json(folder / name) for name in ('opened.json', 'published.json'))
    if set(opened['cases']) != set(published['cases']):
        raise ArmBrachyError(f'{folder.path}: opened are other cases than were published; this '
                             'trial is void')
    for name, one in opened['cases'].items():
        if not seal.holds(one['salt'], one['truth'], one['proof'], published['root']):
            raise ArmBrachyError(f'{folder.path}: {name} is not what was published; this trial '
                                 'is void')


def frozen(folder):
    """True if the program at the end of the answers was the one at the start."""
    return read_json(folder / 'answers.json')['program'] == read_json(
        folder / 'published.json')['program']


def _salt(begun, case):
    return seal.keyed(begun['key'], f'salt/{case}')


def _truth(folder, begun, case):
    return read_json(folder.sealed(begun['key'], case) / 'truth.json')
