"""The recordings of a trial, made in processes of a pool: beside their place, then moved there."""

import os
import shutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.prove.answering import NULL, SUPPLIED
from arm_brachy.prove.folder import read_json, write_json

WHEN = 946684800    # s since 1970: the date of every file, so that it tells nothing
ATTEMPT = 'attempt.json'    # of a body, in its folder
ATTEMPTS = 10       # at a case or body, until the generator finds all its states; own choice


def prepare_body(source, job, folder):
    """Have the body of a job solved and meshed, unless it is; returns its `body_attempt`.

    source : name of a module as `prove.source`;  folder : TrialFolder. Raises as `make_case`.
    """
    done = folder / 'cache' / f'body_{job.body}'
    if not done.is_dir():
        part = done.with_name(f'part_{done.name}')

        def prepare(drawn):
            import_module(source).prepare(drawn, _clean(part), folder / 'cache')
            write_json(part / ATTEMPT, drawn.body_attempt)
        _first_that_can_be_made(source, job, 'body_attempt', prepare)
        os.replace(part, done)
    return read_json(done / ATTEMPT)


def make_case(source, job, folder, sealed, modes):
    """Make the recording of a job, and what else its modes need; returns its name.

    sealed : folder that receives truth.json and heldout.npz;  modes : of answering
    What the generator cannot make is drawn anew, up to ATTEMPTS times; `attempt` of the truth
    counts. Raises ArmBrachyError after that.
    """
    if not folder.given(job.name).is_dir():
        _first_that_can_be_made(source, job, 'attempt', lambda drawn: _record(
            source, drawn, folder, folder.given(job.name), sealed=sealed))
    made = replace(job, attempt=read_json(sealed / 'truth.json')['attempt'])
    if NULL in modes and not folder.sound(job.name).is_dir():
        _record(source, made, folder, folder.sound(job.name), sound=True)
    if SUPPLIED in modes and not folder.supplied(job.name).is_dir():
        _record(source, made, folder, folder.supplied(job.name), again=True)
    return job.name


def _first_that_can_be_made(source, job, counter, make):
    """Call make(job) with one `counter` of the job after the other, until it can be done."""
    unmade = import_module(source).Unmade
    for attempt in range(ATTEMPTS):
        try:
            return make(replace(job, **{counter: attempt}))
        except unmade as error:
            last = error
    raise ArmBrachyError(f'{job.name} on body {job.body}: none of {ATTEMPTS} drawn could be made, '
                         f'the last since {last}; mend the generator')


def same_dates(folder):
    """Set the dates of everything in a folder to WHEN."""
    for path in (*Path(folder).rglob('*'), Path(folder)):
        os.utime(path, (WHEN, WHEN))


def _record(source, job, folder, target, *, sealed=None, **which):
    """Make one recording beside its place and move it there, its truth being sealed before.

    which : sound or again, of the source's `make`
    """
    new = _clean(folder / 'cache' / f'new_{job.name}')
    truth = import_module(source).make(
        job, new, folder / 'cache', folder / 'cache' / f'body_{job.body}', **which)
    if sealed is not None:
        _seal(truth, job, sealed)
    same_dates(new)
    target.parent.mkdir(parents=True, exist_ok=True)
    os.replace(new, target)


def _seal(truth, job, sealed):
    sealed.mkdir(parents=True, exist_ok=True)
    arrays = truth.pop('heldout', {})
    np.savez_compressed(sealed / 'heldout.npz', **{
        f'{name}/{key}': np.asarray(value) for name, one in arrays.items()
        for key, value in one.items()})
    write_json(sealed / 'truth.json', {**truth, 'kind': job.kind, 'body': job.body,
                                       'attempt': job.attempt,
                                       'body_attempt': job.body_attempt})
    same_dates(sealed)


def _clean(path):
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    return path
