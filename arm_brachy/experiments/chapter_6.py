"""Scenarios I to IV of chapter 6 side by side: two strategies, with and without overlay.

A fifth row is scenario III with the spherical scissor linkage of appendix A in place of the Panda,
which the thesis proposed and did not try.

The thesis had five persons insert a needle and asked them how hard it was (NASA-TLX, Fig. 6.7).
No person takes part here. What a person would have used is scored instead: is the tip in the
picture, how well can it be found there, how far is it off the path, how hard does the probe press.
The person who steers by the overlay is control.overlay_reader; without the overlay nobody steers.
The thesis has no manual baseline, and there is none here.
Test: experiments/test_chapter_6.py
"""

from pathlib import Path

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.evaluation.assess import assess
from arm_brachy.evaluation.procedure_metrics import procedure_row, procedure_targets
from arm_brachy.evaluation.report import write_report
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.inprocess import run
from arm_brachy.scenario import load_cell

NAME = 'chapter-6'
SCENARIOS = {'I': 'probe_I', 'II': 'probe_II', 'III': 'probe_III', 'IV': 'probe_IV'}
LINKAGE = {'III on the linkage': 'probe_scissor'}
# mm, targeting error of a probe kept on the tip of a steered needle, Vrooijink et al., IJRR 2014
PUBLISHED = '0.86 +- 0.35'


def reproduce(out_dir, scenarios=None):
    """Run every scenario in this process; report_<scenario>.html receives its report.

    out_dir : folder;  scenarios : name -> file in config/scenarios, without suffix, or a path;
        None = all five
    Returns Result, a row for each scenario.
    """
    rows, targets, seed = [], [], 0
    for name, file in ({**SCENARIOS, **LINKAGE} if scenarios is None else scenarios).items():
        path = Path(file) if str(file).endswith('.yaml') else (
            config_dir() / 'scenarios' / f'{file}.yaml')
        cell = load_cell(path)
        data = run(cell, sensors=('optical', 'force'))
        numbers = assess(data)
        write_report(data, numbers, Path(out_dir) / f'report_{name.replace(" ", "_")}.html')
        seed = cell.scenario.seed
        rows.append({'scenario': name, 'holder': cell.scenario.probe.probe_holder,
                     'strategy': data.procedure.strategy, 'overlay': data.procedure.overlay,
                     **procedure_row(numbers.procedure),
                     'published_tip_to_target_mm': PUBLISHED})
        targets += [Target(f'{name}: {goal.name}', goal.value, goal.unit, goal.goal, goal.met)
                    for goal in procedure_targets(numbers.procedure)]
    return Result(NAME, seed, commit_of(share_dir()), machine_description(), tuple(rows),
                  tuple(targets))
