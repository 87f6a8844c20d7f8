"""Every scenario that is shipped, and every kind that `diagnose` writes, runs."""

from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.control.moves import Move, PadTarget
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.quantity import quantities
from arm_brachy.core.scene import MeshFile
from arm_brachy.diagnosis.report.answer import Diagnosis, Provenance
from arm_brachy.diagnosis.report.corrected_scenario import base_scenario, write_corrected
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.registry import TERMS
from arm_brachy.scenario import Overlay, load_cell

# probe_I to IV are procedure.yaml with another strategy: experiments/test_chapter_6.py.
SHIPPED = sorted(path for path in (config_dir() / 'scenarios').glob('*.yaml')
                 if path.stem not in ('probe_I', 'probe_II', 'probe_III', 'probe_IV'))
LASTS = 2.0     # s, simulated
TOGETHER = 6    # causes in one scenario
# As beam_gravity; as closed_loop/test_procedure.py, and probe_scissor: for `make validate`.
ALIKE = ('beam_load52', 'procedure')
# The estimator does not know that the body breathes, and takes it for a load on the skin.
SAID = {'probe_breathing': {Outcome.UNKNOWN_LOAD.name}}
SCENES = config_dir() / 'scenes'
COARSE = Overlay(mesh=MeshFile(str(SCENES / 'breast' / 'breast_600.msh')), element='linear')
PUSH = Move('push', 10e-3, (PadTarget('pad_1', 2e-3),), hold=0.3)
SOURCE = Provenance('all', 0, 'none', 'none', 'breast.yaml', ())


def play(path):
    """(time reached [s], RunData) of LASTS seconds of a scenario, all sensors on."""
    loop = inprocess.InProcess(load_cell(path), inprocess.SENSORS)
    while loop.t < LASTS - 1e-9 and not loop.finished:
        loop.tick()
    return loop.t, loop.data()


def refused(data):
    """Outcomes other than that the pads stand because nobody has said RUN yet."""
    return [one for one in data.outcomes if one.outcome not in (Outcome.OK.name,
                                                                Outcome.HELD.name)]


@pytest.mark.parametrize('path', [
    pytest.param(path, marks=pytest.mark.validate) if path.stem in ALIKE else path
    for path in SHIPPED], ids=lambda path: path.stem)
def test_a_shipped_scenario_runs(path):
    reached, data = play(path)
    assert reached == pytest.approx(LASTS)
    assert {one.outcome for one in refused(data)} == SAID.get(path.stem, set())
    cell = load_cell(path)
    seen = (data.optical is not None and data.optical.visible.any()) or any(
        len(samples.tracked()) for samples in data.em.values())
    assert seen
    if not cell.scene.pads:     # let go, it falls
        way = data.optical.points - data.optical.points[0]
        assert cell.scenario.release < LASTS and np.nanmax(abs(way)) > 1e-3


def test_there_are_scenarios_of_all_kinds():
    cells = [load_cell(path) for path in SHIPPED]
    assert any(not c.scene.pads for c in cells) and any(c.scenario.moves for c in cells)
    assert any(c.scenario.tasks for c in cells)


def cause(cls):
    """A Cause of a term with its defaults."""
    infos, estimates = quantities(cls), {}
    for f in fields(cls):
        if f.name in infos and f.default is not MISSING and f.default is not None:
            estimates[f.name] = Estimate(f.default, f.default, f.default)
    return Cause(cls.spec.name, estimates)


GROUPS = [TERMS[i:i + TOGETHER] for i in range(0, len(TERMS), TOGETHER)]


@pytest.mark.parametrize('group', GROUPS, ids=lambda group: group[0].spec.name)
def test_a_corrected_scenario_of_every_term_runs(group, tmp_path):
    causes = tuple(cause(cls) for cls in group)
    found = Diagnosis('named', SOURCE, causes, recalibrated={'E': Estimate(6e3, 5e3, 7e3)})
    base = replace(base_scenario(SCENES / 'breast.yaml', 'all', 7, (PUSH,)), settle=0.2,
                   model=COARSE)
    path = write_corrected(found, base, tmp_path / 'corrected.yaml')
    assert len(load_cell(path).plant_terms) == len(group)
    reached, data = play(path)
    assert reached > 1.0 and not refused(data)
    assert data.pad_displacement.values[:, 0].max() > 1.0e-3
