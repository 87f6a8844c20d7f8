"""Needle, arm, image and procedure of the cell in one process: their part of a tick.

As in the graph: an order given to the needle is obeyed in the next tick, a service at once; the
needle moves before the arm, both before the tissue, whose answer they feel one tick later; a scan
that is asked for is made in the next tick and heard by the arm in the one after.
"""

import numpy as np

from arm_brachy import cell as cells
from arm_brachy.control.procedure_steps import Kind, NeedleSeen, ProbeSeen
from arm_brachy.control.safety import Permission
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation.known_load import instrument_loads
from arm_brachy.evaluation.procedure_data import Frame
from arm_brachy.offline_procedure import FRAME_EVERY
from arm_brachy.tissue.needle_path import NeedleInTissue, tangents
from arm_brachy.tissue.probe_face import ProbeFace

_INSIDE = 1e-6      # m of depth from which on a needle is in the way of anything


class ProbeSide:
    """What stands between actuators and tissue, and after it; InProcess calls it in order.

    procedure : control.procedure.Procedure;  needle, arm, imager, scanner : the devices
    """

    def __init__(self, cell, log):
        """cell : scenario.Cell;  log : inprocess_log.RunLog"""
        self._cell, self._log = cell, log
        self.procedure = cells.build_procedure(cell)
        self.needle, self.arm = cells.build_needle(cell), cells.build_probe_arm(cell)
        self.imager, self.scanner = cells.build_imager(cell), cells.build_surface_scanner(cell)
        self._orders, self._scan_due, self._cloud, self._mesh = [], True, None, None
        self._reading, self._step, self._tip = None, None, None
        self._mesh_due, self._said = 0.0, None

    def permit(self, permission, reason):
        """The supervisor's word, for everybody who moves."""
        self.arm.permit(permission, reason)
        self.procedure.permit(permission, reason)
        if permission is Permission.STOP:
            self.needle.stop()
        elif permission is Permission.HOLD:
            self.needle.hold()

    def before(self, t, permission):
        """Move needle and arm; returns probe pose and needle as Body.step takes them."""
        orders, self._orders = self._orders, []
        for order in orders if permission is Permission.RUN else ():
            self._obey(order)
        force = 0.0 if self._reading is None else self._reading.needle_force
        state = self.needle.read(t, force)
        self._hear_needle(t, state)
        self._hear_skin()
        step = self._step = self.arm.step(t, None if self._reading is None
                                          else self._reading.probe)
        self._log_arm(t, step)
        inside = state.true_depth > _INSIDE
        return ((step.R_true, step.p_true),
                NeedleInTissue(state.shaft, state.true_depth) if inside else None)

    def _obey(self, order):
        try:
            if order.kind is Kind.DRIVE:
                self.needle.command(*order.value)
            elif order.kind is Kind.STAY:
                self.needle.hold()
            elif order.kind is Kind.TURN:
                self.needle.turn(*order.value)
            elif order.kind is Kind.BEND:
                self.needle.bends(order.value[0], order.value[1:])
            else:
                self.needle.place(order.value[:3], order.value[3])
        except CommandRefused:
            return      # what the needle refuses it says in its next state

    def _hear_needle(self, t, state):
        self._log.note('needle_driver', state.outcome, state.message)
        self._state = state
        self.procedure.hear_needle(NeedleSeen(state.depth, state.force))
        self._log.add('needle', t, (state.depth, state.velocity, state.force))
        self._log.add('roll', t, state.roll)
        self._tip = None
        if state.tip_p is not None:
            self._tip = state.tip_R, state.tip_p
            self.arm.hear_tip(round(state.measured_t * 1e9) * 1e-9, *self._tip)
            self._log.add('tip_told', t, state.tip_p)

    def _hear_skin(self):
        if self._cloud is not None:
            self.arm.hear_cloud(self._cloud)
            self._cloud = None
        if self._mesh is not None:
            self.arm.hear_mesh(self._mesh)
            self._mesh = None

    def _log_arm(self, t, step):
        self._log.note('probe_controller', step.outcome, step.message)
        self._log.add('probe', t, np.concatenate([step.R_true.ravel(), step.p_true]))
        self._log.add('probe_told', t, np.concatenate([step.R.ravel(), step.p]))
        self._log.add('probe_state', t, (int(step.phase), step.in_contact, step.force_goal,
                                         step.out_of_plane))
        self._log.add('joints', t, step.q)
        self._log.add('torque', t, step.torque)
        self._log.periods.append((t, step.force))

    def after(self, t, reading):
        """Take the tissue's answer (cell.Reading): scan and look."""
        self._reading = reading
        self._log.shape(t, reading.x)
        self._log_needle(t, reading)
        if self._scan_due:
            self._scan_due = False
            self._cloud = self.scanner.scan(reading.x)
            self.procedure.hear_surface()
        contact = reading.probe
        if contact is not None:
            self._log.add('contact', t, contact.wrench[:3])
        if contact is None or contact.area == 0.0:
            return
        step = self._step
        frame = self.imager.see(t, reading.x, (step.R_true, step.p_true), contact.pressure,
                                self._shaft, (step.R, step.p), self._tip)
        if frame is not None:
            self._take(frame)

    def _log_needle(self, t, reading):
        state = self._state
        self._shaft = state.shaft if reading.shaft is None else reading.shaft
        self._log.add('tip', t, self._shaft[-1])
        self._log.add('axis', t, tangents(self._shaft, state.axes)[-1])
        self._log.shafts[t] = self._shaft

    def _take(self, frame):
        self._log.note('ultrasound_imager', frame.outcome, frame.message)
        frames = self._log.frames
        if not frames or frame.t - frames[-1].t >= FRAME_EVERY:
            frames.append(Frame(frame.t, frame.overlay))
        if frame.tip_W is not None:
            self._log.add('tip_image', frame.t, frame.tip_W)
            self.procedure.hear_image(frame.t, frame.tip_W)
        if frame.cavity is not None:
            self._log.add('target_image', frame.t, frame.cavity.centre)
            self.procedure.hear_target_image(frame.t, frame.cavity.centre)

    def loads(self):
        """KnownLoads of probe and needle as the cell measures them; after `before`."""
        step, state = self._step, self._state
        return instrument_loads(
            (step.R, step.p, step.wrench) if step.in_contact else None,
            None if state.tip_p is None else (state.tip_R, state.tip_p, state.force, state.depth),
            ProbeFace(), self._cell.scenario.needle.needle.skin)

    def hear_mesh(self, t, x):
        """The feedback's mesh, at the rate at which it is published; the arm hears it next."""
        if t >= self._mesh_due - 1e-9:
            self._mesh_due += 1.0 / self._cell.scenario.mesh_rate
            self._mesh = x

    def watch(self, safety, t):
        """What the supervisor hears."""
        state, step = self._state, self._step
        safety.force('needle', [state.force])
        safety.old('needle', t - state.measured_t, self._cell.scenario.limits.needle_age)
        if len(step.force):
            safety.force('probe', [np.abs(step.force).max()])

    def conduct(self, t, pads_home, loop):
        """Step the procedure and carry out its orders; returns True once all is over.

        loop : has set_goal(position), shift_goal(position), release(): refusal or ''
        """
        p, step = self.procedure, self._step
        p.hear_pads(pads_home)
        p.hear_probe(ProbeSeen(int(step.phase), step.in_contact, step.out_of_plane, step.outcome,
                               step.message))
        orders = p.step(t)
        self._log.note('operator', p.outcome, p.message)
        if (p.phase, p.outcome) != self._said:
            self._said = (p.phase, p.outcome)
            self._log.steps.append((t, p.figures()))
        phase = p.phase
        for order in orders:
            if p.phase is phase:    # else one was refused, and the rest is of a step that failed
                self._carry_out(t, order, loop)
        return any(order.kind is Kind.FINISH for order in orders)

    def _carry_out(self, t, order, loop):
        refusal = ''
        if order.kind is Kind.SET_GOAL:
            refusal = loop.set_goal(order.value)
        elif order.kind is Kind.SHIFT:
            refusal = loop.shift_goal(order.value)
        elif order.kind is Kind.ARRIVED:
            loop.end_move()
        elif order.kind is Kind.REST:
            loop.rest()
        elif order.kind is Kind.RELEASE:
            refusal = loop.release()
        elif order.kind is Kind.SCAN:
            self._scan_due = True
        elif order.kind is Kind.SHOW:
            self.imager.hear_aim(t, np.reshape(order.value, (2, 3)))
        elif order.kind in (Kind.FOLLOW, Kind.RETRACT):
            try:
                getattr(self.arm, order.kind.name.lower())()
            except CommandRefused as why:
                refusal = str(why)
        elif order.kind is not Kind.FINISH:
            self._orders.append(order)
        if refusal:
            self._log.count('operator', Outcome.REJECTED, refusal)
            self.procedure.refused(refusal, order.kind)
