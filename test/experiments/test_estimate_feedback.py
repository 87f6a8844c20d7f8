"""The loop closed on estimates: what is held to the goal, and the numbers of one task."""

import json

import numpy as np
import pytest

from arm_brachy.experiments import estimate_feedback
from arm_brachy.experiments.estimate_feedback import Run


def runs(worst):
    """Two tasks under two estimators; the second task of each leaves `worst` [m]."""
    return [Run(name, 1, task, 7, error, 1e-3, 2.0, 2e-4, 3e-4, 0.9)
            for name in ('map', 'pod') for task, error in ((1, 1e-4), (2, worst))]


@pytest.mark.parametrize(('worst', 'met'), [(0.4e-3, True), (0.6e-3, False)])
def test_the_chosen_feedback_is_held_to_half_a_millimetre_and_no_other(worst, met):
    targets = {t.name: t for t in estimate_feedback._targets(runs(worst), ('map', 'pod'), 'map')}
    assert targets['map: largest steady-state error'].met is met
    assert targets['map: mean steady-state error'].value == pytest.approx(
        1e3 * (1e-4 + worst) / 2)
    assert {t.met for name, t in targets.items() if name.startswith('pod')} == {None}


def test_a_row_has_units_in_its_keys_and_is_json():
    row = estimate_feedback._flat(runs(0.4e-3)[1])
    assert (row['feedback'], row['target'], row['task']) == ('map', 1, 2)
    assert row['error_mm'] == pytest.approx(0.4) and row['coverage_percent'] == pytest.approx(90.0)
    assert json.loads(json.dumps(row))['claimed_sd_mm'] == pytest.approx(0.3)
    assert np.isnan(row['cpu_s'])
