"""The whole graph, once: what it records, nothing lost, the bits of one process."""

import json
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
import zstandard
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from arm_brachy import graph, inprocess
from arm_brachy.offline import load_run, recorded_cell, with_scene
from arm_brachy.recording.reader import BagReader, payload_hashes, stamp_ns
from arm_brachy.scenario import load_cell

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope='module')
def bag(quiet_run):
    return quiet_run[0] / 'bag'


def differences(ours, theirs):
    """Names of the series of two RunData that differ in any bit of time or value."""
    return [name for name, a, b in _pairs(ours, theirs)
            if a.shape != b.shape or a.tobytes() != b.tobytes()]


def _pairs(a, b):
    """Yield (name, array, array) for what both hold."""
    for name in ('encoder', 'command_position', 'pad_displacement', 'force'):
        yield f'{name}.t', getattr(a, name).t, getattr(b, name).t
        yield name, getattr(a, name).values, getattr(b, name).values
    for name, series in b.truth.items():
        yield f'truth.{name}', a.truth[name].values, series.values
    for name, samples in b.em.items():
        yield f'em.{name}.t', a.em[name].t, samples.t
        yield f'em.{name}', a.em[name].position, samples.position
        yield f'em.{name}.status', a.em[name].status, samples.status
    yield 'optical', a.optical.points, b.optical.points
    for i, (mine, other) in enumerate(zip(a.tasks, b.tasks, strict=True)):
        for field in ('t_start', 't_end', 'start', 'goal', 'axes'):
            yield f'task.{i}.{field}', *(np.asarray(getattr(w, field)) for w in (mine, other))


def test_a_run_in_one_process_equals_the_recording_of_the_graph(bag, short_scenario):
    """To the bit."""
    cell = load_cell(short_scenario)
    recorded = with_scene(load_run(bag), cell.scene)
    ours = inprocess.run(cell, sensors=inprocess.SENSORS)
    assert len(recorded.tasks) == 1 and len(recorded.encoder) > 100
    assert differences(ours, recorded) == []
    assert [(o.node, o.outcome, o.count) for o in ours.outcomes] == \
        [(o.node, o.outcome, o.count) for o in recorded.outcomes]


def test_every_published_message_is_recorded(bag):
    run = load_run(bag)
    counted = [t for t in run.topics if t.published is not None]
    assert len(counted) > 15
    assert [(t.topic, len(t.stamps)) for t in counted] == [(t.topic, t.published) for t in counted]


def test_the_clock_ticks_without_gap_and_every_node_answers(bag, short_scenario):
    tick = load_cell(short_scenario).tick_ns
    with BagReader(bag) as reader:
        ticks = np.array([r.log_time_ns for r in reader.records(['/clock'])])
        answered = {n for n in reader.topics() if n.startswith('/cell/done/')}
        counts = {n: sum(1 for _ in reader.records([n])) for n in answered}
    assert np.array_equal(ticks, tick * np.arange(1, len(ticks) + 1))
    wanted = {f'/cell/done/{n}' for n in graph.CELL if n not in ('cell_clock', 'recorder')}
    assert answered == wanted
    assert set(counts.values()) == {len(ticks)}


def test_two_independent_readers_see_the_same_messages(bag):
    file = next(bag.glob('*.mcap'))
    with BagReader(bag) as reader:
        ours = {n: t.count for n, t in reader.topics().items()}
    theirs = {}
    for message in read_ros2_messages(str(file)):
        theirs[message.channel.topic] = theirs.get(message.channel.topic, 0) + 1
    assert theirs == ours
    with AnyReader([bag]) as reader:  # the directory, with metadata.yaml
        seen = {}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            seen[connection.topic] = seen.get(connection.topic, 0) + 1
    assert seen == ours
    with Reader(file) as reader:      # the bare file
        assert {n: t.msgcount for n, t in reader.topics.items()} == ours


def test_the_bag_holds_the_cell_it_was_made_from(bag, short_scenario, tmp_path):
    again, original = recorded_cell(bag, tmp_path), load_cell(short_scenario)
    assert again.scenario.tasks == original.scenario.tasks
    assert again.plant_terms == original.plant_terms
    assert again.plant.material == original.plant.material
    with BagReader(bag) as reader:
        said = reader.metadata()['arm_brachy']
    assert said['seed'] == '7'
    described = subprocess.run(['git', 'describe', '--always', '--dirty'], capture_output=True,
                               text=True, check=False, cwd=short_scenario.parent)
    if described.returncode == 0:
        assert said['commit'].split('-dirty')[0] == described.stdout.strip().split('-dirty')[0]


def test_the_target_reaches_its_goal_and_pads_only_push(bag):
    run = load_run(bag)
    window, = run.tasks
    truth = run.truth['target_1'].between(window.t_start, window.t_end)
    error = np.abs(truth.values[-1] - window.goal)[window.axes]
    assert error.max() < 0.3e-3
    moved = np.abs(truth.values[0] - window.goal)[window.axes]
    assert moved.max() == pytest.approx(2e-3, abs=0.2e-3)
    command = run.command_position.between(window.t_start, window.t_end)
    assert (np.diff(command.values, axis=0) >= -1e-9).all()


