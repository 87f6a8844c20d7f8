"""The streams of a bag as a picture, for the imports.

Loaded only where a picture is asked for, since drawing takes seconds to load.
"""

from arm_brachy.core.errors import InputError
from arm_brachy.evaluation.stream_figures import streams_plate
from arm_brachy.offline import load_run

KINDS = ('.png', '.svg', '.pdf')


def draw_streams(bag, file):
    """Draw the streams of a bag (path) to a file (Path). Raises InputError for its suffix."""
    if file.suffix.lower() not in KINDS:
        raise InputError(f'{file}: must end in {", ".join(KINDS)}')
    plate = streams_plate(load_run(bag, measured=True))
    if plate is None:
        raise InputError(f'{bag}: holds no stream that can be drawn')
    plate.save(file)
