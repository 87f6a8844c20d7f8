"""Equilibrium at every instant of a body with bonded pads, a probe that touches, a needle inside.

Iteration, r the force out of balance with the instruments' share as last known, H of `compliance`:

    y = x - H r,    needle (along, then across it) and probe in turn find their forces, which
                    change by d:  x <- y - H d

The factor is that of the tissue alone, which changes little while a probe slides; the stiffness of
the contact enters between the few nodes near the face (`probe_patch`), where it is solved for as
often as it takes. Converged when x moves by no more than the tolerance.
"""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue import dense
from arm_brachy.tissue.compliance import Compliance
from arm_brachy.tissue.contact_newton import OutOfBalance
from arm_brachy.tissue.contact_poses import between
from arm_brachy.tissue.dynamics import pad_loads
from arm_brachy.tissue.instruments import Felt, Tools
from arm_brachy.tissue.integrators import QuasiStatic, TissueState, progress, settled
from arm_brachy.tissue.linear_solver import FactorisationFailed
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.needle_beam import Bent, Sideways
from arm_brachy.tissue.needle_load import NeedleLoad, NeedleState, withdrawn
from arm_brachy.tissue.needle_path import stretch
from arm_brachy.tissue.probe_contact import ProbeContact, ProbeState
from arm_brachy.tissue.probe_reading import read, untouched

MOST_ITERATIONS = 30
# [m] No finer tolerance than this: skin under the probe's gel would show no difference.
LOOSEST = 1e-6
# A factor and the columns that it makes new cost as much as so many iterations.
FACTOR_WORTH = 10
SURE = 3            # iterations after which their pace is believed
LEAST_PART = 1 / 64  # of a step, below which it is given up
# The probe's own iteration leaves open a part of the tolerance, before that one of the correction.
INNER, EARLY = 0.1, 0.01
BACK = 5e-3         # m by which a probe that appears inside the body is drawn back, repeatedly


class Native(NamedTuple):
    """State between two steps: what is shown; ways of nodes and pads in the last one; tools."""

    state: TissueState
    way: np.ndarray
    stride: np.ndarray
    probe: ProbeState | None
    needle: NeedleState | None
    bent: Bent | None


