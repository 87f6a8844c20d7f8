"""Do the generator and the registry mean the same by an effect?

In the set-up of an opened case every effect of the tissue and of its boundary that comes and goes
with the pads is played at its typical size by the generator, which shares no code with the
registry, and by the registry's term of that name at the same numbers, on the mesh that the user
has. What the two differ by, beside calibration, over what the effect shows there, is the error of
the mesh, or a term that is not what the registry says.

`python -m arm_brachy.prove.alike COMMIT CASE [NAME...] [--folder FOLDER]`, a case of
results/trials/COMMIT, prints a table and writes FOLDER/alike.json. A body takes 5 minutes of a
core, an effect 1.
Test: prove/test_alike.py
"""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import run_dir, share_dir
from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.selection.problem import stacked_nuisances
from arm_brachy.diagnosis.statistics.linear_gaussian import detectability
from arm_brachy.evaluation.result import commit_of
from arm_brachy.experiments.blind_trials import ALIKE, alike_lines
from arm_brachy.prove.folder import TrialFolder, write_json
from arm_brachy.prove.generator import catalogue
from arm_brachy.prove.generator.catalogue import Effect, tidy
from arm_brachy.prove.generator.solver import NotSolved
from arm_brachy.prove.generator.tissue import STATIC
from arm_brachy.prove.rivals import compared
from arm_brachy.prove.signals import Sight
from arm_brachy.prove.what_hides import drawn_again, effect_at_states, opened
from arm_brachy.registry import parse_terms
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

SEED, ATTEMPTS = 3, 5           # of places and directions, drawn anew where nothing balances
PLAYED = tuple(sorted(set(STATIC) - {'stiffness_scale'}))   # that is a nuisance


@dataclass(frozen=True)
class Both:
    """An effect by the generator and by the registry [standard deviations beside calibration].

    planted : length of the generator's;  apart : length of what the two differ by
    """

    effect: str
    planted: float
    apart: float


class Bench:
    """The set-up of a plan.Job whose truth is known. folder : TrialFolder"""

    def __init__(self, job, truth, folder):
        path = drawn_again(job, truth, folder)
        _, self._matched = compared(path / 'bag', path / 'scene.yaml')
        self._job, self._start = job, truth['start_s']
        self._sight = Sight([job], folder / 'cache')
        self.body = self._sight.body(job)
        self._modulus = StiffnessScale(truth['nuisances']['modulus_factor'])
        self._plain = self._shown()
        U, names = stacked_nuisances([self._matched])
        self._U = U[:, ~np.isin(names, NAMES)]

    def both(self, effect):
        """The Both of a catalogue.Effect."""
        t, shown = self._sight.shown(self._job, (effect,))
        planted = effect_at_states(self._matched, t + self._start, shown)
        found = self._shown(*parse_terms([entry(effect)], 'alike'))
        modelled = self._matched.observables.whiten({
            kind: (values - self._plain[kind])[..., None] for kind, values in found.items()})
        lengths = detectability(self._U, np.hstack([planted, planted - modelled]))
        return Both(effect.name, *map(float, lengths))

    def _shown(self, *terms):
        """kind -> (n, c, 3) of the user's model with the true modulus and more terms."""
        m = self._matched
        found = ForwardModel(m.baseline.model.specimen, (self._modulus, *terms)).predict(
            m.recorded.path, m.recorded.states.t)
        return {kind: found.get(kind) for kind in m.baseline.shown}


def entry(effect):
    """A catalogue.Effect as the entry of a scenario."""
    return {'name': effect.name, **{key: list(value) if isinstance(value, tuple) else value
                                    for key, value in effect.values.items()}}


def typical(name, body, attempt=0):
    """The catalogue.Effect of that name at size 1, its place and direction drawn from SEED.

    Raises InputError for what is not PLAYED.
    """
    if name not in PLAYED:
        raise InputError(f'{name}: must be one of {", ".join(PLAYED)}')
    drawn = {key: values for family in catalogue.FAMILIES.values()
             for key, values in family(np.random.default_rng([SEED, attempt]), body,
                                       1.0).items()}
    return Effect(name, {key: tidy(value) for key, value in drawn[name].items()}, 1.0)


def main():
    """Play effects twice in the set-up of an opened case and print how alike they are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('commit', help='of the detector: a folder of results/trials')
    parser.add_argument('case', help='case_000 and up')
    parser.add_argument('name', nargs='*', help=f'of {", ".join(PLAYED)}; default: all')
    parser.add_argument('--folder', type=Path, default=run_dir() / ALIKE,
                        help='of bodies and recordings; default: %(default)s')
    given = parser.parse_args()
    try:
        found = of_case(given.commit, given.case, given.name or PLAYED, given.folder)
    except ArmBrachyError as error:
        parser.error(str(error))
    write_json(given.folder / f'{ALIKE}.json', found)
    print(alike_lines(found))


def of_case(commit, case, names, folder):
    """What is written: the trial, the case, the commit of today, and a row an effect."""
    jobs, truths, _ = opened(commit)
    if case not in jobs:
        raise InputError(f'{case}: must be one of the {len(jobs)} cases of {commit}, '
                         f'{min(jobs)} to {max(jobs)}')
    at = TrialFolder((Path(folder) / commit).resolve())     # of another trial is another body
    bench = Bench(jobs[case], truths[case], at)
    rows = [asdict(_played(bench, name)) for name in names]
    return {'trial': commit, 'case': case, 'commit': commit_of(share_dir()), 'rows': rows}


def _played(bench, name):
    """The Both of an effect at the first of ATTEMPTS places at which the generator has a balance.

    Raises InputError where it has none.
    """
    for attempt in range(ATTEMPTS):
        try:
            return bench.both(typical(name, bench.body, attempt))
        except NotSolved as error:
            refused = error
    raise InputError(f'{name}: no equilibrium at {ATTEMPTS} places ({refused}); must have one; '
                     'leave it out, or take a case with another body')


if __name__ == '__main__':
    main()
