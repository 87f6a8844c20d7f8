"""Where something is left that nothing explains."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.estimation.parameters import Chart, Space
from arm_brachy.diagnosis.likelihood.observation import Row
from arm_brachy.diagnosis.report.conclusions import places_of, unexplained
from arm_brachy.diagnosis.report.localisation import radius_of
from arm_brachy.diagnosis.selection.pooled_misfit_tests import Past
from arm_brachy.tissue.terms.reference_shape import ReferenceShape

MARKERS, ROWS = ('left', 'right', 'top'), 60


def test_only_markers_that_show_more_than_noise_say_where(monkeypatch):
    """A force alone is off: markers at their noise are no place. One of them as well: it is."""
    monkeypatch.setattr('arm_brachy.diagnosis.report.conclusions._times',
                        lambda assembly, values: ())
    assembly, noise = made_up(), np.random.default_rng(3).normal(size=ROWS * len(MARKERS))
    places, _ = unexplained(assembly, 0, noise)
    assert [(p.stream, p.channel) for p in places] == [('force', 'pad_1')]
    loud = noise + 3.0 * (np.arange(len(noise)) < ROWS)
    _, around = unexplained(assembly, 0, loud)[0]
    assert np.allclose(around.position, (-0.05, 0.0, 0.02))


def test_a_channel_says_when_in_the_recordings_that_have_it(monkeypatch):
    monkeypatch.setattr('arm_brachy.diagnosis.report.conclusions._times',
                        lambda assembly, values: values)
    assembly = made_up()
    other = SimpleNamespace(r=np.zeros(5), observables=SimpleNamespace(
        rows=[Row('force', 'pad_1', axis=2, state=k) for k in range(5)]))
    assembly.matched = (*assembly.matched, other)
    _, when = unexplained(assembly, 0, np.ones(ROWS * len(MARKERS) + 5))
    assert not when[:-5].any()
    assert when[-5:] == pytest.approx(np.sqrt([3.0, 4.0, 5.0, 4.0, 3.0]))   # sums of five, of ones


def test_a_drift_too_faint_for_any_state_says_when_it_began(monkeypatch):
    """0.9 sd in each of three axes from the 40th of 60 states on; noise alone is as large."""
    monkeypatch.setattr('arm_brachy.diagnosis.report.conclusions._times',
                        lambda assembly, values: values)
    assembly = made_up()
    rows = [Row('force', 'pad_1', axis=axis, state=k) for axis in range(3) for k in range(ROWS)]
    assembly.matched[0].observables.rows = rows
    late = np.tile(np.arange(ROWS) >= 40, 3)
    values = np.random.default_rng(5).normal(size=len(rows)) + 0.9 * late
    _, when = unexplained(assembly, 0, values)
    shown = np.sqrt(np.mean(np.square(when.reshape(3, ROWS)), axis=0))
    assert np.all(np.flatnonzero(shown > 0.6 * shown.max()) >= 37)
    assert shown[45:].min() > 0.3 * shown.max()


def test_a_past_says_when_what_is_left_does_as_it_has_it(monkeypatch):
    """Its column is as large at rest, where nothing is left but noise."""
    monkeypatch.setattr('arm_brachy.diagnosis.report.conclusions._times',
                        lambda assembly, values: values)
    assembly = made_up()
    column = np.where(np.arange(ROWS) < 30, -1.0, 1.0)
    assembly.tests = (Past('maximum', 'pad_1', 'pad_1'),)
    assembly.problem = SimpleNamespace(tests=column[:, None])
    late = np.arange(ROWS) >= 50
    left = 0.3 * np.random.default_rng(4).normal(size=ROWS) - 3.0 * late
    _, when = unexplained(assembly, 0, left)
    assert np.array_equal(when > 0.6 * when.max(), late)


def test_when_is_told_of_no_null_recording(monkeypatch):
    """Both are off by as much in their second state; in one of them nothing is wrong."""
    monkeypatch.setattr('arm_brachy.diagnosis.report.conclusions.intervals',
                        lambda m, size: (m.name, *size))
    suspect, null = (SimpleNamespace(
        name=name, r=np.zeros(3), observables=SimpleNamespace(
            states=np.arange(3), rows=[Row('force', 'pad_1', axis=2, state=k) for k in range(3)]),
        recorded=SimpleNamespace(states=SimpleNamespace(t=np.arange(3.0))),
        baseline=made_up().matched[0].baseline) for name in ('suspect', 'null'))
    assembly = SimpleNamespace(matched=(suspect, null), sound=1,
                               tests=((('force', 'pad_1', 2), 'rest'),))
    _, when = unexplained(assembly, 0, np.tile([0.0, 5.0, 0.0], 2))
    assert when == ('suspect', 0.0, 5.0, 0.0)


def test_the_region_of_a_place_holds_what_the_law_may_have_wrong():
    one, millimetre = np.ones(3), 1e-3
    chart = Chart(0, 'bump_centre', tuple, np.zeros(3), millimetre * one, one, one, one, one, one)
    narrow, wide = np.diag([9.0, 1.0, 1.0]), np.diag([9.0, 16.0, 1.0])
    refit = SimpleNamespace(space=Space(((ReferenceShape, {}),), (chart,)), z=np.zeros(3),
                            covariance=narrow)
    fitted = SimpleNamespace(refit=refit, terms=(ReferenceShape(bump_height=1e-3),),
                             covariance=wide)
    place, = places_of(fitted, scene=None)
    assert np.isclose(place.radius, radius_of(millimetre**2 * wide))
    assert place.radius > 1.3 * radius_of(millimetre**2 * narrow)


def made_up():
    """What `unexplained` reads of an assembly: three markers and the pad force that stands out."""
    rows = [Row('optical', name, axis=0, state=k) for name in MARKERS for k in range(ROWS)]
    at = ((-0.05, 0.0, 0.02), (0.05, 0.0, 0.02), (0.0, 0.0, 0.06))
    scene = SimpleNamespace(markers=[SimpleNamespace(name=n, position=x)
                                     for n, x in zip(MARKERS, at, strict=True)])
    model = SimpleNamespace(specimen=SimpleNamespace(scene=scene))
    matched = SimpleNamespace(observables=SimpleNamespace(rows=rows), r=np.zeros(len(rows)),
                              baseline=SimpleNamespace(model=model))
    return SimpleNamespace(matched=(matched,), tests=((('force', 'pad_1', 2), 'rest'),))