class Instrumented(QuasiStatic):
    """A quasi-static integrator whose `step` also takes `instruments.Tools`.

    body : SoftBody with bonded pads;  options : NewtonOptions
    instruments : instruments.Instruments
    `settle` leaves instruments out: they act from the next step on.
    """

    def __init__(self, body, options, instruments):
        super().__init__(body, options)
        self._tolerance = max(self.statics.options.tolerance, LOOSEST)
        self._free = self.statics.free
        self._compliance = Compliance(self._free)
        self._face, self._law = instruments.probe, instruments.needle
        self._beam, self._columns = instruments.beam, _Columns(
            self._compliance, len(body.mesh.nodes))
        self._contact = None if self._face is None else ProbeContact(body, self._face,
                                                                           instruments.layer)
        self._faces = boundary_faces(body.mesh)

    def start(self, x, t, fields):
        """As AbstractIntegrator."""
        (state, _), _ = super().start(x, t, fields)
        state = dataclasses.replace(state, instruments=self._nothing())
        needle = None if self._law is None else NeedleState(self._law, None, 0.0, 0.0, 1.0)
        stride = np.zeros((len(self.body.pads), 3))
        bent = None if needle is None or self._beam is None else Bent(self._beam)
        return Native(state, np.zeros_like(x), stride, None, needle, bent), state

    def settle(self, native, pads, t, fields):
        """As AbstractIntegrator."""
        return settled(self, native, native.state, pads, t, fields)

    def pads(self, native):
        """As AbstractIntegrator."""
        return super().pads((native.state, None))

    def step(self, native, pads, dt, fields, tools=None):
        """As AbstractIntegrator; tools : where the instruments are after dt."""
        tools = Tools() if tools is None else tools
        try:
            found = self._whole(native, pads, dt, fields, tools)
        except OutOfBalance as failure:
            state = dataclasses.replace(native.state, outcome=failure.outcome)
            return native, state
        before = native.state
        probe = found.probe if tools.probe is not None else None
        force, moment = pad_loads(self.body, found.forces)
        residual = float(np.abs(found.forces[self._free.free]).max(initial=0.0))
        felt = Felt(found.reading, 0.0 if found.needle is None else found.needle.force,
                    _shaft(tools.needle, found.bent))
        state = TissueState(before.t + dt, found.x, (found.x - before.x) / dt, force, moment,
                            Outcome.OK, found.iterations, residual, instruments=felt)
        stride = np.asarray(pads, dtype=float) - self.pads(native)
        return Native(state, found.x - before.x, stride, probe, found.needle, found.bent), state

    def _nothing(self):
        return Felt(None if self._face is None else untouched(self._face))

    def _whole(self, native, pads, dt, fields, tools):
        """_Found after dt, in as few parts as lead there."""
        goal = self.statics.held_positions(pads, fields.base)
        motion = _Motion.of(self, native, goal, dt, tools)
        trend = progress(native.stride, np.asarray(pads) - self.pads(native)) * native.way
        now = _Found(native.state.x, motion.probe, native.needle, native.bent, None, None, 0)
        if not self._compliance.ready:
            self._factorise(now.x, fields)
        if trend.any():
            try:
                return self._part(now, motion, 0.0, 1.0, trend, fields)
            except OutOfBalance:
                pass    # not from there; now from where it is
        t, size, spent, fresh = 0.0, 1.0, 0, False
        while t < 1.0:
            ahead = min(1.0, t + size)
            if not self._compliance.ready:  # lost where an iterate had no tangent to factorise
                self._factorise(now.x, fields)
            try:
                now = self._part(now, motion, t, ahead, np.zeros_like(now.x), fields)
            except OutOfBalance:
                size /= 2.0
                if size < LEAST_PART:
                    raise
                if not fresh:
                    self._factorise(now.x, fields)
                    fresh = True
                continue
            t, size, spent, fresh = ahead, 2.0 * size, spent + now.iterations, False
        return dataclasses.replace(now, iterations=spent)

    def _part(self, now, motion, t, ahead, trend, fields):
        """_Found from t to `ahead`, parts of the whole."""
        x = now.x + trend
        held = self._free.held
        x[held] = (motion.start + ahead * (motion.goal - motion.start))[held]
        needle, X, sideways = None, None, None
        if motion.needle is not None:
            path = motion.needle.at(motion.depth(ahead))
            there = path if now.bent is None else now.bent.shaft(path)
            needle = NeedleLoad(now.needle, there, stretch(self.body.mesh, self._faces, there,
                                                           now.x), now.x, (ahead - t) * motion.dt)
            if now.bent is not None:
                sideways = Sideways(now.bent.withdrawn(path.depth), path)
        if motion.X_WP is not None:
            X = between(motion.probe.X_WP[None], motion.X_WP[None], ahead)[0]
        return self._balance(x, _Acting(self, now, X, needle, sideways), fields)

    def _balance(self, x, act, fields):
        """Iterate from x (n, 3) with the instruments `act` (_Acting)."""
        H, free = self._compliance, self._free.free
        pace, last, size = _Pace(self._tolerance), None, 0.0
        for count in range(1, MOST_ITERATIONS + 1):
            now = self.statics.assembler.evaluate(x, fields)
            if not now.min_J > 0.0:
                raise OutOfBalance(Outcome.INVERTED_ELEMENT)
            g = now.forces[free].ravel()
            r = g + act.gradient[free].ravel()
            raw = H.raw(r)
            if last is not None:
                H.learn(last[0], g - last[1], raw - last[2])
            y = x.copy()
            y[free] -= H.updated(r, raw).reshape(-1, 3)
            d, raw_d = act.respond(y, max(INNER * self._tolerance, EARLY * size))
            move = -H.updated(r + d, raw + raw_d)
            size = np.abs(move).max(initial=0.0)
            new = x.copy()
            new[free] += move.reshape(-1, 3)
            if size <= self._tolerance:
                return act.found(new, now.forces + act.gradient, count)
            if pace.slow(size):
                self._factorise(new, fields)
                last = None
            else:   # A^-1 g of the next is A^-1 r there less that of the instruments' new share
                last = (move, g, raw + raw_d)
            x = new
        raise OutOfBalance(Outcome.NOT_CONVERGED)

    def _factorise(self, x, fields):
        """The tangent at x, or where that is indefinite, the nearest that is not."""
        for convex in (False, True):
            try:
                self._compliance.factorise(self.statics.assembler.tangent(x, fields,
                                                                          convex=convex))
            except FactorisationFailed:
                continue
            return
        raise OutOfBalance(Outcome.NOT_CONVERGED)


