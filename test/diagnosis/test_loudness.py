"""What nothing explains: louder noise, within what the rests leave open, or something strange."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.diagnosis import loudness
from arm_brachy.diagnosis.stream import EM, OPTICAL

N = 3000
QUIET = 0.95        # noise a little below what is expected: a median of 1500 squares errs by 6 %


def made(residual, doubt):
    """(assembly, decision) without nuisances or candidates; half of the rows are EM."""
    rows = [SimpleNamespace(kind=EM if i < N // 2 else OPTICAL) for i in range(N)]
    noise = {kind: SimpleNamespace(doubt=doubt) for kind in (EM, OPTICAL)}
    prepared = SimpleNamespace(noise=noise)
    one = SimpleNamespace(observables=SimpleNamespace(rows=rows),
                          recorded=SimpleNamespace(prepared=prepared))
    problem = SimpleNamespace(U=np.zeros((N, 1)), r=residual)
    return (SimpleNamespace(matched=[one], problem=problem), SimpleNamespace(ranked=()))


@pytest.fixture
def white():
    return stream(5, 'loudness').standard_normal(N)


def test_a_stream_that_is_louder_everywhere_is_heard(white):
    loud = np.where(np.arange(N) < N // 2, np.sqrt(2.0), 1.0) * white
    factors = loudness.louder(*made(QUIET * loud, doubt=2.5))
    assert factors == {EM: 2.5}
    assert 'EM tracker was taken as 1.6 times' in loudness.said(factors)[0]


def test_what_shows_in_a_few_states_is_no_noise(white):
    """2 % of the rows off by 30 sd: 18 times the mean square, 3 % of the median."""
    strange = QUIET * white + 30.0 * (np.arange(N) % 50 == 0)
    assert np.mean(strange**2) > 15.0
    assert loudness.louder(*made(strange, doubt=3.0)) == {}


def test_noise_that_is_known_is_no_louder(white):
    assert loudness.louder(*made(3.0 * white, doubt=1.0)) == {}
    assert loudness.louder(*made(3.0 * white, doubt=2.0)) == {EM: 2.0, OPTICAL: 2.0}
