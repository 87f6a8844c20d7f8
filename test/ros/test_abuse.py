"""A small campaign of `arm-brachy abuse`: every kind of fault once, at wall pace in one cell."""

import pytest

from arm_brachy.control.faults import Kind
from arm_brachy.experiments import abuse


@pytest.mark.ros
@pytest.mark.wall
def test_no_fault_moves_a_pad(tmp_path, ros_domain_id):
    result = abuse.reproduce(tmp_path, faults=len(Kind), cells=0, files=35, seed=2)
    assert {row['kind'] for row in result.rows} >= {kind.value for kind in Kind}
    assert all(target.met for target in result.targets), result.rows
