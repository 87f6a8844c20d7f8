"""What a plant's sensors record for the study: nuisances, no truth, what was planted."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.control.moves import Move, PadTarget
from arm_brachy.experiments import diagnosis_recordings as recordings
from arm_brachy.experiments.diagnosis_plan import Nuisance, base_cell, plan

MM = 1e-3
PLAN = plan()


def test_nuisances_are_there_and_within_their_bounds(motion):
    case, most = PLAN[0], Nuisance()
    run = recordings.observe(case, motion)
    scene = base_cell().scene
    rest = np.array([m.position for m in scene.markers])
    off = np.nanmean(run.optical.points, axis=0) - rest
    reach = np.sqrt(3.0) * (most.shift + most.turn * np.linalg.norm(rest, axis=1).max())
    assert 0.02 * MM < np.linalg.norm(off.mean(axis=0)) < reach
    for target in scene.targets:
        shift = np.nanmean(run.em[target.name].position, axis=0) - target.position
        assert np.abs(shift).max() < most.em + 0.05 * MM    # 0.14 mm / sqrt(3 * 160) = 6 um
    zero = run.force.values.mean(axis=0) - [0.0, 0.0, 1.0]
    assert 0.005 < np.abs(zero).max() < most.zero + 0.012   # half a count, and noise
    late = run.optical.t[0] % 0.01
    assert min(late, 0.01 - late) <= most.clock


def test_a_sensing_term_is_what_differs(named, motion):
    """The same seed with and without a slip: the same noise, and one marker 8 mm away."""
    fault = named('marker_slip')
    term = replace(fault.planted.term, onset=2.0, offset=(8 * MM, 0.0, 0.0), marker='tissue_3')
    with_it = recordings.observe(replace(fault, planted=replace(fault.planted, term=term)), motion)
    without = recordings.observe(replace(fault, planted=None), motion)
    moved = np.linalg.norm(with_it.optical.points - without.optical.points, axis=2)
    slipped = with_it.optical.ids.index('tissue_3')
    after = with_it.optical.t > 2.01
    assert np.nanmax(np.delete(moved, slipped, axis=1)) == 0.0
    assert np.nanmax(moved[~after][:-2, slipped]) == 0.0
    seen = moved[after, slipped]
    assert seen[np.isfinite(seen)] == pytest.approx(8 * MM)


def test_a_plant_run_keeps_what_moved(monkeypatch):
    """One short push on a coarse mesh: pads stand where the encoder says, plus what touch adds."""
    base = base_cell()
    push = Move('push', pads=(PadTarget('pad_1', 2 * MM),), speed=20 * MM, hold=0.2, cycles=1)
    short = replace(base, scenario=replace(base.scenario, settle=0.2, moves=(push,)))
    monkeypatch.setattr(recordings, 'base_cell', lambda: short)
    monkeypatch.setattr(recordings, 'PLANT_MESH', '../scenes/breast/breast_600.msh')
    motion = recordings.move(PLAN[0].plant)
    directions = np.array([p.direction for p in base.scene.pads])
    beyond = np.einsum('npi,pi->np', motion.pads, directions) - motion.encoder
    count = base.scenario.actuators.encoder_resolution
    assert beyond == pytest.approx(np.tile(PLAN[0].plant.touch, (len(beyond), 1)), abs=count)
    deepest = motion.encoder[:, 0].argmax()
    assert motion.encoder[deepest, 0] == pytest.approx(2 * MM, abs=count)
    assert motion.force[deepest, 0, 0] - motion.force[0, 0, 0] > 0.3    # pushed back, along +x
