"""Pads that touch with friction where the model bonds them: condensed to the surface under them.

The tissue is taken as linear about the state of the baseline with the pads nearest to where they
are. With the bonds gone and nothing in their place the nodes under the faces would be at y0; with
contact they are at

    y + C g(y) = y0,

C the compliance of these nodes (condensed, as in `interface`, at the state loaded least), g the
gradient of the plant's contact potential (`tissue.contact`: layer, friction, anchors, where a face
starts from). Friction depends on the path, so the states are walked in order of time through the
corners between them, in steps of at most STEP.

Against full runs on 605 quadratic elements, single pads pushed by up to 4 mm: forces are within
3 % of the effect, positions within 15 % (test). What is missed is that tissue stiffens under the
pad that is pushed; it grows with the push, to a third of the effect in positions at 8 mm.
Test: diagnosis/forward/test_slip.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.face_contact import FaceContact
from arm_brachy.diagnosis.motion import corners_of
from arm_brachy.diagnosis.rigid_face import Face
from arm_brachy.tissue.contact_pads import PadContact, touches
from arm_brachy.tissue.free_dofs import held_nodes, moved_from_rest
from arm_brachy.tissue.jacobian import Equations, Linearisation
from arm_brachy.tissue.mesh import interpolate

STEP = 2e-3         # m that pads or tissue move at most before contact is found anew; 0.2 % of the
                    # effect off what 1 mm gives
CORNER = 0.02       # of the largest travel, that a path may be off between its corners
ACCURACY = 0.15     # error over effect, one standard deviation: own choice, positions at some 5 mm
BISECTIONS = 6      # of a step in which no balance is found


class Loosened:
    """A baseline's body with a pad touching, condensed to the nodes under it.

    baseline : baseline.Baseline;  body : SoftBody of its model, one pad with a face
    loose : (p,) True for these;  nodes : (k,);  compliance : (3k, 3k) [m/N]
    Raises InputError for a pad that touches nothing along its direction, NotConverged where the
    body without this pad is not stable.
    """

    def __init__(self, baseline, body):
        contact = PadContact(body)
        statics = contact.solver.statics
        self.baseline, self.loose = baseline, contact.touching
        self._released = contact.solver.body
        self.nodes, faces = _faces(contact)
        i = int(np.argmin(np.abs(baseline.trajectory.pads[baseline.at]).sum(axis=(1, 2))))
        self._linear = Linearisation(
            Equations(self._released, contact.solver.assembler.inner, statics.free),
            baseline.x(i), baseline.fields[i], single=True)
        moves = _rows(np.flatnonzero(~np.isin(self.nodes, statics.free.held)))
        compliance = np.zeros((3 * len(self.nodes), 3 * len(self.nodes)))
        compliance[np.ix_(moves, moves)] = self._linear.compliance(_rows(self.nodes)[moves])
        self.contact = FaceContact(faces, compliance)

    def untouched(self, near, pads):
        """Return y0 (m, k, 3) [m] at m instants, where the nodes would be without contact.

        near : (m,) states of the baseline taken for reference;  pads : (m, p, 3) [m]
        """
        b, held = self.baseline, held_nodes(self._released)
        motion = np.zeros((self._linear.x.size, len(near)))
        for column, i, there in zip(motion.T, near, pads, strict=True):
            goal = moved_from_rest(self._released, there[~self.loose])
            column[_rows(held)] = (goal - b.x(i))[held].ravel()
        out_of_balance = b.forces[near].reshape(len(near), -1).T    # the bonds that are gone
        moved = self._linear.respond(motion, out_of_balance)[_rows(self.nodes)]
        return np.stack([b.x(i)[self.nodes] for i in near]) + moved.T.reshape(len(near), -1, 3)


def slip_change(baseline, body):
    """Return the changes (n, r) of observables by pads of `body` that touch.

    baseline : baseline.Baseline of a model without memory, which keeps what each pad does
    body : SoftBody of its model, some pads with a face
    The sum over pads: what slips under one is hardly noticed under the next. Rows of states from
    where on no balance is found are NaN. Raises as Loosened.
    """
    known, total = baseline.loosened, 0.0
    for i in np.flatnonzero(touches(body)):
        alone = replace(body, pads=tuple(pad if k == i else replace(pad, face=None)
                                         for k, pad in enumerate(body.pads)))
        key = i, body.pads[i].face
        if key not in known:
            known[key] = _one_loose(baseline, alone)
        total = total + known[key]
    return total


def _one_loose(baseline, body):
    """The changes (n, r) by the one pad of `body` that touches."""
    loosened, kept = Loosened(baseline, body), _corners(baseline)
    pads, number = baseline.trajectory.pads[kept], np.searchsorted(kept, baseline.at)
    near = np.array([_nearest(baseline, there) for there in pads])
    y0 = loosened.untouched(near, pads)
    rest = body.mesh.nodes[loosened.nodes]
    walk = dict(enumerate(_walked(loosened.contact, rest, pads[:, loosened.loose], y0)))
    out = np.full((len(baseline.t), len(baseline.sensitivity(0).force)), np.nan)
    for i, k in enumerate(number):
        if k in walk:
            out[i] = _change(loosened, i, near[k], walk[k])
    return out


def _corners(baseline):
    """Instants of the trajectory that are states or corners of the path."""
    pads = baseline.trajectory.pads.reshape(len(baseline.trajectory.t), -1)
    travel = float(np.ptp(pads, axis=0).max(initial=0.0))
    return np.union1d(corners_of(baseline.trajectory.t, pads, CORNER * travel), baseline.at)


def _walked(contact, rest, pads, y0):
    """Yield the Touching of a FaceContact at every instant, until no balance is found.

    rest : (k, 3) [m] where faces and tissue met before anything was loaded, as the plant starts
    pads : (m, t, 3) [m];  y0 : (m, k, 3) [m]
    """
    state, ways, free = contact.start(rest, 0.0 * pads[0]), 0.0 * pads[0], rest
    for there, clear in zip(pads, y0, strict=True):
        far = max(np.abs(there - ways).max(), np.abs(clear - free).max())
        size = 1.0 / max(1, int(np.ceil(far / STEP)))
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
        ways, free = there, clear
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
