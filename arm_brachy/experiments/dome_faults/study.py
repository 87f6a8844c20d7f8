"""Faults in another laboratory's recordings through the diagnosis: what is said, and is it right.

Recordings A and B of the dome rig are fitted and C is held out, all with the same fault. Nothing
is told but the scene file. `faults` says what is wrong, `told` what counts as right. What is
answered is kept in a folder, so that a study that was ended goes on where it was; delete it after
a change of the faults or the detector.
"""

import json
import sys
import tempfile
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import numpy as np

from arm_brachy.core.paths import run_dir, share_dir
from arm_brachy.core.scene import MeshFile, load_scene
from arm_brachy.diagnosis.signals.loading import evidence_of, zero_of
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.experiments import dome_rig, recordings
from arm_brachy.experiments.answers import diagnosed, keep
from arm_brachy.experiments.diagnosis_cases import hasty_pool
from arm_brachy.experiments.dome_faults.faults import BY_NAME, FAULTS
from arm_brachy.experiments.told import errors, sized, three, told, verdict
from arm_brachy.offline import load_run

NAME = 'dome-faults'
SEED = 0
FITTED = 2          # recordings; the last one is held out


def reproduce(out_dir, folder=None, faults=FAULTS):
    """Import, spoil and diagnose; write dome-faults.json into `out_dir`.

    folder : keeps answers (JSON and a page each); default dome-faults/ among the runs
    faults : of FAULTS
    Returns evaluation.result.Result, a row per fault. No goals are set. Raises InputError if the
    recordings are absent.
    """
    source = recordings.folder(dome_rig.SET)
    folder = run_dir() / NAME if folder is None else Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lacking = [one for one in faults if not _answer_file(folder, one).is_file()]
    with tempfile.TemporaryDirectory() as scratch, hasty_pool(len(lacking)) as pool:
        scene, bags = dome_rig.imported(source, Path(scratch))
        bags = tuple(bags.values())
        names = [one.name for one in lacking]
        for name, _ in zip(names, pool.map(answer_one, names, repeat(scene), repeat(bags),
                                           repeat(folder)), strict=True):
            print(f'{NAME}: {name}', file=sys.stderr, flush=True)
    rows = tuple(row(one, json.loads(_answer_file(folder, one).read_text(encoding='utf-8')))
                 for one in faults)
    result = Result(NAME, SEED, commit_of(share_dir()), str(machine_description()), rows)
    result.to_json(Path(out_dir) / f'{NAME}.json')
    return result


def _answer_file(folder, fault):
    return folder / f'{fault.name}.json'


def answer_one(name, scene, bags, folder):
    """Diagnose the recordings with the fault of a name; leaves {'cpu_s', 'answer'} and a page."""
    fault = BY_NAME[name]
    path = _answer_file(folder, fault)
    with tempfile.TemporaryDirectory() as scratch:
        altered = altered_scene(fault, load_scene(scene), Path(scratch))
        runs = [fault.spoil(load_run(bag, measured=True), i) for i, bag in enumerate(bags)]
        keep(path, lambda: _diagnosed(runs, altered, zero_of(bags), path.with_suffix('.html')))


def altered_scene(fault, scene, scratch):
    """The Scene as a Fault has it; a mesh that is changed is written into `scratch`."""
    with np.load(scene.mesh.file) as file:
        mesh = dict(file)
    mesh['nodes'] = mesh['nodes'] * fault.stretched
    np.savez(scratch / 'mesh.npz', **mesh)
    return fault.alter(replace(scene, mesh=MeshFile(str(scratch / 'mesh.npz'), scene.mesh.unit)))


def _diagnosed(runs, scene, zero, page):
    """The answer as JSON holds it; its page is written to `page`.  zero : `loading.zero_of`"""
    evidences = [evidence_of(run, scene, zero=zero) for run in runs]
    return diagnosed(evidences[:FITTED], page.stem, scene.name, page, seed=SEED,
                     held_out=evidences[FITTED:])


def row(fault, line):
    """One row of the table, flat, from a Fault and what `answer_one` left; None = not said."""
    return {'case': fault.name, **told(fault, line['answer']), **errors(line['answer']),
            'cpu_s': line['cpu_s']}


def markdown(body):
    """The README's table of a Result as mapping; errors: recalibrated, with the causes, noise."""
    lines = ['| case | what is wrong | said | right | wrong by, found (90 %) | optical / mm | '
             'em / mm | force / N | CPU s |', '|---|---|---|---|---|---|---|---|---|']
    for one in body['rows']:
        cells = (one['case'], '-' if one['planted'] == '-' else f'`{one["planted"]}`',
                 verdict(one), 'yes' if one['right'] else '**no**', sized(one),
                 *(three(one, stream) for stream in ('optical', 'em', 'force')),
                 f'{one["cpu_s"]:.0f}')
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)
