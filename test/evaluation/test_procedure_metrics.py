"""Numbers of a procedure, against motions whose numbers are known by construction."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.evaluation.material_point import at_rest
from arm_brachy.evaluation.procedure_data import ProcedureData
from arm_brachy.evaluation.procedure_metrics import (
    assess_procedure,
    out_of_plane,
    procedure_row,
    procedure_targets,
)
from arm_brachy.evaluation.timeseries import Series, Tissue

T = np.arange(0.0, 20.0, 0.05)
PLAN = {'hole_m': '0 0 0', 'tip_m': '0 0.02 0', 'goal_m': '0 0.02 0.001',
        'path_m': '0 0 0 0 0.01 0 0 0.02 0'}
STEPS = ((0.0, {'phase': 'settling', 'outcome': 'OK'}),
         (2.0, {'phase': 'approaching', 'outcome': 'OK', **PLAN}),
         (5.0, {'phase': 'inserting', 'outcome': 'OK', **PLAN}),
         (10.0, {'phase': 'dwelling', 'outcome': 'OK', **PLAN}),
         (15.0, {'phase': 'withdrawing', 'outcome': 'OK', **PLAN}),
         (18.0, {'phase': 'retracting', 'outcome': 'OK', **PLAN}),
         (20.0, {'phase': 'finished', 'outcome': 'OK', **PLAN}))


def still(*value):
    return Series(T, np.tile(value, (len(T), 1)).astype(float))


def run(lag=0.0, force_error=0.0, seen_off=0.0, drop=0):
    """Needle along y to 20 mm in 5 s; the probe's plane is `lag` [m] behind; target 1 mm above."""
    y = 0.004 * np.clip(T - 5.0, 0.0, 5.0)
    tip = Series(T, np.column_stack([0 * T, y, 0 * T]))
    turned = np.tile(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, -1]]).ravel(), (len(T), 1))
    probe = Series(T, np.column_stack([turned, 0 * T, y - lag, 0 * T + 0.03]))
    fine = np.arange(0.0, 20.0, 0.001)
    force = Series(fine, 3.0 + force_error * np.sqrt(2.0) * np.sin(2 * np.pi * 7 * fine))
    seen = Series(T, tip.values + [seen_off, 0.0, 0.0])
    if drop:
        seen = Series(T[::drop], seen.values[::drop])
    return ProcedureData(
        steps=STEPS, tip=tip, axis=still(0, 1, 0), tip_image=seen, probe=probe,
        state=still(2, 1, 3.0, 0.0), force=force, joints=still(*range(7)),
        torque=still(3, 4, 0, 0, 0, 0, 0), target='t',
        needle=Series(T, np.column_stack([y, 0 * T, 0 * T + 1.5])))


def test_a_probe_that_lags_is_out_of_plane_by_its_lag():
    data = run(lag=0.4e-3)
    assert out_of_plane(data.tip, data.probe).values == pytest.approx(0.4e-3)
    numbers = assess_procedure(data, still(0, 0.02, 0.001))
    assert numbers.in_plane == 1.0 and numbers.plane_rms == pytest.approx(0.4e-3)
    assert assess_procedure(run(lag=0.6e-3), None).in_plane == 0.0


def test_the_length_of_an_insertion_is_the_way_of_the_needle_in_that_step():
    later = tuple((t + 2.5 * (said['phase'] == 'inserting'), said) for t, said in STEPS)
    assert assess_procedure(run(), None).insertion_length == pytest.approx(20e-3, abs=2e-4)
    numbers = assess_procedure(replace(run(), steps=later), None)
    assert numbers.insertion_length == pytest.approx(10e-3, abs=2e-4)


def test_turns_are_counted_while_the_needle_goes_in():
    roll = Series(T, 2.0 * (T > 1.0) + 0.5 * (T > 6.0) - 1.0 * (T > 8.0) + 0.3 * (T > 16.0))
    assert assess_procedure(replace(run(), roll=roll), None).turns == 2
    assert np.isnan(assess_procedure(run(), None).turns)


