"""From bags to arrays and from scenarios to predictions, in process and through live nodes."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from arm_brachy import launcher, offline
from arm_brachy.control.move_events import Status
from arm_brachy.core.errors import RecordingError
from arm_brachy.evaluation.timeseries import RunData, Series, TaskWindow
from arm_brachy.recording import encode
from arm_brachy.recording.writer import BagWriter
from arm_brachy.scenario import Task, load_cell
from arm_brachy.tissue.box import box_mesh

FRAME_NS = 10_000_000
A_DATE_NS = 1_767_225_600_003_000_000  # early in 2026, not on a tick
FRAMES = 31
HELD = 10       # frames until the block is let go

BLOCK = """name: block
mesh: {file: block.vtu, unit: m}
fixed: {kind: half_space, point_mm: [0, 0, 0], normal: [-1, 0, 0]}
material: {E_kPa: 60, nu: 0.4}
dynamics: DYNAMICS
gravity_m_s2: [0, 0, GRAVITY]
markers:
- {name: tip, position_mm: [60, 10, 10]}
- {name: clamp, position_mm: [0, 10, 10], body: base}
"""
PADS = """pads:
- {name: press, centre_mm: [60, 10, 10], direction: [-1, 0, 0], radius_mm: 15, stroke_mm: 5}
"""
SCENARIO = 'name: block\nseed: 1\nscene: scene.yaml\ntick_ms: 10\n'


@pytest.fixture
def block(tmp_path):
    """Writes scene and scenario of a 60 mm block; with pads it is pushed, without it rings."""

    def write(*, pads):
        mesh = box_mesh((0.06, 0.02, 0.02), (6, 2, 2))
        meshio.Mesh(mesh.nodes, [('tetra', mesh.tets)]).write(tmp_path / 'block.vtu')
        text = BLOCK.replace('DYNAMICS', 'quasi_static' if pads else 'implicit')
        text = text.replace('GRAVITY', '0' if pads else '-9.81') + (PADS if pads else '')
        (tmp_path / 'scene.yaml').write_text(text)
        release = '' if pads else f'release_s: {(HELD + 0.5) * 0.01}\n'
        (tmp_path / 'scenario.yaml').write_text(SCENARIO + release)
        return load_cell(tmp_path / 'scenario.yaml')

    return write


def push(t):
    """A push to 2 mm within the recording [m]."""
    return 2e-3 * np.sin(np.pi * np.asarray(t) / (FRAMES * 0.01)) ** 2


def write_bag(folder, *, pads, begin_ns=0, namespace=''):
    encoder = encode.Encoder()
    with BagWriter(folder, provenance={'name': 'taken'}) as bag:
        bag.add_topic(f'{namespace}/optical/markers', encode.OPTICAL)
        if pads:
            bag.add_topic(f'{namespace}/actuators/state', encode.JOINT_STATE)
        for k in range(FRAMES):
            t = begin_ns + k * FRAME_NS
            bag.write(f'{namespace}/optical/markers', encoder.optical_frame(
                t, 'world', k, ('tip', 'clamp'), np.array([[0.06, 0.01, 0.01], [0, 0.01, 0.01]])),
                t, sequence=k)
            if pads:
                bag.write(f'{namespace}/actuators/state', encoder.joint_state(
                    t, 'world', ['press'], [float(push(k * FRAME_NS * 1e-9))]), t, sequence=k)
    return folder


def test_ticks_end_with_the_recording(block):
    cell = block(pads=False)
    t = offline.ticks(cell, 0.3)
    assert (t[0], len(t)) == (0.01, 30)
    assert t[-1] == pytest.approx(0.3)
    assert len(offline.ticks(cell, 0.301)) == 31


def test_body_without_pads_stands_until_let_go_then_falls(block):
    predicted = offline.predict(block(pads=False), 0.15)
    tip, clamp = (predicted.points[:, predicted.names.index(n)] for n in ('tip', 'clamp'))
    assert predicted.failed == 0
    assert predicted.force.shape == (15, 0, 3)
    np.testing.assert_array_equal(tip[:HELD], np.tile(tip[0], (HELD, 1)))
    assert (np.diff(tip[HELD - 1:HELD + 3, 2]) < 0.0).all()
    np.testing.assert_array_equal(clamp, np.tile(clamp[0], (15, 1)))
    # At first nothing but gravity acts on the free end: it falls as a free body does.
    fallen = tip[HELD - 1, 2] - tip[HELD, 2]
    assert fallen == pytest.approx(0.5 * 9.81 * 0.01 ** 2, rel=0.1)


def test_prediction_follows_the_encoder(block):
    cell = block(pads=True)
    t = np.arange(FRAMES) * 0.01
    predicted = offline.predict(cell, t[-1], Series(t, push(t)[:, None]))
    peak = push(predicted.t).argmax()
    tip = predicted.points[:, predicted.names.index('tip')]
    # The marker rides on the pushed face; the push is along -x.
    np.testing.assert_allclose(tip[0, 0] - tip[peak, 0], push(predicted.t[peak])
                               - push(predicted.t[0]), rtol=1e-6)
    assert predicted.force[peak, 0, 0] > 0.0    # the tissue pushes back, along +x
    # Uniaxial stiffness E A / L bounds it from below, the fully confined one from above.
    slender = 60e3 * 4e-4 / 0.06 * push(predicted.t[peak])
    confined = slender * (1 - 0.4) / ((1 + 0.4) * (1 - 0.8))
    assert slender < predicted.force[peak, 0, 0] < 1.2 * confined


@pytest.mark.parametrize(('encoder', 'words'), [
    (None, 'no actuators/state'), (Series(np.zeros(2), np.zeros((2, 3))), '3 actuators')])
def test_recording_that_does_not_fit_the_scene_is_refused(block, encoder, words):
    with pytest.raises(RecordingError, match=words):
        offline.predict(block(pads=True), 0.1, encoder)


def test_forces_with_a_dropout_keep_their_times(tmp_path):
    encoder = encode.Encoder()
    with BagWriter(tmp_path / 'bag') as bag:
        for pad in 'ab':
            bag.add_topic(f'/force/{pad}/wrench', encode.WRENCH)
        for k in range(5):
            for pad in 'ab':
                if (pad, k) != ('a', 2):
                    bag.write(f'/force/{pad}/wrench', encoder.wrench(
                        k * FRAME_NS, 'world', [float(k), 0.0, 0.0]), k * FRAME_NS)
    run = offline.load_run(tmp_path / 'bag')
    assert run.force_pads == ('a', 'b')
    np.testing.assert_array_equal(run.force.values[:, 1, 0], np.arange(5.0))
    np.testing.assert_array_equal(run.force.values[:, 0, 0], [0.0, 1.0, np.nan, 3.0, 4.0])


def test_of_what_is_measured_no_truth_is_read(block, tmp_path):
    """A diagnosis reads sensors only: meshes of a long simulated recording stay on the disk."""
    encoder = encode.Encoder()
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/actuators/state', encode.JOINT_STATE)
        bag.add_topic('/force/press/wrench', encode.WRENCH)
        bag.add_topic('/truth/pads', 'arm_brachy_msgs/msg/PadState')
        bag.write('/actuators/state', encoder.joint_state(0, 'world', ['press'], [0.001]), 0)
        bag.write('/force/press/wrench', encoder.wrench(0, 'world', [1.0, 0.0, 0.0]), 0)
        bag.write('/truth/pads', b'no message at all', 0)
    run = offline.load_run(tmp_path / 'bag', measured=True)
    assert (len(run.encoder), run.force_pads, run.pad_displacement) == (1, ('press',), None)
    assert [topic.topic for topic in run.topics] == ['/actuators/state', '/force/press/wrench']


def two_pads(cell):
    """The scene with a second pad, 'another'."""
    second = dataclasses.replace(cell.scene.pads[0], name='another')
    return dataclasses.replace(cell.scene, pads=(*cell.scene.pads, second))


def test_scene_decides_the_order_of_pads(block):
    scene = two_pads(block(pads=True))
    force = Series(np.zeros(1), np.array([[[1.0, 0, 0], [2.0, 0, 0]]]))
    run = offline.with_scene(RunData('x', '', 0, '', '', force=force,
                                     force_pads=('another', 'press')), scene)
    assert run.force_pads == ('press', 'another')
    np.testing.assert_array_equal(run.force.values[0, :, 0], [2.0, 1.0])


def write_encoders(folder, rows):
    """A bag of encoder messages: (names, positions) one frame after another."""
    encoder = encode.Encoder()
    with BagWriter(folder) as bag:
        bag.add_topic('/actuators/state', encode.JOINT_STATE)
        for k, (names, position) in enumerate(rows):
            t = k * FRAME_NS
            bag.write('/actuators/state', encoder.joint_state(t, 'world', names, position), t)
    return folder


def test_encoders_are_read_by_name(block, tmp_path):
    bag = write_encoders(tmp_path / 'bag', [(['another', 'press'], [2.0, 1.0]),
                                            (['press', 'another'], [3.0, 4.0])])
    run = offline.with_scene(offline.load_run(bag), two_pads(block(pads=True)))
    assert run.encoder_pads == ('press', 'another')
    np.testing.assert_array_equal(run.encoder.values, [[1.0, 2.0], [3.0, 4.0]])


def test_encoders_of_other_actuators_are_refused(block, tmp_path):
    bag = write_encoders(tmp_path / 'bag', [(['press', 'third'], [1.0, 2.0])])
    with pytest.raises(RecordingError, match='has actuators press, third; scene block has press,'):
        offline.with_scene(offline.load_run(bag), two_pads(block(pads=True)))
    bag = write_encoders(tmp_path / 'mixed', [(['press'], [1.0]), (['other'], [2.0])])
    with pytest.raises(RecordingError, match='has actuators press, other; scene block has press'):
        offline.with_scene(offline.load_run(bag), block(pads=True).scene)


def test_an_actuator_that_was_not_read_for_once_is_missing_there(tmp_path):
    bag = write_encoders(tmp_path / 'bag', [(['a'], [1.0]), (['a', 'b'], [2.0, 3.0]),
                                            (['b'], [4.0])])
    run = offline.load_run(bag)
    assert run.encoder_pads == ('a', 'b')
    np.testing.assert_array_equal(run.encoder.values, [[1.0, np.nan], [2.0, 3.0], [np.nan, 4.0]])


def test_only_targets_are_kept_of_the_truth(block):
    still = Series(np.zeros(1), np.zeros((1, 3)))
    scene = block(pads=True).scene
    scene = dataclasses.replace(scene, targets=(dataclasses.replace(scene.markers[0],
                                                                    name='tumour'),))
    run = RunData('x', '', 0, '', '', truth={'tip': still, 'clamp': still, 'tumour': still})
    assert list(offline.with_scene(run, scene).truth) == ['tumour']


@pytest.mark.parametrize('loop', ['open', 'closed'])
def test_the_scenario_says_which_loop_was_closed_and_how_many_tasks(block, loop):
    cell = block(pads=True)
    task = Task('a', 'tip', ('x',), (1e-3, 0.0, 0.0), 1.0)
    cell = dataclasses.replace(cell, scenario=dataclasses.replace(
        cell.scenario, control=dataclasses.replace(cell.scenario.control, loop=loop),
        tasks=(task, task)))
    window = TaskWindow('a', 'tip', 0.0, 1.0, np.zeros(3), np.ones(3), np.ones(3, dtype=bool))
    run = offline.with_cell(RunData('x', '', 0, '', '', tasks=(window,)), cell)
    assert run.tasks[0].mode == f'{loop}_loop' and run.tasks_planned == 2


def test_bag_without_a_model_has_no_prediction(tmp_path):
    assert offline.recorded_prediction(write_bag(tmp_path / 'bag', pads=False)) is None


@pytest.mark.ros
@pytest.mark.parametrize(('pads', 'begin_ns', 'namespace'), [
    pytest.param(False, 0, '', marks=pytest.mark.validate),
    pytest.param(True, 0, '', marks=pytest.mark.validate),
    (True, A_DATE_NS, '/left')])
def test_live_nodes_and_in_process_agree_bit_for_bit(block, tmp_path, pads, begin_ns, namespace):
    cell = block(pads=pads)
    recording = write_bag(tmp_path / 'taken', pads=pads, begin_ns=begin_ns, namespace=namespace)
    processes = launcher.replay_processes(cell, cell.path, recording, ('tissue_model',),
                                          tmp_path / 'bag')
    assert launcher.Launcher(processes, 'replayer', tmp_path / 'logs').run()
    live = offline.recorded_prediction(tmp_path / 'bag')
    run = offline.load_run(Path(tmp_path / 'bag'))
    here = offline.predict(cell, run.optical.t[-1], run.encoder)
    assert live.names == here.names
    assert np.ptp(here.points, axis=0).max() > 1e-4     # something happened
    for name in ('t', 'points', 'force'):
        np.testing.assert_array_equal(getattr(live, name), getattr(here, name))
    for name in ('t', 'positions', 'rest', 'tets'):
        np.testing.assert_array_equal(getattr(live.tissue, name), getattr(here.tissue, name))


def test_a_task_is_judged_by_the_goal_that_it_had_in_the_end():
    """A procedure corrects the goal while the pads are on their way; its last word has it."""
    def said(state, x, name='bring_target'):
        def place(x):
            return SimpleNamespace(x=x, y=0.0, z=0.0)
        return SimpleNamespace(state=state, name=name, target='t', start=place(0.0),
                               goal=place(x), axes=(True, True, False))
    tasks = [(1.0, said(Status.ACTIVE, 1e-3)), (5.0, said(Status.DONE, 2e-3)),
             (6.0, said(Status.ACTIVE, 3e-3, 'next')), (7.0, said(Status.FINISHED, 9e-3, ''))]
    one, two = offline._windows(SimpleNamespace(tasks=tasks))
    assert (one.t_start, one.t_end, one.goal[0]) == (1.0, 5.0, 2e-3)
    assert (two.t_end, two.goal[0]) == (7.0, 3e-3)
