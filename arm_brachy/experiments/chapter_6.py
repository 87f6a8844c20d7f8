"""Scenarios I to IV of chapter 6 side by side: two strategies, with and without overlay.

A fifth row is scenario III with the spherical scissor linkage of appendix A in place of the Panda,
which the thesis proposed and did not try.

The thesis had five persons insert a needle and asked them how hard it was (NASA-TLX, Fig. 6.7).
No person takes part here. What a person would have used is scored instead: is the tip in the
picture, how well can it be found there, how far is it off the path, how hard does the probe press.
The person who steers by the overlay is control.overlay_reader; without the overlay nobody steers.
The thesis has no manual baseline, and there is none here.

Each scenario is run with the same few needles. They go through different columns of the template,
to different sides of the target; the plan takes the row. They bend more or less than the plan
takes them to: radii are drawn about the geometric mean of the 200 to 650 mm that are published,
nineteen in twenty within these.
A run without overlay is one with it until somebody turns the needle; where nobody has, the run
with overlay counts for both. The linkage has the first needle alone.
Test: experiments/test_chapter_6.py
"""

from dataclasses import dataclass, replace
from pathlib import Path

from arm_brachy import cell as cells
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.evaluation.assess import assess
from arm_brachy.evaluation.procedure_metrics import procedure_row, procedure_targets
from arm_brachy.evaluation.report import write_report
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.inprocess import run
from arm_brachy.scenario import load_cell

NAME = 'chapter-6'
SCENARIOS = {'I': 'probe_I', 'II': 'probe_II', 'III': 'probe_III', 'IV': 'probe_IV'}
LINKAGE = {'III on the linkage': 'probe_scissor'}
WITH_OVERLAY = {'II': 'I', 'IV': 'III'}     # the scenario that differs in the overlay alone
# mm, targeting error of a probe kept on the tip of a steered needle, Vrooijink et al., IJRR 2014
PUBLISHED = '0.86 +- 0.35'
RADIUS = 0.360       # m that the plan takes the needle's arc to have
SPREAD = 0.3         # of its logarithm, from needle to needle
COLUMNS = (7, 5, 8)  # of the template, for needle 1, 2 and so on: pads move 4 to 7 mm


@dataclass(frozen=True)
class Trial:
    """One run: scenario, its file in config/scenarios without suffix or a path, needle from 1."""

    scenario: str
    file: str
    needle: int

    @property
    def cell(self):
        """The scenario.Cell with this needle; what is drawn, its noise too, is of its own seed."""
        path = Path(self.file) if str(self.file).endswith('.yaml') else (
            config_dir() / 'scenarios' / f'{self.file}.yaml')
        found = load_cell(path)
        scenario = found.scenario
        needle = replace(scenario.needle, radius_spread=SPREAD,
                         needle=replace(scenario.needle.needle, radius=RADIUS))
        procedure = replace(scenario.procedure, hole=COLUMNS[self.needle - 1:self.needle])
        return replace(found, scenario=replace(scenario, seed=scenario.seed + self.needle - 1,
                                               needle=needle, procedure=procedure))


def reproduce(out_dir, scenarios=None, needles=None):
    """Run every scenario with every needle; report_<scenario>_<needle>.html receives its report.

    out_dir : folder;  scenarios : name -> file in config/scenarios, without suffix, or a path;
        None = all five
    needles : how many, None = one for each of COLUMNS; the linkage has one
    Returns Result, a row for each scenario and needle.
    """
    files = {**SCENARIOS, **LINKAGE} if scenarios is None else scenarios
    trials = [Trial(name, file, k + 1) for name, file in files.items()
              for k in range(1 if name in LINKAGE else needles or len(COLUMNS))]
    first = [trial for trial in trials if WITH_OVERLAY.get(trial.scenario) not in files]
    with process_pool(len(trials)) as pool:
        done = dict(zip(first, pool.map(_run, first, [out_dir] * len(first)), strict=True))
        rest = [trial for trial in trials if trial not in done]
        turned = [trial for trial in rest if _seen(trial, done)[0]['turns'] > 0]
        done |= zip(turned, pool.map(_run, turned, [out_dir] * len(turned)), strict=True)
    rows, targets = [], []
    for trial in trials:
        row, goals = done.get(trial) or _unseen(trial, done)
        rows.append(row)
        targets += [replace(goal, name=f'{trial.scenario}, needle {trial.needle}: {goal.name}')
                    for goal in goals]
    return Result(NAME, trials[0].cell.scenario.seed, commit_of(share_dir()),
                  machine_description(), tuple(rows), tuple(targets))


def _run(trial, out_dir):
    """(row, targets) of a trial."""
    cell = trial.cell
    data = run(cell, sensors=('optical', 'force'))
    numbers = assess(data)
    name = f'{trial.scenario} {trial.needle}'.replace(' ', '_')
    write_report(data, numbers, Path(out_dir) / f'report_{name}.html')
    row = {'scenario': trial.scenario, 'needle': trial.needle, 'seed': cell.scenario.seed,
           'hole': data.procedure.plan.get('hole', ''),
           'radius_mm': float(1e3 * cells.build_needle(cell).true_radius),
           'holder': cell.scenario.probe.probe_holder, 'strategy': data.procedure.strategy,
           'overlay': data.procedure.overlay, 'run_as': trial.scenario,
           **procedure_row(numbers.procedure), 'published_tip_to_target_mm': PUBLISHED}
    return row, procedure_targets(numbers.procedure)


def _seen(trial, done):
    """(row, targets) of the same needle with the overlay."""
    with_it = WITH_OVERLAY[trial.scenario], trial.needle
    return next(found for other, found in done.items()
                if (other.scenario, other.needle) == with_it)


def _unseen(trial, done):
    """(row, targets) of a trial without overlay whose needle nobody turned with it."""
    row, goals = _seen(trial, done)
    return {**row, 'scenario': trial.scenario, 'overlay': False}, goals
