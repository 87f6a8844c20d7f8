"""A model's states in a recording and how every observable there answers to forces and motions.

Test: diagnosis/forward/test_responses.py
"""

import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm_brachy.core.errors import ConfigError, InputError, NotConverged
from arm_brachy.diagnosis.model.forward import STAGES
from arm_brachy.diagnosis.model.trajectory import evolve, grid
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.tissue.contact_pads import touches
from arm_brachy.tissue.jacobian import Linearisation, pad_translations
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.sensitivity import log_modulus_derivative

NEAR = 3e-4     # m: states whose pads are closer share a factor. Positions and forces stay their
                # own; answers err by NEAR over the radius of a pad, 4 %


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of r observables at one state: the points in the tissue, then the pad forces.

    force : (r, 3n) adjoint states a': minus the derivative by a change of `Assembler.forces` at
        fixed x, single precision; zero at fixed nodes
    held : (d,) the rows of held nodes, 3 node + axis;  motion : (r, d) derivative by their motion
    pads : (r, p, 3) derivative by displacements of the pads
    """

    force: np.ndarray
    held: np.ndarray
    motion: np.ndarray
    pads: np.ndarray

    def change(self, motion, rate):
        """Return the change (r,) by a motion (n, 3) [m] of held nodes and a rate (n, 3) [N]."""
        return (self.motion @ motion.ravel()[self.held]
                - self.force @ rate.ravel().astype(np.float32))


class Baseline:
    """A forward.ForwardModel along a recording, linearised at n states.

    model : ForwardModel with pads bonded;  encoder : transmission.Path
    t : (n,) [s], increasing, stamps of the recording
    lasting : True for answers to what never changed since the start, beside memories
    trajectory : trajectory.Trajectory with the times between, for memories;  at : (n,) the states
        in it;  path : transmission.Path of the pads;  forces : (n, nodes, 3) [N]
    truth : n dicts kind -> (c, 3), before the sensors and their clocks
    fields : n StepFields;  group : (n,) into `sensitivities`
    place : (n,) number of the first state that is the same but for the time: pads in one place
    by_modulus : n arrays (r, m), derivative by log E of every element, its ratio kept, single
        precision; None where the model's memory adds stress that is not linear in it
    restructures : term class -> bool, condensed : condensation.Condensed, loosened : as
        `pad_friction` keeps it, columns : as `sensitivities` keeps them; filled when first wanted
    Raises InputError for instants out of order, ConfigError for touching pads, NotConverged at a
    state that is not found
    or not stable. Linear answers of a model with memory leave out what the change would have
    done to the memory until then.
    """

    def __init__(self, model, encoder, t, *, lasting=False):
        if touches(model.specimen.body).any():
            raise ConfigError(f'scene {model.specimen.scene.name} has pads that touch; must be '
                              'bonded for a diagnosis; give the scene with contact: bonded, that '
                              'a pad slips is then found')
        if touches(model.body).any():
            raise ConfigError('the model has pads that touch; must be bonded to be linearised; '
                              'leave pad_slip out, or fit it by full runs')
        self.model, self.encoder, self.t = model, encoder, np.asarray(t, dtype=float)
        if np.any(np.diff(self.t) <= 0.0):
            raise InputError('the instants of the states do not increase; must be in order, each '
                             'once; sort them')
        self.path = model.pad_path(encoder, self.t)
        self.trajectory = model.trajectory(self.path, self.t, kinks=True)
        self._refuse_lost()
        self.at = np.searchsorted(self.trajectory.t, self.t)
        self.truth = [model.truth(self.trajectory, i) for i in self.at]
        self.restructures, self.condensed, self.loosened, self.columns = {}, None, {}, {}
        self.solver = StaticSolver(model.body)
        self.fields = self._fields(self.trajectory, lasting=lasting)
        self.forces = np.stack([self.solver.assembler.forces(self.x(i), fields)
                                for i, fields in enumerate(self.fields)])
        self.place = self._places()
        self.group, first = self._groups()
        self.sensitivities = self._linearise(first)
        self.by_modulus = self._by_modulus()

    def x(self, i):
        """Positions (n, 3) [m] of the nodes at state i."""
        return self.trajectory.x[self.at[i]]

    def pads(self, i):
        """Displacements (p, 3) [m] of the pads at state i."""
        return self.trajectory.pads[self.at[i]]

    def base(self, i):
        """Displacement (3,) [m] of the base at state i."""
        return self.trajectory.base[self.at[i]]

    def take(self, index):
        """The Baseline at some of its states, index (k,), nothing solved for anew."""
        part, index = copy.copy(self), np.asarray(index)
        part.__dict__.pop('shown', None)
        part.t = self.t[index]
        part.trajectory = self._passing(part.t)
        part.at = np.searchsorted(part.trajectory.t, part.t)
        part.loosened, part.columns = {}, {}
        part.truth, part.fields = ([some[i] for i in index] for some in (self.truth, self.fields))
        part.forces, part.group = self.forces[index], self.group[index]
        if self.by_modulus is not None:
            part.by_modulus = [self.by_modulus[i] for i in index]
        part.place = np.unique(self.place[index], return_index=True, return_inverse=True)
        part.place = part.place[1][part.place[2].ravel()]
        return part

    def _passing(self, t):
        """The trajectory at t (k,) and the times between that lie on the way there."""
        if len(self.trajectory.t) == len(self.t):
            return self.trajectory.take(np.searchsorted(self.trajectory.t, t))
        return self.trajectory.take(
            np.flatnonzero(np.isin(self.trajectory.t, grid(self.path, t))))

    def lasting_fields(self, shift=0.0):
        """n StepFields of steps without end, memories of positions `shift` (nodes, 3) [m] off."""
        return self._fields(replace(self.trajectory, x=self.trajectory.x + shift), lasting=True)

    def places(self):
        """The first state of every place."""
        return np.unique(self.place).tolist()

    def sensitivity(self, i):
        """The Sensitivity of state i."""
        return self.sensitivities[self.group[i]]

    @cached_property
    def shown(self):
        """What the sensors of the model show, kind -> (n, c, 3)."""
        return self.readings([dict.fromkeys(STAGES, 0.0)] * len(self.t), self.model.terms)

    def readings(self, changes, terms):
        """What sensors with these terms show at all states, kind -> (n, c, 3).

        changes : n dicts kind -> (c, 3) or 0, of the truth;  terms : of any stage
        Of a clock's lateness the motion of the pads meanwhile is taken, to first order.
        """
        out = {}
        for kind in STAGES:
            true = [values[kind] + change[kind]
                    for values, change in zip(self.truth, changes, strict=True)]
            out[kind] = np.stack(self._sensed(kind, true, terms))
        return out

    def _sensed(self, kind, true, terms):
        """What a stream shows of its true values, n times (c, 3)."""
        terms = [term for term in terms if term.stage is STAGES[kind]]
        if not terms:
            return true
        late, out = sum(term.lateness for term in terms), []
        for i, values in enumerate(true):
            t = max(self.t[i] - late, self.encoder.t[0])
            if late:
                now, then = self.path.at(np.array([self.t[i], t]))
                values = values + self.pads_moved(i, then - now)[kind]
            out.append(self.model.sense(kind, t, values, self.pads(i), terms=terms,
                                        start=self.encoder.t[0]))
        return out

    def pads_moved(self, i, moved):
        """Change kind -> (c, 3) at state i by pads moved by (p,) [m] along their directions."""
        return self.pads_shifted(i, moved[:, None] * self.model.directions)

    def pads_shifted(self, i, pads):
        """Change kind -> (c, 3) at state i by pads that are `pads` (p, 3) [m] off, as discs."""
        return self._with_riders(np.einsum('rpi,pi->r', self.sensitivity(i).pads, pads),
                                 self.model.attached.on_pad @ pads)

    def pads_turned(self, i, turns):
        """Change kind -> (c, 3) at state i by pads turned by `turns` (p, 3) [rad] in place."""
        body, attached, known = self.model.body, self.model.attached, self.sensitivity(i)
        motion, rides = np.zeros_like(body.mesh.nodes), np.zeros_like(attached.rest)
        for p, (pad, moved, turn) in enumerate(zip(body.pads, self.pads(i), turns, strict=True)):
            motion[pad.nodes] = np.cross(turn, self.x(i)[pad.nodes] - (pad.centre + moved))
            rides += attached.on_pad[:, p:p + 1] * np.cross(turn, attached.rest - pad.centre)
        return self._with_riders(known.motion @ motion.ravel()[known.held], rides)

    def _with_riders(self, change, rides):
        """A change (r,) of observables and rides (k + e, 3) [m] of points on pads, by stream."""
        change, k = self.split(change), len(self.model.specimen.markers)
        return {OPTICAL: change[OPTICAL] + rides[:k], EM: change[EM] + rides[k:],
                FORCE: change[FORCE]}

    def split(self, change):
        """Sort a change (r,) of observables by stream: kind -> (c, 3), zero off the tissue."""
        inside, k = self.model.attached.inside, len(self.model.specimen.markers)
        points = np.zeros((len(inside), 3))
        points[inside] = change[:3 * inside.sum()].reshape(-1, 3)
        return {OPTICAL: points[:k], EM: points[k:],
                FORCE: change[3 * inside.sum():].reshape(-1, 3)}

    @property
    def _single(self):
        """True if no two states need be alike, whatever the pads do."""
        return self.model.remembers or self.model.timed

    def _refuse_lost(self):
        valid = self.trajectory.valid
        if not valid.all():
            i = int(np.argmin(valid))
            outcome = self.trajectory.outcomes[i]
            raise NotConverged(f'the model has no state at {self.trajectory.t[i]:.2f} s '
                               f'({outcome.name}: {outcome.advice})')

    def _fields(self, trajectory, *, lasting=False):
        return evolve(self.model.body, self.model.body_terms, trajectory, self.at,
                      lasting=lasting)

    def _places(self):
        if self._single:
            return np.arange(len(self.t))
        _, first, place = np.unique(self.trajectory.x[self.at].reshape(len(self.t), -1), axis=0,
                                    return_index=True, return_inverse=True)
        return first[place.ravel()]

    def _groups(self):
        """(group (n,), its first state): alike in the places of the pads, one each with memory."""
        if self._single:
            return np.arange(len(self.t)), np.arange(len(self.t))
        flat = self.trajectory.pads[self.at].reshape(len(self.t), -1)
        group, first = np.full(len(self.t), -1), []
        for i in range(len(self.t)):
            if group[i] < 0:
                close = np.abs(flat - flat[i]).max(axis=1, initial=0.0) <= NEAR
                group[close & (group < 0)] = len(first)
                first.append(i)
        return group, np.array(first)

    def _linearise(self, states):
        inside = self.model.attached.embedding
        n, p = self.solver.assembler.n, len(self.model.body.pads)
        k = len(inside.nodes)
        x_bar, pad_bar = np.zeros((3 * n, 3 * (k + p))), np.zeros((3 * p, 3 * (k + p)))
        x_bar[:, :3 * k] = np.kron(inside.matrix(n).toarray().T, np.eye(3))
        pad_bar[:, 3 * k:] = np.eye(3 * p)
        held, found, linearisation = _rows(self.solver.free.held), [], None
        translations = pad_translations(self.model.body)[held]
        for i in states:
            if linearisation is None:
                linearisation = Linearisation(self.solver, self.x(i), self.fields[i],
                                              single=True)
            else:
                linearisation.move_to(self.x(i), self.fields[i])
            a, h = linearisation.adjoint(x_bar, pad_bar)
            found.append(Sensitivity(
                np.ascontiguousarray(a.T, dtype=np.float32), held,
                np.ascontiguousarray(h[held].T),
                (h[held].T @ translations).reshape(-1, p, 3)))
        return found

    def _by_modulus(self):
        """The factor may be a neighbour's; what the elements bear grows with the push itself."""
        if self._single:
            return None
        found = {}
        for i in self.places():
            borne = log_modulus_derivative(self.solver.assembler, self.x(i), self.fields[i])
            found[i] = -(borne.T.astype(np.float32) @ self.sensitivity(i).force.T).T
        return [found[i] for i in self.place.tolist()]


def _rows(nodes):
    return (3 * nodes[:, None] + np.arange(3)).ravel()
