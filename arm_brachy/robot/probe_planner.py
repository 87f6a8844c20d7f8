"""The pose that the probe shall have in a tick, from the tip, the skin and the strategy.

A needle enters the body from the side, where the skin is too steep for a face that presses from
above. The probe therefore waits over the first point of the needle's line where it can stand, and
goes with the tip once that comes by. The search for that point takes a few steps in each tick.
"""

from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.robot.probe_pose import centre_goal, orientation_goal, translational_goal
from arm_brachy.robot.reference import rotation_vector

_AHEAD = 2e-3        # m, step of the search along the needle
_STEPS = 2           # of it in a tick: one takes 4 ms on a scanned surface of a thousand patches
_FARTHEST = 0.15     # m from the tip, where the search ends
_PLANE = 0.1         # m up from the tip: a point of the plane that the strategies stay in
_SHALLOWEST = 2e-3   # m of the tip under the face
_ROUNDING = 1e-9     # rad
_PARALLEL = 0.1      # sine between needle and probe, below which no plane holds both
_SMOOTH = 0.5        # share of the last angular velocity that is kept


@dataclass(frozen=True)
class Plan:
    """Goal pose R (3, 3), p (3,) of the probe, how it moves, and what came of planning.

    v, w : (3,) [m/s, rad/s];  up : (3,) from the skin into the air
    sinking : [m/s] against up with which the path over the skin goes
    waiting : True while the probe stands ahead of the tip. R is None without a pose.
    """

    R: np.ndarray | None = None
    p: np.ndarray | None = None
    v: np.ndarray = field(default_factory=lambda: np.zeros(3))
    w: np.ndarray = field(default_factory=lambda: np.zeros(3))
    up: np.ndarray | None = None
    sinking: float = 0.0
    waiting: bool = False
    outcome: Outcome = Outcome.OK
    message: str = ''


class _Planner:
    """What both strategies share: the plane {N}, the search ahead of the tip."""

    def __init__(self, params, surface, tip, along, z):
        """tip, along : where the needle is and where it goes;  z : (3,) axis of the probe now."""
        self._params, self.surface = params, surface
        up = -(z - along * (along @ z))
        if not np.linalg.norm(up) > _PARALLEL:
            raise InputError("probe: the needle runs along the probe's axis; must be across it: "
                             'turn the template')
        self._up = up / np.linalg.norm(up)
        self._start, self._from = tip, tip
        self._ready, self._last = False, None

    def over(self, tip, along):
        """Return the ProbeGoal of a probe at rest that has followed the needle to a tip.

        tip, along : (3,). Raises InputError where it cannot stand: no skin, a hole, too steep.
        """
        return self._stand(tip, along)[0]

    def _stand(self, tip, along):
        """Goal over a point of the needle's line, or InputError: no skin, a hole, too steep."""
        goal = self._goal(tip, along)
        off = self.surface.distance(goal.p)
        if off > self._params.hole:
            place = ', '.join(f'{1e3 * c:.0f}' for c in goal.p)
            raise _NoSkin(f'probe: the nearest known skin is {1e3 * off:.0f} mm from ({place}) mm '
                          f'where it shall stand; must be within {1e3 * self._params.hole:g} mm: '
                          'scan that part again')
        normal = self.surface.normal(goal.p)
        angle = np.arccos(np.clip(-normal @ goal.R[:, 2], -1.0, 1.0))
        if angle > self._params.steepest:
            raise _TooSteep(f'probe: the skin is {np.degrees(angle):.0f} deg off its axis; must '
                            f'be at most {np.degrees(self._params.steepest):.0f} deg: move the '
                            'template')
        if (tip - goal.p) @ goal.R[:, 2] < _SHALLOWEST:
            raise _TooSteep('probe: the needle is not under the skin yet')
        return goal, normal

    def _goal(self, tip, along):
        up = self._up - along * (along @ self._up)
        return translational_goal(self.surface, tip + _PLANE * up, tip, along)

    def _search(self, along):
        """Step along the needle's line until the probe can stand."""
        for _ in range(_STEPS):
            try:
                self._stand(self._from, along)
            except _NoSkin as problem:
                return Plan(outcome=Outcome.NO_SURFACE, message=str(problem))
            except InputError as problem:
                self._from = self._from + _AHEAD * along
                if (self._from - self._start) @ along > _FARTHEST:
                    return Plan(outcome=Outcome.UNREACHABLE, message=str(problem))
            else:
                self._ready = True
                break
        return Plan(waiting=True, message='looking for where the probe can stand')

    def _ahead(self, tip, along):
        """(waiting, point): the tip, or the first point of its line where the probe can stand."""
        left = (self._from - tip) @ along
        return left > 0.0, tip + along * max(0.0, left)

    def _turning(self, R, dt):
        """Angular velocity (3,) of the goal, smoothed, from the goal before."""
        if self._last is None:
            self._last = R, np.zeros(3)
        before, w = self._last
        w = _SMOOTH * w + (1.0 - _SMOOTH) * rotation_vector(R @ before.T) / dt
        self._last = R, w
        return w


class _NoSkin(InputError):
    """The skin is not known where the probe shall stand."""


class _TooSteep(InputError):
    """The probe cannot stand there, but perhaps farther on."""


def _within(tip, along, pivot, tilt):
    """(waiting, point): the tip, or on the needle's line what the largest tilt points at.

    pivot : (3,) that the probe turns about;  tilt : [rad] to either side
    """
    foot = (pivot - tip) @ along
    depth = np.linalg.norm(pivot - tip - along * foot)
    most = depth * np.tan(tilt)
    if abs(foot) <= most:
        return False, tip
    return True, tip + along * (foot - np.sign(foot) * most)


