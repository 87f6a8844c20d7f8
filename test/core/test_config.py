"""YAML to dataclass and back; every complaint in one line with file, line, value and range."""

import dataclasses
import re
from dataclasses import dataclass, field
from typing import Literal

import pytest

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantities, quantity, whole


@dataclass(frozen=True)
class Disc:
    name: str
    centre: tuple = quantity(None, 'mm', 'centre', shape=(3,))
    radius: float = quantity(8.0, 'mm', 'radius', low=0.5, high=200.0)


@dataclass(frozen=True)
class Noise:
    sigma: float = quantity(0.1, 'mm', 'standard deviation', low=0.0)
    gain: float = 1.0


@dataclass(frozen=True)
class Rig:
    name: str
    seed: int
    mode: Literal['fast', 'slow'] = 'fast'
    wait: float = quantity(..., 's', 'pause', low=0.0, high=10.0)
    place: tuple = quantity(..., 'mm', 'where', shape=(3,))
    still: bool = False
    noise: Noise = field(default_factory=Noise)
    spare: Noise | None = None
    discs: tuple[Disc, ...] = ()
    tags: tuple[str, ...] = ()
    turns: int = whole(3, 'of the rig', low=1, high=9)
    shots: int = whole(1, 'of each turn', low=1)
    labels: dict[str, str] = field(default_factory=dict)
    entries: tuple[dict, ...] = ()


GOOD = """\
name: rig
seed: 7
noise:
  sigma_mm: 0.2
discs:
- name: a
  centre_mm: [1, 2, 3]
- {name: b, centre_mm: [0, 0, 0], radius_mm: 20}
tags: [x, y]
labels: {left: '1'}
"""


def write(tmp_path, text):
    path = tmp_path / 'rig.yaml'
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def complaint_of(tmp_path, text):
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        config.load(Rig, path)
    message = str(caught.value)
    assert '\n' not in message and len(message) < 400 + len(str(path))
    assert message.startswith(str(path))
    return message.removeprefix(str(path))


def test_a_good_file_is_read_in_si(tmp_path):
    rig = config.load(Rig, write(tmp_path, GOOD))
    assert rig == Rig('rig', 7, noise=Noise(0.2e-3), tags=('x', 'y'), labels={'left': '1'},
                      discs=(Disc('a', (0.001, 0.002, 0.003)), Disc('b', (0., 0., 0.), 0.02)))
    assert rig.wait is None and rig.place is None


def test_absent_and_empty_keys_take_the_default(tmp_path):
    rig = config.load(Rig, write(tmp_path, 'name: rig\nseed: 7\ndiscs:\nwait_s:\nnoise: null\n'))
    assert rig == Rig('rig', 7)