@dataclass(frozen=True)
class _Found:
    """Positions, states of the tools, gradient (n, 3) of everything, ProbeReading, count."""

    x: np.ndarray
    probe: ProbeState | None
    needle: NeedleState | None
    bent: Bent | None
    forces: np.ndarray | None
    reading: object
    iterations: int


@dataclass(frozen=True)
class _Motion:
    """One step's motion: held nodes from `start` to `goal`, the probe to X_WP, the needle."""

    start: np.ndarray
    goal: np.ndarray
    probe: ProbeState | None
    X_WP: np.ndarray | None
    needle: object
    first: float | None
    dt: float

    @classmethod
    def of(cls, integrator, native, goal, dt, tools):
        """The motion from `native`; a probe that appears comes along its own axis."""
        x, probe, X = native.state.x, native.probe, None
        contact = integrator._contact
        if tools.probe is not None and contact is not None:
            X = contact.pose(*tools.probe)
            probe = _drawn_back(contact, x, X) if probe is None else probe
        needle = tools.needle if native.needle is not None else None
        first = None if needle is None else native.needle.depth
        return cls(x, goal, probe if X is not None else None, X, needle,
                   needle.depth if first is None and needle is not None else first, dt)

    def depth(self, ahead):
        """Depth [m] of the needle a fraction of the way."""
        return self.first + ahead * (self.needle.depth - self.first)


def _drawn_back(contact, x, X_WP):
    """The ProbeState drawn back along its axis, in steps of BACK, until it touches nothing."""
    X_WP = X_WP.copy()
    while contact.gaps(x, X_WP).min() <= 0.0:
        X_WP[:3, 3] -= BACK * X_WP[:3, 2]
    return contact.start(x, X_WP[:3, :3], X_WP[:3, 3])


def _shaft(path, bent):
    """(k, 3) [m] of a NeedleInTissue as it is bent, None without one."""
    if path is None:
        return None
    return path.points if bent is None else bent.shaft(path).points


class _Columns:
    """A^-1 of the loads on a needle's anchors, kept while factor and anchors stay."""

    def __init__(self, compliance, count):
        """count : of nodes"""
        self._compliance, self._count = compliance, count
        self._kept, self._version = {}, None

    def of(self, anchors):
        """Return loads (2m, 3f) on the free nodes, and A^-1 of each (2m, 3f)."""
        H = self._compliance
        if self._version != H.version:
            self._kept, self._version = {}, H.version
        self._kept = {anchor: self._kept[anchor] for anchor in anchors if anchor in self._kept}
        new = [anchor for anchor in anchors if anchor not in self._kept]
        if new:
            free = H.free
            loads = np.concatenate([a.loads(self._count)[:, free.free].reshape(2, -1)
                                    for a in new])
            raw = H.raw(np.ascontiguousarray(loads.T)).T
            for i, anchor in enumerate(new):
                self._kept[anchor] = loads[2 * i:2 * i + 2], raw[2 * i:2 * i + 2]
        pairs = [self._kept[anchor] for anchor in anchors]
        return tuple(np.concatenate(one) for one in zip(*pairs, strict=True))


