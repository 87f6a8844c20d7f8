"""Small campaigns of `arm-brachy abuse`: every kind of fault once, at wall pace."""

import pytest

from arm_brachy.control.faults import Kind
from arm_brachy.experiments import abuse

pytestmark = [pytest.mark.ros, pytest.mark.wall]


def test_no_fault_moves_a_pad(tmp_path, ros_domain_id):
    log, name = abuse.Log(tmp_path, 2), 'abuse_bench'
    scenario, kinds = abuse.BENCHES[name]
    abuse._bench(name, scenario, len(Kind), 2, 0, log, lambda text: None)
    rows = [row for k in range(len(Kind)) if (row := log.get(f'fault {k}')) is not None]
    assert {row['kind'] for row in rows} == {kind.name for kind in kinds}
    assert not [row for row in rows if row['violated'] or not row['recovered']]


@pytest.mark.validate
def test_no_fault_moves_needle_or_probe_and_no_file_passes_for_another(tmp_path, ros_domain_id):
    result = abuse.reproduce(tmp_path, faults=len(Kind), cells=0, files=35, seed=2)
    assert {row['kind'] for row in result.rows} >= {kind.value for kind in Kind}
    assert all(target.met for target in result.targets), result.rows
