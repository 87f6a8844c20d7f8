"""The layouts in config/viewers/ name topics, fields and frames that the cell publishes."""

import json
import re
from importlib import import_module

import pytest
from ruamel.yaml import YAML

from arm_brachy import graph
from arm_brachy.core.paths import config_dir

VIEWERS = config_dir() / 'viewers'
TOPIC = re.compile(r'/[a-z_]+(?:/[a-z0-9_]+)*')
DRAWN = {'/cell/markers', '/truth/markers', '/robot_description', '/surface/cloud',
         '/ultrasound/image'}


def texts(value):
    """Every string of nested mappings and lists, keys too."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, dict):
        return [t for key, one in value.items() for t in (key, *texts(one))]
    return [t for one in value for t in texts(one)] if isinstance(value, list) else []


def named(value):
    """Message paths and topics: every string that begins as an absolute topic does."""
    return [t for t in texts(value) if t.startswith('/')]


@pytest.fixture(scope='module')
def foxglove():
    return json.loads((VIEWERS / 'foxglove.json').read_text())


@pytest.fixture(scope='module')
def rviz():
    return YAML(typ='safe').load((VIEWERS / 'cell.rviz').read_text())


def row(path):
    """The Topic of the graph that a message path begins with."""
    topic = TOPIC.match(path).group(0)
    found, = [t for t in graph.TOPICS if topic in (t.name, f'/{t.name}')
              or t.matches(topic[1:])]
    return found


@pytest.mark.parametrize('layout', ['foxglove', 'rviz'])
def test_every_topic_is_in_the_graph_and_all_that_is_drawn_is_shown(layout, request):
    paths = named(request.getfixturevalue(layout))
    assert {TOPIC.match(p).group(0) for p in paths} >= DRAWN
    assert all(row(path) for path in paths)


def test_every_field_that_is_plotted_exists(foxglove):
    paths = [p for p in named(foxglove) if '.' in p]
    assert len(paths) > 10
    for path in paths:
        package, kind, name = row(path).type.split('/')
        for field in path[TOPIC.match(path).end():].strip('.').split('.'):
            fields = getattr(import_module(f'{package}.{kind}'), name).get_fields_and_field_types()
            of = fields[re.sub(r'\[\d+\]$', '', field)]
            package, name = of.split('/') if '/' in of else ('', '')
            kind = 'msg'
        assert of == 'double' or of == 'sequence<double>'


def test_every_panel_is_laid_out(foxglove):
    placed = [t for t in texts(foxglove['layout']) if '!' in t]
    assert sorted(placed) == sorted(foxglove['configById'])


def test_rviz_asks_no_more_of_a_topic_than_is_offered(rviz):
    """A subscriber that wants what was said before it came is refused by a volatile publisher."""
    for display in rviz['Visualization Manager']['Displays']:
        asked = display.get('Topic') or display.get('Description Topic')
        if asked is not None:
            latched = row(asked['Value']).latched
            assert (asked['Durability Policy'] == 'Transient Local') == latched
    assert rviz['Visualization Manager']['Global Options']['Fixed Frame'] == 'cell_base'
