"""How much of a planted effect is there for the diagnosis to see, and what hides the rest?

Cases of an opened trial are drawn again from its commit and beacon, and what was planted is
played without noise. Lengths in standard deviations tell where it goes: in all samples, beside
calibration (the trial's oracle); at the states that the diagnosis compares, beside nothing; beside
calibration there; beside what the mesh may be wrong by as well; along the structured test that
shows most of it. An effect of no catalogue is noticed by the last alone, any other by the last but
one.

`python -m arm_brachy.prove.what_hides COMMIT CASE... [--folder FOLDER]`, cases of
results/trials/COMMIT, prints a table and writes FOLDER/what-hides.json. A body takes 5 minutes of
a core, a case half a minute.
Test: prove/test_what_hides.py
"""

import argparse
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import run_dir, share_dir
from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.likelihood.observation import channels_of
from arm_brachy.diagnosis.selection.misfit_tests import structured_tests
from arm_brachy.diagnosis.selection.problem import stacked_nuisances
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.linear_gaussian import detectability
from arm_brachy.diagnosis.statistics.misfit_scan import scan
from arm_brachy.evaluation.result import commit_of
from arm_brachy.experiments.blind_trials import HIDES, hidden_lines
from arm_brachy.prove import plan, seal, source
from arm_brachy.prove.answering import ABSOLUTE
from arm_brachy.prove.folder import TrialFolder, read_json, write_json
from arm_brachy.prove.making import make_case, prepare_body
from arm_brachy.prove.rivals import compared
from arm_brachy.prove.signals import Sight

KINDS = {'optical': OPTICAL, 'em': EM, 'forces': FORCE}


@dataclass(frozen=True)
class Visible:
    """Lengths of a planted effect [standard deviations], each of what the one before leaves.

    oracle : of `prove.oracle`, all samples;  at_states : at the states compared, beside nothing
    calibrated : beside nuisances and tolerances;  seen : beside the errors of the mesh as well
    tested : largest z of the structured tests, of the effect without noise
    outcome : of the trial, in its mode absolute if it had one
    """

    case: str
    planted: str
    size: float
    oracle: float
    at_states: float
    calibrated: float
    seen: float
    tested: float
    outcome: str


def opened(commit):
    """(jobs, truths, rows), each by name of the case, of results/trials/COMMIT.

    The rows are those of mode absolute, or beside null recordings where it was not asked for.
    Raises InputError where there is no such trial.
    """
    folder = share_dir() / 'results' / 'trials' / commit
    trial = read_json(folder / 'opened.json')
    if trial is None:
        raise InputError(f'{folder}: no opened.json; must be a trial that was opened; see '
                         'results/trials')
    truths = {name: one['truth'] for name, one in trial['cases'].items()}
    jobs = plan.draw(seal.seed_of(trial['commit'], trial['beacon']), len(truths),
                     trial.get('wishes') or _before(source.WISHES))
    rows = [row for row in read_json(folder / 'result.json')['rows'] if 'case' in row]
    absolute = [row for row in rows if row['mode'] == ABSOLUTE]
    return {job.name: replace(job, **{key: truths[job.name][key] for key in (
        'attempt', 'body_attempt')}) for job in jobs}, truths, {
            row['case']: row for row in absolute or rows}


def _before(wishes):
    """What trials went through that do not say it: all but what joined later."""
    return {kind: [name for name in names if name not in source.JOINED]
            for kind, names in wishes.items()}


def drawn_again(job, truth, folder):
    """The folder of a job's recording, made if it is not in a TrialFolder.

    Raises InputError where the generator of today draws something else.
    """
    name = source.__name__
    prepare_body(name, job, folder)
    sealed = folder / 'sealed' / job.name
    make_case(name, job, folder, sealed, ())
    made = read_json(sealed / 'truth.json')
    if made['effects'] != truth['effects']:
        raise InputError(f'{job.name}: drawn again it has other effects than were opened; must be '
                         'of a trial of this generator; check out its commit')
    return folder.given(job.name)


def at_states(t, names, values, wanted, states):
    """(s, k, 3, 1) of signals (n, c, 3) at times t (n,), named, at `states` (s,) for k wanted."""
    out = np.zeros((len(states), len(wanted), 3, 1))
    for c, name in enumerate(names):
        for axis in range(3):
            out[:, wanted.index(name), axis, 0] = np.interp(states, t, values[:, c, axis])
    return out


def effect_at_states(matched, t, shown):
    """(N, 1) whitened effect in a Matched recording of what a `signals.Sight` has shown.

    t : (n,) [s] of the recording
    """
    channels = channels_of(matched.baseline.model.specimen)
    return matched.observables.whiten({
        KINDS[name]: at_states(t, names, values, channels[KINDS[name]], matched.recorded.states.t)
        for name, (names, values) in shown.items()})


def visible(job, truth, row, folder):
    """The Visible of a job whose truth is known; row : of the trial's result."""
    path = drawn_again(job, truth, folder)
    _, matched = compared(path / 'bag', path / 'scene.yaml')
    t, shown = Sight([job], folder / 'cache').shown(job)
    effect = effect_at_states(matched, t + truth['start_s'], shown)
    (U, names), (tests, _) = stacked_nuisances([matched]), structured_tests([matched])
    found = scan(U, effect[:, 0], tests, np.random.default_rng(0))
    beside = (U[:, ~np.isin(names, NAMES)], U)
    return Visible(job.name, ' + '.join(truth['labels']),
                   float(np.mean([one['size'] for one in truth['effects']])),
                   row['detectability_sd'], float(np.linalg.norm(effect)),
                   *(float(detectability(some, effect)[0]) for some in beside),
                   float(np.abs(found.z).max()), row['outcome'])


def main():
    """Draw cases of a trial again and print what of them is visible."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('commit', help='of the detector: a folder of results/trials')
    parser.add_argument('case', nargs='+', help='case_000 and up, in which something is planted')
    parser.add_argument('--folder', type=Path, default=run_dir() / HIDES,
                        help='of bodies and recordings; default: %(default)s')
    given = parser.parse_args()
    try:
        found = of_cases(given.commit, given.case, given.folder)
    except ArmBrachyError as error:
        parser.error(str(error))
    write_json(given.folder / f'{HIDES}.json', found)
    print(hidden_lines(found))


def of_cases(commit, cases, folder):
    """{'trial', 'commit', 'rows': Visible each} of cases of a trial, in the order asked for.

    Raises InputError for a case that the trial does not have or in which nothing is planted.
    """
    jobs, truths, rows = opened(commit)
    odd = [case for case in cases if case not in jobs or not truths[case]['effects']]
    if odd:
        raise InputError(f'{", ".join(odd)}: must be cases of {commit} in which something is '
                         f'planted, {min(jobs)} to {max(jobs)}; see its opened.json')
    at = TrialFolder((Path(folder) / commit).resolve())
    return {'trial': commit, 'commit': commit_of(share_dir()),
            'rows': [asdict(visible(jobs[case], truths[case], rows[case], at))
                     for case in cases]}


if __name__ == '__main__':
    main()
