"""What is wrong in a configuration file, in one line: file, line, key, value, allowed range."""

import dataclasses
import difflib
import typing

from arm_brachy.core.quantity import quantities, wholes

LONGEST_VALUE = 60  # characters of a value that a message shows

# kinds of pydantic's complaints -> what a person who writes YAML is told
_WORDS = {
    'string_type': 'must be text (in quotes if it looks like something else)',
    'int_type': 'must be a whole number', 'int_parsing': 'must be a whole number',
    'int_from_float': 'must be a whole number', 'bool_type': 'must be true or false',
    'float_type': 'must be a number', 'finite_number': 'must be a finite number',
    'list_type': 'must be a list', 'tuple_type': 'must be a list',
    'dict_type': 'must be a mapping of keys to values',
    'model_type': 'must be a mapping of keys to values',
    'model_attributes_type': 'must be a mapping of keys to values',
}
_NO_NUMBER = ('value_error', 'float_type')


def complaint(cls, data, where, problems):
    """Turn what pydantic found into one line about one problem.

    cls : the dataclass that is the schema;  data : the mapping as read, with its line numbers
    where : file name, or `file: place` within it;  problems : `ValidationError.errors()`
    A key that does not exist goes first: a misspelt key is missing and unknown at once.
    """
    problem = min(problems, key=lambda p: p['type'] != 'extra_forbidden')
    path = problem['loc']
    key = '.'.join(str(part) for part in path)
    place = f'{where}{line_of(data, path)}'
    if problem['type'] == 'extra_forbidden':
        return f'{place}: unknown key {shown(key)}; {_advice(cls, path)}'
    if problem['type'] == 'missing' and isinstance(path[-1], int):
        return f'{place}: {_too_short(problem, problems)}'
    if problem['type'] == 'missing':
        return f'{place}: key {key!r} is missing; {_allowed(cls, path, problem)}'
    return f'{place}: {key} = {shown(problem["input"])}; {_allowed(cls, path, problem)}'


def _too_short(problem, problems):
    """Of a list of fixed length: what it holds and how many entries it must have."""
    where = problem['loc'][:-1]
    needed = 1 + max(p['loc'][-1] for p in problems
                     if p['type'] == 'missing' and p['loc'][:-1] == where)
    held = shown(list(problem['input']))
    return f'{".".join(map(str, where))} = {held}; must have {needed} entries'


def shown(value):
    """A value as a message shows it: on one line, cut if long."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else text[:LONGEST_VALUE - 3] + '...'


def line_of(data, path):
    """`:line` of the deepest part of `path` whose position the YAML reader kept, or ''.

    data : mapping from `config.read_yaml`;  path : keys and list indices
    """
    line = None
    node = data
    for part in path:
        marks = getattr(node, 'lc', None)
        try:
            line = (marks.item(part)[0] if isinstance(node, list) else marks.key(part)[0]) + 1
            node = node[part]
        except (AttributeError, KeyError, IndexError, TypeError):
            break
    return f':{line}' if line else ''


def _allowed(cls, path, problem):
    owner, key = _owner(cls, path)
    info = {q.key(name): q for name, q in quantities(owner).items()}.get(key)
    if info is not None:
        number = 'a number, ' if problem['type'] in _NO_NUMBER and not info.shape else ''
        return f'must be {number}{info.allowed()}'
    if problem['type'] == 'missing':
        return 'it must be given'
    whole = wholes(owner).get(key)
    if whole is not None:
        return f'must be {whole.allowed()}'
    text = problem['msg'].removeprefix('Value error, ')
    return _WORDS.get(problem['type'], text.replace('Input should', 'must'))


def _advice(cls, path):
    owner, key = _owner(cls, path)
    infos = quantities(owner)
    allowed = [infos[f.name].key(f.name) if f.name in infos else f.name
               for f in dataclasses.fields(owner)]
    near = difflib.get_close_matches(key, allowed, n=1, cutoff=0.6)
    if near:
        return f'did you mean {near[0]!r}?'
    return 'allowed: ' + (', '.join(allowed) or 'none')


def _owner(cls, path):
    """The dataclass that the last key of `path` belongs to, and that key."""
    keys = [part for part in path if isinstance(part, str)]
    for key in keys[:-1]:
        inner = dataclasses_in(typing.get_type_hints(cls).get(key))
        cls = inner[0] if inner else cls
    return cls, keys[-1]


def dataclasses_in(hint):
    """The dataclasses inside a type hint, e.g. [Pad] for `tuple[Pad, ...] | None`."""
    if dataclasses.is_dataclass(hint):
        return [hint]
    return [c for arg in typing.get_args(hint) for c in dataclasses_in(arg)]
