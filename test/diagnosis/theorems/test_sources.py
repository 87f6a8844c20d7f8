"""T5 to T7: what a field of motions says of the forces and the lumps that made it."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.isolation.handover import Occasions
from arm_brachy.diagnosis.selection.candidates import candidates
from arm_brachy.registry import by_name
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.newton import StaticSolver

SAME = 1e-9         # m: ten times what Newton leaves outstanding
CENTRE = (20.0, 10.0, 30.0)
LUMP = {'name': 'inclusion', 'centre_mm': CENTRE, 'radius_mm': 12.0, 'ratio': 5.0}
FIRST, SECOND = ((1, 0, 0, 0), 6e-3, 20e-3), ((0, 1, 0, 0), 6e-3, 20e-3)


def pressure_load(body):
    """Nodal forces (n, 3) [N] of -grad phi, one phi [Pa] an element, none next to the surface."""
    mesh, geometry = body.mesh, body.geometry
    inside = ~np.isin(mesh.tets, np.unique(boundary_faces(mesh))).any(axis=1)
    phi = np.where(inside, 100.0 + 2e3 * mesh.nodes[mesh.tets].mean(axis=1)[:, 0], 0.0)
    centre = int(np.argmin(geometry.weights[0]))    # the point of volume change
    force, share = np.zeros_like(mesh.nodes), phi * geometry.weights.sum(axis=1)
    np.add.at(force, geometry.connectivity, share[:, None, None] * geometry.gradients[:, centre])
    return force


def shift(specimen, force):
    """Largest motion [m] of a node by dead loads (n, 3) with the pads at home."""
    body = replace(specimen.body, nodal_force=force)
    found = StaticSolver(body).solve(body.mesh.nodes, np.zeros((4, 3)))
    assert found.outcome.ok
    return np.abs(found.x - body.mesh.nodes).max()


def test_t5_pressure_bears_a_load_that_is_a_gradient(scene, lab):
    """Its motion goes with 1 / kappa, that of as large forces in another order does not."""
    borne, other = [], []
    for nu in (0.49, 0.499, 0.4999):
        one = lab(replace(scene, element='quadratic',
                          material=replace(scene.material, nu=nu))).specimen
        force = pressure_load(one.body)
        loaded = np.flatnonzero(np.abs(force).sum(axis=1) > 0.0)
        mixed = np.zeros_like(force)
        mixed[loaded] = force[np.random.default_rng(0).permutation(loaded)]
        borne.append(shift(one, force))
        other.append(shift(one, mixed))
    assert borne[1] == pytest.approx(0.1 * borne[0], rel=0.1)
    assert borne[2] == pytest.approx(0.1 * borne[1], rel=0.1)
    assert borne[2] < 1e-3 * other[2] and other[2] > 0.9 * other[0]


def with_load(lab, scene, breast, force):
    """The Lab of the same body under dead loads (n, 3) [N]."""
    one = lab(scene)
    one.specimen = replace(breast.specimen, body=replace(breast.specimen.body,
                                                         nodal_force=force))
    return one


@pytest.fixture(scope='module')
def disturbed(breast, scene, lab, pushes):
    """The Lab of a body under the dead loads that stand in for a lump in its first load case."""
    path, body = pushes(FIRST), breast.specimen.body
    x = breast.run(path, 3.8, LUMP).x[0]
    force = StaticSolver(body).assembler.forces(x, StepFields.of(body))
    force[body.fixed] = 0.0
    for pad in body.pads:
        force[pad.nodes] = 0.0
    return with_load(lab, scene, breast, force)


def test_t6_a_lump_is_a_load_in_one_load_case_and_another_in_the_next(breast, disturbed, pushes):
    path, t = pushes(FIRST, SECOND), [0.0, 3.8, 7.4]
    plain, lump, load = breast.run(path, t), breast.run(path, t, LUMP), disturbed.run(path, t)
    effect = np.abs(lump.optical - plain.optical).max(axis=(1, 2))
    apart = np.abs(lump.optical - load.optical).max(axis=(1, 2))
    assert effect[0] < SAME and effect[1] > 1e-4 and effect[2] > 5e-5
    assert apart[1] < SAME and np.abs(lump.force[1] - load.force[1]).max() < 1e-6
    assert apart[0] > 0.5 * effect[1] and apart[2] > 0.5 * effect[2]


@pytest.mark.parametrize(('legs', 'verdict', 'names'), [
    ((FIRST, FIRST), 'equivalent', {'inclusion', 'load'}),
    ((FIRST, SECOND, FIRST, SECOND), 'named', {'inclusion'})], ids=['one case', 'two cases'])
def test_t6_two_load_cases_split_a_lump_from_a_load(breast, disturbed, pushes, cause, others,
                                                    judge, legs, verdict, names):
    """The load comes and goes with each push, the same in all of them."""
    m = breast.watch(pushes(*legs), LUMP, still=True)
    pushed = (m.recorded.states.q.max(axis=1) > 1e-3).astype(float)
    lump = cause('inclusion', centre=tuple(1e-3 * np.array(CENTRE)), radius=12e-3)
    found = judge([m], [lump, *others], [('load', [disturbed.changed(m, share=pushed)])])
    assert (found.verdict, found.names) == (verdict, names)


def test_t6_a_lump_is_not_named_from_one_load_case(breast, pushes, others, judge):
    m = breast.watch(pushes(FIRST, FIRST), LUMP, still=True)
    places = [one for name in ('inclusion', 'external_force') for one in candidates(
        by_name(name), breast.specimen, Occasions(windows=((2.9, 4.9), (6.5, 8.5))))]
    found = judge([m], [*places, *others])
    assert found.verdict == 'unexplained' and found.decision.unproven.causes == ('inclusion',)


def strength(radius, ratio):
    """Volume times contrast of a sphere in an incompressible matrix, but for 4 pi / 3 [mm^3]."""
    return radius**3 * 5.0 * (ratio - 1.0) / (3.0 + 2.0 * ratio)


def lump(radius, product):
    """Entry of the inclusion of a radius [mm] with a `strength`."""
    g = product / radius**3
    return {**LUMP, 'radius_mm': radius, 'ratio': (5.0 + 3.0 * g) / (5.0 - 2.0 * g)}


def test_t7_lumps_of_one_product_make_fields_of_one_shape(scene, lab, pushes):
    """Within 30 % in size on elements larger than the lumps; radius alone makes 80 %."""
    one, path = lab(replace(scene, element='quadratic')), pushes(FIRST, SECOND)
    plain = one.run(path, [3.8, 7.4])

    def field(entry):
        return (one.run(path, [3.8, 7.4], entry).optical - plain.optical).ravel()

    hard = {**LUMP, 'radius_mm': 10.0, 'ratio': 20.0}
    fields = [field(hard), field(lump(12.0, strength(10.0, 20.0))),
              field({**hard, 'radius_mm': 12.0})]
    size = [np.linalg.norm(f) for f in fields]
    assert fields[0] @ fields[1] > 0.99 * size[0] * size[1]
    assert abs(size[1] / size[0] - 1.0) < 0.3 < 0.6 < size[2] / size[0] - 1.0


def test_t7_radius_and_ratio_come_as_a_class(breast, pushes, cause, others, judge):
    m = breast.watch(pushes(FIRST, SECOND, FIRST, SECOND), LUMP)
    soft = cause('inclusion', centre=tuple(1e-3 * np.array(CENTRE)), radius=12e-3)
    hard = {**LUMP, 'radius_mm': 10.0, 'ratio': 20.0}
    found = judge([m], [soft, *others], [('smaller and harder', [breast.changed(m, hard)])])
    assert found.verdict == 'equivalent' and found.names == {'inclusion', 'smaller and harder'}
