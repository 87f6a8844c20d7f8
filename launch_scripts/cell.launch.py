"""`ros2 launch arm_brachy cell.launch.py scenario:=FILE bag:=FOLDER`: the cell, node by node.

Nodes, parameters, environment and time to close come from arm_brachy.launcher, which
`arm-brachy run` uses too. The first node that ends, at the latest the one that has finished the
scenario, ends all; one that ends with an error ends the launch with status 1, and says so.
"""

import os

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit, OnShutdown
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.session import Session
from arm_brachy.launcher import (
    PATIENCE_S,
    RECORDER_PATIENCE_S,
    cell_namespace,
    cell_processes,
    claim_domain,
    node_environment,
    ros_parameters,
    session_key,
    where,
)
from arm_brachy.scenario import load_cell

DOMAIN = 'ROS_DOMAIN_ID'


def _nodes(context):
    scenario = LaunchConfiguration('scenario').perform(context)
    bag = LaunchConfiguration('bag').perform(context)
    namespace = cell_namespace(LaunchConfiguration('namespace').perform(context))
    speed_limit = float(LaunchConfiguration('speed_limit').perform(context))
    watch = LaunchConfiguration('watch').perform(context) == 'true'
    level = LaunchConfiguration('log_level').perform(context)
    if os.path.exists(bag):     # also the key of the cell that records into it would be replaced
        raise ArmBrachyError(f'bag:={bag} exists; a recording is never overwritten: name another')
    processes = cell_processes(load_cell(scenario), scenario, bag, speed_limit=speed_limit,
                               watch=watch, namespace=namespace)
    domain = claim_domain(os.environ.get(DOMAIN) or '0', namespace)
    key = session_key(bag)
    Session.create(key, domain, namespace)
    nodes = [Node(package='arm_brachy', executable=p.name, name=p.name, output='log',
                  namespace=p.namespace, ros_arguments=['--log-level', level],
                  parameters=[str(ros_parameters()), p.parameters],
                  additional_env=node_environment(), sigterm_timeout=str(_patience(p.name)))
             for p in processes]
    ends = [RegisterEventHandler(OnProcessExit(target_action=node, on_exit=_ended(p.name, bag)))
            for node, p in zip(nodes, processes, strict=True)]
    forget = RegisterEventHandler(OnShutdown(
        on_shutdown=lambda event, context: key.unlink(missing_ok=True)))
    return [LogInfo(msg=f'{where(domain, namespace)}; records into {bag}, session key {key}'),
            *nodes, *ends, forget]


def _ended(name, bag):
    """Event handler: the first node that ends, ends all; with an error it fails the launch."""
    def handle(event, context):
        if event.returncode and not context.is_shutdown:
            raise ArmBrachyError(
                f'{name} ended with status {event.returncode}; its log says why (ros2 launch '
                f'names the folder above). What was recorded is in {bag}: arm-brachy recover '
                f'{bag} {bag}_recovered')
        return [EmitEvent(event=Shutdown(reason=f'{name} has ended; the recording is in {bag}: '
                                                f'arm-brachy evaluate {bag}'))]
    return handle


def _patience(name):
    return RECORDER_PATIENCE_S if name == graph.RECORDER.name else PATIENCE_S


def generate_launch_description():
    """The launch description; all arguments have defaults."""
    return LaunchDescription([
        DeclareLaunchArgument('scenario',
                              default_value=str(config_dir() / 'scenarios' / 'target_1.yaml'),
                              description='scenario file'),
        DeclareLaunchArgument('bag', default_value='cell_bag',
                              description='folder of the recording; must not exist'),
        DeclareLaunchArgument('namespace', default_value='',
                              description='of all nodes, topics and services of this cell'),
        DeclareLaunchArgument('speed_limit', default_value='0',
                              description='simulated seconds per second; 0 = as fast as possible'),
        DeclareLaunchArgument('watch', default_value='false',
                              description='true: tissue_model and mismatch_monitor run beside it'),
        DeclareLaunchArgument('log_level', default_value='info',
                              description='debug, info, warn, error or fatal'),
        OpaqueFunction(function=_nodes),
    ])
