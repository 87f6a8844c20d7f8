"""A body without pads through the whole graph: it is let go, seen, recorded and reported."""

import numpy as np
import pytest

from arm_brachy import graph
from arm_brachy.offline import load_run
from arm_brachy.tissue.box import box_mesh

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SCENE = """
name: strip
mesh: {file: strip.npz}
element: linear
fixed: {kind: half_space, point_mm: [0.1, 0, 0], normal: [-1, 0, 0]}
material: {E_kPa: 100, nu: 0.45}
dynamics: implicit
gravity_m_s2: [0, 0, -9.81]
rayleigh_alpha_per_s: 3.0
markers:
- {name: tip, position_mm: [60, 6, 12]}
- {name: floor, position_mm: [-5, 0, 0], body: base}
"""
SCENARIO = """
name: strip
seed: 4
scene: scene.yaml
tick_ms: 10
settle_s: 2.0
release_s: 0.205
"""


@pytest.fixture(scope='module')
def finished(tmp_path_factory, command_runner):
    """Folder of the run, what the command printed."""
    folder = tmp_path_factory.mktemp('released')
    mesh = box_mesh((0.06, 0.012, 0.012), (5, 1, 1))
    np.savez(folder / 'strip.npz', nodes=mesh.nodes, tets=mesh.tets)
    (folder / 'scene.yaml').write_text(SCENE)
    (folder / 'scenario.yaml').write_text(SCENARIO)
    done = command_runner('run', folder / 'scenario.yaml', '--out', folder / 'run')
    assert done.returncode == 0, done.stderr + done.stdout
    return folder / 'run', done.stdout


def test_the_tip_is_held_falls_and_rings(finished):
    run = load_run(finished[0] / 'bag')
    tip = run.truth['tip']
    z = tip.values[:, 2] - tip.values[0, 2]
    held = tip.t <= 0.2
    assert not z[held].any() and z.min() < -1e-3
    assert z[-1] > 1.2 * z.min() and tip.t[-1] == pytest.approx(2.2, abs=0.03)
    assert np.sum(np.diff(np.sign(np.diff(z[~held]))) != 0) > 3
    assert run.encoder is None and run.force is None and not run.outcomes


def test_nobody_waits_for_pads(finished):
    run = load_run(finished[0] / 'bag')
    answered = {t.topic.rsplit('/', 1)[1] for t in run.topics if '/done/' in t.topic}
    assert not answered & {n.name for n in graph.PUSHING}
    assert {'tissue_simulator', 'optical_tracker', 'operator', 'supervisor'} <= answered


def test_table_and_report_are_there(finished):
    folder, printed = finished
    assert 'messages lost' in printed and 'report.html' in printed
    page = (folder / 'report.html').read_text(encoding='utf-8')
    assert 'Distance of the optical markers' in page and 'pads and the way' not in page
