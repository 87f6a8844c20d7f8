"""CDR bytes against the serialiser of ROS itself, and against an independent decoder."""

import math

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from arm_brachy.recording import encode
from arm_brachy.recording.canonical import Canonical

T_NS = 12_345_678_901


def samples():
    """name -> (type, bytes)."""
    e = encode.Encoder()
    return {
        'joint': (encode.JOINT_STATE, e.joint_state(T_NS, 'world', ['a', 'bc'], [0.1, -2e-9])),
        'wrench': (encode.WRENCH, e.wrench(T_NS, 'base', [1.0, -2.0, 3.5])),
        'pose': (encode.POSE, e.pose(T_NS, 'em', [1e-3, 2.0, 3.0], (0.5, 0.5, 0.5, -0.5))),
        'optical': (encode.OPTICAL, e.optical_frame(
            T_NS, 'world', 7, ['m', 'marker'], [[1, 2, 3], [np.nan, 0, 0]])),
        'status': (encode.TOOL_STATUS, e.tool_status(T_NS, 'em', 'tool_1', 9, False, 0.25)),
    }


@pytest.mark.parametrize('name', ['joint', 'wrench', 'pose', 'optical', 'status'])
def test_ros_reads_and_writes_the_same_bytes(name):
    serialization = pytest.importorskip('rclpy.serialization')
    type_name, data = samples()[name]
    package, _, short = type_name.split('/')
    message_type = getattr(pytest.importorskip(f'{package}.msg'), short)
    message = serialization.deserialize_message(data, message_type)
    theirs = bytes(serialization.serialize_message(message))
    assert Canonical(encode.Encoder().definitions).data(theirs, type_name) == data
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == T_NS


def test_fields_survive_an_independent_decoder():
    type_name, data = samples()['optical']
    text = encode.Encoder().definitions[type_name].encode()
    message = DecoderFactory().decoder_for('cdr', Schema(1, text, 'ros2msg', type_name))(data)
    assert (message.frame_number, message.ids, message.visible) == (7, ['m', 'marker'],
                                                                    [True, False])
    assert [message.points[0].x, message.points[0].y, message.points[0].z] == [1.0, 2.0, 3.0]
    assert all(math.isnan(v) for v in (message.points[1].x, message.points[1].y))

