"""A made-up generator for the trial: a case is one number, and a file says how the answer goes."""

import json

import numpy as np

from arm_brachy.prove.plan import NULL, SINGLE

VALUES = {'backlash': 'width_mm', 'force_gain': 'gain'}
WISHES = {SINGLE: tuple(VALUES)}


class Unmade(Exception):
    pass


def prepare(job, body_folder, cache):
    if job.body == 0 and job.body_attempt < 1:
        (body_folder / 'half').touch()
        raise Unmade('creases')
    assert not (body_folder / 'half').exists()
    (body_folder / 'mesh').write_text('made')
    with (cache.parent / 'prepared.txt').open('a') as file:
        file.write(f'{job.body}\n')


def make(job, folder, cache, body_folder, *, sound=False, again=False):
    assert (body_folder / 'mesh').is_file()
    with (cache.parent / 'made.txt').open('a') as file:
        file.write(f'{job.name} {sound} {again}\n')
    if job.name == 'case_001' and job.attempt < 2:
        raise Unmade('no state')
    assert job.body_attempt == (1 if job.body == 0 else 0)
    size = float(job.rng().uniform(0.2, 2.0))
    label = [] if job.kind == NULL or sound else [job.wish or 'strange_thing']
    (folder / 'bag').mkdir()
    (folder / 'bag' / 'data.json').write_text(json.dumps({'label': label, 'size': size}))
    (folder / 'scene.yaml').write_text('name: made-up')
    return {
        'labels': label, 'in_catalogue': label in ([], ['backlash'], ['force_gain']),
        'effects': [{'name': name, 'size': size, 'values': {VALUES.get(name, 'x'): size},
                     'place_m': None, 'onset_s': None} for name in label],
        'solver': 'none', 'nuisances': {'modulus_factor': 1.0}, 'alike': [], 'withheld': [],
        'start_s': 0.0, 'E_kPa': 6.0, 'heldout': {'forces': {'t_s': np.arange(3.0)}}}
