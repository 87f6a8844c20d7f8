"""A cell in a namespace is read as one at the root; two cells in one bag are named."""

import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.reader import BagReader, CellBag
from arm_brachy.recording.writer import BagWriter

EMPTY = 'std_msgs/msg/Empty'
DEFINITION = 'uint8 structure_needs_at_least_one_member'


def bag_of(folder, *topics):
    with BagWriter(folder, attachments={}) as bag:
        for k, topic in enumerate(topics):
            bag.add_topic(topic, EMPTY, definition=DEFINITION, type_hash='')
            bag.write(topic, b'\x00\x01\x00\x00\x00', k + 1)
    return folder


def names(bag):
    with CellBag(bag) as reader:
        return reader.namespace, list(reader.topics()), [r.topic for r in reader.records()]


def test_a_namespace_is_taken_off_and_what_stands_outside_stays(tmp_path):
    bag = bag_of(tmp_path / 'bag', '/left/actuators/state', '/left/cell/task', '/tf')
    assert names(bag) == ('/left', ['/actuators/state', '/cell/task', '/tf'],
                          ['/actuators/state', '/cell/task', '/tf'])
    with CellBag(bag) as reader:
        assert [r.topic for r in reader.records(['/cell/task'])] == ['/cell/task']
        with pytest.raises(RecordingError, match="no topic '/left/cell/task'"):
            list(reader.records(['/left/cell/task']))


def test_a_bag_at_the_root_is_as_it_is(tmp_path):
    bag = bag_of(tmp_path / 'bag', '/actuators/state', '/other/actuators/state')
    with BagReader(bag) as reader:
        assert names(bag)[:2] == ('', list(reader.topics()))


def test_two_cells_are_named(tmp_path):
    bag = bag_of(tmp_path / 'bag', '/left/cell/task', '/right/cell/task')
    with pytest.raises(RecordingError, match='holds 2 cells, /left, /right; record each'):
        CellBag(bag)
