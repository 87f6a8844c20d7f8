"""What nothing explains: louder noise, within what the rests leave open, or something strange."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.diagnosis import loudness
from arm_brachy.diagnosis.stream import EM, OPTICAL

N, STATES = 3000, 60


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
    factors = loudness.louder(*made(loud, doubt=3.0))
    assert set(factors) <= {EM, OPTICAL} and factors[EM] == pytest.approx(2.0, rel=0.15)
    assert factors.get(OPTICAL, 1.0) < 1.15
    assert 'EM tracker was taken as 1.4 times' in loudness.said(factors)[0]


def test_what_shows_in_a_few_states_is_no_noise(white):
    """A tenth of the rows off by 10 sd moves the median of squares by a fifth, not a hundred."""
    strange = white + 10.0 * (np.arange(N) % 10 == 0)
    factors = loudness.louder(*made(strange, doubt=3.0))
    assert all(factor < 1.5 for factor in factors.values())


def test_noise_that_is_known_is_no_louder(white):
    assert loudness.louder(*made(3.0 * white, doubt=1.0)) == {}
    assert loudness.louder(*made(3.0 * white, doubt=2.0)) == {EM: 2.0, OPTICAL: 2.0}
