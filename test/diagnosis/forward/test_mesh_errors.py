"""Companions of a mesh are meshes of the body; their columns hold what another one says."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import with_mesh
from arm_brachy.diagnosis.likelihood.discretisation import EnsembleOptions, ensemble_of
from arm_brachy.diagnosis.likelihood.mesh_ensemble import fitted, ragged, shaken, with_nodes
from arm_brachy.diagnosis.likelihood.mesh_tangents import pushes
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import boundary_faces, volumes
from arm_brachy.tissue.meshing import mean_ratio
from arm_brachy.tissue.newton import StaticSolver

SCENES = config_dir() / 'scenes'
STATES = np.array([2.5, 7.4, 9.0])


@pytest.fixture(scope='module')
def baseline(quadratic, encoder):
    return Baseline(ForwardModel(quadratic), encoder, STATES)


@pytest.fixture(scope='module')
def errors(baseline):
    ensemble = ensemble_of(baseline.model, np.random.default_rng(3),
                           EnsembleOptions(members=4))
    return ensemble.along(baseline)


def test_shaken_meshes_are_as_good_and_hold_the_same(quadratic):
    body = quadratic.body
    moved = with_nodes(body, shaken(body, np.random.default_rng(1)))
    assert mean_ratio(moved.mesh).min() >= min(0.2, mean_ratio(body.mesh).min())
    assert volumes(moved.mesh).sum() == pytest.approx(volumes(body.mesh).sum(), rel=0.01)
    assert np.array_equal(moved.mesh.nodes[body.fixed], body.mesh.nodes[body.fixed])
    inner = np.setdiff1d(body.mesh.tets, boundary_faces(body.mesh))
    assert np.linalg.norm(moved.mesh.nodes - body.mesh.nodes, axis=1)[inner].mean() > 1e-3


def test_flat_faces_and_sharp_edges_stay_where_they_are(quadratic):
    box = box_mesh((0.06, 0.04, 0.04), (4, 3, 3))
    body = replace(quadratic.body, mesh=box, pads=(), fixed=np.zeros(0, dtype=np.int64))
    nodes = box.nodes + shaken(body, np.random.default_rng(1))
    low, high = box.nodes.min(axis=0), box.nodes.max(axis=0)
    for wall in (low, high):
        on = box.nodes == wall
        assert np.abs(nodes - wall)[on].max() < 1e-12
    assert np.abs(nodes - box.nodes).max() > 1e-4


def test_fitted_rims_let_pads_cover_their_discs(quadratic):
    def covered(body):
        faces = boundary_faces(body.mesh)
        out = []
        for pad in body.pads:
            mine = body.mesh.nodes[faces[np.isin(faces, pad.nodes).all(axis=1)]]
            area = np.cross(mine[:, 1] - mine[:, 0], mine[:, 2] - mine[:, 0])
            out.append(-0.5 * (area @ pad.direction).sum() / (np.pi * pad.radius**2))
        return np.array(out)
    before, after = covered(quadratic.body), covered(fitted(quadratic.body))
    assert np.all(after > before) and after.max() < 1.02
    assert before.mean() < 0.6 and after.mean() > 0.75


def test_outlines_change_only_where_edges_cross_the_rim(quadratic):
    body, rng = quadratic.body, np.random.default_rng(2)
    other = ragged(body, rng)
    for old, new in zip(body.pads, other.pads, strict=True):
        corners = np.intersect1d(np.setxor1d(old.nodes, new.nodes), body.mesh.tets)
        assert len(corners) == 1
    named = replace(body, pads=tuple(replace(pad, radius=None) for pad in body.pads))
    assert fitted(named) is None
    assert all(np.array_equal(a.nodes, b.nodes)
               for a, b in zip(named.pads, ragged(named, rng).pads, strict=True))


def test_tangent_is_that_of_small_pushes(quadratic, baseline):
    """Against the adjoint states of the baseline, another way to the same derivative."""
    found, _ = pushes(quadratic.body, quadratic)
    k = len(quadratic.markers)
    rest = Baseline(ForwardModel(quadratic), baseline.encoder, np.array([0.0]))
    for p in range(4):
        expected = rest.pads_moved(0, np.eye(4)[p])
        rides = rest.model.attached.on_pad[:k] @ (np.eye(4)[p][:, None] * quadratic.directions)
        assert np.allclose(found[:k, :, p], expected['optical'] - rides, rtol=0.0, atol=1e-5)
        assert np.allclose(found[-4:, :, p], expected['force'], rtol=0.0,
                           atol=1e-5 * np.abs(expected['force']).max())


def test_curvature_is_the_second_difference_of_full_solves(quadratic):
    body, push = quadratic.body, 5e-4
    _, found = pushes(body, quadratic)
    model = ForwardModel(quadratic)
    states = [0.0, push, -push]
    path = Path(np.arange(3.0), np.outer(states, [0.0, 1.0, 0.0, 0.0]))
    moved = model.trajectory(path, path.t)
    seen = [np.concatenate([model.attached.points(x, np.zeros((4, 3)), np.zeros(3)), force])
            for x, force in zip(moved.x, moved.force, strict=True)]
    expected = (seen[1] + seen[2] - 2.0 * seen[0]) / push**2
    points = slice(None, -4)
    assert np.abs(expected[points]).max() > 10.0
    assert np.allclose(found[points, :, 1], expected[points], rtol=0.0, atol=0.3)
    assert np.allclose(found[-4:, :, 1], expected[-4:], rtol=0.0,
                       atol=0.01 * np.abs(expected[-4:]).max())


def test_columns_follow_the_pads_that_are_pushed(errors, baseline):
    pushes = baseline.path.at(STATES)
    assert pushes[0, 1] == 0.0 and pushes[2, 1] > 0.0
    systematic = {name for name, s in zip(errors.names, errors.systematic, strict=True) if s}
    assert systematic == {'rims', 'elements'}
    only_second = np.abs(errors.values['force'][0]).max(axis=(0, 1)) == 0.0
    assert only_second.any() and np.abs(errors.values['force'][2][..., only_second]).max() > 0.0
    off_tissue = [i for i, body in enumerate(baseline.model.specimen.carriers) if body != 'tissue']
    assert not errors.values['optical'][:, off_tissue].any()


def test_what_finer_elements_change_is_shared_by_the_pads_and_in_part_their_own(errors):
    """Of tangents and curvatures: one column for all pads, then one for each of the four."""
    chosen, own = np.flatnonzero(np.array(errors.names) == 'elements'), EnsembleOptions().apart
    assert len(chosen) == 10
    for together, *single in (chosen[:5], chosen[5:]):
        for values in errors.values.values():
            assert np.allclose(values[..., single].sum(axis=3), own * values[..., together],
                               rtol=1e-9, atol=1e-12)
        assert np.abs(errors.values['force'][..., together]).max() > 1e-3


def test_elements_that_carry_volume_change_at_all_points_are_one_column(errors, baseline,
                                                                         quadratic):
    """To second order in the pushes, 6 to 8 mm: of what full solves say to an eighth."""
    found = [errors.values[kind][..., np.array(errors.names) == 'in_full'].sum(axis=3)
             for kind in ('optical', 'force')]
    ours, plain = (StaticSolver(replace(quadratic.body, in_full=full)) for full in (False, True))
    points = baseline.model.attached.matrix(len(quadratic.body.mesh.nodes))
    for i in range(len(STATES)):
        one, other = (s.solve(baseline.x(i), baseline.pads(i)) for s in (ours, plain))
        moved = (points @ (other.x - one.x))[:found[0].shape[1]]
        for change, column in zip((moved, other.pad_force - one.pad_force), found, strict=True):
            assert np.linalg.norm(column[i] - change) < 0.125 * np.linalg.norm(change)
        assert np.abs(moved).max() > 1e-4


def test_linear_elements_have_no_other_points(linear, encoder):
    model = ForwardModel(linear)
    ensemble = ensemble_of(model, np.random.default_rng(3), EnsembleOptions(members=1))
    assert 'in_full' not in ensemble.names


def test_equal_seeds_give_equal_companions(quadratic):
    one, other = (ragged(quadratic.body, np.random.default_rng(3)) for _ in range(2))
    assert all(np.array_equal(a.nodes, b.nodes) for a, b in zip(one.pads, other.pads, strict=True))
    assert np.array_equal(*(shaken(one, np.random.default_rng(4)) for _ in range(2)))


def test_a_finer_mesh_is_explained_by_what_a_better_one_would_change(errors, baseline,
                                                                     coarse_scene, encoder):
    """Of a body in 2331 elements, not 600: most of what differs in the forces, without physics."""
    scene = coarse_scene()
    finer = with_mesh(scene, SCENES / 'breast' / 'breast_2331.msh')
    there = ForwardModel(specimen_of(finer)).predict(encoder, STATES)
    differ = (there.force - baseline.shown['force']).ravel()
    columns = errors.part(systematic=True)['force'].reshape(len(differ), -1)
    columns = columns[:, np.abs(columns).max(axis=0) > 1e-9]
    left = differ - columns @ np.linalg.lstsq(columns, differ, rcond=1e-9)[0]
    assert np.linalg.norm(left) < 0.4 * np.linalg.norm(differ)
