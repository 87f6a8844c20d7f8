"""The arm that keeps the ultrasound probe on the needle's tip: plan, phases, holder, tick by tick.

Within a tick the holder's own loop runs at a kilohertz. A tip counts from the tick after its stamp
on, as in a real cell, and is told ahead to the tick's end; so the image plane does not lag behind
a needle in uniform motion.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import CommandRefused, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.probe_phase import ProbePhase as Phase
from arm_brachy.robot.force_torque import MOST_DRIFT
from arm_brachy.robot.panda_holder import PandaHolder
from arm_brachy.robot.probe_arm_params import PERIOD, ProbeArmParams
from arm_brachy.robot.probe_holder import Errand, Way
from arm_brachy.robot.probe_phases import NOT_A_NUMBER, Phases, Situation
from arm_brachy.robot.probe_planner import Plan
from arm_brachy.robot.probe_pose import out_of_plane
from arm_brachy.robot.reference import rotation_vector
from arm_brachy.robot.scissor_holder import ScissorHolder
from arm_brachy.robot.surface_mesh import MeshSurface
from arm_brachy.robot.surface_scan import ScannedSurface
from arm_brachy.robot.tip_filter import TipFilter

__all__ = ['ProbeArm', 'ProbeArmParams', 'ProbeArmStep']

HOLDERS = {'panda': PandaHolder, 'scissor_rcm': ScissorHolder}

_NEAR, _TURNED = 2e-3, np.radians(2.0)    # of a pose that counts as taken
_HOME = 5e-4                              # m from home, at rest
_LONGEST_TICK = 1.0                       # s of clock, beyond which the arm's time stood still
_SLACK = 1e-6                             # s between stamps that count as equal
_SHALLOWEST = 1e-3                        # m of the tip under the face
_STILL = np.zeros(3)
_HURRY = 40.0                             # times faster than at home the zero is taken: 0.05 s
_SLOW = 5e-3                              # m/s, below which the tool's inertia is no load


@dataclass(frozen=True)
class ProbeArmStep:
    """The arm at the end of a tick. World frame, SI.

    phase : Phase;  force : (k,) measured in every period of the tick [N];  out_of_plane : [m] of
    the tip as heard last, NaN without one;  goal_R, goal_p : planned pose;  others as HolderState
    """

    t: float
    phase: Phase
    in_contact: bool
    force_goal: float
    force: np.ndarray
    out_of_plane: float
    waiting: bool
    goal_R: np.ndarray
    goal_p: np.ndarray
    R: np.ndarray
    p: np.ndarray
    R_true: np.ndarray
    p_true: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    torque: np.ndarray
    wrench: np.ndarray
    outcome: Outcome
    message: str


class ProbeArm:
    """Hears of tip, skin and permission; `step` once a tick.

    params : ProbeArmParams;  rng : numpy Generator of the sensor
    inside : (3,) [m] a point of the body that sees all of its skin, for a scanned cloud
    image_depth : [m] of the picture, beyond which a tip is not seen
    holder : probe_holder.ProbeHolder; None = as the parameters say
    """

    def __init__(self, params, rng, *, inside=(0.0, 0.0, 0.01), image_depth=np.inf,
                 holder=None):
        """Start at rest at home. Raises InputError if home is out of reach."""
        self._params, self._inside, self._triangles = params, np.array(inside), None
        self._image_depth = image_depth
        self.holder = HOLDERS[params.probe_holder](params, rng) if holder is None else holder
        self._phases = Phases(params)
        self._tip, self._heard, self._last_tip = TipFilter(params.tip_memory), [], None
        self._surface, self._planner, self._t = None, None, None
        self._state = self.holder.state()
        self._frozen = self._goal = (self._state.R, self._state.p)
        self._plan, self._entered, self._near = None, Phase.IDLE, False
        self._felt = 0.0         # N on the probe at home, where nothing should touch it
        self._over = 0.0         # s that the probe has stood over the skin, before it goes down
        self._sunk = 0.0         # m below the skin as planned, when last there was a plan

    @property
    def joint_names(self):
        """Names of the holder's joints, in the order of `ProbeArmStep.q`."""
        return self.holder.joint_names

    def hear_tip(self, t, R, p):
        """Take the tip's pose at time t [s]: R (3, 3), z along the needle;  p (3,), W.

        One that is not finite is no pose, and one of the future none that can be followed: the
        age of the last one tells.
        """
        future = self._t is not None and t > self._t + _LONGEST_TICK
        if future or not (np.isfinite(R).all() and np.isfinite(p).all()):
            return
        self._heard.append((t, np.array(R), np.array(p)))
        self._last_tip = np.array(p)

    def hear_cloud(self, points):
        """Take the scanner's cloud (n, 3) [m] in W. Raises InputError if it shows no skin."""
        if self._params.surface == 'scan':
            self._set_surface(ScannedSurface.fit(points, self._inside, self._params.scan))

    def hear_topology(self, triangles):
        """Take the skin of the estimator's mesh: triangles (k, 3) of nodes, outward."""
        self._triangles = np.array(triangles, dtype=np.int64)

    def hear_mesh(self, x):
        """Take the nodes (n, 3) [m] of the estimator's mesh in W as they are now.

        Raises InputError without the triangles between them.
        """
        if self._params.surface != 'model':
            return
        if self._triangles is None or self._triangles.max() >= len(x):
            raise InputError(f'probe: {len(x)} nodes of a mesh whose skin was not heard of; must '
                             'follow its topology')
        self._set_surface(MeshSurface(x, self._triangles))

    def _set_surface(self, surface):
        self._surface = surface
        if self._planner is not None:
            self._planner.surface = surface

    def permit(self, permission, reason):
        """Take what the supervisor allows: 0 run, 1 hold, 2 stop, and why."""
        self._phases.permit(permission, reason)

    def follow(self):
        """Approach and follow the tip. Raises CommandRefused where that is not possible."""
        if not self._heard and self._tip.t is None:
            raise CommandRefused('probe: no tip was heard of; insert the needle into the template')
        if self._surface is None:
            what = 'cloud of the skin' if self._params.surface == 'scan' else 'mesh of the model'
            raise CommandRefused(f'probe: no {what} was heard of; scan it, or start the estimator')
        before = self._phases.phase
        if before is Phase.IDLE and self._felt > MOST_DRIFT:
            raise CommandRefused(f'probe: {self._felt:.2f} N on the probe at home; must be at '
                                 f'most {MOST_DRIFT:g} N: take off what touches it, or start its '
                                 'node again to weigh the tool anew')
        self._phases.follow()
        if before is not self._phases.phase:
            self._planner, self._sunk = None, 0.0

    def hold(self):
        """Stand still; in contact the force is kept."""
        self._phases.hold()

    def retract(self):
        """Leave the skin and go home. Raises CommandRefused after a stop."""
        self._phases.retract()

    def release(self):
        """End a stop. Raises CommandRefused while the supervisor does not let it run."""
        self._phases.release()

    def step(self, t, reading=None):
        """Advance to t [s]; the first call only says when the arm begins.

        reading : what the tissue answered to the probe's last pose: wrench (6,) on the probe about
            its face and stiffness (6, 6), axes of W; None = nothing new
        Returns ProbeArmStep.
        """
        start = t if self._t is None or t - self._t > _LONGEST_TICK else self._t
        periods, self._t = round((t - start) / PERIOD), t
        self._take_tips(start)
        self._look(start, max(periods, 1) * PERIOD)
        errand = self._errand(max(periods, 1) * PERIOD)
        force = np.empty(0)
        broken = reading is not None and not (np.isfinite(reading.wrench).all()
                                              and np.isfinite(reading.stiffness).all())
        if periods > 0:
            force = self.holder.run(errand, None if broken else reading, periods)
            before, self._state = self._state, self.holder.state()
            moved = float(np.linalg.norm(self._state.p - before.p))
            if self._state.trip or broken:
                self._phases.trip(self._state.trip or NOT_A_NUMBER)
                self._begin()
            elif self._phases.phase is Phase.IDLE:
                self._felt = self.holder.weigh()
            elif self._over > 0.0 and not self._near and moved < _SLOW * periods * PERIOD:
                self.holder.weigh(_HURRY)
        return self._told(t, force)

    def _take_tips(self, start):
        """Those stamped by the beginning of the tick: a real arm knows no others."""
        while self._heard and self._heard[0][0] <= start + _SLACK:
            self._tip.hear(*self._heard.pop(0))

    def _look(self, t, dt):
        """Plan, judge the situation, let the phases answer."""
        state, phases = self._state, self._phases
        self._plan = None
        if phases.phase in (Phase.APPROACH, Phase.FOLLOW) and self._tip.t is not None:
            self._plan = self._planned(t, dt)
        age = None if self._tip.t is None else t - self._tip.t
        if age is None and self._heard:
            age = 0.0        # the first one, which counts from the next tick on
        home = _missing(self.holder.home, state)
        phases.advance(Situation(
            t, age, state.in_contact, self.holder.retreated(),
            home[0] < _HOME and home[1] < _TURNED, self._below(), self._plan,
            self._depth_fault()))
        self._begin()

    def _planned(self, t, dt):
        p, v = self._tip.at(t)
        if self._planner is None:
            try:
                self._planner = self.holder.planners[self._params.strategy](
                    self._params, self._surface, p, self._tip.along, self._state.R[:, 2])
            except InputError as problem:
                return Plan(outcome=Outcome.UNREACHABLE, message=str(problem))
        plan = self._planner.plan(p, self._tip.along, v, self._state, dt)
        if plan.R is not None:
            obstacle = self.holder.obstacle(plan.R, plan.p)
            if obstacle:
                return Plan(outcome=Outcome.UNREACHABLE, message=obstacle)
            self._goal = plan.R, plan.p
        return plan

    def _below(self):
        if self._phases.phase is Phase.HOLD:
            R, p = self._frozen
            return self._sunk + float((self._state.p - p) @ R[:, 2])
        if self._plan is None or self._plan.R is None:
            return 0.0
        self._sunk = float((self._plan.p - self._state.p) @ self._plan.up)
        return self._sunk

    def _depth_fault(self):
        if self._plan is None or self._plan.R is None:
            return ''
        p, _ = self._tip.at(self._tip.t)
        depth, most = (p - self._state.p) @ self._state.R[:, 2], self._image_depth
        if _SHALLOWEST <= depth <= most:
            return ''
        return (f'the tip is {1e3 * depth:.0f} mm from the face; must be {1e3 * _SHALLOWEST:g} to '
                f'{1e3 * most:g} mm, the depth of the image')

    def _begin(self):
        """What a new phase starts from."""
        before, phase = self._entered, self._phases.phase
        if phase is before:
            return
        self._entered = phase
        if before is Phase.STOPPED:
            self.holder.clear_trip()
        self._frozen = self._state.R, self._state.p
        self._near, self._over = self._state.in_contact, 0.0
        if phase is Phase.RETRACT and before is not Phase.IDLE:
            self._phases.clear = False
            self.holder.begin_retreat(self._params.clearance + max(self._sunk, 0.0))

    def _errand(self, dt):
        """The Errand that belongs to the phase; dt : [s] of the tick."""
        phase, plan = self._phases.phase, self._plan
        if phase is Phase.STOPPED:
            return Errand(Way.BRAKE, *self._frozen, _STILL, _STILL)
        if phase is Phase.RETRACT:
            goal = self.holder.home if self._phases.clear else self._frozen
            return Errand(Way.POSE if self._phases.clear else Way.RETREAT, *goal, _STILL, _STILL)
        if phase in (Phase.APPROACH, Phase.FOLLOW) and plan is not None and plan.R is not None:
            return self._following(phase, plan, dt)
        way = Way.FORCE if self._state.in_contact else Way.POSE
        return Errand(way, *self._frozen, _STILL, _STILL, force=self._params.force)

    def _following(self, phase, plan, dt):
        """Over the skin first, there the zero is taken, then down; in contact with the force."""
        params = self._params
        over = plan.R, plan.p + params.clearance * plan.up
        if phase is Phase.APPROACH and not self._near:
            off, turned = _missing(over, self._state)
            there = off < _NEAR and turned < _TURNED
            self._near = there and self._over >= params.zeroing - _SLACK
            self._over = self._over + dt if there else 0.0
        if phase is Phase.APPROACH and not self._near:
            return Errand(Way.POSE, *over, plan.v, plan.w)
        return Errand(Way.FORCE, plan.R, plan.p, plan.v, plan.w, plan.sinking,
                      params.approach_speed, params.force)

    def _told(self, t, force):
        state, phases = self._state, self._phases
        aside = np.nan if self._last_tip is None else out_of_plane(state.R, state.p,
                                                                    self._last_tip)
        waiting = self._plan is not None and self._plan.waiting
        return ProbeArmStep(
            t, phases.phase, state.in_contact, state.force_goal, force, aside, waiting,
            *self._goal, state.R, state.p, state.R_true, state.p_true, state.q, state.dq,
            state.torque, state.wrench, phases.outcome, phases.message)

    def picture(self, width=640, height=480, skin=None):
        """Return (height, width, 3) uint8 of the arm over the body.

        skin : (x (n, 3), triangles (k, 3)) to draw, W; None = the arm alone
        """
        return self.holder.picture(width, height, skin)

    def close(self):
        """Let the holder go."""
        self.holder.close()


def _missing(goal, state):
    """(m, rad) between a goal (R, p) and where the probe is."""
    return (float(np.linalg.norm(goal[1] - state.p)),
            float(np.linalg.norm(rotation_vector(goal[0] @ state.R.T))))
