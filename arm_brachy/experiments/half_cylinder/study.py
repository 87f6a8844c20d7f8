"""The half-cylinder's recordings through import and diagnosis: what is said of each, is it right.

Nothing is told but the scene file: no null recording, no calibration. `cases` says what was
planted, and what is off besides, `told` what counts as right. What is solved and answered is kept
in a folder, so that a study that was ended goes on where it was. After a change of the bodies, the
recorder or the detector, delete that folder, or of it what would be another.
"""

from pathlib import Path

from arm_brachy.core.paths import run_dir
from arm_brachy.experiments.csv_files import write_recording
from arm_brachy.experiments.half_cylinder.bodies import load_beyond, load_rays, solve_all
from arm_brachy.experiments.half_cylinder.cases import BESIDE, CASES
from arm_brachy.experiments.half_cylinder.recorder import FORMATS, Recorder
from arm_brachy.experiments.half_cylinder.scene import write_scene
from arm_brachy.experiments.laboratory import answer, answered

NAME = 'half-cylinder'
SEED = 0


def reproduce(out_dir, folder=None, cases=CASES):
    """Solve, record, import and diagnose every case; write half-cylinder.json into `out_dir`.

    folder : keeps states/, recordings/ (CSV), answers/ (JSON and a page each); default
        half-cylinder/ among the runs;  cases : cases.Case each
    Returns evaluation.result.Result, a row per case. No goals are set. Raises NotConverged if a
    state of a body cannot be solved.
    """
    folder = run_dir() / NAME if folder is None else Path(folder)
    solve_all(folder / 'states', {case.body for case in cases})
    result = answered(NAME, SEED, cases, folder, answer_one, beside=BESIDE)
    result.to_json(Path(out_dir) / f'{NAME}.json')
    return result


def record(case, folder):
    """Write the scene file and the CSV files of a case; returns (scene, column map), paths."""
    place, states = folder / 'recordings' / case.name, folder / 'states'
    recorder = Recorder(load_rays(states, case.body), case.setup, SEED, case.name,
                        beyond=load_beyond(states, case.body))
    columns = write_recording(recorder.record(), place, case.name, FORMATS)
    write_scene(place / 'scene.yaml')
    return place / 'scene.yaml', columns


def answer_one(case, folder):
    """Record and diagnose a case whose states are in `folder`; leaves its answer there."""
    scene, columns = record(case, folder)
    answer(case, folder, scene, columns, SEED)
