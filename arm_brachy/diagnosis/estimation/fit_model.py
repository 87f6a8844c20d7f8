"""One recording in a full fit: its predictions at any values of the terms, and their derivatives.

Test: diagnosis/forward/test_refit.py
"""

import copy
from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.core.errors import MeshError, NotConverged
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.likelihood.observation import Observables, channels_of
from arm_brachy.diagnosis.model.forward import STAGES, STATICS, ForwardModel
from arm_brachy.diagnosis.model.hypothesis import LOOSENING
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.memory_trajectory import Alongside
from arm_brachy.diagnosis.model.pad_friction import NEAR
from arm_brachy.diagnosis.model.sensitivities import (
    body_change,
    loosened_change,
    prepared,
    sensing_change,
    together,
    transmission_change,
)
from arm_brachy.diagnosis.model.specimen import Specimen
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside
from arm_brachy.registry import TERMS
from arm_brachy.tissue.contact_pads import touches
from arm_brachy.tissue.newton import NewtonOptions
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

# Of what terms do to a recording, the part that their tangents may have wrong where they lead the
# fit: every full run then leaves that part of the step before it open.
BENT = 0.1
# Of the step of a difference, in which the pressure on a support changes little: it comes in over
# some micrometres.
FINE = 1e-3
STEPS = NewtonOptions(tolerance=1e-7)       # m: of these no differences are taken


@dataclass(frozen=True)
class Data:
    """One recording, for a fit.

    specimen : specimen.Specimen to run;  encoder : transmission.Path;  t : (n,) [s] states
    observables : observation.Observables;  U : (N, k) whitened columns of nuisances and mesh
    terms : that the model has anyway;  baseline : Baseline of that model at t, None = to be made
    finer : kind -> (n, c, 3) that elements of no size add to every prediction, {} = nothing
    absent : numbers of the hypotheses that do not act in this recording
    own : (k,) True for columns of U that other recordings do not share, which have theirs in the
        same order; None = all
    """

    specimen: Specimen
    encoder: Path
    t: np.ndarray
    observables: Observables
    U: np.ndarray
    terms: tuple = ()
    baseline: Baseline | None = None
    finer: dict = field(default_factory=dict)
    absent: tuple = ()
    own: np.ndarray | None = None

    def __post_init__(self):
        if self.own is None:
            object.__setattr__(self, 'own', np.ones(self.U.shape[1], dtype=bool))

    def beside(self, columns):
        """The Data with more columns (N, m) of its own beside U."""
        return replace(self, U=np.hstack([self.U, columns]),
                       own=np.append(self.own, np.ones(columns.shape[1], dtype=bool)))

    def present(self, terms):
        """Those of the terms, one per hypothesis, that act in this recording."""
        return tuple(term for i, term in enumerate(terms) if i not in self.absent)

    def plain(self):
        """The Baseline of the model as it is anyway."""
        if self.baseline is not None:
            return self.baseline
        return Baseline(ForwardModel(self.specimen, self.terms, options=STATICS), self.encoder,
                        self.t)

    def modulus_apart(self, terms):
        """(factor of the modulus, other terms) where that scales forces and moves nothing.

        (1, terms) where it may do more. Equations of a body that nothing loads are homogeneous
        in it, contact's layer too (`tissue.contact`); weight, springs and actuators that yield are
        not, nor what other terms make of tissue and force sensors.
        """
        others = tuple(term for term in terms if not isinstance(term, StiffnessScale))
        body = self.specimen.body
        if (body.gravity.any() or body.nodal_force is not None or len(others) != len(terms) - 1
                or any(term.stage not in (STAGES[OPTICAL], STAGES[EM])
                       for term in (*self.terms, *others))):
            return 1.0, terms
        return next(term.factor for term in terms if isinstance(term, StiffnessScale)), others

    def residual(self, shown):
        """(N,) measured less what is shown, kind -> (n, c, 3), and finer elements add."""
        return self.observables.residual(shown) - self.observables.whiten_shift(self.finer)


