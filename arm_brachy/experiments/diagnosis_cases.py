"""The folder of the study of the diagnosis: recordings, truth and labels of what `plan` says.

`python -m arm_brachy.experiments.diagnosis_cases FOLDER` makes every recording from one seed, a
process per core; what is there already is kept.
"""

import json
import os
import sys
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.evaluation.timeseries import EmSamples, OpticalFrames, RunData, Series
from arm_brachy.experiments.diagnosis_plan import SEED, plan
from arm_brachy.experiments.diagnosis_recordings import Motion, move, observe
from arm_brachy.experiments.parallel import process_pool

ALL = slice(None)


def save(path, arrays):
    """Write arrays (str -> array) as .npz, whole or not at all."""
    part = path.with_suffix('.part.npz')
    np.savez_compressed(part, **arrays)
    os.replace(part, path)


def store(path, run):
    """Write the streams of RunData, metres and newtons in single precision (5 nm in 80 mm)."""
    em = {f'em/{tool}/{name}': getattr(s, name) for tool, s in run.em.items()
          for name in ('t', 'position', 'quality', 'status')}
    save(path, {
        'encoder/t': run.encoder.t, 'encoder/values': run.encoder.values,
        'encoder/pads': np.array(run.encoder_pads), 'force/t': run.force.t,
        'force/values': run.force.values.astype(np.float32),
        'force/pads': np.array(run.force_pads), 'optical/t': run.optical.t,
        'optical/points': run.optical.points.astype(np.float32),
        'optical/visible': run.optical.visible, 'optical/ids': np.array(run.optical.ids), **em})


def load(path):
    """Read what `store` wrote: RunData, for diagnosis.evidence.evidence_of(run, scene)."""
    with np.load(path) as file:
        given = {key: file[key] for key in file.files}
    tools = dict.fromkeys(key.split('/')[1] for key in given if key.startswith('em/'))
    em = {tool: EmSamples(*(given[f'em/{tool}/{name}']
                            for name in ('t', 'position', 'quality', 'status'))) for tool in tools}
    optical = OpticalFrames(given['optical/t'], tuple(given['optical/ids'].tolist()),
                            given['optical/points'].astype(float), given['optical/visible'])
    return RunData(Path(path).stem, '', 0, 'unknown', 'unknown', em=em, optical=optical,
                   encoder=Series(given['encoder/t'], given['encoder/values']),
                   encoder_pads=tuple(given['encoder/pads'].tolist()),
                   force=Series(given['force/t'], given['force/values'].astype(float)),
                   force_pads=tuple(given['force/pads'].tolist()))


def make(folder, seed=SEED, only=ALL):
    """Make every recording that `folder` lacks; returns the labels of all that are planned.

    folder : receives plants/NAME.npz (truth), NAME.npz (recordings) and, as they come, index.json
        (the labels of those that are there);  only : slice of the plan to make now
    Raises InputError if it holds recordings of something else.
    """
    folder, cases = Path(folder), plan(seed)
    index = [labels(case, f'{case.name}.npz') for case in cases]
    listed, cases = _listed(folder / 'index.json', index), cases[only]
    (folder / 'plants').mkdir(parents=True, exist_ok=True)
    lacking = {c.name: c.plant for c in cases if not (folder / f'{c.name}.npz').is_file()}
    with hasty_pool(len(lacking)) as pool:
        runs = {plant.name: pool.submit(run_plant, folder / 'plants' / f'{plant.name}.npz', plant)
                for plant in dict.fromkeys(lacking.values())}
        for done, case in enumerate(cases, start=1):
            if case.name in lacking:
                with np.load(runs[case.plant.name].result()) as file:
                    store(folder / f'{case.name}.npz', observe(case, Motion(**file)))
                print(f'{case.name}: {done} of {len(cases)}', file=sys.stderr, flush=True)
            listed.add(case.name)
            _write(folder / 'index.json', [one for one in index if one['name'] in listed])
    return index


def _listed(path, index):
    """Names of the cases in the index at `path`, a set; InputError if `index` has them not."""
    held = json.loads(path.read_text(encoding='utf-8')) if path.is_file() else []
    planned = json.loads(json.dumps(index))
    if any(one not in planned for one in held):
        raise InputError(f'{path}: lists other cases than would be made now; must be of the same '
                         'seed and registry; give a new folder')
    return {one['name'] for one in held}


@contextmanager
def hasty_pool(jobs):
    """A `process_pool` that drops what has not begun as soon as anything fails."""
    pool = process_pool(max(jobs, 1))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def run_plant(path, plant):
    """Run a Plant, unless its Motion is there already; returns `path`, its file."""
    if not path.is_file():
        save(path, vars(move(plant)))
    return path


def _write(path, index):
    part = path.with_suffix('.part')
    part.write_text(json.dumps(index, indent=1), encoding='utf-8')
    os.replace(part, path)


def labels(case, file):
    """What is in a case, SI: `parameters` carry the size, `fields` are all that the term has."""
    one, out = case.planted, {'name': case.name, 'file': file, 'seed': case.seed,
                              'plant': case.plant.name, 'modulus': case.plant.modulus,
                              'touch': case.plant.touch, 'term': None, 'size': 0.0,
                              'parameters': {}, 'place': {}, 'fields': {}}
    if one is None:
        return out
    fields = asdict(one.term)
    return out | {'term': one.term.spec.name, 'size': one.size, 'fields': fields,
                  'parameters': {name: fields[name] for name in one.strengths},
                  'place': {name: fields[name] for name in one.place}}


if __name__ == '__main__':
    make(sys.argv[1])
