"""The running graph against its table, and what becomes of a run that is disturbed."""

import time
from contextlib import contextmanager

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped, WrenchStamped
from rclpy.node import Node, NodeNameNonExistentError
from tf2_msgs.msg import TFMessage

from arm_brachy import graph, launcher
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.nodes.ticker import offered
from arm_brachy.recording.reader import BagReader
from arm_brachy.recording.recover import recover
from arm_brachy.scenario import load_cell
from arm_brachy_msgs.msg import ActuatorCommand, TickDone

pytestmark = [pytest.mark.ros, pytest.mark.slow]
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
        says |= {f'{action.replace("~", spec.name)}/_action/{what}' for action in spec.actions
                 for what in ('feedback', 'status')}
        if spec.managed:
            says.add(graph.LIFECYCLE_EVENT.replace('~', spec.name))
        table[spec.name, 'publishes'] = {'/' + n.lstrip('/') for n in says}
        table[spec.name, 'subscribes'] = {'/' + n.lstrip('/') for n in hears}
    return table


@contextmanager
def newcomer():
    """A node of a participant of its own, which discovers the graph from the start."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node('newcomer', context=context)
    yield node
    node.destroy_node()
    context.shutdown()


def endpoints(node, name):
    """(name, 'publishes' or 'subscribes') -> topics, as far as `node` has discovered them."""
    ask = {'publishes': node.get_publisher_names_and_types_by_node,
           'subscribes': node.get_subscriber_names_and_types_by_node}
    try:
        return {(name, way): {topic for topic, _ in ask[way](name, '/')} - OF_EVERY_NODE
                for way in ask}
    except NodeNameNonExistentError:
        return {}


def discovered(wanted):
    """The same of the live graph.

    rmw_fastrtps tells which endpoint is whose over `ros_discovery_info`, whose readers keep one
    sample: of two that come at once the older is lost, and the reader never hears of it again
    (ros2/rmw_fastrtps 792). No endpoint of the cell goes while it runs, so that what several
    participants have heard counts together.
    """
    seen = {key: set() for key in wanted}
    for _ in range(6):
        with newcomer() as node:
            end = time.monotonic() + 8
            while seen != wanted and time.monotonic() < end:
                for name in graph.CELL:
                    for key, topics in endpoints(node, name).items():
                        seen[key] |= topics
                time.sleep(0.05)
        if seen == wanted:
            break
    return seen


@pytest.fixture
def endless_scenario(short_scenario, tmp_path):
    """The short scenario with a task that outlasts a slow discovery."""
    config = short_scenario.parents[2] / 'config'
    path = tmp_path / 'endless.yaml'
    path.write_text(short_scenario.read_text().replace('../../config', str(config))
                    .replace('duration_s: 5}', 'duration_s: 120}'))
    return path


def foreign(probe):
    """Publishers of a stranger, each with a message: what a robot beside the cell says, a forged
    command and an answer of nobody; the last is of a topic that one node of the cell owns.
    """
    frame = TransformStamped(child_frame_id='camera')
    status = DiagnosticStatus(name='robot: motor')
    for topic, msg in ((graph.TF, TFMessage(transforms=[frame])),
                       (graph.DIAGNOSTICS, DiagnosticArray(status=[status])),
                       (graph.COMMAND, ActuatorCommand(position=[0.03] * 4)),
                       (graph.TICK_DONE.at(node='em_tracker'), TickDone(node='robot', tick=9)),
                       (graph.WRENCH.at(pad='pad_1'), WrenchStamped())):
        yield probe.create_publisher(type(msg), topic.name, offered(topic)), msg


@pytest.mark.wall
def test_nodes_do_what_the_table_says_strangers_are_ignored_or_end_the_run(
        endless_scenario, tmp_path, probe):
    """What belongs to others too, or has a seal, is ignored; data of a sensor end the run."""
    cell, seen, later = load_cell(endless_scenario), [], []
    wanted = promised(cell)
    *harmless, (wrench, sample) = foreign(probe)

    def disturb(name, values):
        if not seen and values['t'] > 1.0:
            seen.append(discovered(wanted))
            for pub, msg in harmless:
                assert wait_until(lambda pub=pub: pub.get_subscription_count() > 0, 10)
                pub.publish(msg)
            later.append(values['t'] + 1.5)
        elif later and values['t'] > later[0]:
            wrench.publish(sample)

    runner = launcher.Launcher(
        launcher.cell_processes(cell, cell.path, tmp_path / 'bag', speed_limit=1.0), 'cell_clock',
        tmp_path / 'logs', disturb)
    with pytest.raises(ArmBrachyError, match='force/pad_1/wrench: holds a message that was not '
                                             'published by force_sensor'):
        runner.run()
    assert seen[0] == wanted
    for log, said in (('actuator_driver', 'actuators/command: no seal'),
                      ('cell_clock', "an answer of 'robot' is ignored")):
        assert said in (tmp_path / 'logs' / f'{log}.log').read_text()
    recover(tmp_path / 'bag', tmp_path / 'mended')
    with BagReader(tmp_path / 'mended') as reader:
        kept = [m.data for m in reader.records(['/tf', '/diagnostics'])]
    assert kept and not any(b'camera' in data or b'robot' in data for data in kept)


def test_a_node_that_never_comes_is_named_within_the_patience(start_node, short_scenario):
    """The tracker is ready and says so all the time; nobody starts the force sensor."""
    common = (f'scenario:={short_scenario}',
              'peers:=["cell_clock", "em_tracker", "force_sensor"]')
    tracker = start_node('em_tracker', *common)
    clock = start_node('cell_clock', *common, 'patience_s:=5.0')
    assert clock.process.wait(90) == 1
    clock.finish()
    assert 'tick 0 has not ended' in clock.lines[-1]
    assert 'not running: force_sensor;' in clock.lines[-1]
    assert tracker.process.poll() is None
