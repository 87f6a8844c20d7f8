"""Pads off their zeros in tissue that changes: columns against full runs of the shifted path."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.diagnosis.estimation.fit_model import Data
from arm_brachy.diagnosis.likelihood.observation import KINDS, Measured, Observables, channels_of
from arm_brachy.diagnosis.likelihood.pad_offset import matters, otherwise
from arm_brachy.diagnosis.likelihood.preload import preload
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.base_debond import BaseDebond
from arm_brachy.tissue.terms.compressibility import Compressibility
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.stress_softening import StressSoftening
from arm_brachy.tissue.terms.swelling_drift import SwellingDrift
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

STATES = np.array([0.2, 1.5, 2.5, 4.5, 6.5, 8.0, 9.0])
TOUCH, PAD = 3e-4, 0        # m


@pytest.fixture(scope='module')
def data(linear, encoder):
    """Data of a recording at rest and in pushes, noise of 1 so that columns are in m and N."""
    baseline, names = Baseline(ForwardModel(linear), encoder, STATES), channels_of(linear)
    streams = [Measured(kind, names[kind], baseline.shown[kind],
                        np.ones(baseline.shown[kind].shape[:2], dtype=bool),
                        np.ones(baseline.shown[kind].shape), np.eye(len(STATES)))
               for kind in KINDS]
    observables = Observables(streams, names)
    return Data(linear, encoder, STATES, observables,
                np.zeros((len(observables.rows), 0)), baseline=baseline)


def shifted(data, terms):
    """kind -> (n, c, 3): what full runs show more with a pad TOUCH further in all along."""
    pad = np.arange(len(data.specimen.pads)) == PAD
    further = replace(data.encoder, q=data.encoder.q + TOUCH * pad)
    model = ForwardModel(data.specimen, terms)
    runs = [model.predict(path, STATES) for path in (further, data.encoder)]
    return {kind: runs[0].get(kind) - runs[1].get(kind) for kind in KINDS}


def told(data, terms):
    """(column (N,), what full runs say, what it does without terms) of the pad, in forces."""
    force = np.array([row.kind == 'force' for row in data.observables.rows])
    column = preload(data, terms, TOUCH)[:, PAD]
    whiten = data.observables.whiten_shift
    plain, full = (whiten(shifted(data, some)) for some in ((), terms))
    return column[force], (full - plain)[force], plain[force]


@pytest.mark.parametrize('term', [StressSoftening(damage=0.4, energy=30.0),
                                  StiffnessDrift(rate=0.01, onset=1.0)],
                         ids=lambda term: term.spec.name)
def test_tissue_that_changes_bears_a_pad_off_its_zero_otherwise(data, term):
    column, full, plain = told(data, (term,))
    assert np.linalg.norm(full) > 0.05 * np.linalg.norm(plain)
    assert np.linalg.norm(column - full) < 0.15 * np.linalg.norm(full)


def test_what_relaxes_has_relaxed_before_the_recording(data):
    """A step of the pad now would meet a stiffer body by g; one of long ago does not."""
    term = Viscoelasticity(g1=0.3, tau1=3.0)
    whiten = data.observables.whiten_shift
    plain, full = (whiten(shifted(data, some)) for some in ((), (term,)))
    assert np.linalg.norm(full - plain) < 0.1 * np.linalg.norm(plain)
    assert not preload(data, (term,), TOUCH).any()


def test_a_body_that_swells_bears_it_where_it_is_then(data):
    """Where it was before is no equilibrium any more."""
    column, full, plain = told(data, (SwellingDrift(rate=0.01),))
    assert np.linalg.norm(column - full) < 0.03 * np.linalg.norm(plain)


def test_a_lump_beside_what_softens_counts(data):
    lump = Inclusion(centre=(0.02, 0.01, 0.03), radius=0.012, ratio=4.0)
    column, full, _ = told(data, (lump, StressSoftening(damage=0.4, energy=30.0)))
    assert np.linalg.norm(column - full) < 0.2 * np.linalg.norm(full)


@pytest.mark.parametrize('term', [Inclusion(centre=(0.02, 0.01, 0.03), radius=0.012, ratio=4.0),
                                  BaseDebond(radius=0.02, centre=(0.02, 0.0, 0.0))],
                         ids=lambda term: term.spec.name)
def test_tissue_without_a_past_has_nothing_in_its_columns(data, term):
    """But as many as one with a past: recordings side by side need them."""
    columns = preload(data, (term,), TOUCH)
    assert columns.shape == (len(data.observables.rows), len(data.specimen.pads))
    assert not columns.any()


def test_a_recording_that_ends_before_anything_changes_has_as_many_columns(data):
    drift = StiffnessDrift(rate=0.01, onset=100.0)
    changing = preload(data, (StiffnessDrift(rate=0.01, onset=1.0),), TOUCH)
    still = preload(data, (drift,), TOUCH)
    assert still.shape == changing.shape and changing.any() and not still.any()


@pytest.mark.parametrize('term', [Compressibility(factor=0.3), BaseCompliance(normal=2e5),
                                  Inclusion(centre=(0.02, 0.01, 0.03), radius=0.012, ratio=8.0)],
                         ids=lambda term: term.spec.name)
def test_another_body_bears_a_pad_off_its_zero_otherwise(data, term):
    """At rest too, where the term itself does nothing."""
    column, whiten = otherwise(data, (term,), TOUCH)[:, PAD], data.observables.whiten_shift
    full = whiten(shifted(data, (term,))) - whiten(shifted(data, ()))
    rows = data.observables.rows
    for kind in KINDS:
        mine = np.array([row.kind == kind for row in rows])
        assert np.linalg.norm(column[mine] - full[mine]) < 0.15 * np.linalg.norm(full[mine])
    assert np.abs(column[data.observables.states == 0]).max() > 0.1 * np.abs(column).max()


def test_memories_and_sensors_are_left_to_others(data):
    for term in (StressSoftening(damage=0.4, energy=30.0), OpticalScale(scale=0.01)):
        assert not otherwise(data, (term,), TOUCH).any()


def test_it_matters_where_a_strong_cause_meets_a_pad_far_off_its_zero(data):
    """An effect of 20 sd, a pad off by a twelfth of its way: (20 / 12)^2 / 2 nats of density."""
    rng = np.random.default_rng(1)
    U = 1e3 * unit(rng.normal(size=200))[:, None]       # of TOUCH: as good as measured
    effect, travel = unit(rng.normal(size=200)), np.abs(data.encoder.q).max()

    def asked(off, size):
        left = off / TOUCH * U[:, 0]
        one = SimpleNamespace(U=U, own=np.array([True]), encoder=data.encoder,
                              baseline=SimpleNamespace(shown=None),
                              residual=lambda shown: left + size * effect)
        return matters([one], [left], [np.array([True])], TOUCH)

    assert asked(travel / 12.0, 20.0)
    assert not asked(travel / 30.0, 20.0)
    assert not asked(travel / 12.0, 4.0)


def unit(v):
    return v / np.linalg.norm(v)
