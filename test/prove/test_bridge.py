"""Test of prove/bridge.py: another laboratory's body and files become our scene and bag."""

import json

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.experiments.make_scenes import dome_surface
from arm_brachy.prove import bridge

RNG = np.random.default_rng(4)


def body():
    """Half an ellipsoid, 65 mm wide and 55 mm high, with two pads and a target."""
    half = dome_surface()
    return {
        'E_Pa': 8000.0, 'nu': 0.47, 'density_kg_m3': 1000.0, 'gravity_m_s2': [0.0, 0.0, 0.0],
        'surface': {'vertices_m': half.vertices.tolist(), 'triangles': half.faces.tolist()},
        'pads': [{'name': 'pad_1', 'centre_m': [0.058, 0.0, 0.025], 'direction': [-1.0, 0.0, 0.0],
                  'radius_m': 0.012, 'stroke_m': 0.005},
                 {'name': 'pad_2', 'centre_m': [0.0, 0.058, 0.025], 'direction': [0.0, -1.0, 0.0],
                  'radius_m': 0.012, 'stroke_m': 0.005}],
        'markers_m': {'tissue_01': [0.0, 0.0, 0.055], 'on_pad_1': [0.066, 0.0, 0.025],
                      'on_pad_2': [0.0, 0.066, 0.025], 'base_1': [0.08, 0.0, 0.0]},
        'targets_m': {'target_1': [0.0, 0.0, 0.02]}}


def write_csv(folder, given):
    """Two pushes of pad 1, half a second of negative time, one marker lost for a while."""
    t = np.arange(-0.2, 6.0, 0.02)
    q = 4e-3 * np.clip(np.sin(t), 0.0, None)

    def save(stem, head, values):
        text = '\n'.join([','.join(['t_s', *head]), *(
            ','.join([f'{a:.6f}', *('' if np.isnan(v) else f'{v:.7f}' for v in row)])
            for a, row in zip(t, values, strict=True))])
        (folder / f'{stem}.csv').write_text(text + '\n')
    save('encoders', ['q_pad_1_m', 'q_pad_2_m'], np.column_stack([q, 0.0 * q]))
    force = np.zeros((len(t), 6))
    force[:, 0] = 100.0 * q
    save('forces', [f'f_{p}_{a}_N' for p in ('pad_1', 'pad_2') for a in 'xyz'],
         force + 1e-3 * RNG.normal(size=force.shape))
    for stem, points in (('optical', given['markers_m']), ('em', given['targets_m'])):
        rest = np.array(list(points.values())).ravel()
        seen = rest + 1e-5 * RNG.normal(size=(len(t), len(rest)))
        seen[50:60, :3] = np.nan
        save(stem, [f'{name}_{a}_m' for name in points for a in 'xyz'], seen)


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.setattr(bridge, '_file', lambda stem: bridge.CsvFile(f'{stem}.csv', time='t_s'))
    write_csv(tmp_path, body())
    return tmp_path


def test_a_scene_says_what_the_description_says(tmp_path):
    bridge.write_scene(json.loads(json.dumps(body())), 'mesh.msh', tmp_path / 'scene.yaml')
    scene = load_scene(tmp_path / 'scene.yaml')
    assert scene.material.E == pytest.approx(8000.0)
    assert [pad.name for pad in scene.pads] == ['pad_1', 'pad_2']
    assert scene.pads[1].direction == (0.0, -1.0, 0.0)
    assert scene.pads[0].radius == pytest.approx(0.012)
    assert {m.name: m.body for m in scene.markers} == {
        'tissue_01': 'tissue', 'on_pad_1': 'pad_1', 'on_pad_2': 'pad_2', 'base_1': 'base'}
    np.testing.assert_allclose(scene.targets[0].position, [0.0, 0.0, 0.02])


def test_a_bag_carries_what_the_files_hold_on_a_clock_that_starts_after_zero(files):
    bridge.write_bag(body(), files, files / 'bag')
    bridge.write_scene(body(), 'mesh.msh', files / 'scene.yaml')
    evidence, = load_evidence([files / 'bag'], load_scene(files / 'scene.yaml'))
    assert set(evidence.streams) == {'encoder', 'force', 'optical', 'em'}
    assert evidence.get('force').t[0] == pytest.approx(0.3)
    assert evidence.get('encoder').values[:, 0, 0].max() == pytest.approx(4e-3, rel=1e-3)
    push = evidence.get('force').values[:, 0, 0]
    assert push.max() == pytest.approx(0.4, abs=0.01)
    assert not evidence.get('optical').valid[55, 0]


def test_what_is_withheld_is_not_in_the_bag(files):
    bridge.write_bag(body(), files, files / 'bag', withheld=('forces', 'em', 'tissue'))
    bridge.write_scene(body(), 'mesh.msh', files / 'scene.yaml')
    evidence, = load_evidence([files / 'bag'], load_scene(files / 'scene.yaml'))
    assert set(evidence.streams) == {'encoder', 'optical'}
    assert set(evidence.get('optical').names) == {'on_pad_1', 'on_pad_2', 'base_1'}


@pytest.mark.slow
def test_the_mesh_of_a_body_is_of_the_size_asked_for(tmp_path):
    given = body()
    count = bridge.mesh_body(given, tmp_path / 'mesh.msh')
    assert 0.7 * bridge.FEWEST < count < 1.4 * bridge.MOST
