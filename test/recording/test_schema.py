"""Message definitions and type hashes against what the message packages say of themselves."""

import json
import sys
from pathlib import Path

import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import schema

TYPES = ('std_msgs/msg/Header', 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/PoseStamped',
         'geometry_msgs/msg/WrenchStamped', 'diagnostic_msgs/msg/DiagnosticArray',
         'visualization_msgs/msg/MarkerArray')


@pytest.mark.parametrize('name', TYPES)
def test_hash_is_that_of_the_installed_package(name):
    package, _, short = name.split('/')
    path = Path(sys.prefix, 'share', package, 'msg', f'{short}.json')
    if not path.is_file():
        pytest.skip(f'{path} is not installed')
    listed = json.loads(path.read_text())['type_hashes']
    hashes = {h['type_name']: h['hash_string'] for h in listed}
    assert schema.type_hash(name) == hashes[name]


def test_definition_lists_every_dependency_once():
    text = schema.message_definition('geometry_msgs/msg/PoseStamped')
    blocks = text.split('\n' + '=' * 80 + '\n')
    assert [b.splitlines()[0] for b in blocks[1:]] == [
        'MSG: std_msgs/Header', 'MSG: geometry_msgs/Pose', 'MSG: builtin_interfaces/Time',
        'MSG: geometry_msgs/Point', 'MSG: geometry_msgs/Quaternion']


@pytest.mark.parametrize('name', ['nowhere_msgs/msg/Thing', 'std_msgs/Header', 'Header'])
def test_unknown_type_is_refused(name):
    with pytest.raises(RecordingError, match=name.split('/')[0]):
        schema.message_definition(name)
