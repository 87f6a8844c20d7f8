"""What scales a modulus scales all of the law, stiffening and fibres too: else markers tell."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.tissue.body import Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.compressibility import Compressibility
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.skin_layer import SkinLayer
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale
from arm_brachy.tissue.terms.strain_stiffening import StrainStiffening
from arm_brachy.tissue.terms.stress_softening import StressSoftening
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

L, DEEP = 0.04, [[1e-3, 0.0, -5e-3]]
LAW = (StrainStiffening(1.5), Anisotropy(0.5, 0.3, 0.9))
SCALING = (StiffnessScale(1.7), StiffnessGradient((8.0, -5.0, 12.0)), SkinLayer(2.5, 0.004),
           Inclusion((0.02, 0.02, 0.025), 0.012, 5.0))


def block():
    """Block held below, a pad over the middle of its top."""
    mesh = quadratic_mesh(box_mesh((L, L, L), (3, 3, 3)))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.49)
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - L / 2, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([L / 2, L / 2, L]), 0.01)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def prepared(*terms):
    body = block()
    for term in terms:
        body = term.prepare(body)
    return body


def laws(body):
    """Everything of the law, element by element."""
    return np.column_stack([body.mu, body.kappa, body.stiffening, body.fibres.modulus,
                            body.fibres.direction])


@pytest.mark.parametrize('term', SCALING, ids=lambda term: term.spec.name)
def test_what_scales_moduli_scales_them_alike_in_any_order(term):
    before, first, last = (laws(prepared(*terms)) for terms in (LAW, (term, *LAW), (*LAW, term)))
    scale = last[:, 0] / before[:, 0]
    assert np.ptp(scale) > 0.1 or scale[0] == pytest.approx(1.7)
    np.testing.assert_allclose(last[:, :4], scale[:, None] * before[:, :4], rtol=1e-12)
    np.testing.assert_array_equal(last[:, 4:], before[:, 4:])
    np.testing.assert_allclose(first, last, rtol=1e-12)


def test_the_bulk_modulus_has_no_part_in_it():
    before, after = (laws(prepared(*terms)) for terms in (LAW, (*LAW, Compressibility(0.3))))
    np.testing.assert_allclose(after[:, 1], 0.3 * before[:, 1])
    np.testing.assert_array_equal(np.delete(after, 1, axis=1), np.delete(before, 1, axis=1))


def test_drift_is_unseen_by_markers():
    """Every modulus grows by a half: forces do, positions stay to rounding."""
    body, drift = prepared(*LAW), StiffnessDrift(rate=0.5 / 60.0)
    plain, now = (TissueSimulator(body, terms).step(60.0, DEEP) for terms in ((), (drift,)))
    assert plain.outcome.ok
    np.testing.assert_allclose(now.x, plain.x, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(now.pad_force, 1.5 * plain.pad_force, rtol=1e-9)


def elastic(scale):
    """Elastic solution of the push with everything but the bulk modulus times `scale`."""
    body = prepared(*LAW)
    fields = StepFields.of(body)
    fields.mu *= scale
    fields.beyond[:, :2] *= scale
    return StaticSolver(body).solve(body.mesh.nodes, DEEP, fields)


@pytest.mark.parametrize(('term', 'late', 'early_scale', 'late_scale'), [
    (Viscoelasticity(g1=0.4, tau1=1.0), 1e6, 1.0 / 0.6, 1.0),
    (StressSoftening(damage=0.4, energy=0.1), 1.0, 1.0, 0.6),  # 0.1 J/m^3: at once and all over
], ids=['viscoelasticity', 'stress_softening'])
def test_what_relaxes_or_softens_is_all_but_the_bulk_modulus(term, late, early_scale, late_scale):
    """A push at once and held: from one elastic state to another, whatever the strain."""
    simulator = TissueSimulator(block(), (*LAW, term))
    for t, scale in ((1e-6, early_scale), (late, late_scale)):
        now, then = simulator.step(t, DEEP), elastic(scale)
        np.testing.assert_allclose(now.x, then.x, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(now.pad_force, then.pad_force, rtol=1e-5, atol=1e-6)


def test_were_fibres_left_out_the_markers_would_tell():
    """The test above can fail: the same change of mu alone, at the same bulk modulus."""
    body = prepared(*LAW)
    softer = dataclasses.replace(body, mu=0.6 * body.mu)
    plain, other = (TissueSimulator(b).step(1.0, DEEP) for b in (body, softer))
    assert np.abs(other.x - plain.x).max() > 5e-5