class TranslationalPlanner(_Planner):
    """(6.4) to (6.8): over the tip, across the needle."""

    _was = None          # (3, 3) of the probe in the call before

    def plan(self, tip, along, v, state, dt):
        """Return the Plan.

        tip, v : (3,) of the tip at the start of the tick;  along : (3,) of the needle
        state : HolderState now;  dt : [s] since the call before
        """
        if not self._ready:
            return self._search(along)
        waiting, point = self._ahead(tip, along)
        v = np.zeros(3) if waiting else v
        try:
            goal, normal = self._stand(point, along)
        except _NoSkin as problem:
            return Plan(outcome=Outcome.NO_SURFACE, message=str(problem))
        except InputError as problem:
            return Plan(outcome=Outcome.UNREACHABLE, message=str(problem))
        up = -goal.R[:, 2]
        # The plane of the picture is to hold the point now, whatever is left to turn; the face
        # goes aside as it turns.
        y = state.R[:, 1]
        v = v + y * ((point - goal.p) @ np.cross(self._turns(state.R, dt), y))
        # On the skin: the velocity of the point has no part along the normal.
        sinking = float((normal @ v) / (normal @ up))
        v = v - up * sinking
        return Plan(goal.R, goal.p + y * (y @ (point - goal.p)), v, self._turning(goal.R, dt), up,
                    sinking, waiting)

    def _turns(self, R, dt):
        """Angular velocity (3,) [rad/s] of the probe since the call before."""
        before, self._was = self._was, R
        return np.zeros(3) if before is None else rotation_vector(R @ before.T) / dt


class OrientationPlanner(_Planner):
    """(6.1) to (6.3): about the contact point, which lies where the skin is flattest.

    The probe touches the skin upright and turns from there, at a speed that the force bears.
    """

    _tilt = 0.0          # rad, largest by now

    def plan(self, tip, along, v, state, dt):
        """Return the Plan; see `TranslationalPlanner.plan`."""
        if not self._ready:
            return self._search(along)
        contact = self._contact
        if state.in_contact:     # it goes with the skin, up and down
            self._tilt = min(self._params.tilt, self._tilt + self._params.tilting * dt)
            contact = contact + self._normal * (self._normal @ (state.p - contact))
        waiting, point = _within(tip, along, contact, self._tilt)
        towards = point - contact
        if towards @ -self._normal < _SHALLOWEST:
            return Plan(outcome=Outcome.UNREACHABLE, message='probe: the needle is not under the '
                        'contact point; must be at least 2 mm below: withdraw it, or insert it '
                        'deeper under the skin')
        goal = orientation_goal(self._R, contact, point)
        w = np.zeros(3) if waiting else np.cross(towards, v) / (towards @ towards)
        return Plan(goal.R, contact, np.zeros(3), w, self._normal, waiting=waiting)

    def over(self, tip, along):
        """See `_Planner.over`."""
        while not self._ready:
            searched = self._search(along)
            if not searched.outcome.ok:
                raise InputError(searched.message)
        _, point = _within(tip, along, self._contact, self._params.tilt)
        return orientation_goal(self._R, self._contact, point)

    def _search(self, along):
        for _ in range(_STEPS):
            try:
                goal, normal = self._stand(self._from, along)
            except _NoSkin as problem:
                return Plan(outcome=Outcome.NO_SURFACE, message=str(problem))
            except InputError as problem:
                self._from = self._from + _AHEAD * along
                if (self._from - self._start) @ along > _FARTHEST:
                    return Plan(outcome=Outcome.UNREACHABLE, message=str(problem))
                continue
            if normal @ along >= 0.0:     # uphill until here
                self._R, self._contact, self._normal = goal.R, goal.p, -goal.R[:, 2]
                self._ready = True
                break
            self._from = self._from + _AHEAD * along
        return Plan(waiting=True, message='looking for where the probe can stand')


class CentrePlanner(_Planner):
    """The orientation strategy of a holder that turns the probe about a fixed centre.

    Where chapter 6 turns the probe about its contact point, such a holder turns it about the
    centre of the body: the face goes over the skin, by its distance from the centre over that of
    the tip times the way of the tip across the axis.
    """

    def __init__(self, centre, *args):
        """centre : (3,) [m];  the rest as in the other planners"""
        super().__init__(*args)
        self._centre = np.array(centre, dtype=float)

    def over(self, tip, along):
        """See `_Planner.over`."""
        _, point = _within(tip, along, self._centre, self._params.tilt)
        return self._stand(point, along)[0]

    def plan(self, tip, along, v, state, dt):
        """Return the Plan; see `TranslationalPlanner.plan`."""
        if not self._ready:
            return self._search(along)
        ahead, point = self._ahead(tip, along)
        beyond, point = _within(point, along, self._centre, self._params.tilt)
        waiting = ahead or beyond
        try:
            goal, normal = self._stand(point, along)
        except _NoSkin as problem:
            return Plan(outcome=Outcome.NO_SURFACE, message=str(problem))
        except InputError as problem:
            return Plan(outcome=Outcome.UNREACHABLE, message=str(problem))
        up, out = -goal.R[:, 2], point - self._centre
        w = np.zeros(3) if waiting else np.cross(out, v) / (out @ out)
        v = np.cross(w, goal.p - self._centre)
        sinking = float((normal @ v) / (normal @ up))
        return Plan(goal.R, goal.p, v - up * sinking, w, up, sinking, waiting)

    def _goal(self, tip, along):
        beyond, _ = _within(tip, along, self._centre, self._params.tilt + _ROUNDING)
        if beyond:
            raise _TooSteep('probe: the needle is not yet where the probe can turn to')
        return centre_goal(self.surface, self._centre, tip, along)


PLANNERS = {'translational': TranslationalPlanner, 'orientation': OrientationPlanner}
