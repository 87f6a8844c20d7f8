"""The shipped SROS2 policy is that of the graph: who may command is one node each."""

from xml.etree import ElementTree

import pytest

from arm_brachy import graph
from arm_brachy.core.paths import config_dir
from arm_brachy.experiments.sros2_policy import CALLS, PATH, policy


@pytest.fixture(scope='module')
def profiles():
    text = config_dir().joinpath(*PATH).read_text(encoding='utf-8')
    assert text == policy(), 'run python -m arm_brachy.experiments.sros2_policy'
    return {p.get('node'): p for p in ElementTree.fromstring(text).iter('profile')}


def allowed(profile, kind, way):
    return {e.text for section in profile.iter(f'{kind}s') if section.get(way) == 'ALLOW'
            for e in section}


def test_only_their_own_nodes_may_publish_what_moves_something(profiles):
    assert set(profiles) == {n.name for n in graph.NODES}
    for topic, owners in (('actuators/command', {'mpc_manipulator', 'push_protocol'}),
                          ('needle/command', {'operator'}), ('cell/safety', {'supervisor'})):
        assert {n for n, p in profiles.items()
                if topic in allowed(p, 'topic', 'publish')} == owners


def test_what_a_node_calls_is_offered_by_another(profiles):
    offered = {f'{n}/{s.removeprefix("~/")}' for n, p in profiles.items()
               for s in allowed(p, 'service', 'reply')}
    assert {s for names in CALLS.values() for s in names} <= offered


def test_nobody_in_the_cell_may_change_the_state_of_a_managed_node(profiles):
    offers = {n for n, p in profiles.items() if '~/change_state' in allowed(p, 'service', 'reply')}
    assert offers == {'actuator_driver', 'supervisor'}
    assert not any(s.endswith('/change_state') for p in profiles.values()
                   for s in allowed(p, 'service', 'request'))
