"""Points in curved elements: what is read there is the field, wherever the point lies."""
import numpy as np
import pytest

from arm_brachy.prove.generator.body import SOLVERS
from arm_brachy.prove.generator.elements import shapes
from arm_brachy.prove.generator.probe import invert, locate
from arm_brachy.prove.generator.solver import NotSolved

LINEAR = np.array([0.3, -0.2, 0.5])


@pytest.fixture(scope='module')
def grid(body):
    return body.grid(SOLVERS['taylor_hood'])


def on_and_in(body, radius, count):
    ball = np.random.default_rng(0).normal(size=(count, 3))
    ball[:, 2] = np.abs(ball[:, 2])
    return body.dome.place(radius * ball / np.linalg.norm(ball, axis=1, keepdims=True))


@pytest.mark.parametrize('radius', [0.5, 0.9])
def test_a_linear_field_is_read_as_it_is(body, grid, radius):
    points = on_and_in(body, radius, 200)
    read = locate(points, grid.nodes, grid.mesh.tets).read(LINEAR + 0.1 * grid.nodes)
    assert read == pytest.approx(LINEAR + 0.1 * points, abs=1e-6)


def test_an_element_that_does_not_hold_a_point_is_not_at_it_by_shapes_of_another_sum(body, grid):
    corners = grid.nodes[grid.mesh.tets]
    for point in on_and_in(body, 1.0, 20):
        weights = shapes(invert(point, corners))
        there = np.linalg.norm(np.einsum('ka,kai->ki', weights, corners) - point, axis=1) < 1e-6
        assert there.any()
        assert weights[there].sum(axis=1) == pytest.approx(1.0, abs=1e-9)


def test_a_point_outside_of_the_body_is_refused(body, grid):
    with pytest.raises(NotSolved, match='outside'):
        locate(on_and_in(body, 1.05, 1), grid.nodes, grid.mesh.tets)
