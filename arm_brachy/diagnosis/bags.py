"""From recordings on disk to the answer: `arm-brachy diagnose` for scripts and notebooks.

    from arm_brachy.diagnosis.bags import diagnose_bags
    answer = diagnose_bags(['push_1', 'push_2'], 'phantom.yaml', hold_out=['push_3'])
    print(answer.diagnosis.verdict, [cause.term for cause in answer.diagnosis.causes])

Test: diagnosis/test_bags.py
"""

from dataclasses import dataclass

from arm_brachy.core.config import load
from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import Scene, load_scene
from arm_brachy.diagnosis.pipeline import diagnose
from arm_brachy.diagnosis.progress import untold
from arm_brachy.diagnosis.report.answer import Provenance
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.loading import load_evidence, told_apart, zero_of
from arm_brachy.evaluation.result import commit_of, machine_description


@dataclass(frozen=True)
class LoadedBags:
    """loading.Evidence of the recordings of one body, on one count of time, names unlike."""

    fitted: tuple
    held_out: tuple = ()
    null: tuple = ()

    @property
    def name(self):
        """What the answer is about: the recording that is fitted, or how many they are."""
        return self.fitted[0].name if len(self.fitted) == 1 else f'{len(self.fitted)} recordings'


def load_bags(bags, scene_of, *, hold_out=(), null=()):
    """Return the LoadedBags of paths.

    scene_of : callable, bag -> core.scene.Scene.  Raises RecordingError
    """
    every = (*bags, *null, *hold_out)
    zero = zero_of(every)
    loaded = told_apart([one for some in (bags, null, hold_out) for one in load_evidence(
        some, [scene_of(bag) for bag in some], zero)], every)
    first, last = len(bags), len(bags) + len(null)
    return LoadedBags(loaded[:first], loaded[last:], loaded[first:last])


def diagnose_bags(bags, scene, *, null=(), hold_out=(), calibration=None, seed=0, scenes=None,
                  progress=untold, jobs=1):
    """Return the pipeline.Answer for recordings of one body: what is missing, where, how sure.

    bags : paths to fit;  null : paths of recordings in which nothing is wrong;  hold_out : paths
    to test on;  scene : file of what they show, or core.scene.Scene
    scenes : bag -> file or Scene where one differs, of a body without pads
    calibration : settings.Calibration or a file of one, None = defaults;  seed : of random draws
    progress : as in `progress`;  jobs : processes at a time, the answer is the same
    Takes minutes. `report.page.write_diagnosis(answer.diagnosis, answer.shown, file)` writes the
    page, `answer.diagnosis.to_json(file)` the JSON.
    Raises ConfigError, InputError, RecordingError and their kin for what cannot be compared,
    NotConverged where the model has no state.
    """
    own = {str(bag): _scene(one) for bag, one in (scenes or {}).items()}
    common = _scene(scene)
    loaded = load_bags(tuple(bags), lambda bag: own.get(str(bag), common),
                       hold_out=tuple(hold_out), null=tuple(null))
    given = {'null': [*map(str, null)], 'hold_out': [*map(str, hold_out)], 'seed': seed,
             'calibration': _said(calibration),
             'scenes': {str(bag): _said(one) for bag, one in (scenes or {}).items()}}
    words = [repr([*map(str, bags)]), repr(_said(scene)),
             *(f'{key}={value!r}' for key, value in given.items() if value)]
    said = Provenance(loaded.name, seed, commit_of(share_dir()), machine_description(),
                      _said(scene), (), f'diagnose_bags({", ".join(words)})')
    if calibration is not None and not isinstance(calibration, Calibration):
        calibration = load(Calibration, calibration)
    return diagnose(loaded.fitted, said, held_out=loaded.held_out, null=loaded.null,
                    calibration=calibration, progress=progress, jobs=jobs)


def _said(one):
    """What was given, for who types it again: a path, or the name of what has none; None stays."""
    if isinstance(one, (Scene, Calibration)):
        return getattr(one, 'name', repr(one))
    return None if one is None else str(one)


def _scene(one):
    return one if isinstance(one, Scene) else load_scene(one)
