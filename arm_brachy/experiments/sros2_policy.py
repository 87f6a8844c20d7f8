"""The SROS2 policy of the cell, made from the table of the graph.

`python -m arm_brachy.experiments.sros2_policy` writes config/sros2/policy.xml. Each node may
publish and hear what its row says, and call the services that it calls, and nothing else.
Format: SROS2 access control policy 0.2.0 (design.ros2.org, ROS 2 Access Control Policies).
Test: experiments/test_sros2_policy.py
"""

import re
from xml.etree import ElementTree

from arm_brachy import graph
from arm_brachy.core.paths import config_dir

PATH = ('sros2', 'policy.xml')
OF_EVERY_NODE = ('rosout', 'parameter_events')
PARAMETER_SERVICES = tuple(f'~/{name}' for name in (
    'describe_parameters', 'get_parameter_types', 'get_parameters', 'list_parameters',
    'set_parameters', 'set_parameters_atomically'))
# The table of the graph has who offers a service; here is who calls it. What needs the session key
# (nodes.keyed_trigger) is called through `set_parameters`, in a cell without a key by its name.
CALLS = {
    'operator': ('mpc_manipulator/set_goal', 'mpc_manipulator/set_parameters',
                 'mpc_manipulator/abort', 'actuator_driver/home',
                 'actuator_driver/set_parameters', 'surface_scanner/scan',
                 'surface_scanner/set_parameters',
                 'probe_controller/follow', 'probe_controller/retract',
                 'probe_controller/set_parameters'),
    'push_protocol': ('actuator_driver/home', 'actuator_driver/set_parameters'),
}


def policy():
    """Return the policy as text."""
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for row in graph.NODES:
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'/arm_brachy/{row.name}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        profile = ElementTree.SubElement(profiles, 'profile', ns='/', node=row.name)
        says = {t.name for t in row.publishes} | {*OF_EVERY_NODE}
        if row is not graph.CELL_CLOCK:
            says.add(graph.TICK_DONE.at(node=row.name).name)
        hears = {t.name for t in row.subscribes} | {graph.CLOCK.name, graph.TICK_DONE.name}
        if row.managed:
            says.add(graph.LIFECYCLE_EVENT)
        _section(profile, 'topic', 'publish', says)
        _section(profile, 'topic', 'subscribe', hears)
        lifecycle = graph.LIFECYCLE_SERVICES if row.managed else ()
        _section(profile, 'service', 'reply',
                 {*row.services, *lifecycle, *PARAMETER_SERVICES})
        _section(profile, 'service', 'request', CALLS.get(row.name, ()))
        _section(profile, 'action', 'execute', row.actions)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode', xml_declaration=True) + '\n'


def _section(profile, kind, way, names):
    if not names:
        return
    section = ElementTree.SubElement(profile, f'{kind}s', {way: 'ALLOW'})
    for name in sorted(re.sub(r'\{\w+\}', '*', name).lstrip('/') for name in names):
        ElementTree.SubElement(section, kind).text = name


if __name__ == '__main__':
    config_dir().joinpath(*PATH).write_text(policy(), encoding='utf-8')
