"""`ros2 launch arm_brachy cell.launch.py scenario:=FILE bag:=FOLDER`: the cell, node by node.

Nodes, parameters, environment and time to close come from arm_brachy.launcher, which
`arm-brachy run` uses too. The first node that ends, at the latest the one that has finished the
scenario, ends all.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from arm_brachy import graph
from arm_brachy.core.paths import config_dir
from arm_brachy.launcher import (
    PATIENCE_S,
    RECORDER_PATIENCE_S,
    cell_processes,
    node_environment,
    ros_parameters,
)
from arm_brachy.scenario import load_cell


def _nodes(context):
    scenario = LaunchConfiguration('scenario').perform(context)
    bag = LaunchConfiguration('bag').perform(context)
    nodes = [Node(package='arm_brachy', executable=p.name, name=p.name, output='log',
                  parameters=[str(ros_parameters()), p.parameters],
                  additional_env=node_environment(), sigterm_timeout=str(_patience(p.name)))
             for p in cell_processes(load_cell(scenario), scenario, bag)]
    ends = [RegisterEventHandler(OnProcessExit(target_action=n,
                                               on_exit=[EmitEvent(event=Shutdown())]))
            for n in nodes]
    return nodes + ends


def _patience(name):
    return RECORDER_PATIENCE_S if name == graph.RECORDER.name else PATIENCE_S


def generate_launch_description():
    """The launch description; both arguments have defaults."""
    return LaunchDescription([
        DeclareLaunchArgument('scenario',
                              default_value=str(config_dir() / 'scenarios' / 'target_1.yaml'),
                              description='scenario file'),
        DeclareLaunchArgument('bag', default_value='cell_bag',
                              description='folder of the recording; must not exist'),
        OpaqueFunction(function=_nodes),
    ])
