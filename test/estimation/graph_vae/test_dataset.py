"""States for the networks: what moves as it must, the same bytes, begun again where it ended."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from arm_brachy.cli import main
from arm_brachy.core.errors import InputError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.estimation.graph_vae import dataset
from arm_brachy.estimation.graph_vae.loads import LoadOptions, draw_walk
from arm_brachy.estimation.graph_vae.walk import walk_states

SCENES = config_dir() / 'scenes'
SCENE = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast/breast_600.msh')
SHORT = LoadOptions(steps=2, deep=8e-3)


@pytest.fixture(scope='module')
def scene_file(tmp_path_factory):
    file = tmp_path_factory.mktemp('scene') / 'breast.yaml'
    file.write_text((SCENES / 'breast.yaml').read_text().replace(
        'breast/breast_rims.msh', str(SCENES / 'breast/breast_600.msh')))
    return file


@pytest.fixture(scope='module')
def plan(scene_file):
    return dataset.DatasetPlan(str(scene_file), 7, dataset.WALKS + 1, SHORT)


@pytest.fixture(scope='module')
def made(plan, tmp_path_factory):
    folder = tmp_path_factory.mktemp('made')
    for number in dataset.begin(plan, folder):
        dataset.make_shard(plan, folder, number)
    return folder


def test_pads_move_by_their_travel_and_the_rest_is_in_equilibrium():
    walk = draw_walk(SCENE, 7, 0, SHORT)
    u, fraction = walk_states(walk, 2)
    assert fraction.tolist() == [0.5, 1.0]
    for pad, travel in zip(walk.body.pads, walk.travel, strict=True):
        assert np.allclose(u[1][pad.nodes], travel * pad.direction, atol=1e-8)
    assert 5e-3 <= walk.travel.max() <= 8e-3


def test_walks_have_both_kinds_of_contact_all_terms_and_the_thesis_depths():
    walks = [draw_walk(SCENE, 1, k) for k in range(40)]
    kinds = [w.kind for w in walks]
    assert 12 <= kinds.count('own') <= 36
    assert {name for w in walks for name in w.drawn['terms']} == {
        'compressibility', 'stiffness_gradient', 'inclusion', 'anisotropy', 'gravity',
        'base_compliance'}
    depths = np.concatenate([w.drawn['depth_mm'] for w in walks])
    assert depths.min() >= 5.0 and depths.max() <= 30.0 and np.ptp(depths) > 15.0
    moduli = np.array([w.drawn['E_kPa'] for w in walks])
    assert moduli.min() >= 6.0 and moduli.max() <= 60.0


def test_a_modulus_alone_moves_nothing():
    """Why the data set varies more than the thesis' modulus: the body is driven by its pads."""
    walk = draw_walk(SCENE, 7, 0, SHORT)
    body = replace(walk.body, gravity=np.zeros(3), springs=type(walk.body.springs)(
        np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))), fixed=np.arange(20))
    soft, _ = walk_states(replace(walk, body=body), 2)
    hard, _ = walk_states(replace(walk, body=body.with_stiffness(5.0)), 2)
    assert np.abs(soft - hard).max() < 1e-6 < 1e-3 < np.abs(soft).max()


def test_a_walk_too_deep_ends_where_it_does_not_converge():
    walk = draw_walk(SCENE, 7, 0, SHORT)
    u, _ = walk_states(replace(walk, travel=np.full(4, 80e-3)), 8)
    assert len(u) < 8


def test_the_same_bytes_whoever_makes_a_shard_and_after_an_end(plan, made, tmp_path):
    assert dataset.begin(plan, tmp_path) == [0, 1]
    (tmp_path / 'shard_00000.123.part').write_bytes(b'half a shard')  # as kill -9 leaves it
    dataset.make_shard(plan, tmp_path, 1)
    assert dataset.begin(plan, tmp_path) == [0]
    assert (dataset.shard_file(tmp_path, 1).read_bytes()
            == dataset.shard_file(made, 1).read_bytes())


def test_reading_gives_whole_walks_to_each_part(made, plan):
    found = dataset.read(made)
    parts = [set(found.walk[found.part(name)].tolist()) for name in dataset.SPLITS]
    assert set.union(*parts) == set(range(plan.walks))
    assert sum(map(len, parts)) == plan.walks
    assert sum(w['kept'] for w in found.walks) == len(found.u) == len(found.kinds())
    assert found.u.dtype == np.float32 and np.isfinite(found.u).all()


def test_another_seed_or_a_changed_mesh_is_refused(plan, made, scene_file):
    with pytest.raises(InputError, match='seed = 7; must be 8'):
        dataset.begin(replace(plan, seed=8), made)
    with pytest.raises(InputError, match='scene_sha256'):
        dataset.begin(replace(plan, scene_file=str(SCENES / 'breast.yaml')), made)


def test_hash_of_a_scene_does_not_depend_on_where_it_lies():
    assert dataset.scene_hash(SCENE) != dataset.scene_hash(replace(SCENE, name='other'))
    moved = replace(SCENE, mesh=replace(SCENE.mesh, file=SCENE.mesh.file.replace(
        '/breast/', '/breast/../breast/')))
    assert dataset.scene_hash(SCENE) == dataset.scene_hash(moved)


def test_command_makes_a_data_set_and_finds_it_made(scene_file, tmp_path):
    args = ['dataset', str(scene_file), '--states', '12', '--seed', '3', '--jobs', '1',
            '--out', str(tmp_path / 'set'), '--json', str(tmp_path / 'out.json')]
    for _ in range(2):
        assert CliRunner().invoke(main, args).exit_code == 0
    rows = {row['part']: row for row in json.loads((tmp_path / 'out.json').read_text())['rows']}
    assert rows['train']['states'] + rows['left out, not converged']['states'] == 12
    refused = CliRunner().invoke(main, [*args, '--seed', '4'])
    assert refused.exit_code == 2 and 'must be 4 to go on' in refused.output


def test_command_refuses_a_folder_that_is_no_data_set(tmp_path):
    with pytest.raises(InputError, match='no manifest'):
        dataset.read(tmp_path)
