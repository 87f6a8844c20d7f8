"""What hangs on nodes depends on the mesh, what hangs on none does not."""

import pytest

from arm_brachy.diagnosis.likelihood.constitutive_error import AS_A_WHOLE, BY_NODES
from arm_brachy.experiments.node_errors import TERMS, compared


@pytest.mark.validate
def test_meshes_disagree_about_what_hangs_on_nodes_alone():
    loose = 'loose base, 20 mm'
    labels = (loose, 'pad elsewhere', 'gradient', 'skin')
    rows = compared({label: TERMS[label] for label in labels})
    scales = {(row['term'], row['stream']): row['scale'] for row in rows}
    for stream in ('optical', 'force'):
        for label in ('gradient', 'skin'):
            assert scales[label, stream] == pytest.approx(1.0, abs=2.0 * AS_A_WHOLE)
        assert abs(scales[loose, stream] - 1.0) > BY_NODES['base_debond']
    assert abs(scales['pad elsewhere', 'force'] - 1.0) > BY_NODES['pad_misplacement']
