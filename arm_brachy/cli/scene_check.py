"""A bag beside the scene that it is to be of: what `diagnose` would refuse is refused here.

Loaded by the imports only where a scene is given, since the diagnosis takes seconds to load.
Test: test_cli_imports.py
"""

from arm_brachy.diagnosis.evidence import load_evidence
from arm_brachy.diagnosis.prepared import prepare


def check_recording(bag, scene):
    """Notes (sentences) on what a diagnosis would leave out of a bag (path) of a core.scene.Scene.

    Units, names, clocks, shape, signs and exchanged pads or markers are those that `diagnose`
    itself looks at, before any model of the tissue. Raises RecordingError.
    """
    evidence, = load_evidence([bag], scene)
    prepared = prepare(evidence)
    return tuple(dict.fromkeys((*evidence.notes, *prepared.evidence.notes)))
