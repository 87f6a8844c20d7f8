"""A short procedure on a coarse body, all parts in one process: needle, arm, image, tissue."""

from pathlib import Path

import numpy as np
import pytest

from arm_brachy.evaluation.assess import assess
from arm_brachy.evaluation.procedure_figures import plates
from arm_brachy.evaluation.report import write_report
from arm_brachy.inprocess import run
from arm_brachy.scenario import load_cell

SHORT = Path(__file__).resolve().parent.parent / 'ros' / 'procedure_short.yaml'


@pytest.fixture(scope='module')
def done():
    """What happened in the run, and its numbers."""
    data = run(load_cell(SHORT), sensors=('optical', 'force'))
    return data, assess(data).procedure


def test_it_goes_through_to_the_end(done):
    data, numbers = done
    assert numbers.outcome == 'OK', data.outcomes
    steps = list(dict.fromkeys(said['phase'] for _, said in data.procedure.steps))
    assert steps[0] == 'settling' and steps[-1] == 'finished' and 'dwelling' in steps


def test_the_tip_meets_the_target_and_stays_in_the_image_plane(done):
    """Error of the depth sensor 0.2 mm, of the arc 10 %, of the target's estimate some 0.3 mm."""
    _, numbers = done
    assert numbers.miss < 3e-3
    assert numbers.in_plane > 0.9


def test_the_probe_presses_as_it_should_and_sees_the_tip(done):
    data, numbers = done
    assert numbers.force_rms < 0.3 and numbers.found > 0.5
    window = data.procedure.when('inserting')
    in_contact = data.procedure.state.between(*window).values[:, 1]
    assert np.mean(in_contact) > 0.95


def test_at_the_end_needle_probe_and_pads_are_back(done):
    data, _ = done
    assert data.procedure.needle.values[-1, 0] < 2e-3
    assert data.encoder.values[-1].max() < 0.3e-3
    assert data.procedure.probe.values[-1, 11] > 0.08      # m over the base, at home


def test_every_figure_can_be_drawn(done):
    names = [plate.name for plate in plates(done[0])]
    assert names == ['cell', 'ultrasound', 'tip_over_depth', 'contact_force']


def test_the_report_has_its_numbers(done, tmp_path):
    page = write_report(done[0], assess(done[0]), tmp_path / 'report.html').read_text()
    assert 'tip to target' in page and 'within 0.5 mm of the image plane' in page
