"""The recordings of a trial, made in processes of a pool: beside their place, then moved there."""

import os
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np

from arm_brachy.prove.folder import write_json

WHEN = 946684800    # s since 1970: the date of every file, so that it tells nothing


def prepare_body(source, job, folder):
    """Have the body of a job solved and meshed, unless it is; returns its number.

    source : name of a module as `prove.source`;  folder : TrialFolder
    """
    done = folder / 'cache' / f'body_{job.body}'
    if not done.is_dir():
        part = _clean(done.with_name(f'part_{done.name}'))
        import_module(source).prepare(job, part, folder / 'cache')
        os.replace(part, done)
    return job.body


def make_case(source, job, folder, sealed, modes):
    """Make the recording of a job, and the sound one where a mode needs it; returns its name.

    sealed : folder that receives truth.json and heldout.npz
    """
    if not folder.given(job.name).is_dir():
        truth = _record(source, job, folder, folder.given(job.name), sound=False, sealed=sealed)
        write_json(sealed / 'truth.json', {**truth, 'kind': job.kind, 'body': job.body})
        same_dates(sealed)
    if 'null' in modes and not folder.sound(job.name).is_dir():
        _record(source, job, folder, folder.sound(job.name), sound=True)
    return job.name


def same_dates(folder):
    """Set the dates of everything in a folder to WHEN."""
    for path in (*Path(folder).rglob('*'), Path(folder)):
        os.utime(path, (WHEN, WHEN))


def _record(source, job, folder, target, *, sound, sealed=None):
    """Make one recording beside its place and move it there; returns the truth, arrays kept."""
    new = _clean(folder / 'cache' / f'new_{job.name}')
    truth = import_module(source).make(
        job, new, folder / 'cache', folder / 'cache' / f'body_{job.body}', sound=sound)
    arrays = truth.pop('heldout', {})
    if sealed is not None:
        sealed.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(sealed / 'heldout.npz', **{
            f'{name}/{key}': np.asarray(value) for name, one in arrays.items()
            for key, value in one.items()})
    same_dates(new)
    target.parent.mkdir(parents=True, exist_ok=True)
    os.replace(new, target)
    return truth


def _clean(path):
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    return path
