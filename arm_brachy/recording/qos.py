"""Offered quality of service as rosbag2 stores it, in both spellings that are in use.

Channel metadata in the MCAP file carry the integer enumerators of rmw/types.h, which every reader
accepts once the file says that it is older than version 9 (see `writer`); metadata.yaml of version
9 carries names, because its reader takes integers for unknown policies.
"""

from dataclasses import asdict, dataclass
from io import StringIO

from ruamel.yaml import YAML

INFINITE = (9223372036, 854775807)  # RMW_DURATION_INFINITE as (s, ns), rmw/time.h

# Enumerators of rmw/types.h.
NAMES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': ('system_default', 'automatic', 'manual_by_node', 'manual_by_topic', 'unknown',
                   'best_available'),
}


@dataclass(frozen=True)
class Qos:
    """One publisher's offer; integers are the enumerators of rmw/types.h.

    depth : queue length;  deadline, lifespan, liveliness_lease_duration : (s, ns)
    """

    history: int = 1
    depth: int = 10
    reliability: int = 1
    durability: int = 2
    deadline: tuple = INFINITE
    lifespan: tuple = INFINITE
    liveliness: int = 1
    liveliness_lease_duration: tuple = INFINITE
    avoid_ros_namespace_conventions: bool = False

    def mapping(self, *, names=False):
        """Return the mapping rosbag2 writes; `names` spells the policies as words (version 9)."""
        out = {}
        for key, value in asdict(self).items():
            if isinstance(value, tuple):
                value = {'sec': value[0], 'nsec': value[1]}
            elif names and key in NAMES:
                value = NAMES[key][value]
            out[key] = value
        return out


RELIABLE = Qos()
SENSOR_DATA = Qos(depth=5, reliability=2)
LATCHED = Qos(depth=1, durability=1)


def dump(profiles):
    """Return the YAML text of channel metadata `offered_qos_profiles` (integer enumerators)."""
    if not profiles:
        return ''
    stream = StringIO()
    yaml = YAML(typ='safe')
    yaml.default_flow_style = False
    yaml.dump([p.mapping() for p in profiles], stream)
    return stream.getvalue().strip()


def parse(text):
    """Return the tuple of Qos that channel metadata say, in either spelling; '' gives ()."""
    items = YAML(typ='safe').load(text) if text else None
    return tuple(_profile(item) for item in items or ())


def _profile(item):
    values = {}
    for key, value in item.items():
        if isinstance(value, dict):
            value = (value['sec'], value['nsec'])
        elif key in NAMES and isinstance(value, str):
            value = NAMES[key].index(value)
        values[key] = value
    return Qos(**values)
