"""What the pads did before: a gap that fills while one pushes has a past, a wrong law has none."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.constitutive_error import SPILL, past_errors
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.report.localisation import places_of_test
from arm_brachy.diagnosis.selection.misfit_tests import in_directions, structured_tests
from arm_brachy.diagnosis.selection.pooled_misfit_tests import Past
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.misfit_scan import scan
from arm_brachy.tissue.newton import StaticSolver

FILL, LEAK = 6.0, 25.0      # s
STIFFENING = {'name': 'strain_stiffening', 'ratio': 3.0}


@pytest.fixture(scope='module')
def thrice(pushes):
    """Path of one pad, pushed three times, and of another between; they stand for 5 s."""
    first, second = (1, 0, 0, 0), (0, 1, 0, 0)
    return pushes((first, 6e-3, 20e-3), (second, 6e-3, 20e-3), (first, 6e-3, 20e-3),
                  (first, 6e-3, 20e-3), stand=5.0)


def with_gap(path, width):
    """The Path of the tissue under the first pad: air fills a gap of `width` [m] as it pushes."""
    t, q, gap = path.t, path.q.copy(), 0.0
    for k in range(1, len(t)):
        pushed = path.q[k, 0] / 6e-3
        gap += (t[k] - t[k - 1]) * (pushed * (1.0 - gap) / FILL - (1.0 - pushed) * gap / LEAK)
        q[k, 0] -= width * gap * pushed
    return Path(t, q)


def scanned(matched):
    """(misfit_scan.Scan, labels) of a Matched without any cause."""
    columns, labels = structured_tests([matched])
    return scan(matched.U, matched.r, columns, np.random.default_rng(3),
                together=in_directions(labels)), labels


def largest(found, labels, *, past):
    """Largest |z| among the tests of single channels, or of what follows pushes of the past."""
    return max(abs(z) for z, label in zip(found.z, labels, strict=True)
               if (isinstance(label, Past) and label.pad != '') is past)


def test_a_gap_that_fills_shows_as_the_past_of_its_pad(breast, thrice):
    recorded = breast.record(with_gap(thrice, 0.2e-3))
    encoder = breast.record(thrice).streams[ENCODER]
    matched = breast.beside(replace(recorded, streams=recorded.streams | {ENCODER: encoder}))
    found, labels = scanned(matched)
    worst = labels[found.worst]
    assert found.chance < 1e-3 and isinstance(worst, Past)
    assert worst.pad == 'pad_1' and worst.history.startswith('memory')
    pad = breast.specimen.scene.pads[0]
    assert worst.moved == 'pad_1' or np.linalg.norm(np.subtract(worst.centre, pad.centre)) < 0.03
    assert any(place.actuator == 'pad_1' for place in places_of_test(worst))
    assert 'of the pushes of pad_1' in worst.said


WARM = 8.0          # s in which a motor cools


def bent_aside(breast, path, bend):
    """Evidence of pads along a Path, the first one `bend` (3,) [m] aside as its motor warms."""
    model = ForwardModel(breast.specimen)
    solver, gone = StaticSolver(model.body), np.abs(np.diff(path.q[:, 0], prepend=0.0)) / 6e-3
    x, warmth, shown = model.body.mesh.nodes, 0.0, {OPTICAL: [], FORCE: []}
    for t, q, work in zip(np.diff(path.t, prepend=0.0), path.q, gone, strict=True):
        warmth = warmth * np.exp(-t / WARM) + work
        pads = q[:, None] * model.directions
        pads[0] += warmth * np.asarray(bend)
        found = solver.follow(x, solver.held_positions(pads))
        assert found.outcome.ok
        x = found.x
        points = model.attached.points(x, pads, np.zeros(3))
        shown[OPTICAL].append(points[:len(breast.specimen.markers)])
        shown[FORCE].append(found.pad_force)
    plain, recorded = breast.run(path, path.t), breast.record(path)
    changed = {}
    for kind, values in shown.items():
        stream = recorded.streams[kind]
        every = breast.specimen.markers if kind == OPTICAL else breast.specimen.pads
        more = np.stack(values) - plain.get(kind)
        changed[kind] = replace(stream, values=stream.values
                                + more[:, [every.index(name) for name in stream.names]])
    return replace(recorded, streams=recorded.streams | changed)


@pytest.mark.validate
def test_an_arm_that_bends_as_its_motor_warms_shows_as_its_pad_aside(breast, thrice):
    """By tissue and forces alone: no marker on the pad."""
    fine = np.union1d(thrice.t, np.arange(thrice.t[0], thrice.t[-1], 0.5))
    path = Path(fine, thrice.at(fine))
    across = np.cross(ForwardModel(breast.specimen).directions[0], (0.0, 0.0, 1.0))
    matched = breast.beside(bent_aside(breast, path, 0.15e-3 * across / np.linalg.norm(across)))
    found, labels = scanned(matched)
    worst = labels[found.worst]
    assert found.chance < 1e-3 and isinstance(worst, Past)
    assert worst.aside and (worst.moved, worst.pad) == ('pad_1', 'pad_1')
    assert worst.history.endswith('of the work')
    assert 'pad_1 takes the tissue aside' in worst.said


def test_a_seal_that_rubs_shows_in_what_its_force_sensor_reads(breast, thrice):
    """Between sensor and pad; the tissue knows nothing of it (Dahl 1968; turned in 0.1 mm)."""
    recorded, friction = breast.record(thrice), [0.0]
    for step in np.diff(thrice.q[:, 0]):
        way = np.sign(step)
        friction.append(way + (friction[-1] - way) * np.exp(-abs(step) / 1e-4))
    force = recorded.streams[FORCE]
    values, pad = force.values.copy(), force.names.index('pad_1')
    values[:, pad] -= 0.1 * np.interp(force.t, thrice.t, friction)[:, None] * (
        ForwardModel(breast.specimen).directions[0])
    matched = breast.beside(replace(recorded, streams=recorded.streams | {
        FORCE: replace(force, values=values)}))
    found, labels = scanned(matched)
    worst = labels[found.worst]
    assert found.chance < 1e-3 and isinstance(worst, Past)
    assert worst.sensor == worst.pad == 'pad_1'
    assert [(p.stream, p.channel) for p in places_of_test(worst)] == [(FORCE, 'pad_1')]
    assert 'the force sensor of pad_1 reads' in worst.said


def test_where_nothing_is_missing_no_past_stands_out(breast, thrice):
    found, labels = scanned(breast.watch(thrice))
    assert found.chance > 0.05


def test_a_law_that_is_wrong_has_no_past(breast, thrice):
    """Axes of force sensors are known: what they leave open takes of the present alone."""
    known = replace(Calibration(), sensor_axes=0.0)
    found, labels = scanned(breast.watch(thrice, STIFFENING, calibration=known))
    assert largest(found, labels, past=False) > 6.0
    assert largest(found, labels, past=True) < 0.5 * largest(found, labels, past=False)


def test_tests_keep_their_numbers_where_only_some_states_are_looked_at(breast, thrice):
    """A test is known by its number, in a full fit as in all."""
    matched = breast.watch(thrice)
    some = np.arange(0, len(matched.recorded.states.t), 3)
    whole, labels = structured_tests([matched])
    part, same = structured_tests([matched], [(matched.observables.at(some), some)])
    assert same == labels and part.shape[1] == whole.shape[1] == len(labels)


def test_a_law_may_be_wrong_by_as_much_of_a_past_as_its_effect_has():
    rng = np.random.default_rng(5)
    tests = np.linalg.qr(rng.normal(size=(200, 4)))[0]
    size = 0.1 * tests[:, 2]
    np.testing.assert_allclose(past_errors(tests, size)[:, 2], np.hypot(1.0, SPILL) * size,
                               rtol=1e-6)
    apart = rng.normal(size=200)
    apart -= tests @ (tests.T @ apart)
    np.testing.assert_allclose(np.linalg.norm(past_errors(tests, apart), axis=0),
                               SPILL * np.linalg.norm(apart), rtol=1e-6)


def test_a_hundred_tests_that_show_the_same_allow_no_more_than_one():
    rng = np.random.default_rng(6)
    one = rng.normal(size=(200, 1))
    alone, size = past_errors(one, 0.1 * one[:, 0]), 0.1 * one[:, 0]
    together = past_errors(np.tile(one, (1, 100)) * rng.uniform(0.5, 2.0, 100), size)
    np.testing.assert_allclose(together @ together.T, alone @ alone.T, atol=1e-6)
