"""The table of nodes: whoever listens has a speaker to wait for, and nobody waits in a circle."""

import re
from types import SimpleNamespace

import pytest

from arm_brachy import graph

NAMES = [n.name for n in graph.NODES]
COMPARED = {'tissue_model', 'mismatch_monitor'}
PROBING_ARM = {'needle_driver', 'probe_controller', 'ultrasound_imager', 'surface_scanner'}
ESTIMATING = {'kf_admm_estimator', 'graph_vae_estimator', 'map_estimator', 'pod_estimator'}
each_node = pytest.mark.parametrize('node', graph.NODES, ids=NAMES)


def test_names_are_unique():
    assert len(set(NAMES)) == len(NAMES)
    topics = [t.name for t in graph.TOPICS]
    assert len(set(topics)) == len(topics)


@each_node
def test_a_node_waits_for_every_writer_of_what_it_hears(node):
    """Else it would take its count from a node whose answers it does not receive."""
    waited_for = {*node.same, *node.previous}
    for topic in node.subscribes:
        writers = set(graph.writers(topic.name, NAMES)) - {node.name, graph.CELL_CLOCK.name}
        if topic is not graph.CLOCK and node is not graph.CELL_CLOCK:
            assert writers <= waited_for, topic.name


@each_node
def test_what_a_node_hears_is_said_by_somebody(node):
    for topic in node.subscribes:
        assert set(graph.writers(topic.name, NAMES)) - {node.name}, topic.name


@each_node
def test_a_node_waits_for_others_that_exist_and_in_one_way_only(node):
    assert {*node.same, *node.previous} <= set(NAMES) - {node.name}
    assert not set(node.same) & set(node.previous)
    assert len(set(node.same)) == len(node.same)
    assert len(set(node.previous)) == len(node.previous)


@each_node
def test_one_delay_per_topic(node):
    """A topic's writers are all in `same` or all in `previous`: its count is of one tick."""
    for topic in node.subscribes:
        writers = set(graph.writers(topic.name, NAMES)) & {*node.same, *node.previous}
        if node is not graph.RECORDER:
            assert writers <= set(node.same) or writers <= set(node.previous), topic.name


def test_nobody_waits_in_a_circle_within_a_tick():
    waits = {n.name: set(n.same) for n in graph.NODES}
    while ready := {name for name, others in waits.items() if not others}:
        waits = {name: others - ready for name, others in waits.items() if name not in ready}
    assert not waits, f'on or behind a circle: {sorted(waits)}'


def test_every_topic_is_in_the_list_and_has_a_writer():
    said = {t.name for n in graph.NODES for t in n.publishes}
    assert said | {graph.TICK_DONE.name} == {t.name for t in graph.TOPICS}


def test_truth_reaches_devices_and_recorder_only():
    """No estimator, controller or operator may know what a real cell could not tell it."""
    allowed = {graph.ACTUATOR_DRIVER, graph.TISSUE_SIMULATOR, graph.EM_TRACKER,
               graph.OPTICAL_TRACKER, graph.FORCE_SENSOR, graph.RECORDER, graph.CELL_VIEWER,
               *graph.PROBE_NODES}
    listeners = {n for n in graph.NODES if any(t.name.startswith('truth/') for t in n.subscribes)}
    assert listeners <= allowed
    writers = {n for n in graph.NODES if any(t.name.startswith('truth/') for t in n.publishes)}
    assert writers == {graph.ACTUATOR_DRIVER, graph.TISSUE_SIMULATOR, graph.NEEDLE_DRIVER,
                       graph.PROBE_CONTROLLER, graph.CELL_VIEWER}


def test_nobody_hears_the_viewer_but_the_recorder():
    """It reads the truth: what it says must come back to no node, not even as a wait."""
    shared = {graph.TF, graph.OUTCOME, graph.DIAGNOSTICS}
    for topic in set(graph.CELL_VIEWER.publishes) - shared:
        assert graph.writers(topic.name, NAMES) == ('cell_viewer',)
    for topic in graph.CELL_VIEWER.publishes:
        assert graph.readers(topic.name, NAMES) == ('recorder',), topic.name
    assert graph.waiters('cell_viewer', NAMES) == ('cell_clock', 'recorder')
    assert not graph.CELL_VIEWER.services


def test_what_is_drawn_of_the_truth_is_concealed_with_it():
    assert graph.TRUTH_MARKERS.name.startswith('truth/')


def test_a_scenario_can_leave_the_viewer_out():
    off = scenario_of(tasks=(1,), viewer=SimpleNamespace(on=False))
    assert set(graph.cell_of(TASKED)) - set(graph.cell_of(off)) == {'cell_viewer'}


def test_the_recorder_waits_for_everybody_who_speaks():
    assert set(graph.RECORDER.same) == set(NAMES) - {'recorder', 'cell_clock'}


def test_a_template_matches_its_instances_and_nothing_else():
    pose = graph.EM_POSE
    assert pose.at(tool='target_1').name == 'em/target_1/pose'
    assert pose.matches('em/target_1/pose') and pose.matches(pose.name)
    assert not pose.matches('em/a/b/pose') and not pose.matches('em/target_1/status')
    assert not pose.matches('xem/target_1/pose')
    assert graph.writers('em/target_1/pose', NAMES) == ('em_tracker',)


def test_an_instance_keeps_what_its_topic_asks_for():
    one, topic = graph.WRENCH.at(pad='pad_1'), graph.WRENCH
    assert (one.type, one.text, one.depth, one.reliable, one.latched) \
        == (topic.type, topic.text, topic.depth, topic.reliable, topic.latched)