def test_controllers_and_sensors_never_hear_the_truth():
    """Only the plant's own devices, recorder and evaluation subscribe to truth/..."""
    allowed = {'actuator_driver', 'tissue_simulator', 'em_tracker', 'optical_tracker',
               'force_sensor', 'recorder', 'needle_driver', 'probe_controller',
               'ultrasound_imager', 'surface_scanner', 'cell_viewer'}
    for node in graph.NODES:
        if any(t.name.startswith('truth/') for t in node.subscribes):
            assert node.name in allowed


def test_the_report_is_written_and_no_process_is_left(quiet_run, still_alive):
    folder, printed = quiet_run
    assert (folder / 'report.html').stat().st_size > 10_000
    assert 'real time' in printed
    assert still_alive(folder) == []


@pytest.mark.validate
def test_load_changes_no_bit_of_what_is_recorded(quiet_run, loaded_run, still_alive):
    quiet, loaded = (payload_hashes(folder / 'bag') for folder, _ in (quiet_run, loaded_run))
    assert quiet == loaded
    assert len(quiet) > 20
    assert still_alive(loaded_run[0]) == []


@pytest.mark.validate
def test_two_cells_at_once_say_what_one_alone_says_each_in_a_bag_of_its_own(quiet_run, two_cells):
    """In one domain, under different namespaces; both are evaluated and reach their goal."""
    alone = payload_hashes(quiet_run[0] / 'bag')
    for name, (folder, printed) in two_cells.items():
        assert f'namespace /{name}' in printed
        found = payload_hashes(folder / 'bag')
        assert found == {f'/{name}{topic}': digest for topic, digest in alone.items()}
        report = json.loads((folder / 'report.json').read_text())
        met = {target['name']: target['met'] for target in report['targets']}
        assert met['tasks done'] and all(met.values()), met


VIEWER = ('/cell/markers', '/truth/markers', '/tf', '/tf_static', '/joint_states',
          '/robot_description')


def test_the_cell_is_drawn_five_times_a_second_in_small_messages(bag):
    with BagReader(bag) as reader:
        for topic in ('/cell/markers', '/truth/markers'):
            drawn = list(reader.records([topic]))
            after_the_first = [r.log_time_ns for r in drawn[1:]]
            assert np.allclose(np.diff(after_the_first), 0.2e9)
            assert max(len(r.data) for r in drawn) < 60_000
        surfaces = [m for _, msg in reader.messages(['/truth/markers']) for m in msg.markers
                    if m.ns == 'true tissue']
    assert len(surfaces) == len(drawn) and len(surfaces[0].colors) == len(surfaces[0].points)
    assert any(a.x != b.x for a, b in zip(surfaces[0].points, surfaces[-1].points, strict=True))


def test_what_viewers_are_given_takes_a_tenth_of_the_bag(bag):
    """As it lies on disk: the drawings repeat themselves, and chunks are compressed."""
    with BagReader(bag) as reader:
        data = b''.join(r.data for r in reader.records(VIEWER))
    packed = len(zstandard.compress(data))
    assert packed < 0.1 * next(bag.glob('*.mcap')).stat().st_size


def test_every_frame_that_data_are_in_is_known_in_time(bag):
    """A viewer looks up a wrench's frame at the wrench's stamp: /tf must have come that far."""
    moved, early = {}, []
    with BagReader(bag) as reader:
        still = {t.child_frame_id for _, msg in reader.messages(['/tf_static'])
                 for t in msg.transforms}
        for record, msg in reader.messages():
            for t in getattr(msg, 'transforms', ()):
                moved.setdefault(t.child_frame_id, []).append(
                    (record.log_time_ns, stamp_ns(t)))
        for record, msg in reader.messages():
            frame = getattr(getattr(msg, 'header', None), 'frame_id', '')
            if frame in ('', 'cell_base') or frame in still:
                continue
            known = [stamp for when, stamp in moved[frame] if when <= record.log_time_ns]
            if max(known) < stamp_ns(msg):
                early.append((record.topic, record.log_time_ns))
    assert {'pad_1', 'pad_2', 'pad_3', 'pad_4', 'em_target_1'} <= set(moved)
    assert still >= {'em_tracker', 'optical_tracker'} and not early


def test_a_force_arrow_begins_at_the_origin_of_its_pads_frame(bag):
    with BagReader(bag) as reader:
        frames = {stamp_ns(t): t.transform.translation for _, msg in reader.messages(['/tf'])
                  for t in msg.transforms if t.child_frame_id == 'pad_1'}
        checked = 0
        for _, msg in reader.messages(['/cell/markers']):
            for arrow in (m for m in msg.markers if m.ns == 'pad forces'):
                where = frames[stamp_ns(arrow)]
                start = arrow.points[0]
                if abs(start.x - where.x) < 0.04 and start.x > 0.03:     # of the four, pad_1's
                    assert np.allclose([start.x, start.y, start.z], [where.x, where.y, where.z],
                                       atol=2e-5)
                    checked += 1
    assert checked > 10


def test_joints_are_those_of_the_robot_model(bag):
    with BagReader(bag) as reader:
        (_, urdf), = reader.messages(['/robot_description'])
        names = {n for _, msg in reader.messages(['/joint_states']) for n in msg.name}
    joints = {j.get('name') for j in ElementTree.fromstring(urdf.data).findall('joint')}
    assert names == joints == {'pad_1', 'pad_2', 'pad_3', 'pad_4'}