def test_what_was_planned_anew_before_the_insertion_is_the_plan():
    first = {**PLAN, 'goal_m': '0.003 0.02 0.001', 'path_m': '0 0 0 0.001 0.01 0 0.003 0.02 0'}
    steps = tuple((t, said | (first if said['phase'] == 'approaching' else {}))
                  for t, said in STEPS)
    numbers = assess_procedure(replace(run(), steps=steps), still(0, 0.02, 0.001))
    assert numbers.miss_pads == pytest.approx(0.0) and numbers.off_plan_end < 1e-9


def test_miss_is_split_along_and_across_the_needle():
    numbers = assess_procedure(run(), still(0.0, 0.022, 0.001))
    assert numbers.miss_along == pytest.approx(2e-3) and numbers.miss_across == pytest.approx(1e-3)
    assert numbers.miss == pytest.approx(np.hypot(1e-3, 2e-3))
    assert numbers.miss_pads == pytest.approx(0.0)      # along the needle they let it go
    aside = assess_procedure(run(), still(1.5e-3, 0.022, 0.001))
    assert aside.miss_pads == pytest.approx(1.5e-3)


def test_force_effort_and_localisation():
    numbers = assess_procedure(run(force_error=0.05, seen_off=0.3e-3, drop=2), None)
    assert numbers.force_rms == pytest.approx(0.05, rel=1e-3)
    assert numbers.force_peak == pytest.approx(0.05 * np.sqrt(2.0), rel=1e-3)
    assert numbers.force_steady < 1e-3
    assert numbers.torque == pytest.approx(5.0) and numbers.joint_travel == 0.0
    assert numbers.localisation_rms == pytest.approx(0.3e-3)
    assert numbers.found == pytest.approx(0.5, abs=0.02) and numbers.needle_peak == 1.5


def test_overshoot_counts_from_the_first_touch_until_the_probe_retracts():
    """Also where the force comes before the insertion, which the other figures begin with."""
    data = run()
    force = data.force.values.copy()
    force[(data.force.t > 3.0) & (data.force.t < 3.1)] = 4.5    # N, as the probe meets the skin
    force[data.force.t > 18.5] = 9.0                            # off the skin: not counted
    data = replace(data, force=Series(data.force.t, force))
    numbers = assess_procedure(data, None)
    assert numbers.force_overshoot == pytest.approx(1.5) and numbers.force_peak < 1e-9
    goal = procedure_targets(numbers)[-1]
    assert goal.met is False and goal.value == pytest.approx(1.5)


def test_goals_of_force_are_judged_by_what_truly_presses_but_for_the_mean_at_rest():
    """The probe looks along -z: 3.07 N press up on it while its drifted sensor says 3 N."""
    pressed = replace(run(), contact=still(0.4, -0.2, 3.07))
    numbers = assess_procedure(pressed, None)
    assert numbers.force_steady < 1e-9
    for name in ('rms', 'steady', 'peak', 'overshoot'):
        assert getattr(numbers, f'true_force_{name}') == pytest.approx(0.07)
    rms, steady, over = procedure_targets(numbers)[-3:]
    assert [one.met for one in (rms, steady, over)] == [True] * 3
    assert rms.value == pytest.approx(0.07) and 'true' in rms.name
    assert steady.value < 1e-9 and 'as measured' in steady.name
    assert 'as measured' in procedure_targets(assess_procedure(run(), None))[-3].name


def test_a_tip_is_off_its_plan_by_what_lies_between_them_at_the_same_depth():
    """Arc of 400 mm planned to 80 mm; the needle stops short or goes on, on it or beside it."""
    turn = np.linspace(0.0, 0.2, 41)
    arc = 0.4 * np.column_stack([1.0 - np.cos(turn), np.sin(turn), 0.0 * turn])
    plan = {'hole_m': '0 0 0', 'goal_m': '0 0 0',
            'path_m': ' '.join(f'{v:.12g}' for v in arc.ravel())}
    steps = tuple((t, said | (plan if 'hole_m' in said else {})) for t, said in STEPS)
    for end, aside in ((0.06, 0.0), (0.09, 0.0), (0.06, 0.7e-3)):
        s = end * np.clip(T - 5.0, 0.0, 5.0) / 5.0
        tip = np.column_stack([0.4 * (1.0 - np.cos(s / 0.4)), 0.4 * np.sin(s / 0.4),
                               aside + 0 * s])
        numbers = assess_procedure(replace(run(), steps=steps, tip=Series(T, tip)), None)
        assert numbers.off_plan_end == pytest.approx(aside, abs=1e-7)
    old = tuple((t, {k: v for k, v in said.items() if k != 'path_m'}) for t, said in STEPS)
    assert np.isnan(assess_procedure(replace(run(), steps=old), None).off_plan_end)