def test_instances_fill_in_every_tool_and_pad():
    names = [t.name for t in graph.instances(('a', 'b'), ('p',), ('t', 'u', 'v'))]
    assert not [n for n in names if '{' in n]
    more = 2 + 2 * len(graph.ESTIMATORS)    # a second tool's pose and status, two targets each
    assert len(set(names)) == len(names) == len(graph.RECORDER.subscribes) + more
    assert {'em/a/pose', 'em/b/pose', 'em/a/status', 'em/b/status', 'force/p/wrench',
            'estimate/map/u'} <= set(names)


def test_a_cell_without_tools_and_pads_has_none_of_their_topics():
    assert not [t for t in graph.instances((), ()) if t.name.startswith(('em/', 'force/'))]


def test_readers_and_waiters_are_among_the_peers_that_take_part():
    assert graph.readers('actuators/command', NAMES) == ('actuator_driver', 'recorder')
    assert graph.readers('actuators/command', ['recorder']) == ('recorder',)
    assert graph.waiters('supervisor', ['em_tracker', 'actuator_driver', 'cell_clock']) \
        == ('cell_clock', 'actuator_driver')


def test_an_unknown_node_is_a_bug():
    with pytest.raises(KeyError):
        graph.node('tissue')
    assert graph.node('recorder') is graph.RECORDER


def scenario_of(**given):
    return SimpleNamespace(**({'moves': (), 'tasks': (), 'feedback': 'em', 'estimators': (),
                               'procedure': None, 'viewer': SimpleNamespace(on=True)}
                              | given))


PROBING, TASKED = scenario_of(moves=(1,)), scenario_of(tasks=(1,))
MARKED = scenario_of(tasks=(1,), feedback='map', estimators=('pod', 'map'))


def test_a_full_run_leaves_out_what_only_a_replay_runs_and_what_the_other_kind_needs():
    assert set(NAMES) - set(graph.cell_of(TASKED)) == {*COMPARED, *ESTIMATING, *PROBING_ARM,
                                                       'push_protocol'}
    assert set(NAMES) - set(graph.cell_of(PROBING)) == {*COMPARED, *ESTIMATING, *PROBING_ARM,
                                                        'mpc_manipulator', 'operator'}
    assert graph.cell_of(scenario_of()) == graph.CELL


@pytest.mark.parametrize('scenario', [PROBING, TASKED])
def test_without_pads_nobody_pushes_and_nobody_feels(scenario):
    left_out = set(graph.cell_of(scenario)) - set(graph.cell_of(scenario, ()))
    assert left_out <= {'actuator_driver', 'force_sensor', 'mpc_manipulator'}
    assert not graph.writers('actuators/command', set(graph.cell_of(scenario, ())) - {
        'push_protocol'})


def test_a_cell_that_hears_an_estimator_has_no_sensor_in_the_tissue():
    names = graph.cell_of(MARKED)
    assert set(graph.CELL) - set(names) == {'em_tracker'}
    assert set(names) - set(graph.CELL) == {'map_estimator', 'pod_estimator'}
    assert 'mpc_manipulator' in graph.readers('estimate/map/target_1', names)


def test_a_procedure_takes_needle_arm_image_and_scanner():
    plain = graph.cell_of(scenario_of(feedback='map'))
    names = graph.cell_of(scenario_of(feedback='map', procedure=object()))
    assert set(names) - set(plain) == PROBING_ARM and set(plain) <= set(names)
    assert graph.writers('needle/command', names) == ('operator',)


def test_estimators_run_beside_prescribed_moves_and_em_feedback():
    beside = {'estimators': ('pod',), 'feedback': 'em'}
    for scenario, plain in ((scenario_of(tasks=(1,), **beside), graph.CELL),
                            (scenario_of(moves=(1,), **beside), graph.PROBING_CELL)):
        assert set(graph.cell_of(scenario)) == {*plain, 'pod_estimator'}


def test_estimators_hear_markers_encoders_and_what_instruments_measure_and_no_truth():
    for name in ESTIMATING:
        heard = {t.name for t in graph.node(name).subscribes}
        assert heard == {'optical/markers', 'actuators/state', 'probe/state', 'probe/pose',
                         'probe/wrench', 'needle/tip', 'needle/state'}


@pytest.mark.parametrize('scenario', [PROBING, TASKED, MARKED])
def test_of_a_full_run_one_node_commands_and_one_tells_what_is_under_way(scenario):
    names = graph.cell_of(scenario)
    assert graph.writers('cell/task', names) == (graph.conductor_of(scenario).name,)
    assert len(graph.writers('actuators/command', names)) == 1


def test_the_table_has_a_row_for_every_node_and_names_every_topic():
    lines = graph.documentation_table().splitlines()
    cells = [re.split(r'(?<!\\)\|', line) for line in lines]
    assert len({len(row) for row in cells}) == 1
    assert [row[1].strip() for row in cells[2:]] == NAMES
    unmentioned = {t.name for t in graph.TOPICS} - set(re.findall(r'`([^`]+)`', '\n'.join(lines)))
    assert unmentioned == {graph.TICK_DONE.name, graph.OUTCOME.name, graph.DIAGNOSTICS.name}


def test_topics_of_a_procedure_are_nobodys_without_its_nodes():
    for topic in graph.PROBE_TOPICS:
        assert graph.writers(topic.name, NAMES) and not graph.writers(topic.name, graph.CELL)
    assert not {t.name for t in graph.received(graph.SUPERVISOR, graph.CELL)} & {
        t.name for t in graph.PROBE_TOPICS}
