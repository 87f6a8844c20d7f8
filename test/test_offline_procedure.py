"""What of a run only the scenario explains."""

import numpy as np

from arm_brachy.core.paths import config_dir
from arm_brachy.evaluation.procedure_data import ProcedureData
from arm_brachy.evaluation.timeseries import Series
from arm_brachy.offline_procedure import with_instruments
from arm_brachy.scenario import load_cell


def explained(scenario, joints):
    """ProcedureData of a run with so many joints, as evaluation gets it."""
    series = Series(np.arange(3.0), np.arange(3.0 * joints).reshape(3, joints))
    return with_instruments(ProcedureData(joints=series, torque=series),
                            load_cell(config_dir() / 'scenarios' / f'{scenario}.yaml'))


def test_a_stage_does_not_count_among_angles_and_torques():
    panda, linkage = explained('probe_III', 7), explained('probe_scissor', 4)
    assert panda.joints.values.shape[1] == panda.torque.values.shape[1] == 7
    assert np.array_equal(linkage.joints.values, [[0, 1, 2], [4, 5, 6], [8, 9, 10]])
    assert linkage.torque.values.shape[1] == 3
    assert linkage.strategy == 'orientation' and linkage.target == 'target_1'
