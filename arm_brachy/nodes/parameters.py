"""ROS parameters of the nodes: declared with description, unit and range, read once at start.

All are read-only: setting one of a running node is refused, since nobody would read it.

Each `quantity` of a device's parameter dataclass becomes a ROS parameter under its edge name
(`stroke_mm`), whose default is what the scenario says. So the scenario is the one place where
values live, and `--ros-args -p stroke_mm:=12.0` still changes a single node for a single run.
"""

import dataclasses
from dataclasses import dataclass

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.parameter import Parameter

from arm_brachy import graph
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantities
from arm_brachy.core.session import Session
from arm_brachy.scenario import Cell, load_cell

UNBOUNDED = 1e12  # ROS ranges need both ends
# Says where and among whom a node runs, not what it does: the same run elsewhere has others.
OF_THE_LAUNCHER = ('peers', 'absent', 'session_key', 'output', 'bag', 'speed_limit', 'patience_s')


@dataclass(frozen=True)
class NodeSetup:
    """What every node of the cell is started with.

    cell : the resolved scenario;  lockstep : wait for the clock's ticks
    tick_ns : period [ns];  peers : names of the nodes that take part in this run
    absent : those among them that a replayer speaks for
    frame : frame_id of everything in the base frame of the cell
    session : core.session.Session of the run; None where commands carry no seal
    """

    cell: Cell
    lockstep: bool
    tick_ns: int
    peers: tuple
    absent: tuple
    frame: str
    session: Session | None


def node_setup(node):
    """Declare and read the parameters common to all nodes of the cell.

    Raises ConfigError (one line) if the scenario is missing or wrong.
    """
    node.declare_parameter('scenario', Parameter.Type.STRING, ParameterDescriptor(
        description='path of a scenario file (config/scenarios/*.yaml); required', read_only=True))
    try:
        path = node.get_parameter('scenario').value
    except ParameterUninitializedException:
        raise ConfigError(f'{node.get_name()}: parameter scenario is missing; give '
                          '--ros-args -p scenario:=<file.yaml>') from None
    cell = load_cell(path)
    pace = text(node, 'pace', cell.scenario.pace, 'lockstep (follow the cell clock) or wall')
    if pace not in ('lockstep', 'wall'):
        raise ConfigError(f'{node.get_name()}: pace = {pace!r}; must be lockstep or wall')
    peers = _names(node, 'peers', list(graph.cell_of(cell.scenario, cell.scene.pads)),
                   'nodes that take part; each is waited for')
    absent = _names(node, 'absent', [''], 'those among peers that a replayer speaks for')
    frame = text(node, 'base_frame', 'cell_base', 'frame_id of data in the base frame')
    key = text(node, 'session_key', '', 'file with the key of the session; empty: commands carry '
               'no seal, anyone in the domain may command')
    session = Session.load(key) if key else None
    return NodeSetup(cell, pace == 'lockstep', cell.tick_ns, peers, absent, frame, session)


def _names(node, name, default, description):
    given = _declare(node, name, default, ParameterDescriptor(description=description),
                     'a list of node names')
    names = tuple(n for n in given if n)  # ROS has no empty list of strings on a command line
    allowed = [n.name for n in graph.NODES]
    for unknown in (n for n in names if n not in allowed):
        raise ConfigError(f'{node.get_name()}: {name} = {unknown!r}; must be among '
                          + ', '.join(allowed))
    return names


def text(node, name, default, description):
    """Declare and read a string parameter."""
    return _declare(node, name, default, ParameterDescriptor(description=description), 'text')


def flag(node, name, default, description):
    """Declare and read a parameter that is true or false."""
    return _declare(node, name, default, ParameterDescriptor(description=description),
                    'true or false')


def _declare(node, name, default, descriptor, allowed):
    """Declare, read, and turn ROS's refusal of a value into one line."""
    descriptor.read_only = True
    try:
        value = node.declare_parameter(name, default, descriptor).value
    except (InvalidParameterTypeException, InvalidParameterValueException):
        raise ConfigError(f'{node.get_name()}: parameter {name} was given a value outside what is '
                          f'allowed: {allowed} ({descriptor.description})') from None
    if value != default and name not in OF_THE_LAUNCHER:
        given(node)[name] = value
    return value


def given(node):
    """Parameters of a node that were set to something else than the scenario says: name -> value.

    Without what the launcher sets (places of files, who takes part).
    """
    return node.__dict__.setdefault('_given_parameters', {})


def number(node, name, default, description, low, high):
    """Declare and read a floating-point parameter with its range (edge unit in the name)."""
    span = FloatingPointRange(from_value=float(low), to_value=float(high))
    return _declare(node, name, float(default), ParameterDescriptor(
        description=description, floating_point_range=[span]), f'{low:g} to {high:g}')


def device_parameters(node, params):
    """Declare the scalar quantities of a parameter dataclass; return it with what was set.

    params : frozen dataclass as the scenario has it; optional quantities left out stay out
    """
    changed = {}
    for name, info in quantities(type(params)).items():
        value = getattr(params, name)
        if info.shape or value is None:
            continue
        low = -UNBOUNDED if info.low is None else info.low
        high = UNBOUNDED if info.high is None else info.high
        unit = info.unit or '1'
        given = number(node, info.key(name), info.to_edge(value), f'{info.text} [{unit}]', low,
                       high)
        changed[name] = info.to_si(given)
    return dataclasses.replace(params, **changed)
