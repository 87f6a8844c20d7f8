"""Derivatives of markers and targets with respect to every kind of unknown, by differences."""

import numpy as np
import pytest

from arm_brachy.estimation.forward import Forward
from arm_brachy.estimation.unknowns import PriorParams, hemisphere
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.pad_misplacement import PadMisplacement

Q = np.array([0.004, 0.001])
PRIOR = PriorParams(modulus_modes=8, force_modes=4, load_places=3)


@pytest.fixture(scope='module')
def forward(block):
    return Forward(block.scene, (), block.targets, block.markers, PRIOR, tolerance=1e-11)


@pytest.fixture(scope='module')
def state(forward):
    return forward.solve(forward.rest(), Q)


@pytest.fixture(scope='module')
def response(forward, state):
    return forward.response(state, Q)


def column(forward, response, name):
    return response[:, forward.unknowns.names.index(name)]


@pytest.mark.parametrize('name', ['modulus_0', 'modulus_5', 'bulk', 'fibres_2', 'fibres_11',
                                  'left_travel', 'left_tilt_up', 'right_tilt_side', 'force_3',
                                  'left_face_0', 'right_face_4', 'load_2', 'load_7'])
def test_response_equals_central_differences_of_the_model_with_it(forward, state, response, name):
    k, step, seen = forward.unknowns.names.index(name), 0.01, []
    for sign in (-1.0, 1.0):
        theta = np.zeros(forward.unknowns.count)
        theta[k] = sign * step
        fields, offset, _ = forward.unknowns.applied(theta, Q, state)
        seen.append(forward.points(forward.solve(state, Q, fields, offset)).ravel())
    slope = (seen[1] - seen[0]) / (2.0 * step)
    np.testing.assert_allclose(response[:, k], slope, atol=2e-4 * np.abs(slope).max() + 1e-9)


def points_with(term, forward, block):
    """Markers and targets of the scene's body with a registry term, same mesh."""
    body = term.prepare(build_body(block.scene))
    found = StaticSolver(body).solve(body.mesh.nodes, Q[:, None] * np.array(
        [pad.direction for pad in body.pads]))
    assert found.outcome.ok
    rest = np.vstack([forward.model.rest_markers, forward.model.rest_targets])
    return interpolate(embed(body.mesh, rest), found.x).ravel()


def test_a_slid_pad_moves_the_points_as_the_registry_term_does(forward, state, response, block):
    small = 2e-4
    moved = (points_with(PadMisplacement(side=small, pads=('left',)), forward, block)
             - points_with(PadMisplacement(side=-small, pads=('left',)), forward, block))
    ours = column(forward, response, 'left_side') / PRIOR.offset * 2.0 * small
    assert np.linalg.norm(ours - moved) < 0.15 * np.linalg.norm(moved)


def test_a_base_that_gives_moves_the_points_as_the_registry_term_does(
        forward, state, response, block):
    # Two bases: the term leaves corners of quadratic faces free, ours holds them.
    stiff = 2e8  # Pa/m
    soft, hard = (points_with(BaseCompliance(normal=k, tangential=k), forward, block)
                  for k in (stiff, 2.0 * stiff))
    moved, compliance = soft - hard, 0.5 / stiff
    ours = (column(forward, response, 'base_normal') + column(
        forward, response, 'base_tangential')) / PRIOR.base * compliance
    assert ours @ moved > 0.9 * np.linalg.norm(ours) * np.linalg.norm(moved)
    assert 0.7 < np.linalg.norm(ours) / np.linalg.norm(moved) < 1.3


def test_fibres_are_the_registry_terms(forward, state, response, block):
    a, small = forward.unknowns.directions[2], 0.002
    azimuth, elevation = np.arctan2(a[1], a[0]), np.arcsin(a[2])
    moved = (points_with(Anisotropy(ratio=small, azimuth=azimuth, elevation=elevation), forward,
                         block) - forward.points(state).ravel())
    ours = column(forward, response, 'fibres_2') / PRIOR.fibres * small
    assert np.linalg.norm(ours - moved) < 0.05 * np.linalg.norm(moved)


def test_adjoint_and_tangent_problem_agree(forward, state, response):
    by_nodes = forward.watch.T @ forward.nodal_response(state, Q)
    slid = [k for k, name in enumerate(forward.unknowns.names)
            if name in ('left_up', 'left_side', 'right_up', 'right_side')]  # points shift, too
    keep = np.setdiff1d(np.arange(forward.unknowns.count), slid)
    np.testing.assert_allclose(by_nodes[:, keep], response[:, keep], atol=1e-12)


def test_directions_carry_every_fibre_distribution():
    moments = np.array([np.einsum('i,j,k,l->ijkl', a, a, a, a).ravel() for a in hemisphere()])
    assert np.linalg.matrix_rank(moments) == 15
