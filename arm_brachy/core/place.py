"""Where in a file something stands, for messages on what a schema cannot see."""

from arm_brachy.core import config
from arm_brachy.core.complaint import line_of
from arm_brachy.core.errors import ConfigError


class Place:
    """Turns keys of a file into `file:line: key` for messages."""

    def __init__(self, path):
        self._path = path

    def __call__(self, *keys):
        """`file:line: key` of keys of the file, as far as it has them."""
        # read anew for its lines: only a message needs them; what is made in Python has no file
        source = config.read_yaml(self._path) if self._path.is_file() else None
        return f'{self._path}{line_of(source, keys)}: {".".join(str(k) for k in keys)}'


def names_of(owner, kind):
    """Map keys of the file -> name for a tuple of named things."""
    return {(kind, i, 'name'): item.name for i, item in enumerate(getattr(owner, kind))}


def refuse_twice(place, names):
    """Raise ConfigError for the second of two equal names. names : keys of the file -> name"""
    seen = set()
    for keys, name in names.items():
        if name in seen:
            raise ConfigError(f'{place(*keys)} = {name!r} is given twice; names must differ')
        seen.add(name)
