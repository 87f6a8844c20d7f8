"""The touching pads of a body, as the plant drives them: displacements in, loads on pads out.

Zero displacement is where the face, moved along its direction, just touches the body at rest. A
footprint touches its whole patch there. A flat face touches a convex body outside the pad's
centre, which lies on the surface, by what the surface bends away from a plane under the disc (4
to 7 mm on the breast): it comes to bear gradually where a bonded pad holds its whole patch from
the start.
"""

import dataclasses

import numpy as np

from arm_brachy.tissue.body import PadFootprint
from arm_brachy.tissue.contact import ContactPair
from arm_brachy.tissue.contact_poses import moved, placed
from arm_brachy.tissue.contact_shapes import Disc, Plane
from arm_brachy.tissue.contact_solver import ContactSolver
from arm_brachy.tissue.mesh import boundary_faces


def touches(body):
    """Return (p,) bool: which pads of a SoftBody have a face and touch; the others are bonded."""
    return np.array([pad.face is not None for pad in body.pads], dtype=bool)


def _pair(mesh, pad):
    """The ContactPair of a Pad with a face on a TetMesh."""
    if not isinstance(pad.face, PadFootprint):
        return ContactPair(pad.name, Disc(pad.face.radius, pad.face.edge_radius),
                           pad.face.friction)
    faces = boundary_faces(mesh)
    rise = (mesh.nodes - pad.centre) @ pad.direction
    return ContactPair(pad.name, Plane(), pad.face.friction,
                       faces[np.isin(faces, pad.nodes).all(axis=1)],
                       np.outer(rise, pad.direction))


class PadContact:
    """A ContactSolver for a SoftBody whose pads with a face touch; pads without stay bonded.

    body : SoftBody;  law : contact.ContactLaw;  options : contact_solver.ContactOptions
    newton : NewtonOptions
    X_WP : (b, 4, 4) poses of the touching pads at zero displacement, z along their direction
    Raises InputError for a pad that touches nothing along its direction.
    """

    def __init__(self, body, *, law=None, options=None, newton=None):
        self.touching = touches(body)
        pads = [pad for pad in body.pads if pad.face is not None]
        bonded = tuple(pad for pad in body.pads if pad.face is None)
        pairs = [_pair(body.mesh, pad) for pad in pads]
        self.body = body
        self.solver = ContactSolver(dataclasses.replace(body, pads=bonded), pairs, law=law,
                                    options=options, newton=newton)
        centres = np.array([placed(pad.centre, pad.direction) for pad in pads])
        self.X_WP = self.solver.touching(centres)

    def start(self, x, displacement):
        """Return the ContactState of positions x (n, 3) [m], not at rest unless nothing pushes.

        displacement : (p, 3) [m] of all pads, rows as `body.pads`. Touching points bear no
        friction yet.
        """
        return self.solver.initial(self._poses(displacement), x)

    def step(self, state, displacement, fields=None):
        """Return the ContactState at rest with the pads at `displacement` (p, 3) [m].

        state, fields : as `ContactSolver.step`
        """
        return self.solver.step(state, self._poses(displacement),
                                self._held(displacement, fields), fields)

    def follow(self, state, displacement, trend, fields=None):
        """The same, from positions expected to change by trend (n, 3) [m], as the solver's."""
        return self.solver.follow(state, self._poses(displacement), trend,
                                  self._held(displacement, fields), fields)

    def at_rest(self, state, displacement, fields, residual):
        """True if the pads are there already and no free node is pulled by more than `residual`.

        residual : [N];  other arguments : as `step`
        """
        held = self.solver.statics.free.held
        if not (np.array_equal(self._poses(displacement), state.X_WB)
                and np.array_equal(self._held(displacement, fields)[held], state.x[held])):
            return False
        assembler = self.solver.assembler
        assembler.place(state.X_WB, state.points)
        pull = assembler.forces(state.x, fields)[self.solver.statics.free.free]
        return bool(np.abs(pull).max(initial=0.0) <= residual)

    def displacement(self, state):
        """Return where the pads of a ContactState are, (p, 3) [m] from zero."""
        out = np.zeros((len(self.body.pads), 3))
        out[self.touching] = state.X_WB[:, :3, 3] - self.X_WP[:, :3, 3]
        first = [pad.nodes[0] for pad in self.solver.body.pads]
        out[~self.touching] = (state.x - self.body.mesh.nodes)[first]
        return out

    def loads(self, state):
        """Return force and moment (p, 3) [N], [N m] of the tissue on each pad of a ContactState.

        Moments about the centre of a touching pad's face, of a bonded one's disc.
        """
        loads = np.zeros((2, len(self.body.pads), 3))
        loads[:, self.touching] = state.force, state.moment
        loads[:, ~self.touching] = state.pad_force, state.pad_moment
        return loads[0], loads[1]

    def _poses(self, displacement):
        return moved(self.X_WP, np.asarray(displacement, dtype=float)[self.touching])

    def _held(self, displacement, fields):
        base = None if fields is None else fields.base
        return self.solver.statics.held_positions(np.asarray(displacement)[~self.touching], base)