class RecordingFit:
    """Predictions of one Data and their derivatives.

    terms : what is to be fitted, where the fit starts: those that act on sensors alone share one
        Baseline; pads that they loosen are condensed to their faces (`pad_friction`)
    runs : forward runs made
    beside : Baseline of the model without the terms, by whose adjoints all predictions are made
        and to which `correct` adds what a full run is more; None = all are full runs. Memories
        are answered so, and what bends by less than BENT where the fit starts.
    open : how large all that is, and the effect of the terms, squared, over the noise beside
        nuisances; infinite before memories were run
    Raises NotConverged for memories beside pads that touch.
    """

    def __init__(self, data, terms):
        self.data, self.runs = data, 0
        self._added, self._still, self.beside, self.open = {}, None, None, (0.0, 0.0)
        self._memories = False
        self._last = None   # equilibria of the model before, from which those of the next begin
        self._bonded = None     # (terms, Baseline) of the model before whose pads come loose
        if data.baseline is not None:
            self._last = data.baseline.model.equilibria
        terms = data.present(terms)
        if all(term.stage in STAGES.values() for term in terms):
            self._still = self._plain()
            return
        whole = self.model(terms)
        if touches(whole.body).any():
            bonded = self.model(_bonding(terms))
            if bonded.remembers or bonded.timed:
                raise NotConverged('memories beside pads that touch ask for a run with contact '
                                   'at every step: it takes hours')
        elif whole.remembers:
            self.beside, self.open, self._memories = self._plain(), (np.inf, 1.0), True
        else:
            self._led_if_straight(whole, terms)

    def _led_if_straight(self, whole, terms):
        """Take the way of `beside` if terms do to first order what `whole` has them do in full."""
        plain = self.data.baseline
        if plain is None or not all(_has_tangent(plain.model, term) for term in terms):
            return
        full = self._run(whole)
        if full is None:
            return
        self.beside = plain
        self._add(full, self._to_first_order(terms))
        self._leave_if_bent()

    def _leave_if_bent(self):
        """Have all predictions be full runs from now on where tangents have too much wrong."""
        if self.open[0] > BENT**2 * self.open[1]:
            self.beside, self.open, self._added = None, (0.0, 0.0), {}

    def _plain(self):
        """`Data.plain`, a run where it is made."""
        self.runs += self.data.baseline is None
        return self.data.plain()

    def model(self, terms):
        """The ForwardModel with terms besides the known ones."""
        self.runs += 1
        model = ForwardModel(self.data.specimen, (*self.data.terms, *terms), options=STATICS)
        if model.equilibria is not None:
            if isinstance(self._last, type(model.equilibria)):
                model.equilibria.begin_from(self._last)
            self._last = model.equilibria
        return model

    def predicted(self, terms):
        """(ForwardModel, kind -> (n, c, 3)) with terms, None for a state that is not found."""
        terms = self.data.present(terms)
        if self._still is not None:
            return self._still.model, self._offset(self._sensed(terms))
        if self.beside is not None:
            return self.beside.model, self._offset(self._to_first_order(terms))
        model = self.model(terms)
        found = self._loosened(terms) if touches(model.body).any() else self._run(model)
        return model, None if found is None else self._offset(found)

    def _loosened(self, terms):
        """Prediction with pads that a term takes off their bonds, None where it is not found."""
        loose, = (term for term in terms if term not in _bonding(terms))
        factor, others = self.data.modulus_apart(_bonding(terms))
        if self._bonded is None or self._bonded[0] != others:
            self._bonded = others, self._plain() if not others else Baseline(
                self.model(others), self.data.encoder, self.data.t)
        bonded = self._bonded[1]
        change = loosened_change(bonded, loose, NEAR)
        found = {kind: bonded.shown[kind] + change[kind] for kind in STAGES}
        found[FORCE] = factor * found[FORCE]
        return found if all(np.isfinite(one).all() for one in found.values()) else None

    def correct(self, terms, shown):
        """Run the model in full: from now on that is added to which `shown` with terms lacks.

        shown : as `predicted`. Nothing where all predictions are full runs. Raises NotConverged
        where a state is not found.
        """
        if self.beside is not None:
            full = self._run(self._in_full(self.data.present(terms)))
            if full is None:
                raise NotConverged('the model, run in full, has a state that is not found; start '
                                   'from fainter effects')
            self._add(full, shown)
            if not self._memories:
                self._leave_if_bent()

    def _add(self, full, shown):
        """Add from now on what a full run has more than is shown."""
        residual, alone = self.data.residual, Beside(self.data.U)
        for kind in STAGES:
            self._added[kind] = self._added.get(kind, 0.0) + full[kind] - shown[kind]
        self.open = (alone.square(self.data.observables.whiten_shift(self._added)),
                     alone.square(residual(self.beside.shown) - residual(full)))

    def _to_first_order(self, terms):
        change = together(self.beside, terms)
        return {kind: self.beside.shown[kind] + change[kind] for kind in STAGES}

    def _in_full(self, terms):
        """The ForwardModel with terms, memories stepped along the motion without them."""
        model, plain = self.model(terms), self.beside
        if not model.remembers:
            return model
        return ForwardModel(
            self.data.specimen, model.terms, options=STEPS,
            alike=Alongside(plain.trajectory, plain.model.body.mesh.nodes))

    def _run(self, model):
        found = model.predict(self.data.encoder, self.data.t)
        return {kind: found.get(kind) for kind in STAGES} if found.valid.all() else None

    def _sensed(self, terms):
        every = sorted((*self.data.terms, *terms), key=lambda term: TERMS.index(type(term)))
        nothing = [dict.fromkeys(STAGES, 0.0)] * len(self.data.t)
        return self._still.readings(nothing, every)

    def _offset(self, shown):
        return {kind: shown[kind] + self._added.get(kind, 0.0) for kind in STAGES}

    def columns(self, space, now, model):
        """Return (N, k): change of the prediction over the noise per coordinate at a _Point.

        Central differences, one-sided at a limit and where the term does not fit the mesh at one
        end. Raises NotConverged where a full run fails, or it fits at neither.
        """
        baseline, changes = None, {}
        if self._still is None and self.beside is None and not touches(model.body).any():
            self.runs += 1
            baseline = Baseline(model, self.data.encoder, self.data.t)
        for number, term in enumerate(now.terms):
            changes[number] = (self._unchanged, 1.0) if number in self.data.absent else (
                self._change(baseline, number, term))
        low, high = space.joined('low'), space.joined('high')
        out = []
        for number, step in zip(space.owner, np.diag(space.joined('step')), strict=True):
            change, share = changes[number]
            ends = np.maximum(now.z - share * step, low), np.minimum(now.z + share * step, high)
            out.append(_slope(lambda z, by=change: by(space.terms(z)), now.z, ends))
        return self.data.observables.whiten(
            {kind: np.stack([one[kind] for one in out], axis=3) for kind in STAGES})

    def _unchanged(self, terms):
        """Prediction but for a constant by a term that does not act here."""
        return {kind: np.zeros((len(self.data.t), len(names), 3))
                for kind, names in channels_of(self.data.specimen).items()}

    def _change(self, baseline, number, term):
        """(Function from terms, one of them varied, to the prediction but for a constant; share of
        its steps by which it may be varied).
        """
        by = _CHANGES.get(term.stage, sensing_change)
        if self.beside is not None and term.stage is not Stage.BODY:
            return lambda terms: by(self.beside, terms[number]), 1.0
        if baseline is None or term.stage is Stage.TRANSMISSION and baseline.model.remembers:
            return self._varied, 1.0
        view, share = _struck(baseline, term), 1.0
        if not _has_tangent(baseline.model, term):
            by, share = _support_change, FINE
        return lambda terms: by(view, terms[number]), share

    def _varied(self, terms):
        found = self.predicted(terms)[1]
        if found is None:
            raise NotConverged('no state was found beside one that was, where the derivative by '
                               'a contact is asked for; hold its place or its size')
        return found


