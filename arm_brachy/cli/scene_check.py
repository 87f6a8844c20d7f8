"""A bag beside the scene that it is to be of: what `diagnose` would refuse is refused here.

Loaded by the imports only where a scene is given, since the diagnosis takes seconds to load.
Test: test_cli_imports.py
"""

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.isolation.sensor_offsets import exchanged_findings
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.diagnosis.signals.preparation import prepare


def check_recording(bag, scene):
    """Notes (sentences) on what a diagnosis would leave out of a bag (path) of a core.scene.Scene.

    Units, names, clocks, shape, signs and exchanged pads are those that `diagnose` itself refuses,
    before any model of the tissue; exchanged markers it would report, and here they can be mended.
    Raises RecordingError.
    """
    evidence, = load_evidence([bag], scene)
    prepared = prepare(evidence)
    for finding in exchanged_findings(prepared):
        raise RecordingError(f'{evidence.name}: {finding.statement[:-1]}; mend `names` in the '
                             'import')
    return tuple(dict.fromkeys((*evidence.notes, *prepared.evidence.notes)))