def test_a_seed_is_where_the_tissue_at_the_tip_comes_to_rest():
    """Compressed along the needle to four fifths, and aside: 1 mm of it is 1.25 mm at rest."""
    rest = np.array([[x, y, z] for x in (-0.04, 0.04) for y in (-0.04, 0.04)
                     for z in (-0.04, 0.04)])
    tets = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7],
                     [0, 5, 1, 7]])
    now = rest * [1.0, 0.8, 1.0] + [0.003, 0.0, 0.0]
    tissue = Tissue(np.array([2.0, 12.0]), np.stack([rest, now]), rest, tets)
    numbers = assess_procedure(run(), still(0.0, 0.021, 0.0), tissue)
    assert numbers.miss == pytest.approx(1e-3) and numbers.seed_miss == pytest.approx(1.25e-3)
    before = replace(tissue, t=np.array([2.0, 9.0]))        # never shown during the dwell
    assert np.isnan(assess_procedure(run(), still(0.0, 0.021, 0.0), before).seed_miss)
    out = at_rest(np.array([[0.003, 0.0, 0.0], [0.5, 0.0, 0.0]]), now, rest, tets)
    assert out[0] == pytest.approx(np.zeros(3), abs=1e-12) and np.isnan(out[1]).all()
    flat = np.vstack([tets, [0, 1, 2, 3]])      # four corners of one face
    assert at_rest(now[:1] * 0.5, now, rest, flat) == pytest.approx(
        at_rest(now[:1] * 0.5, now, rest, tets))


def test_a_target_located_in_the_images_is_compared_while_the_needle_goes_in_and_rests():
    seen = Series(T, np.tile([0.3e-3, 0.02, 0.0014], (len(T), 1)))
    seen.values[T < 5.0] = 1.0                                  # before the insertion: not counted
    numbers = assess_procedure(replace(run(), target_image=seen), still(0, 0.02, 0.001))
    assert numbers.target_located_rms == pytest.approx(0.5e-3)
    assert np.isnan(assess_procedure(run(), still(0, 0.02, 0.001)).target_located_rms)


def test_goals_are_met_or_missed_or_cannot_be_judged():
    met = [g.met for g in procedure_targets(assess_procedure(run(), None))]
    assert met == [True] * 7
    bad = assess_procedure(run(lag=1e-3, force_error=0.2, seen_off=1e-3, drop=4), None)
    assert [g.met for g in procedure_targets(bad)][:5] == [True, False, False, False, False]
    nothing = procedure_targets(assess_procedure(ProcedureData(steps=STEPS[:1]), None))
    assert {g.met for g in nothing[1:]} == {None}


def test_a_needle_that_stops_beside_the_target_misses_a_goal_where_the_target_is_known():
    for aside, met in ((1.5e-3, True), (1.7e-3, False)):
        goals = procedure_targets(assess_procedure(run(), still(0.0, 0.02, aside)))
        (hit,) = (g for g in goals if g.name == 'tip to target at the dwell')
        assert hit.met is met and hit.value == pytest.approx(1e3 * aside)


def test_the_row_has_every_number_with_its_unit():
    row = procedure_row(assess_procedure(run(), still(0, 0.02, 0.001)))
    assert row['tip_in_plane_percent'] == 100.0
    assert row['tip_to_target_mm'] == pytest.approx(1.0) and len(row) == 29


def test_the_row_of_a_failed_procedure_says_why():
    steps = (*STEPS[:1], (2.0, {'phase': 'finished', 'outcome': 'INFEASIBLE',
                                'message': 'choose another hole'}))
    row = procedure_row(assess_procedure(ProcedureData(steps=steps), None))
    assert row['outcome'] == 'INFEASIBLE' and row['why'] == 'choose another hole'
    assert 'why' not in procedure_row(assess_procedure(run(), None))
