"""The live comparison on a replayed recording: silent while sound, then names the marker."""

import meshio
import numpy as np
import pytest

from arm_brachy import launcher, offline
from arm_brachy.evaluation.timeseries import Series
from arm_brachy.recording import encode
from arm_brachy.recording.reader import BagReader
from arm_brachy.recording.writer import BagWriter
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.box import box_mesh

pytestmark = [pytest.mark.ros]

PERIOD, SECONDS, FAULT = 0.02, 7.0, 4.0     # s
MARKERS = ('tip', 'side', 'clamp')
NOISE, STEP = 0.05e-3, 1e-3                 # m, rms length of the noise

SCENE = """name: block
mesh: {file: block.vtu, unit: m}
fixed: {kind: half_space, point_mm: [0, 0, 0], normal: [-1, 0, 0]}
material: {E_kPa: 60, nu: 0.4}
pads:
- {name: press, centre_mm: [60, 10, 10], direction: [-1, 0, 0], radius_mm: 15, stroke_mm: 5}
markers:
- {name: tip, position_mm: [60, 10, 10]}
- {name: side, position_mm: [30, 20, 10]}
- {name: clamp, position_mm: [0, 10, 10], body: base}
"""
SCENARIO = f"""name: block
seed: 1
scene: scene.yaml
tick_ms: 20
optical: {{rate_Hz: 50, noise_mm: {1e3 * NOISE}}}
"""


@pytest.fixture
def block(tmp_path):
    """The resolved scenario of a 60 mm block that is pushed at its end."""
    mesh = box_mesh((0.06, 0.02, 0.02), (6, 2, 2))
    meshio.Mesh(mesh.nodes, [('tetra', mesh.tets)]).write(tmp_path / 'block.vtu')
    (tmp_path / 'scene.yaml').write_text(SCENE)
    (tmp_path / 'scenario.yaml').write_text(SCENARIO)
    return load_cell(tmp_path / 'scenario.yaml')


def record(cell, folder):
    """A bag in which the body does as the model, but `side` shifts by STEP along y."""
    t = PERIOD * np.arange(round(SECONDS / PERIOD))
    q = np.interp(t, [2.5, 3.5], [0.0, 2e-3])[:, None]
    model = offline.predict(cell, t[-1], Series(t, q))
    rng, encoder = np.random.default_rng(3), encode.Encoder()
    order = [model.names.index(name) for name in MARKERS]
    with BagWriter(folder, provenance={'name': 'block'}) as bag:
        bag.add_topic('/optical/markers', encode.OPTICAL)
        bag.add_topic('/actuators/state', encode.JOINT_STATE)
        for k, now in enumerate(t):
            ns = round(now * 1e9)
            points = model.points[np.abs(model.t - now).argmin()][order]
            points = points + NOISE / np.sqrt(3.0) * rng.normal(size=points.shape)
            points[1, 1] += STEP * (now >= FAULT)
            bag.write('/actuators/state', encoder.joint_state(ns, 'world', ['press'], [q[k, 0]]),
                      ns, sequence=k)
            bag.write('/optical/markers', encoder.optical_frame(ns, 'world', k, MARKERS, points),
                      ns, sequence=k)
    return folder


def test_a_marker_that_departs_is_named_and_nothing_before_it(block, tmp_path):
    """The push between 2.5 and 3.5 s raises nothing, the shift of one marker at 4 s does."""
    recording = record(block, tmp_path / 'taken')
    processes = launcher.replay_processes(block, block.path, recording,
                                          ('tissue_model', 'mismatch_monitor'), tmp_path / 'bag')
    assert launcher.Launcher(processes, 'replayer', tmp_path / 'logs').run()
    said, health = outcomes(tmp_path / 'bag')
    assert [one.outcome for one in said] == ['DEPARTED']
    assert FAULT < stamp(said[0]) < FAULT + 1.0
    assert said[0].advice.startswith('optical side is off its prediction by 1 mm along y since 4')
    assert [one.level for one in health[:4]] == [0, 0, 0, 0]
    assert health[-1].level == 1 and health[-1].message == said[0].advice
    assert {'departure 1': said[0].advice, 'departures so far': '1'} == {
        one.key: one.value for one in health[-1].values}


def stamp(msg):
    return msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec


def outcomes(bag):
    """(StepOutcomes, statuses) of the monitor in a bag."""
    said, health = [], []
    with BagReader(bag) as reader:
        for record, msg in reader.messages(['/cell/outcome', '/diagnostics']):
            if record.topic == '/cell/outcome' and msg.source == 'mismatch_monitor':
                said.append(msg)
            elif record.topic == '/diagnostics' and msg.status[0].name.endswith('monitor'):
                health.append(msg.status[0])
    return said, health
