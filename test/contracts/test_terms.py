"""Every registered term through one suite: what simulator, fitter and report rely on."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from arm_brachy import registry
from arm_brachy.core import config
from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.core.term import Kind, Stage, TermSpec
from arm_brachy.tissue.body import Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli


def off(cls):
    """Parameters that switch a term off, as declared; None where that is a limit only."""
    values = {name: info.to_si([info.neutral] * 3 if info.shape else info.neutral)
              for name, info in quantities(cls).items() if info.neutral is not None}
    finite = np.isfinite(np.concatenate([np.ravel(v) for v in values.values()])).all()
    return values if finite else None


BODY_STAGES = (Kind.TISSUE, Kind.BOUNDARY)

switchable = pytest.mark.parametrize(
    'cls', [c for c in registry.TERMS if off(c) is not None], ids=lambda c: c.spec.name)
every_term = pytest.mark.parametrize('cls', registry.TERMS, ids=lambda c: c.spec.name)


# Terms that act at a place do so in the small block of this suite.
PLACES = {'inclusion': {'centre': (0.015, 0.015, 0.015)},
          'reference_shape': {'bump_centre': (0.0, 0.015, 0.015)},
          'external_force': {'centre': (0.0, 0.015, 0.015)},
          'point_mass': {'centre': (0.0, 0.015, 0.015)},
          'base_debond': {'centre': (0.015, 0.015, 0.0)},
          'obstacle': {'centre': (0.0, 0.015, 0.015)}}


def body():
    """Small block, held below, one pad above; damped, or there would be no damping to change."""
    mesh = box_mesh((0.03, 0.03, 0.03), (3, 3, 3))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.45)
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.015, axis=1) < 0.01]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.015, 0.015, 0.03]), 0.01,
              radius=0.01)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,), damping=(5.0, 1e-3))


def placed(cls, **changes):
    """The term with its defaults, somewhere in the block."""
    return dataclasses.replace(cls(), **PLACES.get(cls.spec.name, {}), **changes)


def typical(cls):
    """The term at the size at which it usually shows; a vector has that length, along x."""
    return placed(cls, **{
        name: info.to_si([info.typical, 0.0, 0.0] if info.shape else info.typical)
        for name, info in quantities(cls).items() if info.typical is not None})


def run_body(term):
    """Everything a body term gives over two steps: (prepared body, fields, memories)."""
    prepared = term.prepare(body())
    memory, fields_seen, memories = term.memory(prepared), [], []
    for k in (1, 2):
        fields = StepFields.of(prepared)
        term.before_step(prepared, memory, 0.1 * k, 0.1, fields)
        x = prepared.mesh.nodes * [1.0, 1.0, 1.0 - 0.05 * k]
        memory = term.after_step(prepared, memory, x, 0.1 * k, 0.1)
        fields_seen.append(fields)
        memories.append(memory)
    return prepared, fields_seen, memories


def run_actuation(term):
    """Outputs and memories over a move there and back."""
    memory, out = term.memory(np.zeros(2)), []
    for k, u in enumerate([1e-3, 2e-3, 3e-3, 2.5e-3, 1e-3]):
        y, memory = term.step(memory, np.array([u, 0.5 * u]), np.ones(2), 0.1 * (k + 1), 0.1)
        out.append((y, memory))
    return out


def run_sensing(term):
    """Distorted values at two times, and how late the stamps are."""
    values = np.arange(9.0).reshape(3, 3) * 0.01
    pads = np.array([[0.0, 0.0, 1e-3]])
    seen = [term.distort(t, ('a', 'b', 'c'), values, pads) for t in (0.0, 1.0)]
    return [*seen, term.lateness]


def run(term):
    """Everything a term does on a fixed input."""
    runner = {Kind.ACTUATION: run_actuation, Kind.SENSING: run_sensing}
    return runner.get(term.spec.kind, run_body)(term)


def leaves(value):
    """Arrays and numbers inside a nested result, in order."""
    if dataclasses.is_dataclass(value):
        value = [getattr(value, f.name) for f in dataclasses.fields(value)]
    if isinstance(value, dict):
        value = [value[k] for k in sorted(value)]
    if isinstance(value, (list, tuple)):
        return [leaf for item in value for leaf in leaves(item)]
    return [value]


def assert_same(a, b):
    """Two nested results agree to the last bit."""
    a, b = leaves(a), leaves(b)
    assert len(a) == len(b)
    for left, right in zip(a, b, strict=True):
        np.testing.assert_array_equal(left, right)


@every_term
def test_the_specification_is_complete(cls):
    spec = cls.spec
    assert isinstance(spec, TermSpec)
    assert spec.name == cls.__module__.rpartition('.')[2]
    assert spec.summary and spec.equation and spec.source and spec.leaves_open
    assert (spec.stage is Stage.BODY) == (spec.kind in BODY_STAGES)
    assert cls().stage is spec.stage
    assert cls.__doc__ and 'Test: ' in cls.__doc__


@every_term
def test_it_is_frozen_and_every_parameter_is_declared(cls):
    assert dataclasses.fields(cls)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(cls(), dataclasses.fields(cls)[0].name, 1.0)
    for name, info in quantities(cls).items():
        assert info.unit in UNITS, name
        assert info.text and info.source, name
        assert info.low is not None and info.high is not None and info.low < info.high, name
        default = np.atleast_1d(info.to_edge(getattr(cls(), name)))
        assert np.all((default >= info.low) & (default <= info.high)), name
        if info.typical is not None:
            assert info.low <= info.typical <= info.high, name


@every_term
def test_priors_can_be_drawn_from(cls):
    for name, info in quantities(cls).items():
        if info.prior is None:
            continue
        kind, a, b = info.prior
        assert kind in ('uniform', 'normal', 'lognormal'), name
        assert {'uniform': a < b, 'normal': b > 0.0, 'lognormal': a > 0.0 and b > 1.0}[kind], name
        centre = 0.5 * (a + b) if kind == 'uniform' else a
        assert info.low <= centre <= info.high, name


@every_term
def test_something_scales_the_effect(cls):
    for name, info in quantities(cls).items():
        if info.neutral is not None:
            assert np.isinf(info.neutral) or info.low <= info.neutral <= info.high, name
    assert any(info.neutral is not None for info in quantities(cls).values())


@every_term
def test_something_can_be_fitted(cls):
    assert any(info.prior for info in quantities(cls).values())


@every_term
def test_round_trip_through_configuration(cls):
    term = typical(cls)
    assert config.from_mapping(cls, config.to_mapping(term), 'test') == term


@every_term
def test_same_input_same_bits(cls):
    assert_same(run(typical(cls)), run(typical(cls)))


@every_term
def test_arguments_are_untouched(cls):
    term = typical(cls)
    if term.spec.kind in BODY_STAGES:
        given = body()
        kept = copy.deepcopy(given)
        prepared = term.prepare(given)
        assert_same(given, kept)
        memory = term.memory(prepared)
        remembered, kept = copy.deepcopy(memory), copy.deepcopy(prepared)
        x = prepared.mesh.nodes * 1.01
        term.before_step(prepared, memory, 0.1, 0.1, StepFields.of(prepared))
        term.after_step(prepared, memory, x, 0.1, 0.1)
        assert_same((prepared, memory, x), (kept, remembered, prepared.mesh.nodes * 1.01))
    elif term.spec.kind is Kind.ACTUATION:
        memory, u, effort = term.memory(np.zeros(2)), np.full(2, 1e-3), np.ones(2)
        kept = copy.deepcopy((memory, u, effort))
        term.step(memory, u, effort, 0.1, 0.1)
        assert_same((memory, u, effort), kept)
    else:
        values, pads = np.ones((2, 3)), np.ones((1, 3))
        out = term.distort(1.0, ('a', 'b'), values, pads)
        assert_same((values, pads), (np.ones((2, 3)), np.ones((1, 3))))
        assert not np.shares_memory(out, values)


@every_term
def test_memory_survives_pickling(cls):
    """A step from an unpickled memory is the step from the memory itself."""
    term = typical(cls)
    if term.spec.kind in BODY_STAGES:
        prepared = term.prepare(body())
        memory = term.after_step(prepared, term.memory(prepared), prepared.mesh.nodes * 1.1,
                                 0.1, 0.1)
        restored = pickle.loads(pickle.dumps(memory))
        x = prepared.mesh.nodes * 1.2
        assert_same(term.after_step(prepared, memory, x, 0.2, 0.1),
                    term.after_step(prepared, restored, x, 0.2, 0.1))
    elif term.spec.kind is Kind.ACTUATION:
        u, effort = np.full(2, 1e-3), np.ones(2)
        _, memory = term.step(term.memory(np.zeros(2)), u, effort, 0.1, 0.1)
        restored = pickle.loads(pickle.dumps(memory))
        assert_same(term.step(memory, 2 * u, effort, 0.2, 0.1),
                    term.step(restored, 2 * u, effort, 0.2, 0.1))
    assert pickle.loads(pickle.dumps(term)) == term


@switchable
def test_the_neutral_value_switches_it_off(cls):
    term = placed(cls, **off(cls))
    if cls.spec.kind in BODY_STAGES:
        prepared, fields, _ = run_body(term)
        assert_same(prepared, body())
        for field in fields:
            assert_same(field, StepFields.of(body()))
    elif cls.spec.kind is Kind.ACTUATION:
        y, _ = term.step(term.memory(np.zeros(2)), np.array([2e-3, 1e-3]), np.ones(2), 0.1, 0.1)
        np.testing.assert_array_equal(y, [2e-3, 1e-3])
    else:
        values = np.arange(6.0).reshape(2, 3)
        out = term.distort(1.0, ('a', 'b'), values, np.ones((1, 3)))
        np.testing.assert_array_equal(out, values)
        assert term.lateness == 0.0


@switchable
def test_the_typical_value_does_something(cls):
    term = typical(cls)
    none = dataclasses.replace(term, **off(cls))
    present, absent = leaves(run(term)), leaves(run(none))
    assert len(present) != len(absent) or any(
        not np.array_equal(a, b) for a, b in zip(present, absent, strict=True))
