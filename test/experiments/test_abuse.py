"""Faults of `arm-brachy abuse`: their order, and what counts as a violation."""

from arm_brachy.control.faults import Kind, draw
from arm_brachy.experiments import abuse


def test_every_kind_comes_in_turn_and_the_seed_says_in_which_order():
    n = len(Kind)
    faults = draw(3 * n, 1)
    assert all(sum(f.kind is kind for f in faults) == 3 for kind in Kind)
    assert faults == draw(3 * n, 1) != draw(3 * n, 2)


def test_a_fault_that_moves_a_pad_is_a_violation():
    row = {'kind': 'FORGED', 'overshoot_mm': 0.2, 'rest_s': 0.0, 'violated': True,
           'recovered': False}
    met = {t.name: t.met for t in abuse._fault_targets([row], 1)}
    assert len(met) == 3 and not any(met.values())
