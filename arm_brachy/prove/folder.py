"""The folder of a trial: what lies where, written whole or not at all."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

from arm_brachy.prove.seal import keyed


@dataclass(frozen=True)
class TrialFolder:
    """Paths of a trial below `path`. What a detector is given: `given`, in mode 'null' `sound`.

    Names in sealed/ follow from the secret key: whoever cannot list that folder cannot name a
    file in it, nor learn a size or a date by asking.
    """

    path: Path

    def given(self, case):
        """Folder of the recording, scene and mesh of a case."""
        return self.path / 'recordings' / case

    def sound(self, case):
        """Folder of the recording of the same set-up with nothing wrong."""
        return self.path / 'sound' / case

    def supplied(self, case):
        """Folder of the recording that tells apart what that of a case cannot."""
        return self.path / 'supplied' / case

    def sealed(self, key, what):
        """Folder of what must not be known yet of a case."""
        return self.path / 'sealed' / keyed(key, f'sealed/{what}')[:24]

    def work(self, mode, case):
        """The detector's own folder."""
        return self.path / 'work' / mode / case

    def answer(self, mode, case):
        """File of the answer to a case."""
        return self.path / 'answers' / mode / f'{case}.json'

    def page(self, mode, case):
        """File of the detector's page of a case."""
        return self.path / 'pages' / mode / f'{case}.html'

    def __truediv__(self, name):
        return self.path / name


def read_json(path):
    """What a JSON file holds; None if it is not there."""
    path = Path(path)
    return json.loads(path.read_text(encoding='utf-8')) if path.is_file() else None


def write_json(path, value):
    """Write JSON, whole or not at all."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + '.part')
    part.write_text(json.dumps(value, indent=1, allow_nan=False) + '\n', encoding='utf-8')
    os.replace(part, path)
