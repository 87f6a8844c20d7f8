"""Markers glued anew between two recordings, and a cause that moves them as well."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag

from arm_brachy.diagnosis.likelihood.nuisances import Nuisances
from arm_brachy.diagnosis.selection.marker_placement import apart_in, named_apart, reglued, said
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.signals.stream import BASE, EM, TISSUE
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, evidence_over_none

STATES = 30
MARKERS = {'t1': TISSUE, 't2': TISSUE, 't3': TISSUE, 'b1': BASE, 'b2': BASE, 'p1': 'pad_1'}
PLACES = [f'optical_{m}_{axis}' for m in MARKERS for axis in 'xyz']
PRIOR = 10.0    # of a place, over the noise of a state


class Two:
    """A null and a suspect that see all markers; a cause sags the tissue and shows in pushes."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        rows = STATES * len(PLACES)
        self.frame = np.kron(np.eye(3), np.ones(STATES))    # of every tracker its own
        self.frame = 100.0 * np.tile(self.frame, len(MARKERS)).T
        self.place = np.kron(PRIOR * np.eye(len(PLACES)), np.ones((STATES, 1)))
        specimen = SimpleNamespace(markers=tuple(MARKERS), carriers=tuple(MARKERS.values()),
                                   tools=())
        self.matched = [SimpleNamespace(
            U=self.place, nuisances=SimpleNamespace(names=tuple(PLACES)),
            baseline=SimpleNamespace(model=SimpleNamespace(specimen=specimen)))] * 2
        on_tissue = np.kron(np.repeat([on == TISSUE for on in MARKERS.values()], 3),
                            np.ones(STATES))
        self.on_tissue = on_tissue
        push = np.tile(np.abs(np.sin(np.linspace(0.0, 9.0, STATES))), len(PLACES))
        directions = np.kron(rng.standard_normal((len(PLACES), 3)), np.ones((STATES, 1)))
        self.cause = np.vstack([np.zeros((rows, 3)),
                                directions * (on_tissue * (1.0 + 0.5 * push))[:, None]])
        self.noise = rng.standard_normal(2 * rows)
        self.rng = rng

    def found(self, *moved, cause=0.0, bent=0.0, fits=False):
        """`reglued` where markers on `moved` were glued anew and the cause is so large.

        bent : part of the cause's effect, at rest, that its response does not have
        fits : True if its full fit has that, False if it is as its response
        """
        shift = np.repeat([on in moved for on in MARKERS.values()], 3) * self.rng.standard_normal(
            len(PLACES))
        effect = self.cause @ np.full(3, cause)
        wrong = bent * np.concatenate([np.zeros(len(self.place)), np.repeat(
            self.rng.standard_normal(len(PLACES)), STATES) * self.on_tissue]) * np.sqrt(
                np.mean(effect[len(self.place):]**2))
        r = (self.noise + effect + wrong
             + np.concatenate([np.zeros(len(self.place)), self.place @ shift]))
        U = np.hstack([block_diag(self.frame, self.frame), np.vstack([self.place] * 2)])
        best = SimpleNamespace(explanations=[SimpleNamespace(columns=self.cause)])
        fitted = (self.cause + wrong[:, None] / max(3 * cause, 1e-9)) if fits else self.cause
        weighted = Beside(U).weighted(np.column_stack([fitted, r]))
        evidence = evidence_over_none(fitted.T @ weighted[:, :-1], fitted.T @ weighted[:, -1])
        judge = SimpleNamespace(problem=SimpleNamespace(U=U, r=r), rules=Rules(),
                                singles=lambda: (best,),
                                weighed_singles=lambda: (SimpleNamespace(evidence=evidence),))
        return set(reglued(self.matched, judge))


@pytest.fixture(params=range(5))
def two(request):
    return Two(request.param)


@pytest.mark.parametrize('moved', [(BASE,), ('pad_1',)])
@pytest.mark.parametrize('cause', [0.0, 3.0])
def test_what_was_glued_anew_is_told_by_what_it_is_on(two, moved, cause):
    """Tissue that moved as one would do as well as a pad, with more numbers."""
    assert two.found(*moved, cause=cause) == set(moved)


@pytest.mark.parametrize('moved', [(BASE, 'pad_1'), (TISSUE, BASE, 'pad_1')])
def test_of_more_than_one_kind_all_were(two, moved):
    """A tracker that stands elsewhere makes up for one marker, but it says nothing any more."""
    assert two.found(*moved) == {TISSUE, BASE, 'pad_1'}


@pytest.mark.parametrize('cause', [0.0, 0.3, 3.0])
def test_a_sag_is_no_glue(two, cause):
    assert two.found(cause=cause) == set()


def test_what_a_large_sag_bends_is_no_glue(two):
    """A tenth of it is, as much again is not."""
    assert two.found(cause=30.0, bent=0.1) == set()
    assert two.found(cause=30.0, bent=1.0)


def test_what_its_full_fit_has_is_no_glue(two):
    assert two.found(cause=30.0, bent=0.4)
    assert two.found(cause=30.0, bent=0.4, fits=True) == set()
    assert two.found(BASE, cause=3.0, fits=True) == {BASE}


def test_one_recording_has_nothing_to_differ_from(two):
    assert reglued(two.matched[:1], SimpleNamespace(problem=None)) == {}


def test_places_apart_keep_their_number_and_are_known_again():
    told = named_apart(Nuisances(('modulus', 'optical_p1_x'), {}), ['optical_p1_x'])
    assert told.names == ('modulus', 'apart_optical_p1_x')
    assert apart_in(SimpleNamespace(nuisances=told)) == ('optical_p1_x',)


def test_it_is_said_what_they_are_on():
    sentence, = said({'Pad_N': [], EM: []})
    assert sentence.startswith('Markers on Pad_N and tools of the EM tracker do not sit')
    assert said({}) == ()