MISTAKES = [
    # line 1: name, 2: seed; then what is appended, from line 3 on
    ('colour: red', 3, "unknown key 'colour'; allowed: name, seed, mode, wait_s"),
    ('wait: 3', 3, "unknown key 'wait'; did you mean 'wait_s'?"),
    ('noise: {sigma: 3}', 3, "unknown key 'noise.sigma'; did you mean 'sigma_mm'?"),
    ('discs:\n- name: a\n  center_mm: [0, 0, 0]', 5, "did you mean 'centre_mm'?"),
    ('wait_s: -1', 3, 'wait_s = -1; must be 0 to 10 s'),
    ('wait_s: 11.5', 3, 'wait_s = 11.5; must be 0 to 10 s'),
    ('wait_s: .nan', 3, 'wait_s = nan; must be 0 to 10 s'),
    ('wait_s: .inf', 3, 'wait_s = inf; must be 0 to 10 s'),
    ('wait_s: 1' + 400 * '0', 3, 'must be a number, 0 to 10 s'),
    ("wait_s: '3'", 3, "wait_s = '3'; must be a number, 0 to 10 s"),
    ('wait_s: 3 s', 3, "wait_s = '3 s'; must be a number, 0 to 10 s"),
    ('wait_s: true', 3, 'wait_s = True; must be a number, 0 to 10 s'),
    ('wait_s: &a true', 3, 'wait_s = True; must be a number, 0 to 10 s'),
    ('wait_s: [1]', 3, 'wait_s = [1]; must be a number, 0 to 10 s'),
    ('noise:\n  sigma_mm: -0.1', 4, 'noise.sigma_mm = -0.1; must be at least 0 mm'),
    ("noise:\n  gain: '1'", 4, "noise.gain = '1'; must be a number"),
    ('noise:\n  gain: .inf', 4, 'noise.gain = inf; must be a finite number'),
    ('noise: 3', 3, 'noise = 3; must be a mapping of keys to values'),
    ('spare: [1]', 3, 'spare = [1]; must be a mapping of keys to values'),
    ('spare: {sigma_mm: -2}', 3, 'spare.sigma_mm = -2; must be at least 0 mm'),
    ('place_mm: [1, 2]', 3, 'place_mm = [1, 2]; must be 3 finite numbers in mm'),
    ('place_mm: [1, 2, 3, 4]', 3, 'must be 3 finite numbers in mm'),
    ('place_mm: 5', 3, 'place_mm = 5; must be 3 finite numbers in mm'),
    ('place_mm:\n- 1\n- 2\n- .nan', 6, 'place_mm.2 = nan; must be 3 finite numbers in mm'),
    ('place_mm: [1, 2, x]', 3, "place_mm.2 = 'x'; must be 3 finite numbers in mm"),
    ('discs:\n- name: a', 4, "key 'discs.0.centre_mm' is missing; must be 3 finite numbers"),
    ('discs:\n- centre_mm: [0, 0, 0]', 4, "key 'discs.0.name' is missing; it must be given"),
    ('discs: {name: a}', 3, "discs = {'name': 'a'}; must be a list"),
    ('discs:\n- {name: a, centre_mm: [0, 0, 0]}\n- {name: b, centre_mm: [0, 0, 0],\n'
     '   radius_mm: 900}', 6, 'discs.1.radius_mm = 900; must be 0.5 to 200 mm'),
    ('mode: quick', 3, "mode = 'quick'; must be 'fast' or 'slow'"),
    ('still: 1', 3, 'still = 1; must be true or false'),
    ("still: 'yes'", 3, "still = 'yes'; must be true or false"),
    ('tags: x', 3, "tags = 'x'; must be a list"),
    ('turns: 0', 3, 'turns = 0; must be a whole number, 1 to 9'),
    ('turns: 10', 3, 'turns = 10; must be a whole number, 1 to 9'),
    ('turns: 2.5', 3, 'turns = 2.5; must be a whole number, 1 to 9'),
    ('shots: 0', 3, 'shots = 0; must be a whole number, at least 1'),
    ('tags: [1]', 3, 'tags.0 = 1; must be text'),
    ('labels: {left: 1}', 3, 'labels.left = 1; must be text'),
    ('labels: [a]', 3, "labels = ['a']; must be a mapping of keys to values"),
    ('entries: [a]', 3, "entries.0 = 'a'; must be a mapping of keys to values"),
    ('seed: 8', 3, 'not valid YAML: found duplicate key "seed"'),
    ('noise:\n\tsigma_mm: 1', 4, "not valid YAML: found character '\\t'"),
    ('place_mm: [1, 2', 4, 'not valid YAML'),
    ('---\nname: second', 3, 'not valid YAML'),
]


@pytest.mark.parametrize('text,line,says', MISTAKES, ids=[m[0][:25] for m in MISTAKES])
def test_a_mistake_is_told_by_line_value_and_range(tmp_path, text, line, says):
    message = complaint_of(tmp_path, f'name: rig\nseed: 7\n{text}\n')
    assert message.startswith(f':{line}: ')
    assert says in message


@pytest.mark.parametrize('text,says', [
    ('name: 5\nseed: 7', ':1: name = 5; must be text'),
    ('name: rig\nseed: true', ':2: seed = True; must be a whole number'),
    ("name: rig\nseed: '7'", ":2: seed = '7'; must be a whole number"),
    ('name: rig\nseed: 7.5', ':2: seed = 7.5; must be a whole number'),
    ('name: rig\nseed:', ':2: seed = None; must be a whole number'),
    ('name: rig', ": key 'seed' is missing; it must be given"),
    ('name: 2026-01-07\nseed: 7', ':1: name = '),
])
def test_required_keys(tmp_path, text, says):
    assert complaint_of(tmp_path, text).startswith(says)


