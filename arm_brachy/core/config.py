"""YAML file -> frozen dataclass, with the file, line, key and allowed range in every complaint.

A dataclass is the schema. Its `quantity` fields appear in YAML under `<name>_<unit>` and are
converted to SI; nested dataclasses, tuples of dataclasses, literals and enums go by their names.
Checking of types, ranges and unknown keys is pydantic's; what is ours is the unit suffix and the
one-line message (`complaint.py`).
"""

import dataclasses
import functools
import types
import typing
from pathlib import Path
from typing import Annotated

import pydantic
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.scalarbool import ScalarBoolean

from arm_brachy.core.complaint import complaint, dataclasses_in, shown
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantities, wholes


def load(cls, path):
    """Read a YAML file as dataclass `cls`.

    Raises ConfigError naming file, line, key, value and what is allowed.
    """
    path = Path(path)
    return from_mapping(cls, read_yaml(path), str(path))


def read_yaml(path):
    """Read a YAML mapping that remembers its line numbers; duplicate keys are refused."""
    path = Path(path)
    try:
        data = YAML(typ='rt').load(path.read_text(encoding='utf-8'))
    except FileNotFoundError:
        raise ConfigError(f'{path}: no such file') from None
    except OSError as error:
        raise ConfigError(f'{path}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise ConfigError(f'{path}: byte {error.start} is not UTF-8 text; save the file as '
                          'UTF-8') from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f':{mark.line + 1}' if mark else ''
        problem = ' '.join(str(error.problem or error.context).split())
        raise ConfigError(f'{path}{line}: not valid YAML: {problem}') from None
    except (YAMLError, ValueError) as error:  # a character YAML forbids; the 32nd of a month
        problem = ' '.join(str(error).split())
        raise ConfigError(f'{path}: not valid YAML: {problem}') from None
    if not isinstance(data, dict):
        raise ConfigError(f'{path}: got {_kind(data)}; must be a mapping of keys to values')
    return data


def _kind(data):
    if data is None:
        return 'an empty file'
    return 'a list' if isinstance(data, list) else f'only {shown(data)}'


def from_mapping(cls, data, where):
    """Build dataclass `cls` from a mapping in edge units.

    where : file name for messages;  Raises ConfigError (one line) on the first problem found.
    """
    if not isinstance(data, dict):
        raise ConfigError(f'{where}: got {shown(data)}; must be a mapping of keys to values')
    try:
        checked = _model(cls).model_validate(_plain(data))
    except pydantic.ValidationError as error:
        raise ConfigError(complaint(cls, data, where, error.errors())) from None
    try:
        return _build(cls, checked)
    except ConfigError as error:  # from a __post_init__, which does not know the file
        raise ConfigError(f'{where}: {error}') from None


def to_mapping(obj):
    """Return the plain mapping in edge units that `from_mapping` turns back into `obj`."""
    infos = quantities(type(obj))
    out = {}
    for f in dataclasses.fields(obj):
        value = getattr(obj, f.name)
        if f.name in infos:
            if value is not None:
                out[infos[f.name].key(f.name)] = infos[f.name].to_edge(value)
        else:
            out[f.name] = _to_plain(value)
    return out


