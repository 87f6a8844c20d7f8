"""The running graph against its table, and what becomes of a run that is disturbed."""

import time

import pytest
import rclpy
from rclpy.node import Node

from arm_brachy import graph, launcher
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.nodes.ticker import offered
from arm_brachy.scenario import load_cell
from arm_brachy_msgs.msg import ActuatorCommand

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.wall]
OF_EVERY_NODE = {'/rosout', '/parameter_events'}


@pytest.fixture
def probe(ros_domain_id):
    """A node that is not in the table."""
    rclpy.init()
    node = Node('probe')
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def wait_until(condition, seconds):
    """Poll; returns whether it came true."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


def promised(cell):
    """(node, 'publishes' or 'subscribes') -> absolute topic names, as the table has them."""
    every = graph.instances(cell.em_tools, [p.name for p in cell.scene.pads])
    every = [t for t in every if graph.writers(t.name, graph.CELL)]
    table = {}
    for spec in map(graph.node, graph.CELL):
        says = {t.name for t in every if any(mine.matches(t.name) for mine in spec.publishes)}
        hears = {t.name for t in every if spec.hears(t.name)} | {graph.CLOCK.name}
        upstream = {*spec.same, *spec.previous} & set(graph.CELL)
        if spec is graph.CELL_CLOCK:
            says, hears = {graph.CLOCK.name}, hears - {graph.CLOCK.name}
            upstream = set(graph.CELL) - {spec.name}
        else:
            says.add(graph.TICK_DONE.at(node=spec.name).name)
        hears |= {graph.TICK_DONE.at(node=n).name for n in upstream}
        table[spec.name, 'publishes'] = {'/' + n.lstrip('/') for n in says}
        table[spec.name, 'subscribes'] = {'/' + n.lstrip('/') for n in hears}
    return table


def found(probe):
    """The same of the live graph."""
    ask = {'publishes': probe.get_publisher_names_and_types_by_node,
           'subscribes': probe.get_subscriber_names_and_types_by_node}
    return {(name, way): {topic for topic, _ in ask[way](name, '/')} - OF_EVERY_NODE
            for name in graph.CELL for way in ask}


def test_nodes_do_what_the_table_says_and_a_foreign_publisher_ends_the_run(
        short_scenario, tmp_path, probe):
    cell, seen = load_cell(short_scenario), []
    wanted = promised(cell)
    command = probe.create_publisher(ActuatorCommand, graph.COMMAND.name, offered(graph.COMMAND))

    def disturb(name, values):
        if not seen and values['t'] > 1.0:
            wait_until(lambda: set(probe.get_node_names()) >= set(graph.CELL), 10)
            seen.append(found(probe))
            assert wait_until(lambda: command.get_subscription_count() == 2, 10)
            command.publish(ActuatorCommand(position=[0.001] * len(cell.scene.pads)))

    runner = launcher.Launcher(
        launcher.cell_processes(cell, cell.path, tmp_path / 'bag', speed_limit=1.0), 'cell_clock',
        tmp_path / 'logs', disturb)
    with pytest.raises(ArmBrachyError, match='actuators/command: holds a message that was not '
                                             'published by mpc_manipulator'):
        runner.run()
    assert seen[0] == wanted


def test_a_node_that_never_comes_is_named_within_the_patience(start_node, short_scenario):
    """The tracker is ready and says so all the time; nobody starts the force sensor."""
    common = (f'scenario:={short_scenario}',
              'peers:=["cell_clock", "em_tracker", "force_sensor"]')
    tracker = start_node('em_tracker', *common)
    clock = start_node('cell_clock', *common, 'patience_s:=5.0')
    assert clock.process.wait(40) == 1
    clock.finish()
    assert 'tick 0 has not ended' in clock.lines[-1]
    assert 'not running: force_sensor;' in clock.lines[-1]
    assert tracker.process.poll() is None
