"""What nothing explains: louder noise, within what the rests leave open, or something strange."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.likelihood.observation import Row
from arm_brachy.diagnosis.selection import noise_scale, revision
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.noise_process import MEDIAN_CHI2

STATES, CHANNELS = 250, 2           # a second apart; of each of two streams, three axes each
N = 2 * CHANNELS * 3 * STATES
QUIET = 0.95        # noise a little below what is expected: a median of 1500 squares errs by 6 %


def recording(doubt):
    """What `louder` asks of a Matched; half of the rows are EM."""
    rows = [Row(kind, f'{kind}_{c}', axis, state) for kind in (EM, OPTICAL)
            for c in range(CHANNELS) for axis in range(3) for state in range(STATES)]
    noise = {kind: SimpleNamespace(doubt=doubt) for kind in (EM, OPTICAL)}
    states = SimpleNamespace(t=np.arange(float(STATES)))
    return SimpleNamespace(
        observables=SimpleNamespace(rows=rows),
        recorded=SimpleNamespace(prepared=SimpleNamespace(noise=noise), states=states))


def made(residual, *doubts, sound=0):
    """(assembly, explanations) of a recording per doubt, without nuisances or candidates."""
    matched = [recording(doubt) for doubt in doubts]
    residual = np.tile(residual, len(doubts))
    problem = SimpleNamespace(U=np.zeros((len(residual), 1)), r=residual)
    return SimpleNamespace(matched=matched, problem=problem, sound=sound), ()


@pytest.fixture
def white():
    return stream(5, 'loudness').standard_normal(N)


def test_a_stream_that_is_louder_everywhere_is_heard(white):
    loud = np.where(np.arange(N) < N // 2, np.sqrt(2.0), 1.0) * white
    factors = noise_scale.louder(*made(QUIET * loud, 2.5))
    assert factors == {EM: 2.5}
    assert 'EM tracker was taken as 1.6 times' in noise_scale.said(factors)[0]


def test_what_shows_in_a_few_states_is_no_noise(white):
    """2 % of the rows off by 30 sd: 18 times the mean square, 3 % of the median."""
    strange = QUIET * white + 30.0 * (np.arange(N) % 50 == 0)
    assert np.mean(strange**2) > 15.0
    assert noise_scale.louder(*made(strange, 3.0)) == {}


def test_noise_that_is_known_is_no_louder(white):
    assert noise_scale.louder(*made(3.0 * white, 1.0)) == {}
    assert noise_scale.louder(*made(3.0 * white, 2.0)) == {EM: 2.0, OPTICAL: 2.0}


def test_a_creep_is_no_noise(white):
    """It goes on for half of the recording: by the median of squares it would be noise."""
    t = np.tile(np.arange(STATES), N // STATES)
    creep = 4.0 * np.clip(t / STATES - 0.5, 0.0, None) / 0.5
    assert np.median((QUIET * white + creep)**2) > 1.5 * MEDIAN_CHI2
    assert noise_scale.louder(*made(QUIET * white + creep, 3.0)) == {}


def test_how_loud_noise_may_be_a_null_recording_tells(white):
    """A creep, say, in the recording under suspicion seems to be noise between its rests."""
    assert noise_scale.louder(*made(3.0 * white, 3.0, 1.0, sound=1)) == {}
    assert noise_scale.louder(*made(3.0 * white, 1.0, 2.0, sound=1)) == {EM: 2.0, OPTICAL: 2.0}


class Judged:
    """What `_noise_beside` asks of a Judge: what is left has that chance.

    far : by a cause far ahead, or by none where none stands out; None = there is no such cause
    best : by the best once all are fitted in full
    """

    rules = SimpleNamespace(alarm=1e-3)

    def __init__(self, far, best=None):
        self.far, self.best = far, best

    def outstanding(self):
        return self.far and ((), SimpleNamespace(chance=self.far))

    def alone(self):
        assert self.best is not None, 'full fits were asked for in vain'
        return (), SimpleNamespace(chance=self.best)


@pytest.mark.parametrize(('quiet', 'loud', 'expected'), [
    ((1e-9,), (0.2,), {EM: 2.5}),                   # what is left is no more than noise may be
    ((1e-9, 1e-9), (1e-7, 1e-7), {}),               # it is: something else is there as well
    ((0.2,), None, {}),                             # nothing is left
    ((None, 1e-9), (None, 0.2), {EM: 2.5}),         # the best of several leaves no more
    ((None, 1e-9), (None, 1e-7), {}),
    ((None, 0.2), None, {}),
    ((1e-9, 1e-9), (None, 0.2), {EM: 2.5})])        # beside loud noise it is no longer far ahead
def test_noise_is_asked_before_a_second_cause(white, quiet, loud, expected):
    half = np.where(np.arange(N) < N // 2, np.sqrt(2.0), 1.0) * white
    assembly, _ = made(QUIET * half, 2.5)
    given, other = (assembly, None, Judged(*quiet)), (assembly, None, loud and Judged(*loud))
    factors, found = revision._noise_beside(given, lambda factors: other)
    assert factors == expected
    assert found is (other if expected else given)


def test_where_no_stream_seems_louder_nothing_is_asked_again(white):
    assembly, _ = made(QUIET * white, 2.5)
    given = (assembly, None, Judged(1e-9, 1e-9))
    assert revision._noise_beside(given, None) == ({}, given)


def test_what_is_asked_again_in_noise_as_loud_is_the_same():
    made_of = []

    def judge(factors):
        made_of.append(factors)
        return object()

    again = revision._once(judge)
    first = again({EM: 2.5, FORCE: 1.5})
    assert again({FORCE: 1.5, EM: 2.5}) is first
    assert again({EM: 2.5}) is not first
    assert made_of == [{EM: 2.5, FORCE: 1.5}, {EM: 2.5}]
