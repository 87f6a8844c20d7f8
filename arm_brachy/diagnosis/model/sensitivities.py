"""How every observable answers to every hypothesis, all from one factor per state.

In equilibrium f(x, theta) = 0. What a term adds to the forces at the positions of the baseline is
its residual g; to first order in it the positions move by -K^-1 g, and an observable J, with the
adjoint state a = K^-1 dJ/dx, by -a . g (`jacobian.Linearisation.adjoint`). That asks nothing of a
term but to be prepared and to have its memory carried along the baseline. Where held nodes or
supports change or pads come loose, the balance is found on the few nodes concerned
(`condensation`, `pad_friction`).
Test: diagnosis/forward/test_responses.py
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.model.condensation import interface_change
from arm_brachy.diagnosis.model.force_rates import Rates, alike, same_fields
from arm_brachy.diagnosis.model.forward import STAGES, ForwardModel
from arm_brachy.diagnosis.model.hypothesis import Hypothesis
from arm_brachy.diagnosis.model.pad_friction import slip_change
from arm_brachy.diagnosis.model.specimen import attach
from arm_brachy.diagnosis.model.trajectory import Trajectory, evolve, remembers
from arm_brachy.diagnosis.model.transmission import transmitted
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import EM, OPTICAL
from arm_brachy.registry import TERMS, split
from arm_brachy.tissue.contact_pads import touches
from arm_brachy.tissue.free_dofs import moved_from_rest

SMALL = 1e-3    # of the typical size, at which effects on the tissue are linearised
WHOLE = 1.0     # at which thresholds and play are run: fainter, they may not act


@dataclass(frozen=True)
class Response:
    """Change of every observable per strength of a hypothesis, in units of its typical size.

    values : kind -> (n, c, 3, k) [m or N], NaN at states a full run did not find
    scale : of the typical size at which it was taken;  exact : by full runs, not by the tangent
    """

    hypothesis: Hypothesis
    values: dict
    scale: float
    exact: bool

    def per_prior(self):
        """The values per prior standard deviation of every strength."""
        spread = np.array([strength.spread for strength in self.hypothesis.strengths])
        return {kind: values * spread for kind, values in self.values.items()}


def respond(baseline, hypothesis, scale=None):
    """Return the Response to a Hypothesis beside the terms of a linearised.Baseline.

    scale : amplitude to take the difference at; None = SMALL for tangents of the tissue, the
        hypothesis' size for supports and bonds that are lost, else WHOLE
    Raises ConfigError for a term that the encoders hide (set point), and what terms raise that do
    not fit.
    """
    columns = [_known(baseline, hypothesis, k, scale) for k in range(len(hypothesis.strengths))]
    values = {kind: np.stack([column[0][kind] for column in columns], axis=3) for kind in STAGES}
    return Response(hypothesis, values, columns[0][1], columns[0][2])


def _known(baseline, hypothesis, k, scale):
    """`_column` of strength k, kept with the baseline where other hypotheses have the same."""
    same = hypothesis.same_alone(k)
    if same is None:
        return _column(baseline, partial(hypothesis.alone, k), scale, hypothesis.size)
    key = same, scale, hypothesis.size
    if key not in baseline.columns:
        baseline.columns[key] = _column(baseline, partial(hypothesis.alone, k), *key[1:])
    return baseline.columns[key]


def _column(baseline, at, scale, size):
    """(change per typical size kind -> (n, c, 3), scale, exact) of one strength.

    at : amplitude -> term;  size : as Hypothesis has it
    """
    whole = at(scale or WHOLE)
    if whole.stage is Stage.BODY:
        if _restructures(baseline, at(WHOLE)):
            return _supported(baseline, at(scale or size), scale or size)
        return _by(scale or SMALL, body_change(baseline, at(scale or SMALL)))
    if whole.stage is Stage.TRANSMISSION:
        if baseline.model.remembers:
            return _rerun(baseline, whole, scale or WHOLE)
        return _by(scale or WHOLE, transmission_change(baseline, whole))
    if whole.stage in STAGES.values():
        return _by(scale or WHOLE, sensing_change(baseline, whole))
    raise ConfigError(f'{whole.spec.name} acts at {whole.stage.value}, before the encoders; no '
                      'recording of the encoders shows it to a model that is driven by them')


def _by(scale, change):
    """A column that is not exact, from the change at an amplitude."""
    return {kind: values / scale for kind, values in change.items()}, scale, False


def _with(model, *added):
    """Terms of a model and some more, order of the registry."""
    return tuple(sorted((*model.terms, *added), key=lambda t: TERMS.index(type(t))))


def prepared(model, *added):
    """Return (SoftBody, body terms) of a model with more body terms."""
    terms = tuple(t for t in _with(model, *added) if t.stage is Stage.BODY)
    body = model.specimen.body
    for one in terms:
        body = one.prepare(body)
    return body, terms


def _restructures(baseline, term):
    """True if terms of this class take the tangent away; asked once of each class."""
    known = baseline.restructures
    if type(term) not in known:
        known[type(term)] = rebuilt(baseline.model.body, prepared(baseline.model, term)[0])
    return known[type(term)]


def rebuilt(old, new):
    """True if no tangent leads from one SoftBody to the other: nodes held otherwise, contact."""
    same = (np.array_equal(old.fixed, new.fixed)
            and np.array_equal(touches(old), touches(new))
            and old.mesh.connectivity.shape == new.mesh.connectivity.shape
            and all(np.array_equal(a.nodes, b.nodes)
                    for a, b in zip(old.pads, new.pads, strict=True))
            and len(old.supports.nodes) == len(new.supports.nodes))
    return not same


def _supported(baseline, term, scale):
    """Condensed to the nodes of a support or loose pad without memory, else run in full."""
    body, terms = prepared(baseline.model, term)
    if touches(body).any() and not any(one.memory(body) is not None for one in terms):
        return _by(scale, loosened_change(baseline, term))
    change = supported_change(baseline, term)
    return _rerun(baseline, term, scale) if change is None else _by(scale, change)


def supported_change(baseline, term):
    """Return the change kind -> (n, c, 3) by a term that is a support only (`condensation`).

    None where it is more than that, pads touch or something remembers; NaN where no balance is
    found.
    """
    changes = support_changes(baseline, term)
    return None if changes is None else _difference(baseline, changes)


def support_changes(baseline, term):
    """`supported_change` of the truth: n dicts kind -> (c, 3), or None."""
    body, terms = prepared(baseline.model, term)
    if touches(body).any() or remembers(body, terms):
        return None
    changes = interface_change(baseline, body)
    return None if changes is None else [baseline.split(change) for change in changes]


def loosened_change(baseline, term, near=np.inf, back=0.0):
    """Return the change kind -> (n, c, 3) by a term that unbonds pads (`pad_friction`).

    baseline : of a model without memory;  near, back : as in `pad_friction.slip_change`
    NaN from a state on that is not found
    """
    changes = slip_change(baseline, prepared(baseline.model, term)[0], near, back)
    return _difference(baseline, [baseline.split(change) for change in changes])


def _rerun(baseline, term, scale):
    """Full nonlinear runs with and without, on the same states."""
    model = ForwardModel(baseline.model.specimen, _with(baseline.model, term))
    new = model.predict(baseline.encoder, baseline.t)
    return {kind: (new.get(kind) - baseline.shown[kind]) / scale for kind in STAGES}, scale, True


def body_change(baseline, term):
    """Return the first-order change kind -> (n, c, 3) that a body term makes, at its amplitude.

    The term may change moduli, loads, the motion of held nodes, the shape at rest and what is
    remembered; which nodes are held, supported or touched it must not (`rebuilt`).
    """
    return _difference(baseline, body_changes(baseline, (term,)))


def body_changes(baseline, added):
    """`body_change` of the truth by body terms together: n dicts kind -> (c, 3)."""
    model = baseline.model
    body, terms = prepared(model, *added)
    fractions = _moduli_alone(baseline, body, terms)
    if fractions is not None:
        places = {i: baseline.split(baseline.by_modulus[i] @ fractions)
                  for i in baseline.places()}
        return [places[i] for i in baseline.place.tolist()]
    rates, known, changes = Rates(baseline, body), {k: [] for k in baseline.places()}, []
    still = body.pads is model.body.pads and not rates.shift.any()
    attached = model.attached if still else attach(model.specimen, body)
    for i, fields in _states(baseline, body, terms, rates.shift):
        at = known[baseline.place[i]]
        if not any(same_fields(fields, other) for other, _ in at):
            at.append((fields, _first_order(baseline, i, body, attached, rates, fields)))
        changes.append(next(change for other, change in at if same_fields(fields, other)))
    return changes


def _first_order(baseline, i, body, attached, rates, fields):
    """Change kind -> (c, 3) of the truth at state i by another body, attachment and StepFields."""
    model, x = baseline.model, baseline.x(i) + rates.shift
    push = baseline.path.at(baseline.t[i:i + 1])[0]
    pads = push[:, None] * np.array([pad.direction for pad in body.pads])
    motion = moved_from_rest(body, pads, fields.base) - x
    change = baseline.split(baseline.sensitivity(i).change(motion, rates.at(i, fields)))
    moved = attached.points(x, pads, fields.base) - model.attached.points(
        baseline.x(i), baseline.pads(i), baseline.base(i))
    k = len(model.specimen.markers)
    return change | {OPTICAL: change[OPTICAL] + moved[:k], EM: change[EM] + moved[k:]}


def _moduli_alone(baseline, body, terms):
    """Change (m,) of the moduli, in parts of them, of a body that differs in these alone, or None.

    Forces are linear in them as long as their ratio stays, on which the quadrature depends.
    """
    plain = baseline.model.body
    if baseline.by_modulus is None or any(term.memory(body) is not None for term in terms):
        return None
    if not alike(plain, body, but=('mu', 'kappa')):
        return None
    if not np.allclose(body.mu * plain.kappa, plain.mu * body.kappa, rtol=1e-12, atol=0.0):
        return None
    return (body.mu / plain.mu - 1.0).astype(np.float32)


def _states(baseline, body, terms, shift):
    """(state, StepFields) of each, with the memory of all terms carried along the baseline."""
    path, at = baseline.trajectory, baseline.at
    if not any(term.memory(body) is not None for term in terms):
        path, at = path.take(at), np.arange(len(at))
    if shift.any():
        path = Trajectory(path.t, path.pads, path.x + shift, path.force, path.base, path.outcomes)
    return enumerate(evolve(body, terms, path, at))


def transmission_change(baseline, term):
    """Return the first-order change kind -> (n, c, 3) by a transmission term at its amplitude."""
    return _difference(baseline, transmission_changes(baseline, (term,)))


def transmission_changes(baseline, added):
    """`transmission_change` of the truth by terms together: n dicts kind -> (c, 3)."""
    model, encoder = baseline.model, baseline.encoder
    states = baseline.trajectory
    push = -np.einsum('mpi,pi->mp', states.force, model.directions)
    effort = Path(states.t, push).at(encoder.t)
    path = transmitted(_with(model, *added), encoder, effort)
    before = transmitted(model.terms, encoder, effort)
    moved = path.at(baseline.t) - before.at(baseline.t)
    return [baseline.pads_moved(i, moved[i]) for i in range(len(baseline.t))]


def sensing_change(baseline, term):
    """Return the change kind -> (n, c, 3) by a sensing term at its amplitude.

    Exact but for a clock's lateness, of which the motion of the pads meanwhile is taken.
    """
    nothing = [dict.fromkeys(STAGES, 0.0)] * len(baseline.t)
    return _difference(baseline, nothing, (term,))


def together(baseline, added):
    """Return the change kind -> (n, c, 3) by terms of any stage at once, each at its amplitude.

    Forces that tissue terms add are those at the positions of the baseline, in full; what the
    body gives way to them, to supports and to pads that move is to first order. Raises
    NotConverged where a support is asked for beside memories of the baseline.
    """
    by_stage, body = split(added), baseline.model.body
    bonded = [t for t in by_stage[Stage.BODY]   # a support so small that it holds no node is one
              if not rebuilt(body, prepared(baseline.model, t)[0])]
    parts = [body_changes(baseline, bonded)] if bonded else []
    if by_stage[Stage.TRANSMISSION]:
        parts.append(transmission_changes(baseline, by_stage[Stage.TRANSMISSION]))
    parts += [support_changes(baseline, t) for t in by_stage[Stage.BODY] if t not in bonded]
    if any(part is None for part in parts):
        raise NotConverged('a support beside memories of the model has no answer to first order')
    nothing = dict.fromkeys(STAGES, 0.0)
    changes = [{kind: sum(one[kind] for one in (nothing, *state)) for kind in STAGES}
               for state in zip(*parts, strict=True)] or [nothing] * len(baseline.t)
    return _difference(baseline, changes, tuple(
        t for t in added if t.stage in STAGES.values()))


def _difference(baseline, changes, added=()):
    """Change of what the sensors show, kind -> (n, c, 3), by changes of the truth at each state.

    added : sensing terms besides those of the model
    """
    terms = _with(baseline.model, *added)
    new = baseline.readings(changes, terms)
    return {kind: new[kind] - baseline.shown[kind] for kind in STAGES}
