"""A pad that turns as it goes: seen by the tissue around it and by what its sensor feels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.report.localisation import places_of_test
from arm_brachy.diagnosis.selection.misfit_tests import in_directions, structured_tests
from arm_brachy.diagnosis.selection.pad_rotation_tests import Turn
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.misfit_scan import scan
from arm_brachy.tissue.newton import StaticSolver

ROCKS = np.deg2rad(2.0) / 6e-3      # rad/m of push


@pytest.fixture(scope='module')
def twice(pushes):
    """Path of the first pad and of the second, pushed twice each."""
    both = ((1, 0, 0, 0), 6e-3, 20e-3), ((0, 1, 0, 0), 6e-3, 20e-3)
    return pushes(*both, *both, stand=3.0)


def rocking(breast, path, rate):
    """Shown kind -> (n, c, 3) along a Path whose first pad turns by rate (3,) [rad/m] of push."""
    model = ForwardModel(breast.specimen)
    solver, pad, x = StaticSolver(model.body), model.body.pads[0], model.body.mesh.nodes
    shown = {OPTICAL: [], FORCE: []}
    for q in path.q:
        pads = q[:, None] * model.directions
        held = solver.held_positions(pads)
        centre, turn = pad.centre + pads[0], Rotation.from_rotvec(q[0] * np.asarray(rate))
        held[pad.nodes] = centre + turn.apply(held[pad.nodes] - centre)
        found = solver.solve_held(x, held)
        assert found.outcome.ok
        x = found.x
        shown[OPTICAL].append(
            model.attached.points(x, pads, np.zeros(3))[:len(breast.specimen.markers)])
        shown[FORCE].append(found.pad_force)
    return {kind: np.stack(values) for kind, values in shown.items()}


def with_rocking(breast, path, rate):
    """Evidence of a pad that rocks, of markers on the tissue and of forces."""
    plain, recorded = breast.run(path, path.t), breast.record(path)
    names = {OPTICAL: breast.specimen.markers, FORCE: breast.specimen.pads}
    changed = {}
    for kind, values in rocking(breast, path, rate).items():
        stream, more = recorded.streams[kind], values - plain.get(kind)
        kept = [names[kind].index(name) for name in stream.names]
        changed[kind] = replace(stream, values=stream.values + more[:, kept])
    return replace(recorded, streams=recorded.streams | changed)


def test_what_a_turn_does_is_the_derivative_of_states_with_the_pad_turned(breast, twice):
    matched = breast.beside(breast.record(twice))
    baseline = matched.baseline
    k = int(np.argmax(baseline.path.at(baseline.t)[:, 0]))
    path = type(twice)(np.array([0.0, 1.0]), baseline.path.at(baseline.t[k:k + 1]).repeat(2, 0))
    rate, push = np.array([0.2, -0.5, 0.3]), path.q[0, 0]
    size = 1e-3 / push
    up, down = (rocking(breast, path, sign * size * rate) for sign in (1.0, -1.0))
    turns = np.zeros((len(breast.specimen.pads), 3))
    turns[0] = push * rate
    found = baseline.pads_turned(k, turns)
    tissue = np.array(breast.specimen.carriers) == 'tissue'
    for kind, rows in ((OPTICAL, tissue), (FORCE, slice(None))):
        expected = ((up[kind] - down[kind]) / (2.0 * size))[0][rows]
        np.testing.assert_allclose(found[kind][rows], expected, rtol=0.0,
                                   atol=5e-3 * np.abs(expected).max())


def test_a_pad_that_rocks_shows_as_its_turn(breast, twice):
    along = ForwardModel(breast.specimen).directions[0]
    across = np.cross(along, (0.0, 0.0, 1.0))
    matched = breast.beside(with_rocking(breast, twice, ROCKS * across / np.linalg.norm(across)))
    columns, labels = structured_tests([matched])
    found = scan(matched.U, matched.r, columns, np.random.default_rng(3),
                 together=in_directions(labels))
    worst = labels[found.worst]
    assert found.chance < 1e-3 and isinstance(worst, Turn) and worst.pad == 'pad_1'
    assert [place.actuator for place in places_of_test(worst)] == ['pad_1']
    assert 'pad_1 turned as it goes' in worst.said


def test_the_turn_of_a_pad_that_never_moves_is_not_asked(breast, twice):
    _, labels = structured_tests([breast.watch(twice)])
    assert {label.pad for label in labels if isinstance(label, Turn)} == {'pad_1', 'pad_2'}
