"""Pads that touch with friction where the model bonds them: condensed to the surface under them.

The tissue is taken as linear about the state of the baseline with the pads nearest to where they
are. With the bonds gone and nothing in their place the nodes under the faces would be at y0; with
contact they are at

    y + C g(y) = y0,

C the compliance of these nodes (condensed, as in `condensation`), g the gradient of the plant's
contact potential (`tissue.contact`: layer, friction, anchors, where a face starts from). Friction
depends on the path, so the states are walked in order of time through the corners between them, in
steps of at most `Walk.step`.

Tissue stiffens under a pad that is pushed, so C is that of a bonded state whose pad is near, or
of the deepest before it that would hold without its bonds. With pads within NEAR, against full
runs of single pads pushed by up to 8 and 9 mm, forces are within 2 % of the effect and positions
within 6 % (605 quadratic elements: test; 2278: 9 % in single states). One C for all states, that
of the one loaded least, will do to find out what slips: 8 % and 16 %.
Test: diagnosis/forward/test_slip.py
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import eye_array

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.model.face_contact import FaceContact
from arm_brachy.diagnosis.model.rigid_face import Face
from arm_brachy.diagnosis.signals.motion import corners_of
from arm_brachy.tissue.contact_pads import PadContact, touches
from arm_brachy.tissue.free_dofs import held_nodes, moved_from_rest
from arm_brachy.tissue.jacobian import Equations, Linearisation
from arm_brachy.tissue.mesh import interpolate

NEAR = 1.5e-3       # m that loose pads may be from where C is known, for the numbers of a fit
ACCURACY = 0.08     # error over effect, one standard deviation: own choice, positions at 9 mm
BISECTIONS = 6      # of a step in which no balance is found


@dataclass(frozen=True)
class Walk:
    """How closely a path is walked.

    step : [m] that pads or tissue move at most before contact is found anew
    corner : of the largest travel, that the path may be off between its corners
    close : [m] of contact's last Newton step
    """

    step: float
    corner: float
    close: float


FITTING = Walk(2e-3, 0.02, 1e-8)    # for numbers of a fit: 0.2 % of the effect off steps of 1 mm
FINDING = Walk(4e-3, 0.1, 1e-6)     # to find out what slips: 1 % of the effect off FITTING, at a
                                    # quarter of the time (phantom of the study of terms)


class Released:
    """A baseline's body with the bonds of one pad gone and nothing in their place, condensed.

    baseline : linearised.Baseline;  contact : PadContact of its body, one pad with a face
    near : [m] as in `slip_change`;  nodes : (k,) under the face
    place : (n,) states whose compliance each takes;  compliances : of these, (3k, 3k) [m/N]
    Raises NotConverged where the body without this pad is not stable.
    """

    def __init__(self, baseline, contact, nodes, near):
        self._baseline, self._nodes, self._loose = baseline, nodes, contact.touching
        self._solver, self._statics = contact.solver, contact.solver.statics
        self._linear, self.compliances = {}, {}
        self.place = self._places(near)
        self._clear, self._led = np.empty((len(self.place), len(nodes), 3)), {}
        for place in np.unique(self.place):
            self._clear[self.place == place], self._led[place] = self._without_contact(place)
        self._linear.clear()

    def untouched(self, i, pads):
        """Return y0 (k, 3) [m], where the nodes would be without contact, from state i.

        pads : (p, 3) [m]
        """
        further = (pads - self._baseline.pads(i))[~self._loose]
        return self._clear[i] + np.einsum('kabc,bc->ka', self._led[self.place[i]], further)

    def _without_contact(self, place):
        """((m, k, 3) [m] of the states of one place, (k, 3, b, 3) by the pads that are bonded).

        The bonds that are gone let the tissue follow; so do its nodes where pads go further.
        """
        b, body, linear = self._baseline, self._solver.body, self._linear[place]
        held, states = _rows(held_nodes(body)), np.flatnonzero(self.place == place)
        motion = np.zeros((linear.x.size, len(states)))
        for column, i in zip(motion.T, states, strict=True):
            goal = moved_from_rest(body, b.pads(i)[~self._loose])
            column[held] = (goal - b.x(i)).ravel()[held]
        forces = np.stack([b.forces[i].ravel() for i in states], axis=1)
        moved = linear.respond(motion, forces)[_rows(self._nodes)]
        x = np.stack([b.x(i)[self._nodes] for i in states])
        return x + moved.T.reshape(x.shape), linear.state_sensitivity()[self._nodes]

    def _places(self, near):
        """(n,) states whose compliance each takes: that loaded least with the loose pad near."""
        pads = self._baseline.trajectory.pads[self._baseline.at]
        order = np.argsort(np.abs(pads).sum(axis=(1, 2)), kind='stable')
        place, last = np.full(len(pads), -1), None
        for i in order:
            if place[i] < 0:
                away = np.linalg.norm((pads - pads[i])[:, self._loose], axis=2).max(axis=1)
                last = i if self._stable(i) else last
                place[(place < 0) & (away <= near)] = last
        return place

    def _stable(self, i):
        """True if the tissue at state i would hold without the bonds; condenses it if so.

        Deep under a pad the free surface may be compressed beyond what it bears alone.
        """
        try:
            linear = Linearisation(
                Equations(self._solver.body, self._solver.assembler.inner, self._statics.free),
                self._baseline.x(i), self._baseline.fields[i], single=True)
        except NotConverged:
            if not self._linear:
                raise
            return False
        each = eye_array(linear.x.size, format='csc')[:, _rows(self._nodes)]
        self._linear[i], self.compliances[i] = linear, linear.compliance(each)
        return True


class Loosened:
    """A baseline's body with a pad touching, condensed to the nodes under it.

    baseline : linearised.Baseline;  body : SoftBody of its model, one pad with a face
    near : [m] as in `slip_change`;  close : [m] of contact's last Newton step
    loose : (p,) True for these;  nodes : (k,)
    Raises InputError for a pad that touches nothing along its direction, and as Released, which
    faces of any friction share.
    """

    def __init__(self, baseline, body, near, close):
        contact = PadContact(body)
        self.baseline, self.loose = baseline, contact.touching
        self.nodes, faces = _faces(contact)
        key = (Released, *np.flatnonzero(self.loose).tolist(), near)
        if key not in baseline.loosened:
            baseline.loosened[key] = Released(baseline, contact, self.nodes, near)
        self._released = baseline.loosened[key]
        self._contacts = {place: FaceContact(faces, compliance, close)
                          for place, compliance in self._released.compliances.items()}

    def contact(self, i):
        """The FaceContact about state i."""
        return self._contacts[self._released.place[i]]

    def untouched(self, i, pads):
        """As `Released.untouched`."""
        return self._released.untouched(i, pads)


def slip_change(baseline, body, near=np.inf, back=0.0):
    """Return the changes (n, r) of observables by pads of `body` that touch.

    baseline : linearised.Baseline of a model without memory, which keeps what each pad does
    body : SoftBody of its model, some pads with a face
    near : [m] that a loose pad may be from where a compliance is known; inf = one will do, and
        the path is walked as FINDING does
    back : (p,) or float [m] that a loose pad stands back from where the tissue is at rest
    The sum over pads: what slips under one is hardly noticed under the next. Rows of states from
    where on no balance is found are NaN. Raises as Loosened.
    """
    known, total = baseline.loosened, 0.0
    back = np.broadcast_to(back, len(body.pads))
    for i in np.flatnonzero(touches(body)):
        alone = replace(body, pads=tuple(pad if k == i else replace(pad, face=None)
                                         for k, pad in enumerate(body.pads)))
        key = i, body.pads[i].face, near, float(back[i])
        if key not in known:
            known[key] = _one_loose(baseline, alone, near, back[i])
        total = total + known[key]
    return total


def _one_loose(baseline, body, near, back):
    """The changes (n, r) by the one pad of `body` that touches."""
    walk = FITTING if np.isfinite(near) else FINDING
    loosened, kept = Loosened(baseline, body, near, walk.close), _corners(baseline, walk.corner)
    pads, number = baseline.trajectory.pads[kept], np.searchsorted(kept, baseline.at)
    ways = (pads - back * baseline.model.directions)[:, loosened.loose]
    about = np.array([_nearest(baseline, there) for there in pads])
    rest = body.mesh.nodes[loosened.nodes]
    found = dict(enumerate(_walked(loosened, rest, pads, ways, about, walk.step)))
    out = np.full((len(baseline.t), len(baseline.sensitivity(0).force)), np.nan)
    for i, k in enumerate(number):
        if k in found:
            out[i] = _change(loosened, i, about[k], found[k])
    return out


def _corners(baseline, corner):
    """Instants of the trajectory that are states or corners of the path, as in Walk."""
    pads = baseline.trajectory.pads.reshape(len(baseline.trajectory.t), -1)
    travel = float(np.ptp(pads, axis=0).max(initial=0.0))
    return np.union1d(corners_of(baseline.trajectory.t, pads, corner * travel), baseline.at)


def _walked(loosened, rest, pads, faces, about, step):
    """Yield the Touching at every instant, until no balance is found.

    rest : (k, 3) [m] where faces and tissue met before anything was loaded, as the plant starts
    pads : (m, p, 3) [m];  faces : (m, t, 3) [m] of those that touch
    about : (m,) states of the baseline that are their references;  step : [m] as in Walk
    """
    ways = faces[0] - pads[0][loosened.loose]
    state = loosened.contact(about[0]).start(rest, ways)
    for bonded, there, i in zip(pads, faces, about, strict=True):
        contact, clear = loosened.contact(i), loosened.untouched(i, bonded)
        free = contact.untouched(state)
        far = max(np.abs(there - ways).max(), np.abs(clear - free).max())
        size = 1.0 / max(1, int(np.ceil(far / step)))
        t, least = 0.0, size * 0.5 ** BISECTIONS
        while t < 1.0:
            ahead = 1.0 if t + size > 1.0 - least else t + size
            found = contact.step(state, free + ahead * (clear - free),
                                 ways + ahead * (there - ways))
            if found is not None:
                state, t = found, ahead
            elif size <= least:
                return
            else:
                size *= 0.5
        ways = there
        yield state


def _change(loosened, i, near, touching):
    """Change (r,) of observables at state i, from the state `near` that is its reference."""
    b = loosened.baseline
    inside, x, force = b.model.attached.embedding, b.x(near), b.trajectory.force[b.at]
    motion, rate = moved_from_rest(b.model.body, b.pads(i)) - x, np.zeros_like(x)
    motion[loosened.nodes] = touching.y - x[loosened.nodes]
    rate[loosened.nodes] = touching.p
    change = b.sensitivity(near).change(motion, rate)
    points = 3 * len(inside.nodes)
    change[:points] += interpolate(inside, x - b.x(i)).ravel()
    change[points:] += (force[near] - force[i]).ravel()
    on_pads = change[points:].reshape(-1, 3)
    on_pads[loosened.loose] = touching.forces - force[i][loosened.loose]
    return change


def _nearest(baseline, pads):
    """The state whose pads are nearest to `pads` (p, 3) [m]."""
    return int(np.abs(baseline.trajectory.pads[baseline.at] - pads).max(axis=(1, 2)).argmin())


def _faces(contact):
    """(nodes (k,), Faces) of a PadContact whose pads came off their bonds."""
    assembler = contact.solver.assembler
    nodes = np.unique(np.concatenate([s.faces.ravel() for s in assembler.surfaces]))
    return nodes, tuple(
        _face(pair, surface, X, nodes, assembler.law.constants(contact.body))
        for pair, surface, X in zip(assembler.pairs, assembler.surfaces, contact.X_WP,
                                    strict=True))


def _face(pair, surface, X_WP, nodes, law):
    R, p = pair.shape.mount
    return Face(replace(surface, faces=np.searchsorted(nodes, surface.faces)),
                np.ascontiguousarray(X_WP[:3, :3] @ R), X_WP[:3, :3] @ p + X_WP[:3, 3],
                pair.shape.core, pair.friction, law, pair.relief[nodes])


def _rows(nodes):
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
