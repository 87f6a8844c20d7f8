"""A recording beside what nulls say of its set-up, against all of them together."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.likelihood.match import Matched
from arm_brachy.diagnosis.likelihood.nuisances import Nuisances
from arm_brachy.diagnosis.likelihood.observation import Measured, Observables
from arm_brachy.diagnosis.selection.problem import Assembly, stacked_nuisances
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.linear_gaussian import log_density

CHANNELS = {OPTICAL: ('a', 'b', 'c'), FORCE: ('pad_1',)}
# The first its own; errors of the mesh have one name for many columns.
OURS = ('touch_pad_1', NAMES[0], 'optical_a_x', NAMES[1], 'modulus', NAMES[0], 'scale_scale')
STATES = 6


def matched(rng, sd):
    """A Matched of random numbers; optical markers in another order than the model's."""
    def stream(kind, *names):
        shape = (STATES, len(names), 3)
        return Measured(kind, names, sd * rng.standard_normal(shape),
                        rng.random(shape[:2]) < 0.9, np.full(shape, sd), np.eye(STATES))

    def arrays(*last):
        return {kind: sd * rng.standard_normal((STATES, len(names), 3, *last))
                for kind, names in CHANNELS.items()}
    return Matched(None, SimpleNamespace(shown=arrays()),
                   Observables([stream(OPTICAL, 'c', 'a'), stream(FORCE, 'pad_1')], CHANNELS),
                   Nuisances(OURS, arrays(len(OURS))), arrays())


@pytest.fixture(params=[1, 2])
def assembly(request):
    """One suspect and one or two nulls."""
    rng = np.random.default_rng(7)
    every = tuple(matched(rng, sd) for sd in (1e-3, *(2e-3, 1e-2)[:request.param]))
    return Assembly(every, None, None, (), (), request.param)


def test_the_density_beside_nulls_is_that_of_all_less_that_of_the_nulls(assembly):
    def density(some, sound):
        return log_density(stacked_nuisances(some, sound)[0], np.concatenate([m.r for m in some]))
    nulls = assembly.matched[1:]
    suspect, = assembly.suspects
    assert log_density(suspect.U, suspect.r) == pytest.approx(
        density(assembly.matched, len(nulls)) - density(nulls, 0), rel=1e-9)


def test_what_is_known_of_the_mesh_alone_is_left_to_the_model(assembly):
    """Not taken off what was measured, so that no prediction has the mesh's errors for known."""
    suspect, (raw, *_) = assembly.suspects[0], assembly.matched
    moved = suspect.of_mesh - raw.of_mesh
    columns = raw.U[:, np.isin(OURS, NAMES)]
    assert columns @ np.linalg.lstsq(columns, moved)[0] == pytest.approx(moved)
    assert np.linalg.norm(moved) > 0.1 * np.linalg.norm(columns[:, 0])
    assert suspect.U[:, OURS.index('touch_pad_1')] == pytest.approx(
        raw.U[:, OURS.index('touch_pad_1')])


def test_without_nulls_nothing_changes(assembly):
    alone = Assembly(assembly.matched[:1], None, None, (), ())
    assert alone.suspects == assembly.matched[:1]
