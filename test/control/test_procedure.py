"""The procedure against a toy cell: what is ordered when, and that every failure ends safely."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.control.needle_plan import NeedleCourse
from arm_brachy.control.procedure import Procedure
from arm_brachy.control.procedure_params import ProcedureParams
from arm_brachy.control.procedure_steps import Kind, NeedleSeen, Phase, ProbeSeen
from arm_brachy.control.safety import Permission
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.probe_phase import ProbePhase

TICK = 0.05
AXIS, SIDE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
BEND = 0.4
HOLES = np.array([[(-0.1, y, z) for z in (-5e-3, 0.0, 5e-3)] for y in (-5e-3, 0.0, 5e-3)])


def arc(roll, depth, turn=np.inf, radius=BEND):
    """Bent to one side, and back from a depth `turn` on, for small slopes."""
    n = np.cos(roll) * SIDE + np.sin(roll) * np.cross(AXIS, SIDE)
    return depth * AXIS + (0.5 * depth**2 - max(depth - turn, 0.0) ** 2) / radius * n


class Toy:
    """Everything does what it is told, at once or at the speed it is told; parts can be broken.

    broken : names among target, scanner, needle, probe, contact, pads, sight, plane, depth
    bias : [m] that the told depth is off by
    drag : share of the needle's way by which it takes the target along
    rise : share of the way along y by which the pads lift the target
    """

    def __init__(self, broken=(), radius=BEND, press=(0.0, 0.0, 0.0), rise=0.0, bias=0.0,
                 drag=0.0, **given):
        self.procedure = Procedure(ProcedureParams('t', **given), HOLES,
                                   NeedleCourse(AXIS, SIDE, 0.2, arc, 1.0 / BEND), settle=0.2,
                                   press=press)
        self.broken, self.radius, self.rise, self.bias = set(broken), radius, rise, bias
        self.drag = drag
        self.t, self.orders, self.phases = 0.0, [], []
        self.target, self.goal = np.array([0.0, 0.002, 0.0]), None
        self.depth, self.drive, self.hole, self.probe = 0.0, (0.0, 0.0), HOLES[1, 1], 0
        self.told = 1.0 / BEND, np.zeros(3)     # curvature [1/m] and offset [m] of the needle
        self.aside = np.zeros(3)    # m by which the tissue has bent it off its path
        self.shown = []             # depth, where the tip will be, where it is to be
        self.p, self.t_dir, self.n, self.home = self.hole.copy(), AXIS, SIDE, True
        self.permission, self.contact, self.seen_off = Permission.RUN, True, None
        self.nearest = -np.inf      # m along the axis, from which on the probe can see the tip

    def run(self, seconds=200.0, until=None):
        """Go on until all is over, a phase begins, or the time is up; returns self."""
        end = self.t + seconds
        while self.t < end and self.procedure.phase not in (Phase.FINISHED, until):
            self.tick()
        return self

    def tick(self):
        self.t += TICK
        self._move()
        p = self.procedure
        p.permit(self.permission, 'a test')
        if 'target' not in self.broken:
            p.hear_target(self.t, self.target)
        p.hear_needle(NeedleSeen(self.depth + self.bias))
        touching = self.probe == 2 and self.contact
        off = min(0.0, self.p[0] - self.nearest) if touching else np.nan
        p.hear_probe(ProbeSeen(self.probe, touching, np.nan if 'plane' in self.broken else off,
                               *self._probe_says()))
        p.hear_pads(self.home)
        if touching and 'sight' not in self.broken:
            p.hear_image(self.t, self.p + self.aside)
            if self.seen_off is not None:
                p.hear_target_image(self.t, self.target + self.seen_off)
        for order in p.step(self.t):
            self._obey(order)
        self.phases.append(p.phase)

    def _probe_says(self):
        if 'probe' in self.broken and self.probe == 3:
            return Outcome.UNREACHABLE, 'too far'
        if 'depth' in self.broken and self.probe == 2:
            return Outcome.OUT_OF_IMAGE, 'the tip is 70 mm from the face'
        return ()

    def _move(self):
        depth, speed = self.drive
        if 'needle' not in self.broken:
            step = np.clip(depth - self.depth, -speed * TICK, speed * TICK)
            self.depth += step
            self.p = self.p + step * self.t_dir
            self.target = self.target + self.drag * step * AXIS
            self.t_dir = self.t_dir + step / self.radius * self.n
            self.t_dir /= np.linalg.norm(self.t_dir)
        if self.goal is not None and 'pads' not in self.broken:
            moved = 0.2 * (self.goal - self.target)
            if self.rise:       # of y by itself, as tissue does that is pushed from its side
                moved[2] = self.rise * moved[1]
            self.target = self.target + moved

    def _obey(self, order):
        self.orders.append(order.kind)
        kind, value = order.kind, order.value
        if kind in (Kind.SET_GOAL, Kind.SHIFT):
            self.goal, self.home = np.array(value), False
        elif kind is Kind.REST:
            self.goal = None
        elif kind is Kind.BEND:
            self.told = value[0], np.array(value[1:])
        elif kind is Kind.SHOW:
            self.shown.append((self.depth, np.array(value[:3]), np.array(value[3:])))
        elif kind is Kind.RELEASE:
            self.goal, self.home = None, 'home' not in self.broken
        elif kind is Kind.SCAN and 'scanner' not in self.broken:
            self.procedure.hear_surface()
        elif kind is Kind.PLACE:
            self.p, self.roll = np.array(value[:3]), value[3]
            self._turn()
        elif kind is Kind.TURN:
            self.roll = value[0]
            self._turn()
        elif kind is Kind.DRIVE:
            self.drive = value
        elif kind is Kind.STAY:
            self.drive = (self.depth, 1.0)
        elif kind is Kind.FOLLOW:
            self.probe = 3 if 'probe' in self.broken else 2
        elif kind is Kind.RETRACT:
            self.probe = 0

    def _turn(self):
        self.n = np.cos(self.roll) * SIDE + np.sin(self.roll) * np.cross(AXIS, SIDE)
        self.n = self.n - self.t_dir * (self.t_dir @ self.n)


def test_the_path_ends_where_the_probe_will_have_pressed_the_target():
    """Along the axes of the pads it does not: they follow the target under the probe."""
    toy, blind = Toy(press=(0.0, 1e-3, -3e-3)), Toy()
    plans = [one.run(until=Phase.MOVING).procedure.plan for one in (toy, blind)]
    aside = plans[0].goal - plans[1].goal
    assert aside[2] == pytest.approx(-3e-3, abs=1e-9)
    assert abs(plans[0].tip[2] - plans[0].goal[2]) == pytest.approx(plans[0].left, abs=1e-9)
    there = toy.target + [0.0, 0.0, -3e-3]
    assert plans[0].goal[0] == pytest.approx(there[0]) and plans[0].left < 1e-3


def test_the_path_is_planned_anew_to_where_pads_lift_the_target_besides():
    toy = Toy(rise=0.3, turn=False).run(until=Phase.SCANNING)
    assert toy.orders.count(Kind.SET_GOAL) == 1 and Kind.SHIFT in toy.orders
    assert toy.target[2] > 1e-3     # lifted: a path to where it was would miss it by as much
    assert abs(toy.procedure.plan.tip[2] - toy.target[2]) < 0.3e-3


def straight(**given):
    """A Toy whose needle is planned to go straight."""
    toy = Toy(overlay=False, **given)
    toy.procedure._course = NeedleCourse(AXIS, SIDE, 0.2, lambda roll, depth, turn: depth * AXIS)
    return toy


def test_a_path_that_passes_the_target_by_more_than_allowed_is_not_begun():
    """Holes 5 mm apart, a target between two of them: 2.5 mm aside of each."""
    for miss, outcome in ((2.6e-3, Outcome.OK), (2.4e-3, Outcome.INFEASIBLE)):
        toy = straight(miss=miss)
        toy.target = np.array([0.0, 0.0, 2.5e-3])
        toy.run(until=Phase.PLACING)
        assert toy.procedure.outcome is outcome
        assert (Kind.PLACE in toy.orders) == (outcome is Outcome.OK)
    assert 'pass the target by 2.5 mm' in toy.procedure.message
    assert Kind.DRIVE not in toy.orders


def test_pads_that_lift_the_target_beyond_what_a_needle_may_pass_it_by_end_the_procedure():
    toy = straight(rise=0.5, miss=0.5e-3, hole=(1, 1)).run()
    assert toy.procedure.outcome is Outcome.INFEASIBLE and Kind.PLACE not in toy.orders
    assert toy.procedure.message.startswith('moving: the needle would pass the target by ')
    assert toy.home and toy.procedure.phase is Phase.FINISHED


def test_a_better_plan_whose_goal_is_refused_is_given_up_and_nothing_else():
    toy = Toy(rise=0.3, turn=False).run(until=Phase.MOVING)
    while Kind.SHIFT not in toy.orders:
        before = toy.procedure.plan
        toy.tick()
    toy.goal = before.goal      # as it was: the manipulator did not take the new one
    toy.procedure.refused('out of reach', Kind.SHIFT)
    assert toy.procedure.plan is before and toy.procedure.phase is Phase.MOVING
    toy.run()
    assert toy.procedure.outcome is Outcome.OK and toy.orders.count(Kind.SHIFT) == 1


def test_pads_stay_while_a_stopped_probe_is_on_the_skin():
    toy = Toy(overlay=False).run(until=Phase.WITHDRAWING)
    seen = toy.procedure.hear_probe
    stopped = ProbeSeen(int(ProbePhase.STOPPED), True, 0.0, Outcome.HELD, 'stopped')
    toy.procedure.hear_probe = lambda _: seen(stopped)
    toy.run(until=Phase.RETRACTING).run(seconds=3.0)
    assert toy.procedure.phase is Phase.RETRACTING and Kind.RELEASE not in toy.orders
    stopped = ProbeSeen(int(ProbePhase.STOPPED), False, 0.0, Outcome.HELD, 'stopped')
    toy.run()
    assert toy.procedure.phase is Phase.FINISHED and Kind.RELEASE in toy.orders


def test_what_pads_have_done_counts_in_how_far_they_may_displace_the_target():
    toy = Toy(rise=0.3, reach=5e-3).run(until=Phase.SCANNING)
    assert abs(toy.procedure.plan.goal[1] - 2e-3) <= 5e-3


def test_an_undisturbed_procedure_goes_through_every_step_in_order():
    toy = Toy().run()
    seen = list(dict.fromkeys(toy.phases))
    assert [p for p in Phase if p in seen] == seen
    assert {Phase.MOVING, Phase.INSERTING, Phase.DWELLING, Phase.FINISHED} <= set(seen)
    assert toy.procedure.outcome is Outcome.OK and toy.procedure.message == ''
    assert toy.depth < 2e-3 and toy.probe == 0 and toy.home
    assert toy.orders[-1] is Kind.FINISH


def test_the_needle_comes_to_a_probe_that_cannot_reach_back_to_its_tip():
    toy = Toy(overlay=False).run(until=Phase.APPROACHING)
    toy.nearest = toy.p[0] + 7e-3
    toy.run(until=Phase.INSERTING)
    assert abs(toy.p[0] - toy.nearest) <= 0.3e-3 + 1e-9
    toy.run()
    assert toy.procedure.outcome is Outcome.OK


def test_a_tip_that_is_in_the_image_plane_already_is_not_waited_for():
    toy = Toy(overlay=False).run(until=Phase.APPROACHING)
    behind = Toy(overlay=False).run(until=Phase.APPROACHING)
    behind.nearest = behind.p[0] + 1e-3
    for one in (toy, behind):
        one.run(until=Phase.INSERTING)
    waited = toy.phases.count(Phase.APPROACHING) * TICK - toy.procedure.params.calm
    assert abs(waited) <= 2.5 * TICK
    assert Phase.MEETING not in toy.phases
    assert behind.phases.count(Phase.MEETING) * TICK > 2 * behind.procedure.params.calm


def test_contact_lost_on_the_way_to_the_image_plane_stops_the_needle_for_so_long():
    toy = Toy(overlay=False).run(until=Phase.APPROACHING)
    toy.nearest = toy.p[0] + 7e-3
    toy.run(until=Phase.MEETING).run(seconds=1.6)
    toy.contact = False
    toy.run(seconds=0.2)
    stopped = toy.depth
    toy.run(seconds=1.0)
    assert toy.depth == stopped and toy.procedure.phase is Phase.MEETING
    toy.contact = True
    toy.run(until=Phase.INSERTING)
    assert abs(toy.p[0] - toy.nearest) <= 0.3e-3 + 1e-9
    assert toy.run().procedure.outcome is Outcome.OK


def test_a_probe_that_never_sees_the_tip_ends_the_procedure_before_the_target():
    toy = Toy(overlay=False).run(until=Phase.APPROACHING)
    toy.nearest = toy.target[0] + 0.05
    toy.run(until=Phase.MEETING)
    deepest = toy.depth
    while toy.procedure.phase is Phase.MEETING:
        toy.tick()
        deepest = max(deepest, toy.depth)
    assert deepest <= toy.procedure.plan.depth + 1e-9
    assert toy.procedure.outcome is Outcome.TIMED_OUT
    assert toy.procedure.message.startswith('meeting: ')


def test_the_needle_goes_the_last_of_its_way_slowly():
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    speeds = []
    while toy.procedure.phase is Phase.INSERTING:
        before = toy.depth
        toy.tick()
        speeds.append((toy.procedure.plan.depth - before, (toy.depth - before) / TICK))
    far = [v for left, v in speeds if left > 5e-3]
    last = [v for left, v in speeds if left < 3.5e-3]
    assert np.isclose(max(far), 5e-3) and np.isclose(max(last), 2e-3)
    change = np.diff([v for left, v in speeds if left > 1e-3])
    assert np.abs(change).max() < 0.51e-3   # six steps from 2 to 5 mm/s and back, in their ticks
    assert max(v for _, v in speeds[:3]) < 2.6e-3


def test_a_slow_insertion_does_not_speed_up_before_the_target():
    toy = Toy(overlay=False, speed=1e-3).run(until=Phase.INSERTING)
    while toy.procedure.phase is Phase.INSERTING:
        before = toy.depth
        toy.tick()
        assert (toy.depth - before) / TICK < 1.01e-3


@pytest.mark.parametrize('bias', [0.8e-3, -0.8e-3])
def test_a_depth_sensor_that_is_off_ends_no_procedure(bias):
    """By four standard deviations: the drive goes to its depth, another one is told."""
    toy = Toy(overlay=False, bias=bias).run()
    assert toy.procedure.outcome is Outcome.OK and Kind.TURN in toy.orders


def test_a_person_turns_the_base_by_half_a_turn_at_most_and_not_where_no_way_is_left():
    toy, rolls = Toy(radius=0.25, view=0.045, turn=False).run(until=Phase.INSERTING), []
    while toy.procedure.phase is Phase.INSERTING:
        before, left = toy.roll, toy.procedure.plan.depth - toy.depth
        toy.tick()
        if toy.roll != before:
            rolls.append(abs(toy.roll - before))
            assert left > 5e-3      # sqrt(2 R 0.1 mm) is 7 mm, and a curvature less sure
    assert rolls and max(rolls) <= np.pi + 1e-9


def test_at_the_dwell_the_tip_is_at_the_target():
    toy = Toy(overlay=False).run(until=Phase.DWELLING)
    assert np.linalg.norm(toy.p - toy.target) < 0.7e-3


@pytest.mark.parametrize('radius', [0.25, 0.65])
def test_a_needle_that_is_turned_over_as_planned_ends_where_another_would(radius):
    """Nobody steers. Without the turn it is 7.5 or 4.8 mm off: L^2 / 2 (1 / R - 1 / 0.4)."""
    def ended(turn):
        toy = Toy(radius=radius, overlay=False, turn=turn).run(until=Phase.DWELLING)
        return np.linalg.norm((toy.p - toy.target)[1:]), toy
    (off, turned), (without, _) = ended(True), ended(False)
    assert off < 0.7e-3 and without > 4e-3
    assert turned.orders.count(Kind.TURN) == 1
    assert np.isclose(turned.roll, turned.procedure.plan.roll + np.pi)
    assert turned.orders.index(Kind.TURN) < turned.orders.index(Kind.FOLLOW)


def test_the_person_who_sees_the_overlay_brings_a_needle_of_another_arc_nearer():
    """True radius 300 mm, nominal 400 mm: 4 mm beside the path if nobody turns the needle.

    Seen over 45 mm, turned about from bending with the plan (1/0.3) to against it (-1/0.3), it
    could come back by 45^2 / 2 (1/400 + 1/300) = 5.9 mm; a person who starts late gets less.
    """
    def missed(overlay):
        toy = Toy(radius=0.3, overlay=overlay, view=0.045, turn=False).run(until=Phase.DWELLING)
        return np.linalg.norm(toy.p - toy.target), toy.orders.count(Kind.TURN)
    without, with_it = missed(False), missed(True)
    assert without[0] > 3e-3 and without[1] == 0
    assert with_it[0] < 2e-3 and 1 <= with_it[1] < 20


def test_each_image_of_the_tip_is_answered_by_where_it_will_be():
    """Radius 0.3 m instead of 0.4: in the end right within 0.2 mm, two pixels."""
    toy = Toy(radius=0.3, overlay=False, view=0.045, turn=False).run(until=Phase.DWELLING)
    ends = [p for _, p, _ in toy.shown]
    off = np.linalg.norm([(p - toy.p)[1:] for p in ends], axis=1)
    assert len(ends) == pytest.approx(toy.phases.count(Phase.INSERTING), abs=1)
    assert off[-1] < 0.2e-3 and off[0] > 1e-3
    # Half way there it is known already by what the person steers for.
    assert off[len(off) // 2] < ProcedureParams('t').steering.seen
    assert np.allclose([p[0] for p in ends], [wanted[0] for _, _, wanted in toy.shown])
    assert np.allclose(toy.shown[-1][2], toy.procedure.plan.goal)


def test_a_needle_of_another_arc_is_told_as_the_images_show_it_and_a_usual_one_is_not():
    other, usual = (Toy(radius=r, overlay=False).run(until=Phase.DWELLING) for r in (0.3, BEND))
    assert abs(other.told[0] - 1.0 / 0.3) < 0.5 * (1.0 / 0.3 - 1.0 / BEND)
    assert abs(usual.told[0] * BEND - 1.0) < 0.02 and np.linalg.norm(usual.told[1]) < 0.1e-3


def test_a_needle_that_the_tissue_has_bent_aside_is_told_where_the_images_show_it():
    """0.5 mm down since the probe pressed, and an arc of 0.3 m; across the axis, by the depth."""
    toy = Toy(radius=0.3, overlay=False)
    toy.aside = np.array([0.0, 0.0, -0.5e-3])
    toy.run(until=Phase.DWELLING)
    plan, (kappa, offset) = toy.procedure.plan, toy.told
    told = plan.hole + arc(plan.roll, toy.depth, plan.turn, 1.0 / kappa) + offset
    blind = plan.hole + arc(plan.roll, toy.depth, plan.turn)
    true = toy.p + toy.aside
    assert np.linalg.norm((told - true)[1:]) < 0.15e-3
    assert np.linalg.norm((blind - true)[1:]) > 0.5e-3


def test_pads_rest_while_the_needle_goes_out():
    """It drags the target along: pads that push against that squeeze the tissue."""
    toy = Toy(overlay=False).run(until=Phase.DWELLING)
    asked = toy.orders.count(Kind.SHIFT)
    toy.run(until=Phase.WITHDRAWING)
    while toy.depth > 5e-3:
        toy.tick()
        assert toy.goal is None or toy.phases[-1] is Phase.DWELLING
    toy.run()
    assert toy.orders.count(Kind.REST) == 1 and toy.orders.count(Kind.SHIFT) == asked
    assert toy.orders.index(Kind.REST) < toy.orders.index(Kind.RELEASE)


def test_the_needle_follows_a_target_that_moves_along_it():
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.goal = toy.goal + [0.003, 0.0, 0.0]
    toy.run(until=Phase.DWELLING)
    assert abs(toy.p[0] - toy.target[0]) < 0.7e-3


def test_what_the_images_show_of_the_target_counts_before_the_estimate():
    """The estimate is 2.5 mm off along the needle: it knows nothing of probe and needle."""
    off = np.array([0.0025, 0.0, 0.0])
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.seen_off = off
    toy.run(until=Phase.DWELLING)
    assert abs(toy.p[0] - (toy.target + off)[0]) < 0.7e-3
    late = Toy(overlay=False).run(until=Phase.INSERTING)
    while abs(late.p[0] - late.target[0]) > 0.6e-3:
        late.tick()
    late.run(seconds=0.5)
    assert late.procedure.phase is Phase.INSERTING      # seen only when the tip is there already
    late.seen_off = off
    late.run(until=Phase.DWELLING)
    assert abs(late.p[0] - (late.target + off)[0]) < 0.7e-3
    lost = Toy(overlay=False).run(until=Phase.INSERTING)
    lost.seen_off = off
    lost.tick()
    lost.seen_off = None            # out of sight again: the estimate it is
    lost.run(until=Phase.DWELLING)
    assert abs(lost.p[0] - lost.target[0]) < 0.7e-3


@pytest.mark.parametrize('recentre', [True, False])
def test_pads_take_a_target_that_is_seen_beside_the_needle_onto_its_way(recentre):
    """The needle bends more than planned, 1/0.33 against 1/0.4 per metre: 2.8 mm over 0.1 m."""
    toy = Toy(overlay=False, radius=0.33, recentre=recentre, dwell=3.0, turn=False,
              axes=('x', 'y', 'z')).run(until=Phase.INSERTING)
    toy.seen_off = np.zeros(3)
    toy.run(until=Phase.WITHDRAWING)
    assert (Kind.SHIFT in toy.orders) == recentre and toy.orders.count(Kind.SET_GOAL) == 1
    beside = np.linalg.norm((toy.p - toy.target)[1:])
    assert beside < 0.5e-3 if recentre else beside > 2e-3


@pytest.mark.parametrize(('broken', 'phase', 'outcome'), [
    ({'target'}, 'registering', Outcome.TIMED_OUT), ({'pads'}, 'moving', Outcome.TIMED_OUT),
    ({'scanner'}, 'scanning', Outcome.TIMED_OUT), ({'needle'}, 'placing', Outcome.NEEDLE_STANDS),
    ({'probe'}, 'approaching', Outcome.UNREACHABLE), ({'home'}, 'homing', Outcome.TIMED_OUT),
])
def test_each_failure_is_named_once_and_everything_goes_back(broken, phase, outcome):
    toy = Toy(broken).run(400.0)
    p = toy.procedure
    assert p.phase is Phase.FINISHED and p.outcome is outcome
    assert p.message.startswith(f'{phase}: ') and '\n' not in p.message
    assert toy.orders[-1] is Kind.FINISH and Kind.RELEASE in toy.orders
    assert toy.depth < 2e-3 and toy.probe == 0


@pytest.mark.parametrize('breath', [0.0, 1e-3])
def test_a_needle_that_something_stops_on_its_way_in_is_named_within_seconds(breath):
    """Also where its depth is ordered anew again and again, for a target that moves."""
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.run(1.0)
    toy.broken.add('needle')
    since, centre = toy.t, toy.target
    while toy.procedure.phase is Phase.INSERTING and toy.t < since + 20.0:
        toy.target = centre + breath * np.sin(0.5 * np.pi * toy.t) * AXIS
        toy.tick()
    assert toy.t - since < ProcedureParams('t').limits.standing + 3 * TICK
    assert toy.procedure.outcome is Outcome.NEEDLE_STANDS
    assert 'has stood at' in toy.procedure.message
    assert ' N: look at its drive' in toy.procedure.message


def test_a_probe_that_gives_up_at_the_target_is_named():
    toy = Toy(dwell=3.0, overlay=False).run(until=Phase.DWELLING)
    toy.broken.add('probe')
    toy.probe = 3
    toy.tick()
    assert toy.procedure.phase is Phase.WITHDRAWING
    assert toy.procedure.outcome is Outcome.UNREACHABLE
    assert toy.procedure.message.startswith('dwelling: ')


def test_the_needle_waits_for_the_probe_and_goes_on():
    toy = Toy().run(until=Phase.INSERTING)
    toy.run(1.0)
    toy.contact = False
    toy.run(0.3)
    there = toy.depth
    toy.run(1.0)
    assert toy.depth == there and toy.procedure.phase is Phase.INSERTING
    toy.contact = True
    assert toy.run().procedure.outcome is Outcome.OK


def test_contact_lost_for_good_ends_the_procedure_by_name():
    toy = Toy().run(until=Phase.INSERTING)
    toy.contact = False
    p = toy.run().procedure
    assert p.phase is Phase.FINISHED and p.outcome is Outcome.STALE_INPUT
    assert 'probe/state: the probe has lost the skin' in p.message and toy.depth < 2e-3


BLIND = [('depth', Outcome.OUT_OF_IMAGE, '70 mm from the face'),
         ('sight', Outcome.TIP_NOT_SEEN, 'found in an image'),
         ('plane', Outcome.STALE_INPUT, 'the tip is nan m from the image plane; must be a number'),
         ('target', Outcome.STALE_INPUT, 'no image of it (ultrasound/target) came; must be at '
          'most 0.5 s old')]


@pytest.mark.parametrize(('broken', 'outcome', 'said'), BLIND)
def test_a_needle_that_goes_blind_stops_and_the_procedure_ends_by_name(broken, outcome, said):
    """Within patience and freshness, 0.5 s at 5 mm/s, and a tick of either."""
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.run(1.0)
    toy.broken.add(broken)
    lost, deepest = toy.depth, 0.0
    while toy.procedure.phase is Phase.INSERTING:
        deepest = max(deepest, toy.depth)
        toy.tick()
    p = toy.run().procedure
    assert deepest <= lost + 0.5 * 5e-3 + 2 * TICK * 5e-3
    assert p.outcome is outcome and toy.depth < 2e-3
    assert said in p.message and p.message.startswith('inserting: ') and '\n' not in p.message


@pytest.mark.parametrize(('broken', 'outcome', 'said'), BLIND[:3])
def test_a_procedure_that_is_blind_throughout_never_goes_on(broken, outcome, said):
    toy = Toy({broken}, overlay=False)
    deepest, phases = 0.0, {Phase.MEETING, Phase.INSERTING}
    while toy.procedure.phase is not Phase.FINISHED:
        toy.tick()
        deepest = max(deepest, toy.depth)
    plan = toy.procedure.plan
    assert phases & set(toy.phases) and Phase.DWELLING not in toy.phases
    assert deepest <= plan.depth - 0.018 + 1e-4        # where the probe was to find the tip
    assert toy.procedure.outcome is outcome and said in toy.procedure.message


@pytest.mark.parametrize('broken', [name for name, *_ in BLIND])
def test_a_needle_that_was_blind_for_a_while_goes_on(broken):
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.run(1.0)
    toy.broken.add(broken)
    toy.run(2.5)
    there = toy.depth
    toy.run(1.0)
    assert toy.depth == there and toy.procedure.phase is Phase.INSERTING
    toy.broken.clear()
    assert toy.run().procedure.outcome is Outcome.OK
    assert Phase.DWELLING in toy.phases


def test_images_that_show_the_target_do_for_estimates_that_fell_silent():
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.seen_off = np.zeros(3)
    toy.broken.add('target')
    toy.run(until=Phase.DWELLING)
    assert toy.procedure.outcome is Outcome.OK
    assert abs(toy.p[0] - toy.target[0]) < 0.7e-3


def test_pads_let_the_needle_drag_the_target_along_and_hold_it_across():
    """By a tenth of the way: the goal goes along, the depth follows."""
    toy = Toy(overlay=False, drag=0.1).run(until=Phase.DWELLING)
    goal, plan = toy.procedure._goal, toy.procedure.plan
    along = (goal - plan.goal) @ AXIS
    assert along > 2e-3 and np.linalg.norm(goal - plan.goal - along * AXIS) < 1e-9
    assert abs((toy.target - goal) @ AXIS) < 0.3e-3
    assert toy.depth > plan.depth + 2e-3 and abs(toy.p[0] - toy.target[0]) < 0.7e-3
    assert toy.orders.count(Kind.SET_GOAL) == 1


def test_a_corrected_goal_that_is_refused_is_given_up_and_a_probe_that_refuses_is_a_fault():
    toy = Toy(overlay=False, drag=0.1).run(until=Phase.APPROACHING)
    before = toy.orders.count(Kind.SHIFT)
    assert before > 0
    toy.procedure.refused('out of reach', Kind.SHIFT)
    toy.run(until=Phase.DWELLING)
    assert toy.orders.count(Kind.SHIFT) == before and toy.procedure.outcome is Outcome.OK
    toy = Toy(overlay=False, radius=0.33, recentre=True, axes=('x', 'y', 'z'), turn=False)
    toy.run(until=Phase.INSERTING)
    toy.seen_off = np.zeros(3)
    while Kind.SHIFT not in toy.orders:
        toy.tick()
    toy.procedure.refused('out of reach', Kind.SHIFT)      # as the images asked for
    toy.run(until=Phase.DWELLING)
    assert toy.orders.count(Kind.SHIFT) == 1 and toy.procedure.outcome is Outcome.OK
    other = Toy(overlay=False).run(until=Phase.APPROACHING)
    other.procedure.refused('no tip was heard of', Kind.FOLLOW)
    assert other.procedure.outcome is Outcome.REJECTED


def test_the_probe_leaves_a_needle_on_its_way_out_half_way_back():
    toy = straight().run(until=Phase.WITHDRAWING)
    deepest = toy.depth
    while Kind.RETRACT not in toy.orders:
        toy.tick()
    gone = deepest - toy.depth
    assert gone == pytest.approx(0.5 * toy.procedure.params.view, abs=5e-3 * 3 * TICK)


def test_pads_take_no_target_anywhere_by_an_estimate_that_fell_silent():
    toy = Toy(overlay=False, radius=0.33, recentre=True, axes=('x', 'y', 'z'))
    toy.run(until=Phase.INSERTING)
    toy.broken.add('target')
    toy.run(0.5)
    many = toy.orders.count(Kind.SHIFT)
    toy.seen_off = np.array([0.0, 0.002, 0.0])
    toy.run(until=Phase.DWELLING)
    assert toy.procedure.outcome is Outcome.OK and toy.orders.count(Kind.SHIFT) == many


def test_what_is_no_number_in_an_image_is_not_heard():
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.seen_off = np.full(3, np.nan)
    toy.run(until=Phase.DWELLING)
    assert toy.procedure.outcome is Outcome.OK and abs(toy.p[0] - toy.target[0]) < 0.7e-3


@pytest.mark.parametrize('permission', [Permission.HOLD, Permission.STOP])
def test_nothing_is_ordered_while_the_supervisor_forbids(permission):
    toy = Toy().run(until=Phase.INSERTING)
    toy.permission, many = permission, len(toy.orders)
    p = toy.run(30.0).procedure
    assert set(toy.orders[many:]) <= {Kind.FINISH}
    assert p.phase is Phase.FINISHED and p.outcome is Outcome.HELD and 'a test' in p.message


def test_a_hold_on_the_way_out_is_followed_by_the_rest_of_the_way():
    """The cell stops the needle while it holds; it has to be ordered out again."""
    toy = Toy().run(until=Phase.WITHDRAWING)
    toy.run(seconds=1.0)
    toy.permission, toy.drive = Permission.HOLD, (toy.depth, 1.0)
    toy.run(seconds=0.5)
    assert toy.depth > 2e-3
    toy.permission = Permission.RUN
    toy.run()
    assert toy.depth < 2e-3 and toy.procedure.phase is Phase.FINISHED
    assert toy.procedure.outcome is Outcome.HELD


def test_a_hold_that_is_lifted_soon_ends_with_everything_back():
    toy = Toy().run(until=Phase.INSERTING)
    toy.permission = Permission.HOLD
    toy.run(1.0)
    toy.permission = Permission.RUN
    p = toy.run().procedure
    assert p.outcome is Outcome.HELD and toy.depth < 2e-3 and toy.probe == 0 and toy.home


def test_before_anything_has_moved_a_hold_is_waited_for():
    toy = Toy()
    toy.permission = Permission.HOLD
    toy.run(3.0)
    toy.permission = Permission.RUN
    assert toy.run().procedure.outcome is Outcome.OK


def test_a_needle_on_its_way_in_is_turned_back_when_a_step_fails_at_once():
    """Told depth below 1 mm, where it counts as out, and under way to 80 mm."""
    toy = straight(entry=5e-3).run(until=Phase.PLACING)
    while toy.depth < 0.5e-3:
        toy.tick()
    toy.procedure._fail(Outcome.TIMED_OUT, 'a test')
    for _ in range(100):
        toy.tick()
    assert toy.procedure.phase is Phase.FINISHED and toy.depth < 1e-3


def test_a_needle_that_did_not_hear_the_way_out_is_told_again():
    toy = straight().run(until=Phase.DWELLING)
    toy.broken.add('needle')
    toy.run(until=Phase.WITHDRAWING).run(1.0)
    before, toy.drive = toy.orders.count(Kind.DRIVE), (toy.depth, 1.0)      # it was not heard
    toy.broken.clear()
    toy.run()
    assert toy.orders.count(Kind.DRIVE) > before and toy.depth < 1.5e-3
    assert toy.procedure.outcome is Outcome.OK


def test_what_is_refused_on_the_way_back_is_said_and_the_end_refuses_nothing():
    toy = straight().run(until=Phase.HOMING)
    toy.procedure.refused('driver: no', Kind.RELEASE)
    assert toy.procedure.outcome is Outcome.REJECTED
    assert toy.procedure.message == 'homing: driver: no'
    toy.run()
    toy.procedure.refused('too late', Kind.RELEASE)
    assert toy.procedure.phase is Phase.FINISHED and 'too late' not in toy.procedure.message


def test_pads_that_were_held_on_their_way_home_are_sent_again():
    toy = Toy(broken=['probe', 'home']).run(until=Phase.HOMING)
    toy.tick()
    toy.permission = Permission.HOLD
    toy.run(0.5)
    toy.permission = Permission.RUN
    toy.broken.discard('home')
    toy.run()
    assert toy.orders.count(Kind.RELEASE) == 2 and toy.home


def test_places_of_the_future_and_a_target_far_from_its_goal_are_not_believed():
    toy = straight().run(until=Phase.INSERTING)
    p = toy.procedure
    p.hear_target_image(toy.t, p.plan.goal + [0.5, 0.0, 0.0])
    p.hear_target_image(1e9, p.plan.goal)
    assert p._target_seen is None
    p.hear_target(1e9, p.plan.goal)
    p.hear_image(1e9, p.plan.tip)
    assert p._tip_seen <= toy.t and p._target[-1][0] <= toy.t
    for late in (0.4, 0.2, 0.0):
        p.hear_target_image(toy.t - late, p.plan.goal + [1e-3, 0.0, 0.0])
    assert p._target_seen is not None


def test_images_that_do_not_agree_yet_where_the_target_is_are_not_followed():
    """The first fix 5 mm off along the needle, as by two planes: the depth stays as estimated."""
    toy = Toy(overlay=False).run(until=Phase.INSERTING)
    toy.run(1.0)
    toy.seen_off = -5e-3 * AXIS
    toy.run(0.2)
    assert toy.drive[0] == pytest.approx(toy.procedure.plan.depth, abs=1e-3)
    toy.seen_off = np.zeros(3)
    toy.run(until=Phase.DWELLING)
    assert abs(toy.p[0] - toy.target[0]) < 0.7e-3


def test_a_target_that_has_gone_where_the_needle_cannot_get_ends_the_insertion_by_name():
    """A needle that bends so much that its tip gets 20 mm far along its hole, and no farther."""
    toy = straight().run(until=Phase.INSERTING)
    toy.procedure._course = replace(toy.procedure._course, offset=lambda r, s, u: 0.02 * np.array(
        [np.sin(s / 0.02), 0.0, 1.0 - np.cos(s / 0.02)]))
    toy.run()
    assert toy.procedure.outcome is Outcome.NO_PLAN
    assert 'inserting: the needle does not get' in toy.procedure.message
    assert toy.procedure.phase is Phase.FINISHED and toy.depth < 1.5e-3
