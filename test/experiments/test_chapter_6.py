"""Scenarios I to IV and that of the linkage differ in what they say, and in nothing else."""

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

from arm_brachy import cell as cells
from arm_brachy.core.paths import config_dir
from arm_brachy.evaluation.result import Target
from arm_brachy.experiments import chapter_6
from arm_brachy.scenario import load_cell


def test_the_four_scenarios_differ_in_strategy_and_overlay_alone():
    cells = {name: load_cell(config_dir() / 'scenarios' / f'{file}.yaml').scenario
             for name, file in chapter_6.SCENARIOS.items()}
    kinds = {name: (s.probe.strategy, s.procedure.overlay) for name, s in cells.items()}
    assert kinds == {'I': ('translational', True), 'II': ('translational', False),
                     'III': ('orientation', True), 'IV': ('orientation', False)}
    first = cells['I']
    cells['procedure'] = load_cell(config_dir() / 'scenarios' / 'procedure.yaml').scenario
    for scenario in cells.values():
        alike = replace(scenario, name=first.name, description=first.description,
                        probe=first.probe, procedure=first.procedure)
        assert alike == first
        assert replace(scenario.probe, strategy='translational') == first.probe
        assert replace(scenario.procedure, overlay=True) == first.procedure


def test_the_scenario_of_the_linkage_is_the_third_with_another_holder():
    panda, linkage = (load_cell(config_dir() / 'scenarios' / f'{file}.yaml').scenario
                      for file in ('probe_III', chapter_6.LINKAGE['III on the linkage']))
    assert linkage.probe.probe_holder == 'scissor_rcm'
    assert replace(linkage.probe, probe_holder='panda') == panda.probe
    assert replace(linkage, name=panda.name, description=panda.description,
                   probe=panda.probe) == panda


def test_the_needles_are_the_same_in_every_scenario_and_bend_as_published():
    files = {**chapter_6.SCENARIOS, **chapter_6.LINKAGE}
    radii = {name: [cells.build_needle(chapter_6.Trial(name, file, k + 1).cell).true_radius
                    for k in range(len(chapter_6.COLUMNS))] for name, file in files.items()}
    assert all(found == radii['I'] for found in radii.values())
    assert len(set(radii['I'])) == len(chapter_6.COLUMNS)
    assert all(0.2 <= radius <= 0.65 for radius in radii['I'])


def test_a_trial_differs_from_its_scenario_in_the_needle_alone():
    plain = load_cell(config_dir() / 'scenarios' / 'probe_III.yaml').scenario
    found = chapter_6.Trial('III', 'probe_III', 2).cell.scenario
    assert (found.seed, found.procedure.hole) == (plain.seed + 1, chapter_6.COLUMNS[1:2])
    assert replace(found, seed=plain.seed, needle=plain.needle, procedure=replace(
        found.procedure, hole=plain.procedure.hole)) == plain


def test_without_overlay_only_needles_that_were_turned_are_run_again(monkeypatch, tmp_path):
    ran = []

    def fake(trial, out_dir):
        ran.append((trial.scenario, trial.needle))
        row = {'scenario': trial.scenario, 'needle': trial.needle, 'run_as': trial.scenario,
               'overlay': trial.scenario == 'I', 'turns': float(trial.needle == 2)}
        return row, [Target('procedure', 'OK', '1', '= OK', True)]

    @contextmanager
    def pool(jobs):
        yield SimpleNamespace(map=map)

    monkeypatch.setattr(chapter_6, '_run', fake)
    monkeypatch.setattr(chapter_6, 'process_pool', pool)
    result = chapter_6.reproduce(tmp_path, {'I': 'probe_I', 'II': 'probe_II'}, needles=2)
    assert ran == [('I', 1), ('I', 2), ('II', 2)]
    assert [(r['scenario'], r['needle'], r['run_as'], r['overlay']) for r in result.rows] == [
        ('I', 1, 'I', True), ('I', 2, 'I', True), ('II', 1, 'I', False), ('II', 2, 'II', False)]
    assert [t.name for t in result.targets][2:] == ['II, needle 1: procedure',
                                                    'II, needle 2: procedure']