class _Acting:
    """Probe and needle during one iteration: their forces as last found.

    before : _Found at the start;  X : pose of the probe or None;  needle : NeedleLoad or None
    sideways : needle_beam.Sideways, None = no needle, or one without a beam
    """

    def __init__(self, integrator, before, X, needle, sideways):
        self._in, self._before, self._X, self._needle = integrator, before, X, needle
        self._patch = self._y = self._C = None
        self._q = np.zeros_like(before.x)
        if X is not None:
            self._q += before.probe.force
        self._load, self._state = np.zeros_like(before.x), before.needle
        self._sideways, self._aside = sideways, np.zeros(0)
        inside = needle is not None and not needle.outside
        if inside:
            self._load = np.einsum('u,unk->nk', self._weights(), needle.directions())
        elif before.needle is not None:
            self._state = withdrawn(before.needle, None if needle is None else needle.depth)
        if sideways is not None and inside:
            self._aside = sideways.before.force.ravel()
        self._columns = self._version = None

    @property
    def gradient(self):
        """(n, 3) [N] what the instruments add to the gradient of the potential."""
        out = self._q - self._load
        if len(self._aside):
            free = self._in._free.free
            loads, _ = self._in._columns.of(self._sideways.before.anchors)
            out[free] += (self._aside @ loads).reshape(-1, 3)
        return out

    def respond(self, y, tolerance):
        """Find their forces anew; without a change of them the nodes would be at y (n, 3) [m].

        tolerance : [m] that the probe's may leave open
        Returns the change d (3f,) [N] of `gradient` on the free nodes, and A^-1 d.
        """
        size = len(self._in._free.dofs)
        d, raw = np.zeros(size), np.zeros(size)
        if self._needle is not None and not self._needle.outside:
            d, raw = self._stab(y)
            y = y.copy()
            y[self._in._free.free] -= self._in._compliance.updated(d, raw).reshape(-1, 3)
            if len(self._aside):
                more = self._lean(y)
                d, raw = d + more[0], raw + more[1]
                y[self._in._free.free] -= self._in._compliance.updated(*more).reshape(-1, 3)
        if self._X is not None:
            more = self._touch(y, tolerance)
            d, raw = d + more[0], raw + more[1]
        return d, raw

    def _lean(self, y):
        """The tissue's force on the shaft, across it."""
        H, sideways = self._in._compliance, self._sideways
        loads, raw = self._in._columns.of(sideways.before.anchors)
        new = sideways.balanced(sideways.moved(y), H.between(loads, raw), self._aside)
        change, self._aside = new - self._aside, new
        return change @ loads, change @ raw

    def _stab(self, y):
        H, free = self._in._compliance, self._in._free.free
        units = self._needle.directions()[:, free].reshape(2, -1)
        if self._version != H.version:
            self._columns, self._version = H.raw(np.ascontiguousarray(units.T)).T, H.version
        give = np.zeros((2, *y.shape))
        for i in range(2):
            give[i, free] = H.updated(units[i], np.ascontiguousarray(
                self._columns[i])).reshape(-1, 3)
        old = self._weights()
        y = y.copy()
        y -= np.einsum('u,unk->nk', old, give)
        self._state = self._needle.balanced(y, give, self._state.share)
        change = self._weights() - old
        self._load = np.einsum('u,unk->nk', self._weights(), self._needle.directions())
        return -(change @ units), -(change @ self._columns)

    def _weights(self):
        """The load as multiples (2,) [N] of its two directions."""
        s = self._state
        return np.array([s.force * s.share, s.force * (1.0 - s.share)])

    def _touch(self, y, tolerance):
        H, q = self._in._compliance, self._q
        patch = self._in._contact.patch(y, self._X, self._before.probe)
        if patch is None:
            self._patch = None
            return np.zeros((2, len(self._in._free.dofs)))
        old, self._C = q[patch.nodes], H.among(patch.nodes)
        y0 = y[patch.nodes] + dense.products(self._C, old.ravel()).reshape(-1, 3)
        self._patch, self._y, new = patch.balanced(y0, self._C, old, tolerance)
        q[patch.nodes] = new
        return H.of_nodes(patch.nodes, new - old)

    def found(self, x, forces, count):
        """The _Found of the balance at x (n, 3)."""
        contact, face = self._in._contact, self._in._face
        probe = reading = None
        if self._X is not None:
            q = None if self._patch is None else self._q[self._patch.nodes]
            probe = contact.reached(self._before.probe, x, self._X, self._patch, q)
        if face is not None:
            reading = untouched(face) if self._patch is None or not self._q.any() else read(
                face, self._patch, self._y, self._q[self._patch.nodes], self._C)
        return _Found(x, probe, self._state, self._bent(x), forces, reading, count)

    def _bent(self, x):
        """The shaft at the end: bent, with tissue at x (n, 3) that it has cut by then."""
        before = self._before.bent
        if before is None or self._sideways is None or self._needle.outside:
            return None if before is None else before.withdrawn(0.0)
        bent = self._sideways.after(self._aside)
        if not self._state.law.punctured:
            return bent
        return bent.advanced(self._in.body.mesh, self._sideways.needle, self._needle.entry, x)


class _Pace:
    """How fast corrections shrink with one factor."""

    def __init__(self, tolerance):
        self._tolerance, self._sizes = tolerance, []

    def slow(self, size):
        """Take in a correction [m]; True if a new factor is cheaper than those still to come."""
        self._sizes.append(size)
        made = len(self._sizes) - 1
        if made < SURE:
            return False
        rate = (size / self._sizes[0]) ** (1.0 / made)
        if rate < 1.0 and np.log(self._tolerance / size) / np.log(rate) <= FACTOR_WORTH:
            return False
        self._sizes.clear()
        return True
