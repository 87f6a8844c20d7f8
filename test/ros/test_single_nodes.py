"""`ros2 run` of one node: parameters with unit and range, one-line errors, a quiet end."""

import signal

import pytest
import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.node import Node

pytestmark = pytest.mark.ros


@pytest.fixture
def probe(ros_domain_id):
    """A node of the test's own."""
    rclpy.init()
    node = Node('probe')
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def ask(node, kind, name, request, seconds=30):
    """Call a service once it is there."""
    client = node.create_client(kind, name)
    assert client.wait_for_service(seconds), name
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
    assert future.done(), f'{name} did not answer'
    return future.result()


@pytest.mark.parametrize(('parameters', 'said'), [
    ((), 'parameter scenario is missing'),
    (('scenario:=/nowhere/x.yaml',), '/nowhere/x.yaml: no such file'),
])
def test_bad_start_is_one_line_and_status_2(start_node, parameters, said):
    node = start_node('em_tracker', *parameters)
    assert node.process.wait(90) == 2
    node.finish()
    assert len(node.lines) == 1
    assert said in node.lines[0]


def test_parameters_have_description_unit_and_range(start_node, probe, short_scenario):
    start_node('em_tracker', f'scenario:={short_scenario}', 'pace:=wall', 'rate_Hz:=20.0')
    names = ['rate_Hz', 'position_noise_mm', 'dropout_probability', 'scenario', 'pace']
    answer = ask(probe, DescribeParameters, 'em_tracker/describe_parameters',
                 DescribeParameters.Request(names=names))
    rate, noise, dropout, *_ = answer.descriptors
    assert all(d.description for d in answer.descriptors)
    assert '[Hz]' in rate.description and '[mm]' in noise.description
    assert dropout.floating_point_range[0].from_value == 0.0
    assert dropout.floating_point_range[0].to_value == 1.0
    values = ask(probe, GetParameters, 'em_tracker/get_parameters',
                 GetParameters.Request(names=['rate_Hz', 'pace'])).values
    assert values[0].double_value == 20.0
    assert values[1].string_value == 'wall'
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=10.0)
    result, = ask(probe, SetParameters, 'em_tracker/set_parameters', SetParameters.Request(
        parameters=[Parameter(name='rate_Hz', value=value)])).results
    assert not result.successful and 'read-only' in result.reason


def test_a_value_out_of_range_is_refused(start_node, short_scenario):
    node = start_node('em_tracker', f'scenario:={short_scenario}', 'dropout_probability:=2.0')
    assert node.process.wait(90) == 2
    node.finish()
    assert len(node.lines) == 1
    assert 'dropout_probability' in node.lines[0]


def test_a_node_ends_quietly_on_a_signal(start_node, probe, short_scenario):
    node = start_node('optical_tracker', f'scenario:={short_scenario}', 'pace:=wall')
    ask(probe, GetParameters, 'optical_tracker/get_parameters', GetParameters.Request())
    assert node.process.poll() is None
    assert node.finish(signal.SIGINT) == 0
    assert not any('Traceback' in line for line in node.lines)
