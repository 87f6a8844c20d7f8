"""Strips a bag of everything that tells what played the patient, for blind trials."""

import dataclasses
from io import StringIO
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import qos
from arm_brachy.recording.canonical import Canonical
from arm_brachy.recording.reader import CellBag
from arm_brachy.recording.writer import SCENARIO, SCENE, BagWriter

TRUTH = '/truth/'
# Free text of every process, the plant's included: log lines, parameters, health reports.
TALKATIVE = ('/rosout', '/parameter_events', '/diagnostics')
# Keys of a scenario that say nothing of the plant. What is not listed goes: a key added to the
# schema later stays concealed until somebody decides otherwise. The seed would let one regenerate.
SCENARIO_KEYS = ('pace', 'tick_ms', 'settle_s', 'mesh_rate_Hz', 'model', 'actuator_driver',
                 'actuators', 'em', 'em_tools', 'optical', 'force', 'control', 'feedback',
                 'estimators', 'estimation', 'limits', 'tasks', 'moves')
PLANT_KEYS = ('plant', 'truth')       # dropped at any depth
PROSE_KEYS = ('description', 'source')
PUBLIC_MESHES = ('mesh_scene', 'mesh_model')  # stems of attached files; mesh_plant is the secret
CONCEALED = 'concealed'
DATED_NS = 10**18  # log times beyond 2001-09-09 are dates; simulated time starts at 0
TIME_TYPES = ('builtin_interfaces/msg/Time',)


def conceal(src, dst, *, also=()):
    """Write a copy of a bag without truth, plant, names, seed, commit, machine and dates.

    src : bag directory or file, untouched;  dst : new bag directory
    also : further topics to leave out
    Left out: topics under /truth/, the talkative ones (TALKATIVE), every metadata record, every
    attachment but scenario, scene and the meshes of scene and model. Of the scenario only
    SCENARIO_KEYS stay, with seed 0; the scene loses name and prose. Times that are dates are
    shifted, in headers too, so that the bag begins at 0. Padding inside payloads, which may hold
    stray memory of the plant's process, is zeroed.
    Returns a dict: source, bag, messages (topic -> number), dropped (topics), shift_s.
    Valid if no other topic carries the plant's parameters in words.
    Raises RecordingError if the scenario or scene inside is not YAML or `also` is not recorded.
    """
    with CellBag(src) as reader:
        topics = reader.topics()
        unknown = sorted(set(also) - set(topics))
        if unknown:
            raise RecordingError(f'{reader.path}: no topic {unknown[0]!r} to leave out; recorded: '
                                 f'{", ".join(topics)}')
        kept = {n: t for n, t in topics.items() if not _is_secret(n) and n not in also}
        shift = reader.span_ns[0] if reader.span_ns[0] >= DATED_NS else 0
        attachments = _attachments(reader)
        with BagWriter(dst, attachments=attachments) as bag:
            _copy(reader, kept, shift, bag)
    return {'source': str(src), 'bag': str(bag.directory), 'messages': bag.counts,
            'dropped': sorted(set(topics) - set(kept)), 'shift_s': shift * 1e-9}


def _is_secret(topic):
    return topic.startswith(TRUTH) or topic in TALKATIVE


def _copy(reader, kept, shift, bag):
    for topic in kept.values():
        bag.add_topic(topic.name, topic.type, definition=topic.definition,
                      type_hash=topic.type_hash, qos=qos.parse(topic.qos))
    canonical = Canonical({t.type: t.definition for t in kept.values()})
    for record in reader.records(list(kept)):
        message = canonical.decode(record.data, record.type)
        if shift:
            message = _earlier(message, shift)
        bag.write(record.topic, canonical.encode(message, record.type),
                  record.log_time_ns - shift, sequence=record.sequence)


def _earlier(value, shift):
    """Take `shift` ns off every date inside a message; zero stamps mean "unset" and stay."""
    if isinstance(value, list):
        return [_earlier(v, shift) for v in value]
    if not dataclasses.is_dataclass(value):
        return value
    if getattr(value, '__msgtype__', '') in TIME_TYPES:
        ns = value.sec * 10**9 + value.nanosec
        sec, nanosec = divmod(ns - shift if ns >= DATED_NS else ns, 10**9)
        return dataclasses.replace(value, sec=sec, nanosec=nanosec)
    fields = {f.name: _earlier(getattr(value, f.name), shift)
              for f in dataclasses.fields(value) if f.init}
    return dataclasses.replace(value, **fields)


def _attachments(reader):
    found = reader.attachments()
    out = {name: data for name, data in found.items() if Path(name).stem in PUBLIC_MESHES}
    if SCENARIO in found:
        scenario = _mapping(reader.path, SCENARIO, found[SCENARIO])
        public = {k: scenario[k] for k in SCENARIO_KEYS if k in scenario}
        out[SCENARIO] = _dump({'name': CONCEALED, 'seed': 0, 'scene': SCENE,
                               **_without(public, PLANT_KEYS)})
    if SCENE in found:
        scene = _mapping(reader.path, SCENE, found[SCENE])
        out[SCENE] = _dump({**_without(scene, (*PLANT_KEYS, *PROSE_KEYS)), 'name': CONCEALED})
    return out


def _mapping(path, name, data):
    try:
        value = YAML(typ='safe').load(data.decode())
    except (YAMLError, UnicodeDecodeError) as error:
        problem = ' '.join(str(error).split())
        raise RecordingError(f'{path}: attachment {name} is not YAML: {problem}') from None
    if not isinstance(value, dict):
        raise RecordingError(f'{path}: attachment {name} is no mapping; its secrets '
                             'cannot be told apart')
    return value


def _without(value, keys):
    if isinstance(value, dict):
        return {k: _without(v, keys) for k, v in value.items() if k not in keys}
    if isinstance(value, list):
        return [_without(v, keys) for v in value]
    return value


def _dump(mapping):
    stream = StringIO()
    yaml = YAML(typ='safe')
    yaml.default_flow_style = False
    yaml.dump(mapping, stream)
    return stream.getvalue()
