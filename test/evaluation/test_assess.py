"""A run of known first-order tasks: its numbers, goals and losses."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.evaluation import assess
from arm_brachy.evaluation.timeseries import EmSamples, MoveWindow

TAU, STEP, NOISE = 0.8, 5e-3, 0.05e-3


@pytest.fixture(scope='module')
def numbers(run):
    return assess.assess(run)


def test_tasks_have_the_closed_form_values(numbers):
    for task, size in zip(numbers.tasks, (STEP, STEP, STEP * np.sqrt(2)), strict=True):
        assert task.itae_truth == pytest.approx(size * TAU**2, rel=2e-4)
        assert task.rise_time == pytest.approx(TAU * np.log(9), rel=1e-3)
        assert task.settling_time == pytest.approx(TAU * np.log(size / 0.3e-3), rel=1e-3)
        assert task.response_from == 'truth'


def test_em_numbers_carry_the_noise_of_the_controlled_axes(numbers):
    one_axis = NOISE * np.sqrt(2 / np.pi)   # mean of |normal|
    two_axes = NOISE * np.sqrt(np.pi / 2)   # mean of a Rayleigh
    found = [task.steady_em.mean_abs for task in numbers.tasks]
    assert found == pytest.approx([one_axis, one_axis, two_axes], rel=0.25)


def test_untracked_samples_are_no_measurements():
    samples = EmSamples(np.arange(4.0), np.array([[0, 0, 0], [1, 1, 1], [np.nan] * 3, [2, 2, 2]]),
                        np.zeros(4), np.array([0, 3, 0, 0]))
    assert samples.tracked().t.tolist() == [0.0, 3.0]


def test_losses_are_a_missed_goal(numbers):
    assert numbers.lost == 121
    by_name = {goal.name: goal.met for goal in numbers.targets}
    assert by_name.pop('messages lost') is False
    assert all(by_name.values())


def test_a_goal_below_the_error_is_missed(run):
    far = dataclasses.replace(run.tasks[0], goal=run.tasks[0].goal - [1e-3, 0, 0])
    numbers = assess.assess(dataclasses.replace(run, tasks=(far,)))
    assert numbers.targets[0].met is False
    assert numbers.targets[0].value == pytest.approx(1.0, rel=1e-3)
    assert numbers.tasks[0].overshoot.distance == pytest.approx(-1e-3, rel=1e-3)


def test_without_truth_the_measurement_is_judged(run):
    bare = dataclasses.replace(run, truth={}, tissue=None, force=None, encoder=None,
                               wall_time=None)
    numbers = assess.assess(bare)
    assert {task.response_from for task in numbers.tasks} == {'EM'}
    assert np.isnan(numbers.tasks[0].itae_truth)
    assert numbers.deformation is None
    assert np.isnan(numbers.real_time_factor)


@pytest.mark.parametrize(('done', 'met'), [(3, True), (1, False), (0, False)])
def test_a_task_that_never_ran_is_a_missed_goal(run, done, met):
    cut = dataclasses.replace(run, tasks=run.tasks[:done], tasks_planned=3)
    goal = next(g for g in assess.assess(cut).targets if g.name == 'tasks done')
    assert (goal.value, goal.goal, goal.met) == (done, '= 3', met)


def test_a_run_that_planned_no_tasks_is_not_held_to_any(numbers):
    assert 'tasks done' not in [goal.name for goal in numbers.targets]


@pytest.mark.parametrize(('made', 'met'), [((True, True), True), ((True, False), False),
                                           ((True,), False)])
def test_a_move_that_was_not_made_is_a_missed_goal(run, made, met):
    windows = tuple(MoveWindow(f'move {i}', i, i + 1.0, (), ok) for i, ok in enumerate(made))
    probed = dataclasses.replace(run, tasks=(), moves=windows, moves_planned=2)
    numbers = assess.assess(probed)
    goals = {goal.name: goal for goal in numbers.targets}
    assert (goals['moves made'].value, goals['moves made'].met) == (sum(made), met)
    assert 'tasks done' not in goals
    rows = assess.to_result(probed, numbers).rows
    assert [row['made'] for row in rows] == list(made)


def test_task_without_any_position_is_refused(run):
    with pytest.raises(InputError, match='neither EM samples nor truth'):
        assess.assess(dataclasses.replace(run, truth={}, em={}))


def test_uncounted_topics_cannot_be_judged(run):
    topics = tuple(dataclasses.replace(r, published=None) for r in run.topics)
    numbers = assess.assess(dataclasses.replace(run, topics=topics))
    assert numbers.targets[-1].met is None


def test_real_time_factor_and_rows(run, numbers):
    assert numbers.real_time_factor == pytest.approx(2.0, rel=1e-3)
    result = assess.to_result(run, numbers)
    assert [row['task'] for row in result.rows] == ['task 1', 'task 2', 'task 3']
    assert result.rows[0]['itae_truth_mm_s2'] == pytest.approx(1e3 * STEP * TAU**2, rel=2e-4)
    assert result.rows[0]['pad_travel_mm'] == pytest.approx(2.2 * 5.0, rel=1e-2)
    assert [row['topic'] for row in assess.stream_rows(numbers.streams)][0] == 'em/target_1/pose'