def _to_plain(value):
    if dataclasses.is_dataclass(value):
        return to_mapping(value)
    if isinstance(value, dict):
        return {k: _to_plain(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [_to_plain(v) for v in value]
    return value


def _plain(value):
    """Strip ruamel's round-trip types."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, ScalarBoolean):  # derives from int, as bool does
        return bool(value)
    for base in (int, float, str):
        if isinstance(value, base) and type(value) not in (base, bool):
            return base(value)
    return value


@functools.cache
def _model(cls):
    """The pydantic model whose fields are the edge names of dataclass `cls`."""
    infos, whole = quantities(cls), wholes(cls)
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = {}
    for f in dataclasses.fields(cls):
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if f.name in infos:
            info = infos[f.name]
            kind = _number_type(info)
            fields[info.key(f.name)] = (kind if required else kind | None,
                                        ... if required else None)
        else:
            kind = _edge_type(hints[f.name])
            if f.name in whole:
                kind = Annotated[kind, pydantic.Field(ge=whole[f.name].low,
                                                      le=whole[f.name].high)]
            fields[f.name] = (kind, ...) if required else (kind | None, None)
    config = pydantic.ConfigDict(extra='forbid', strict=False, frozen=True)
    return pydantic.create_model(cls.__name__, __config__=config, **fields)


def _number_type(info):
    number = Annotated[float, pydantic.Field(ge=info.low, le=info.high, allow_inf_nan=False),
                       pydantic.BeforeValidator(_refuse_bool_and_text)]
    if info.shape:
        size = info.shape[0]
        return Annotated[list[number], pydantic.Field(min_length=size, max_length=size)]
    return number


def _refuse_bool_and_text(value):
    if isinstance(value, (bool, str)):
        raise ValueError('must be a number')
    return value


# Text is no number and a number no text: `seed: '7'`, `seed: true` and `name: 7` are mistakes.
_STRICT = {
    int: Annotated[int, pydantic.Strict()], bool: Annotated[bool, pydantic.Strict()],
    str: Annotated[str, pydantic.Strict()],
    float: Annotated[float, pydantic.Field(allow_inf_nan=False), pydantic.Strict()],
}


def _edge_type(hint):
    """Replace dataclasses inside a type hint by their pydantic models."""
    if dataclasses.is_dataclass(hint):
        return _model(hint)
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is None or origin is typing.Literal:
        return _STRICT.get(hint, hint)
    if origin is Annotated:
        return Annotated[(_edge_type(args[0]), *args[1:])]
    inner = tuple(_edge_type(a) if a is not Ellipsis else a for a in args)
    if origin in (types.UnionType, typing.Union):
        return functools.reduce(lambda a, b: a | b, inner)
    return origin[inner]


def _build(cls, checked):
    """pydantic object in edge units -> dataclass in SI; absent keys keep the dataclass default."""
    infos = quantities(cls)
    given = checked.model_fields_set
    values = {}
    for f in dataclasses.fields(cls):
        key = infos[f.name].key(f.name) if f.name in infos else f.name
        if key not in given or (getattr(checked, key) is None and f.name in infos):
            continue
        value = getattr(checked, key)
        if f.name in infos:
            values[f.name] = infos[f.name].to_si(value)
        elif value is not None or f.default is None:
            values[f.name] = _build_value(typing.get_type_hints(cls)[f.name], value)
    return cls(**values)


def _build_value(hint, value):
    if isinstance(value, pydantic.BaseModel):
        return _build(next(c for c in dataclasses_in(hint) if _model(c) is type(value)), value)
    if isinstance(value, (list, tuple)):
        return tuple(_build_value(hint, v) for v in value)
    if isinstance(value, dict):
        return {k: _build_value(hint, v) for k, v in value.items()}
    return value


def key_rows(cls, prefix=''):
    """Rows (key, default, allowed, meaning) of every key that a file of `cls` may hold."""
    infos, hints, whole = quantities(cls), typing.get_type_hints(cls), wholes(cls)
    rows = []
    for f in dataclasses.fields(cls):
        inner = dataclasses_in(hints[f.name])
        if f.name in infos:
            info = infos[f.name]
            rows.append((prefix + info.key(f.name),
                         _default_text(f, info.to_edge), info.allowed(), info.text))
        elif inner:
            item = '[]' if typing.get_origin(hints[f.name]) is tuple else ''
            rows += key_rows(inner[0], f'{prefix}{f.name}{item}.')
        else:
            allowed = whole[f.name].allowed() if f.name in whole else _type_name(hints[f.name])
            rows.append((prefix + f.name, _default_text(f), allowed.removeprefix('a '),
                         f.metadata.get('text', '')))
    return rows


def _default_text(f, to_edge=lambda value: value):
    if f.default is dataclasses.MISSING:
        return 'required' if f.default_factory is dataclasses.MISSING else 'none'
    return '' if f.default is None else _spoken(to_edge(f.default))


def _spoken(value):
    """A value as YAML has it: lists in brackets, true and false."""
    if isinstance(value, (tuple, list)):
        return f'[{", ".join(map(_spoken, value))}]'
    if isinstance(value, float):
        return f'{value:.12g}'
    return str(value).lower() if isinstance(value, bool) else str(value)


PLAIN = {str: 'text', int: 'whole number', float: 'number', bool: 'true or false',
         dict: 'a mapping', list: 'a list', types.NoneType: 'none'}


def _type_name(hint):
    """What a key may hold, in words: 'list of text', 'mapping of text to 3 numbers'."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return ' or '.join(map(str, args))
    if origin in (types.UnionType, typing.Union):
        return ' or '.join(_type_name(a) for a in args if a is not types.NoneType)
    if origin is dict:
        return f'mapping of {_type_name(args[0])} to {_type_name(args[1])}'
    if origin is tuple and Ellipsis not in args:
        of = dict.fromkeys(map(_type_name, args))
        return f'list of {len(args)}: {" and ".join(of)}'
    if origin in (tuple, list):
        return f'list of {_type_name(args[0])}'
    return PLAIN.get(hint, getattr(hint, '__name__', str(hint)))
