"""Scenarios I to IV and that of the linkage differ in what they say, and in nothing else."""

from dataclasses import replace

from arm_brachy.core.paths import config_dir
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