@pytest.mark.parametrize('content,says', [
    ('', 'got an empty file; must be a mapping of keys to values'),
    ('# only a comment\n', 'got an empty file'),
    ('- name: rig\n', 'got a list; must be a mapping'),
    ('rig\n', "got only 'rig'; must be a mapping"),
    (b'name: caf\xe9\n', 'byte 9 is not UTF-8 text; save the file as UTF-8'),
    (b'name: a\x00b\n', 'not valid YAML'),
    ('name: 2026-02-32\nseed: 7\n', 'not valid YAML'),
    (f'name: rig\nseed: {"1" * 5000}\n', 'not valid YAML'),
])
def test_what_is_no_mapping_at_all(tmp_path, content, says):
    assert says in complaint_of(tmp_path, content)


def test_a_file_that_cannot_be_opened(tmp_path):
    with pytest.raises(ConfigError, match='rig.yaml: no such file'):
        config.load(Rig, tmp_path / 'rig.yaml')
    with pytest.raises(ConfigError, match='cannot be read: Is a directory'):
        config.load(Rig, tmp_path)
    with pytest.raises(ConfigError, match='cannot be read: Not a directory'):
        config.load(Rig, write(tmp_path, GOOD) / 'rig.yaml')


def test_a_long_value_is_cut(tmp_path):
    message = complaint_of(tmp_path, f'name: rig\nseed: {"x" * 5000}\n')
    assert re.search(r"seed = 'x{50,60}\.\.\.; must be a whole number", message)


def test_a_misspelt_required_key_is_told_as_such(tmp_path):
    assert "unknown key 'sed'; did you mean 'seed'?" in complaint_of(tmp_path, 'name: a\nsed: 7\n')


def test_a_dataclass_that_checks_itself_gets_the_file_named(tmp_path):
    @dataclass(frozen=True)
    class Window:
        start: float = quantity(0.0, 's', 'start')
        stop: float = quantity(1.0, 's', 'stop')

        def __post_init__(self):
            if self.stop <= self.start:
                raise ConfigError(f'stop_s = {self.stop:g}; must be after start_s')

    path = write(tmp_path, 'start_s: 2\n')
    with pytest.raises(ConfigError, match=re.escape(f'{path}: stop_s = 1; must be after')):
        config.load(Window, path)


def test_from_mapping_refuses_what_is_no_mapping():
    with pytest.raises(ConfigError, match=r'^here: got \[1\]; must be a mapping'):
        config.from_mapping(Rig, [1], 'here')


def test_round_trip_of_every_kind_of_field(tmp_path):
    rig = dataclasses.replace(
        config.load(Rig, write(tmp_path, GOOD)), wait=0.3, place=(0.0123, -1.0, 0.1), still=True,
        mode='slow', spare=Noise(1e-6, 2.5), entries=({'name': 'x', 'deep': {'list': (1, 2)}},))
    assert config.from_mapping(Rig, config.to_mapping(rig), 'x') == rig


def test_a_mapping_holds_plain_values_under_edge_names():
    plain = config.to_mapping(Rig('rig', 7, discs=(Disc('a', (0.001, 0.0, 0.0)),)))
    assert plain['discs'] == [{'name': 'a', 'centre_mm': [1.0, 0.0, 0.0], 'radius_mm': 8.0}]
    assert 'wait_s' not in plain and plain['spare'] is None
    assert set(plain) - {'place_mm', 'wait_s'} \
        == {f.name for f in dataclasses.fields(Rig) if f.name not in quantities(Rig)}


def test_two_schemas_of_one_name_are_told_apart():
    def schema(unit):
        @dataclass(frozen=True)
        class Part:
            size: float = quantity(1.0, unit, 'size')
        return Part

    first, second = schema('mm'), schema('m')

    @dataclass(frozen=True)
    class Both:
        a: first
        b: second

    assert config.from_mapping(Both, {'a': {'size_mm': 2}, 'b': {'size_m': 2}}, 'x') \
        == Both(first(0.002), second(2.0))


def test_a_whole_number_keeps_its_range_and_its_row(tmp_path):
    assert config.load(Rig, write(tmp_path, 'name: rig\nseed: 7\nturns: 9\n')).turns == 9
    rows = {row[0]: row[1:] for row in config.key_rows(Rig)}
    assert rows['turns'] == ('3', 'whole number, 1 to 9', 'of the rig')
    assert rows['shots'][1] == 'whole number, at least 1'
    with pytest.raises(ValueError, match='must be a whole number, 1 to 9'):
        whole(0, 'a bug in a declaration', low=1, high=9)