def _slope(change, z, ends):
    """kind -> (n, c, 3) slope of `change` between two ends (k,); z in the place of a refused one.

    Raises NotConverged where the mesh refuses both, or the one that is not z.
    """
    found, refused = [], None
    for end in ends:
        try:
            found.append((end, change(end)))
        except MeshError as error:
            refused = error
    if refused is not None and all(np.array_equal(end, z) for end, _ in found):
        raise NotConverged(f'no derivative beside a model that the mesh refuses: {refused}')
    if refused is not None:
        found.append((z, change(z)))
    (one, there), (other, here) = found
    width = np.sum(other - one)
    return {kind: (here[kind] - there[kind]) / width for kind in STAGES}


def _bonding(terms):
    """The terms that leave pads on their bonds."""
    return tuple(term for term in terms if term.spec.name not in LOOSENING)


_CHANGES = {Stage.BODY: body_change, Stage.TRANSMISSION: transmission_change}


def _support_change(view, term):
    """`body_change` by other values of a support that the body of a struck Baseline has.

    Raises MeshError where these hold other nodes.
    """
    if not np.array_equal(prepared(view.model, term)[0].fixed, view.model.body.fixed):
        raise MeshError(f'{term.spec.name}: other nodes are held beside its present values; must '
                        'be the same for a tangent')
    return body_change(view, term)


def _has_tangent(model, term):
    """True if a model without the term answers to it as the tangent of `sensitivities` says."""
    if term.stage is Stage.BODY:
        body = term.prepare(model.specimen.body)
        return not len(body.supports.nodes) and not touches(body).any()
    return term.stage is not Stage.TRANSMISSION or not model.remembers


def _struck(baseline, term):
    """The Baseline with a term struck from its list, not from its states.

    What `sensitivities` then adds is not a second term but another value of this one.
    """
    view = copy.copy(baseline)
    view.model = copy.copy(baseline.model)
    view.model.terms = tuple(one for one in baseline.model.terms if one is not term)
    return view
