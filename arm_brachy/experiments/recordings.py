"""Where the laboratories' recordings are; they are not part of the project."""

import os
from pathlib import Path

from arm_brachy.core.errors import InputError

VARIABLE = 'ARM_BRACHY_RECORDINGS'
DEFAULT = Path(__file__).resolve().parents[3] / 'shared' / 'recordings'


def folder(name):
    """Return the folder of one set of recordings (absolute Path).

    It is looked for in $ARM_BRACHY_RECORDINGS, by default ../shared/recordings beside the
    project. Raises InputError if it is not there.
    """
    place = Path(os.environ.get(VARIABLE, DEFAULT)).resolve() / name
    if not place.is_dir():
        raise InputError(f'{place}: no such folder; get the recordings {name} and name the folder '
                         f'that holds them in {VARIABLE}')
    return place
