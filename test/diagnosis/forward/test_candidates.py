"""Every term has hypotheses, few enough, each a term that fits the body."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.quantity import quantities
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.isolation.handover import Occasions
from arm_brachy.diagnosis.model.hypothesis import hypothesis, strengths
from arm_brachy.diagnosis.selection.candidates import (
    FIBRES,
    candidates,
    interior_places,
    surface_places,
)
from arm_brachy.registry import TERMS, by_name
from arm_brachy.tissue.mesh import boundary_faces

KNOWN = Occasions(onsets=(12.0,), windows=((10.0, 12.0),), frequencies=(0.23,))


@pytest.mark.parametrize('cls', TERMS, ids=lambda cls: cls.spec.name)
def test_every_term_has_some_and_they_fit(linear, cls):
    found = candidates(cls, linear, KNOWN)
    assert 0 < len(found) <= 60
    for one in (found[0], found[-1]):
        assert one.strengths
        term = one.term(np.ones(len(one.strengths)))
        if term.stage is Stage.BODY:
            body = term.prepare(linear.body)
            term.memory(body)


@pytest.mark.parametrize('cls', TERMS, ids=lambda cls: cls.spec.name)
def test_every_place_is_where_its_prior_has_it(linear, cls):
    """A fit that starts elsewhere starts at the limit, somewhere else."""
    for one in candidates(cls, linear, KNOWN):
        for name, value in one.place.items():
            info = quantities(cls).get(name)
            if info is None or info.prior is None or info.prior[0] != 'uniform':
                continue
            low, high = (info.scale * end for end in info.prior[1:])
            assert low - 1e-9 <= value <= high + 1e-9, (name, value)


def test_fibres_are_tried_within_28_degrees_of_any_direction():
    tried = np.array([by_name('anisotropy')(azimuth=a, elevation=e).direction
                      for a, e in np.radians(FIBRES)])
    some = np.random.default_rng(1).normal(size=(2000, 3))
    some /= np.linalg.norm(some, axis=1)[:, None]
    assert np.abs(some @ tried.T).max(axis=1).min() > np.cos(np.radians(28.0))
    assert np.abs(tried @ tried.T - np.eye(13)).max() < 1.0 - 1e-6      # each axis once


def test_what_no_occasion_supports_is_no_hypothesis(linear):
    assert candidates(by_name('external_force'), linear) == ()
    assert candidates(by_name('breathing'), linear) == ()
    assert candidates(by_name('lost_steps'), linear) == ()
    assert len(candidates(by_name('stiffness_drift'), linear)) == 1


def test_a_drift_may_set_in_at_any_time(linear):
    """Nothing jumps where a drift begins: without a change point as well."""
    found = candidates(by_name('swelling_drift'), linear, Occasions(onsets=(12.0,), end=60.0))
    assert {one.place['onset'] for one in found} == {0.0, 12.0, 15.0, 30.0, 45.0}


def test_strengths_run_from_off_to_typical():
    for cls in TERMS:
        for one in strengths(cls):
            if np.isfinite(one.neutral):
                assert one.value(0.0) == one.neutral
            else:
                assert one.value(0.0) == pytest.approx(one.high) and one.high > 10.0 * one.typical
            assert one.value(1.0) == pytest.approx(one.typical)
            assert one.value(1.0) != one.value(0.0)


def test_spread_is_the_width_of_the_prior_in_typical_sizes():
    gain, offset = strengths(by_name('actuator_gain'))
    assert gain.spread == pytest.approx(0.06 / 0.06) and offset.spread == pytest.approx(1.0)
    damage, = strengths(by_name('stress_softening'))
    assert damage.spread == pytest.approx(0.6 / np.sqrt(12.0) / 0.3)


def test_what_is_off_at_its_limit_has_one_side():
    sides = {(cls.spec.name, one.name): one.one_sided for cls in TERMS for one in strengths(cls)}
    for never_less in (('anisotropy', 'ratio'), ('stress_softening', 'damage'),
                       ('base_debond', 'radius'), ('backlash', 'width'), ('obstacle', 'gap')):
        assert sides[never_less]
    for either in (('inclusion', 'ratio'), ('stiffness_drift', 'rate'), ('force_gain', 'gain')):
        assert not sides[either]


def test_fibres_are_near_some_direction_that_is_tried(linear):
    rng = np.random.default_rng(1)
    any_way = rng.normal(size=(2000, 3))
    any_way /= np.linalg.norm(any_way, axis=1)[:, None]
    tried = np.array([one.term(np.ones(1)).direction
                      for one in candidates(by_name('anisotropy'), linear)])
    away = np.degrees(np.arccos(np.abs(any_way @ tried.T).max(axis=1)))
    assert away.max() < 28.0 and len(tried) == 13


def test_a_rhythm_of_any_phase_is_met_by_one_that_only_adds(linear):
    """A wave that cannot be negative: some quarter of a period is within 45 degrees of it."""
    phases = {one.place['phase'] for one in candidates(by_name('breathing'), linear, KNOWN)}
    for phase in np.linspace(0.0, 2.0 * np.pi, 17):
        assert max(np.cos(phase - one) for one in phases) >= np.cos(0.25 * np.pi) - 1e-9


def test_the_strengths_left_out_are_off():
    gain = hypothesis(by_name('actuator_gain'), ('offset',)).term(np.array([1.0]))
    assert gain.gain == 0.0 and gain.offset == pytest.approx(5e-4)


def test_a_body_that_is_held_by_single_nodes_has_no_glued_base(linear):
    one = by_name('base_debond')
    held = linear.body.fixed[:1]
    loose = replace(linear, body=replace(linear.body, fixed=held))
    assert candidates(one, linear) and candidates(one, loose) == ()


def test_places_cover_the_body_and_its_surface(linear):
    mesh = linear.mesh
    inner = interior_places(mesh, 60)
    assert inner.shape == (60, 3)
    middles = mesh.nodes[mesh.tets].mean(axis=1)
    gap = np.linalg.norm(middles[:, None] - inner, axis=2).min(axis=1)
    assert gap.max() < 0.02     # 440 ml / 60 is a ball of 12 mm; corners lie further off
    free = surface_places(linear, 24, base=False)
    outer = mesh.nodes[boundary_faces(mesh)].mean(axis=1)
    assert np.linalg.norm(outer[:, None] - free, axis=2).min(axis=0).max() < 1e-12
    assert np.array_equal(inner, interior_places(mesh, 60))


def test_a_step_that_a_finding_explains_is_no_slip_as_well(linear):
    """Of that marker at that time; others may slip then, and it later."""
    slip, marker = by_name('marker_slip'), linear.markers[0]
    found = candidates(slip, linear, replace(KNOWN, onsets=(12.0, 30.0),
                                             explained=((marker, (11.9, 12.1)),)))
    tried = {(one.place['marker'], one.place['onset']) for one in found}
    assert tried == {(name, t) for name in linear.markers
                     for t in (12.0, 30.0)} - {(marker, 12.0)}
