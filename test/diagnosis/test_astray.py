"""A marker that goes its own way does so in every kind of push."""

import numpy as np
import pytest

from arm_brachy.core.random import stream as draws
from arm_brachy.diagnosis.selection.pad_marker_check import _asked, _uneven

SD = np.array([0.2, 0.2, 0.25, 0.3, 0.3, 0.5, 0.5])


@pytest.mark.parametrize(('share', 'uneven'), [
    (np.full(7, 1.0), False), (np.array([0.2, 1.2, 1.1, -0.3, 0.0, 0.3, 0.0]), True)])
def test_shares_of_kinds_of_push_are_one_within_their_errors(share, uneven):
    """Seven kinds. One in a hundred of what is one share is taken for more."""
    power, rng = SD**-2, draws(1, 'astray')
    told = [_uneven(np.stack([power, power * (share + SD * rng.standard_normal(7))], axis=1))
            for _ in range(300)]
    assert np.mean(told) > 0.8 if uneven else np.mean(told) < 0.03


def test_a_kind_that_does_not_show_the_change_says_nothing():
    assert not _uneven(np.array([[25.0, 24.0], [20.0, 21.0], [0.0, 0.0]]))


class _Rows:
    """As `match.Matched`, as far as it is asked here: four kinds of push, one pad's marker."""

    def __init__(self, monkeypatch, effect, other):
        rng, n = draws(2, 'astray'), 800
        self.kinds = np.repeat(np.array(['a', 'b', 'c', 'd'], dtype=object), n // 4)
        e = np.repeat([1.0, 1.5, 0.5, 1.0], n // 4) * np.sin(0.3 * np.arange(n))
        r = rng.standard_normal(n) + effect * e + other * np.where(self.kinds == 'b', e, 0.0)
        monkeypatch.setattr('arm_brachy.diagnosis.selection.pad_marker_check._ways',
                        lambda *of: (e, r))
        monkeypatch.setattr('arm_brachy.diagnosis.selection.pad_marker_check._others',
                            lambda *of: np.ones(n, dtype=bool))


@pytest.mark.parametrize(('effect', 'other', 'astray'), [(1.0, 0.0, True), (0.0, 2.0, False)])
def test_what_one_kind_of_push_shows_is_something_else(monkeypatch, effect, other, astray):
    """Tissue that stiffens in deep pushes hides that the actuator yields: not in shallow ones."""
    one = _Rows(monkeypatch, effect, other)
    found = _asked((one,), ((),), np.zeros((800, 1)), ('pad_1',))
    assert (found is not None) == astray
    if astray:
        assert found.share == pytest.approx(1.0, abs=4.0 * found.sd) and found.lead > 15.0
