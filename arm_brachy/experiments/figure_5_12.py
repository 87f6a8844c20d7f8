"""Figure 5.12: target error against the push in scenario 2, actuators 1 and 2 at once."""

from functools import partial

from arm_brachy.experiments import scenario_errors

NAME = 'figure-5.12'
PADS = ('pad_1', 'pad_2')
TITLE = 'Scenario 2: pads 1 and 2 push along x and y'

reproduce = partial(scenario_errors.reproduce, NAME, PADS, TITLE)
