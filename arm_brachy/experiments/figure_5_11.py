"""Figure 5.11: target error against the push in scenario 1, actuator 1 along x."""

from functools import partial

from arm_brachy.experiments import scenario_errors

NAME = 'figure-5.11'
PADS = ('pad_1',)
TITLE = 'Scenario 1: pad 1 pushes along x'

reproduce = partial(scenario_errors.reproduce, NAME, PADS, TITLE)
