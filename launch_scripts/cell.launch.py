"""`ros2 launch arm_brachy cell.launch.py scenario:=FILE bag:=FOLDER`: the cell, node by node.

The nodes and their parameters come from arm_brachy.launcher, which `arm-brachy run` uses too.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from arm_brachy.core.paths import config_dir
from arm_brachy.launcher import cell_processes, ros_parameters
from arm_brachy.scenario import load_cell


def _nodes(context):
    scenario = LaunchConfiguration('scenario').perform(context)
    bag = LaunchConfiguration('bag').perform(context)
    nodes = [Node(package='arm_brachy', executable=p.name, name=p.name, output='log',
                  parameters=[str(ros_parameters()), p.parameters])
             for p in cell_processes(load_cell(scenario), scenario, bag)]
    ends = [RegisterEventHandler(OnProcessExit(target_action=n,
                                               on_exit=[EmitEvent(event=Shutdown())]))
            for n in nodes]
    return nodes + ends


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
