"""What a model says of a recording at given instants: encoders in, every measured stream out.

Test: diagnosis/forward/test_forward.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.model.specimen import attach
from arm_brachy.diagnosis.model.trajectory import (
    Equilibria,
    TimedEquilibria,
    grid,
    partners,
    remembers,
    stepped,
    timed,
)
from arm_brachy.diagnosis.model.transmission import balanced, transmitted, yields
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.registry import TERMS, split
from arm_brachy.tissue.newton import NewtonOptions

STATICS = NewtonOptions(tolerance=1e-8)     # m: a hundredth of what any tracker averages to

STAGES = {OPTICAL: Stage.OPTICAL, EM: Stage.EM, FORCE: Stage.FORCE}


@dataclass(frozen=True)
class Predicted:
    """A model's answer at n instants, channels in the order of the scene, world frame.

    t : (n,) [s];  markers : k names;  tools : e names
    optical : (n, k, 3) [m];  em : (n, e, 3) [m];  force : (n, p, 3) [N] of the tissue on each pad
    pads : (n, p, 3) [m] true displacements
    outcomes : n core.outcome.Outcome, the first trouble where a stream is late
    x : (n, nodes, 3) [m], None unless asked for
    Where an outcome is not OK, everything but `pads` is NaN.
    """

    t: np.ndarray
    markers: tuple
    tools: tuple
    optical: np.ndarray
    em: np.ndarray
    force: np.ndarray
    pads: np.ndarray
    outcomes: tuple
    x: np.ndarray | None = None

    @property
    def valid(self):
        """(n,) True where every stream has a value."""
        return np.array([outcome.ok for outcome in self.outcomes], dtype=bool)

    def get(self, kind):
        """The values (n, c, 3) of the stream OPTICAL, EM or FORCE."""
        return {OPTICAL: self.optical, EM: self.em, FORCE: self.force}[kind]


class ForwardModel:
    """A specimen.Specimen with terms of any stage.

    terms : instances of the registry's terms, any order
    options : NewtonOptions or None
    alike : memory_trajectory.Alongside from which steps of memories begin, None = each from
        the last
    body : SoftBody as its terms prepared it;  body_terms : those that act there
    attached : specimen.Attachment;  directions : (p, 3) in which the pads are pushed
    remembers : True if a state depends on the path to it;  timed : True if on when it is
    Setpoint terms have acted before the encoders and change nothing here. Starts are at rest: the
    body has always been where the first sample of the encoders finds it.
    Raises what a term raises that does not fit the body.
    """

    def __init__(self, specimen, terms=(), *, options=None, alike=None):
        self.specimen, self._options, self._alike = specimen, options, alike
        self.terms = tuple(sorted(terms, key=lambda term: TERMS.index(type(term))))
        self._by_stage = split(self.terms)
        self.body_terms = self._by_stage[Stage.BODY]
        body = specimen.body
        for term in self.body_terms:
            body = term.prepare(body)
        self.body, self.attached = body, attach(specimen, body)
        self.directions = np.array([pad.direction for pad in body.pads])
        self.remembers = remembers(body, self.body_terms)
        self.timed = timed(self.body_terms)
        self.equilibria = (None if self.remembers else
                           TimedEquilibria(body, self.body_terms, options) if self.timed else
                           Equilibria(body, options))

    def pad_path(self, encoder, t):
        """Return the Path of the pads, given that of the encoders, for states at t (n,) [s].

        Raises NotConverged where pads yield more than the tissue lets them.
        """
        if not yields(self.terms, encoder):
            return transmitted(self.terms, encoder)

        # the same instants in every pass: corners that come and go would make the forces jump
        instants = self._instants(encoder, np.unique(t), kinks=True)

        def effort_of(path):
            states = self._states(path, *instants)
            push = -np.einsum('mpi,pi->mp', states.force, self.directions)
            seen = states.valid
            return Path(states.t[seen], push[seen]).at(encoder.t)

        return balanced(self.terms, encoder, effort_of)

    def trajectory(self, path, t, *, kinks=False):
        """Return the Trajectory along a Path of the pads at t (n,) [s] and whatever lies between.

        kinks : ask a body without memory for the times between as well
        """
        t = np.unique(t)
        return self._states(path, *self._instants(path, t, kinks))

    def _instants(self, path, t, kinks):
        """(times (m,) to ask for, partner (m,) as in `Equilibria.trajectory`)."""
        if not self.remembers and not kinks:
            return t, None
        times = grid(path, t)
        return times, None if self.remembers else partners(path.at(times), ~np.isin(times, t))

    def _states(self, path, times, partner):
        pads = path.at(times)[:, :, None] * self.directions
        if self.remembers and self._alike is not None:
            return self._alike.trajectory(self.body, self.body_terms, times, pads, self._options)
        if self.remembers:
            return stepped(self.specimen.body, self.body_terms, times, pads, self._options)
        return self.equilibria.trajectory(times, pads, partner)

    def lateness(self, kind):
        """By how much the stamps of a stream are late [s]."""
        return sum(term.lateness for term in self._by_stage[STAGES[kind]])

    def sense(self, kind, t, values, pads, *, terms=None, start=0.0):
        """Return what the sensors of a stream show (c, 3) of the true `values` (c, 3) at t [s].

        pads : (p, 3) [m];  terms : to sense with, of any stage; None = the model's
        start : [s] of the recording: force sensors are tared then, and drift from there
        """
        names = {OPTICAL: self.specimen.markers, EM: self.specimen.tools,
                 FORCE: self.specimen.pads}[kind]
        by_stage = self._by_stage if terms is None else split(terms)
        t = t - start if kind == FORCE else t
        for term in by_stage[STAGES[kind]]:
            values = term.distort(t, names, values, pads)
        return values

    def truth(self, trajectory, i):
        """Return the true values kind -> (c, 3) at instant i of a Trajectory."""
        points = self.attached.points(trajectory.x[i], trajectory.pads[i], trajectory.base[i])
        k = len(self.specimen.markers)
        return {OPTICAL: points[:k], EM: points[k:], FORCE: trajectory.force[i]}

    def predict(self, encoder, t, *, nodes=False):
        """Return the Predicted at t (n,) [s], stamps of the recording.

        encoder : transmission.Path of the encoders, in full: it decides where the pads are
        nodes : keep the positions of the nodes
        Raises InputError if an instant lies outside the encoder's time, NotConverged as
        `pad_path`. A state that is not found is NaN, and its outcome says why.
        """
        t = np.asarray(t, dtype=float)
        _refuse_outside(t, encoder)
        when = {kind: np.maximum(t - self.lateness(kind), encoder.t[0]) for kind in STAGES}
        wanted = np.unique(np.concatenate([t, *when.values()]))
        path = self.pad_path(encoder, wanted)
        states = self.trajectory(path, wanted)
        at = np.searchsorted(states.t, t)
        values, outcomes = {}, [states.outcomes[i] for i in at]
        for kind, times in when.items():
            index = np.searchsorted(states.t, times)
            values[kind] = np.stack([self.sense(kind, states.t[i], self.truth(states, i)[kind],
                                                states.pads[i], start=encoder.t[0])
                                     for i in index])
            outcomes = [old if not old.ok else states.outcomes[i]
                        for old, i in zip(outcomes, index, strict=True)]
        lost = np.array([not outcome.ok for outcome in outcomes])
        for kind in values:
            values[kind][lost] = np.nan
        return Predicted(t, self.specimen.markers, self.specimen.tools, values[OPTICAL],
                         values[EM], values[FORCE], states.pads[at], tuple(outcomes),
                         states.x[at] if nodes else None)


def _refuse_outside(t, encoder):
    if not len(t) or t.min() < encoder.t[0] or t.max() > encoder.t[-1]:
        span = f'{t.min():g} to {t.max():g} s' if len(t) else 'no instant'
        raise InputError(f"{span} asked for; must lie within the encoders' {encoder.t[0]:g} to "
                         f'{encoder.t[-1]:g} s')
