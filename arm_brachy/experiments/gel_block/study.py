"""The gel block's recordings through import and diagnosis: what is said of each, and is it right.

Nothing is told but the scene file: no null recording, no calibration. `cases` says what was
planted, `told` what counts as right. What is solved and answered is kept in a folder, so that a
study that was ended goes on where it was. After a change of the block, the recorder or the
detector, delete that folder, or of it what would be another.
"""

from pathlib import Path

from arm_brachy.core.paths import run_dir
from arm_brachy.experiments.csv_files import FORCES, OPTICAL, write_recording
from arm_brachy.experiments.gel_block.bodies import load_rays, solve_all
from arm_brachy.experiments.gel_block.cases import CASES
from arm_brachy.experiments.gel_block.recorder import FORMATS, Recorder, lateness
from arm_brachy.experiments.gel_block.scene import write_scene
from arm_brachy.experiments.laboratory import answer, answered

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
    result = answered(NAME, SEED, cases, folder, answer_one, truth=truth)
    result.to_json(Path(out_dir) / f'{NAME}.json')
    return result


def record(case, folder):
    """Write the scene file and the CSV files of a case; returns (scene, column map), paths."""
    place = folder / 'recordings' / case.name
    recorder = Recorder(load_rays(folder / 'states', case.body), case.setup, SEED, case.name)
    columns = write_recording(recorder.record(), place, case.name, FORMATS)
    write_scene(place / 'scene.yaml', poor=case.setup.poor)
    return place / 'scene.yaml', columns


def answer_one(case, folder):
    """Record and diagnose a case whose states are in `folder`; leaves its answer there."""
    scene, columns = record(case, folder)
    answer(case, folder, scene, columns, SEED)


def truth(case):
    """Parameters that an answer to a Case should find; a delay includes what the clock is off."""
    if case.term != 'clock_offset':
        return case.truth
    late = lateness(case.setup, SEED, case.name)[DEVICE[case.place['stream']]]
    return {'delay_ms': 1e3 * late}
