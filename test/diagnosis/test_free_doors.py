"""What is not claimed of a released body although its rows would allow it."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from arm_brachy.diagnosis.free_vibration.vetoes import MISSED, stood_back, told_apart
from arm_brachy.diagnosis.results.parts import StreamFit


@dataclass(frozen=True)
class Decision:
    """The fields of a judge.Decision that doors look at."""

    verdict: str
    accepted: object = None
    equals: tuple = ()
    nearest: object = None


@dataclass(frozen=True)
class Rival:
    """What doors look at of a judge.Candidate."""

    name: str
    weighed: bool = False


@dataclass(frozen=True)
class Full:
    """What full fits say: by how much the first is likelier than each other."""

    leads: dict = field(default_factory=dict)

    def lead(self, candidate, other):
        return self.leads[other]


def fits(*named):
    return [StreamFit('optical', 1.0, 0.5, 0.01, one) for one in named]


def test_a_cause_that_leaves_ten_times_the_noise_is_none():
    given = Decision('equivalent', 'one', ('other',))
    found = stood_back(given, lambda one: fits(0.05, 1.01 * MISSED * 0.01))
    assert found == Decision('unexplained', nearest='one')
    assert stood_back(given, lambda one: fits(0.05, 0.99 * MISSED * 0.01)) is given


def test_a_cause_that_predicts_hardly_better_than_the_scene_as_given_is_none():
    """Where that is the noise it may: what was given then was good."""
    given = Decision('named', 'one')

    def left(named, noise):
        return [StreamFit('optical', 0.10, 0.20, noise, named)]

    assert stood_back(given, lambda one: left(0.098, 0.02)).nearest == 'one'
    assert stood_back(given, lambda one: left(0.090, 0.02)) is given
    assert stood_back(given, lambda one: left(0.098, 0.06)) is given


def test_nothing_is_asked_of_no_claim():
    given = Decision('nothing_missing')
    assert stood_back(given, lambda one: pytest.fail('asked')) is given
    assert told_apart(given, SimpleNamespace()) is given


def test_a_rival_that_fits_worse_in_full_is_no_equal():
    near, far, weighed = Rival('near'), Rival('far'), Rival('weighed', True)
    given = Decision('equivalent', 'one', (near, far, weighed))
    assert told_apart(given, Full({near: 1.0, far: 9.0})).equals == (near, weighed)
    given = Decision('equivalent', 'one', (near, far))
    assert told_apart(given, Full({near: 5.0, far: 9.0})) == Decision('named', 'one')
