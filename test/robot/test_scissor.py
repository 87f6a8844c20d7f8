"""The scissor linkage: closure, kinematics, isotropy, and stiffness against beams."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from arm_brachy.core.errors import InputError
from arm_brachy.experiments import scissor_frame
from arm_brachy.robot import scissor_stiffness
from arm_brachy.robot.scissor_rcm import (
    MEASURES,
    ScissorParams,
    branch,
    clear_range,
    global_conditioning,
    isotropy,
    jacobian,
    joint_angles,
    passive_angles,
    polar_angle,
    rigid_passive_angle,
    tip,
)
from arm_brachy.robot.scissor_stiffness import (
    Section,
    arc_compliance,
    carrier_compliance,
    layout,
    radial_stiffness,
    tip_compliance,
    torsional_spring,
)

PROTOTYPE = ScissorParams()
DESIGNS = [PROTOTYPE, ScissorParams(links=4, beta=np.pi / 8),
           ScissorParams(links=2, beta=np.pi / 4)]
OPENINGS = np.linspace(0.05, 1.5, 12)
STEP = 1e-6


@pytest.mark.parametrize('params', DESIGNS)
def test_every_hinge_stays_on_the_sphere_and_the_branches_meet(params):
    for theta_1 in OPENINGS:
        hinges, _ = layout(params, theta_1)
        assert np.allclose([np.linalg.norm(p) for p in hinges.values()], params.radius,
                           rtol=0, atol=1e-9)
        psi = passive_angles(params, theta_1, np.zeros(params.links))
        assert np.allclose(psi, rigid_passive_angle(params, theta_1), atol=1e-12)


@pytest.mark.parametrize('params', DESIGNS)
def test_the_closed_chain_ends_where_the_formula_puts_the_tip(params):
    for theta_0 in (-0.4, 0.0, 1.1):
        for theta_1 in OPENINGS:
            psi = passive_angles(params, theta_1, np.zeros(params.links))
            ends = [branch(params, theta_0, theta_1, psi, np.zeros(params.links), side)[-1, :3, 3]
                    for side in (1, -1)]
            middle = 0.5 * sum(ends) + [0.0, 0.0, params.radius]
            middle *= params.radius / np.linalg.norm(middle)
            assert np.allclose(middle, tip(params, theta_0, theta_1), atol=1e-9)


def test_bent_links_still_close_though_no_longer_on_the_sphere():
    params = ScissorParams(links=6, beta=np.radians(15))
    gamma = np.array([0.01, 0.02, 0.015, 0.005, 0.01, 0.0])
    psi = passive_angles(params, 0.8, gamma)
    left, right = (branch(params, 0.3, 0.8, psi, gamma, side) for side in (1, -1))
    for stage_end in (5, 9, 13):
        assert np.linalg.norm(left[stage_end, :3, 3] - right[stage_end, :3, 3]) < 1e-9
    centre = np.array([0.0, 0.0, -params.radius])
    assert abs(np.linalg.norm(left[-1, :3, 3] - centre) - params.radius) > 1e-4
    with pytest.raises(InputError, match='does not close'):
        passive_angles(params, 0.8, np.full(6, 1.5))


def test_inverse_kinematics_find_the_direction_again_and_refuse_one_beyond_the_stroke():
    rng = np.random.default_rng(0)
    for _ in range(50):
        u = rng.normal(size=3)
        u[2] = abs(u[2])
        u /= np.linalg.norm(u)
        assert np.allclose(tip(PROTOTYPE, *joint_angles(PROTOTYPE, u)), PROTOTYPE.radius * u,
                           atol=1e-12)
    with pytest.raises(InputError, match='must be at most 90.00 deg'):
        joint_angles(PROTOTYPE, [1.0, 0.0, -0.1])


def test_the_jacobian_is_the_derivative_of_the_tip():
    for theta in ((0.3, 0.2), (-1.0, 0.9), (2.0, 1.4)):
        numeric = [(tip(PROTOTYPE, *(theta + d)) - tip(PROTOTYPE, *(theta - d))) / (2 * STEP)
                   for d in STEP * np.eye(2)]
        assert np.allclose(jacobian(PROTOTYPE, *theta), np.transpose(numeric), atol=1e-9)


def test_the_linkage_is_singular_at_both_ends_of_its_stroke():
    assert isotropy(PROTOTYPE, 1e-7) < 1e-5
    assert isotropy(PROTOTYPE, np.pi / 2 - 1e-7) < 1e-5
    assert max(isotropy(PROTOTYPE, t) for t in OPENINGS) > 0.9


def test_the_conditioning_index_is_the_mean_over_its_measure_and_within_a_tenth_of_0_45():
    def weighted(weight):
        polar = lambda t: polar_angle(PROTOTYPE, t)          # noqa: E731
        slope = lambda t: abs(polar(t + STEP) - polar(t - STEP)) / (2 * STEP)   # noqa: E731
        f = {'joint': lambda t: 1.0, 'polar': slope,
             'area': lambda t: slope(t) * np.sin(polar(t))}[weight]
        over = quad(lambda t: isotropy(PROTOTYPE, t) * f(t), 1e-5, np.pi / 2 - 1e-5, limit=200)[0]
        return over / quad(f, 1e-5, np.pi / 2 - 1e-5, limit=200)[0]

    for measure in MEASURES:
        assert np.isclose(global_conditioning(PROTOTYPE, measure), weighted(measure), rtol=2e-3)
    assert np.isclose(global_conditioning(PROTOTYPE, 'polar'), 0.45, rtol=0.1)
    with pytest.raises(InputError, match='measure'):
        global_conditioning(PROTOTYPE, 'volume')


def test_links_are_clear_within_the_range_and_touch_at_its_ends():
    low, high = clear_range(PROTOTYPE)
    for theta_1, pair in ((low, ('L1', 'R1')), (high, ('L1', 'L2'))):
        hinges, _ = layout(PROTOTYPE, theta_1)
        gap = np.linalg.norm(hinges[pair[0]] - hinges[pair[1]])
        assert np.isclose(gap, PROTOTYPE.thickness, rtol=0.01)
    with pytest.raises(InputError, match='touch at any opening'):
        clear_range(replace(PROTOTYPE, thickness=0.17))


def test_a_thin_arc_bends_in_its_plane_as_14_says_and_stands_on_a_quarter_circle_of_roark():
    """(A.14): bending only. A quarter circle bent across: out-of-plane bending and torsion."""
    thin = replace(PROTOTYPE, width=2e-3, thickness=2e-3)
    section, E = Section.of(thin), thin.E
    G, R = E / (2 * (1 + thin.nu)), thin.radius
    phi = thin.beta
    bending = R**3 / (E * section.in_plane) * 0.5 * (phi - np.sin(phi) * np.cos(phi))
    # the end's radial direction: what (A.14) calls the bending force
    end = np.array([np.cos(phi), 0.0, np.sin(phi)])
    C = arc_compliance(thin, phi)[:3, :3]
    assert np.isclose(end @ C @ end, bending, rtol=2e-3)
    quarter = arc_compliance(thin, np.pi / 2)[1, 1]
    expected = R**3 * (np.pi / 4 / (E * section.across)
                       + (3 * np.pi / 4 - 2) / (G * section.torsion))
    assert np.isclose(quarter, expected, rtol=2e-3)


@pytest.mark.parametrize('params', [*DESIGNS, replace(PROTOTYPE, width=0.01, thickness=0.03)])
def test_stiffness_agrees_with_straight_beams_and_the_beams_converge_to_it(params):
    for theta_1 in (0.2, 0.8, 1.35):
        ours = radial_stiffness(params, theta_1)
        coarse, fine = (abs(scissor_frame.radial_stiffness(params, theta_1, n) / ours - 1.0)
                        for n in (4, 8))
        # chords for arcs: second order in the angle of a beam
        assert fine < 0.25 * (params.beta / 8) ** 2
        assert 3.0 < coarse / fine < 5.0


def test_compliance_is_symmetric_and_positive_and_scales_with_the_modulus():
    C = tip_compliance(PROTOTYPE, 0.7)
    assert np.allclose(C, C.T, rtol=1e-8, atol=1e-16) and np.linalg.eigvalsh(C).min() > 0.0
    softer = tip_compliance(replace(PROTOTYPE, E=PROTOTYPE.E / 3), 0.7)
    assert np.allclose(softer, 3.0 * C, rtol=1e-9, atol=1e-16)


def test_the_torsional_spring_stores_what_the_bent_arc_does():
    """(A.15) corrected: 1/2 F Delta = 1/2 K Gamma^2 with Delta of (A.14), Gamma of (A.16)."""
    phi, R = PROTOTYPE.beta, PROTOTYPE.radius
    deflection = R**3 / (PROTOTYPE.E * Section.of(PROTOTYPE).in_plane) \
        * 0.5 * (phi - np.sin(phi) * np.cos(phi))
    angle = deflection / (R * np.sin(phi) / np.cos(phi / 2))
    assert np.isclose(torsional_spring(PROTOTYPE), deflection / angle**2)


@pytest.mark.parametrize('params', DESIGNS)
@pytest.mark.parametrize('theta_1', [0.2, 0.7, 1.3])
def test_the_carrier_moves_and_turns_as_with_straight_beams(params, theta_1):
    """All six directions; the goal for the radial stiffness is 5 %."""
    ours, theirs = (model.carrier_compliance(params, theta_1)
                    for model in (scissor_stiffness, scissor_frame))
    size = np.sqrt(np.diag(theirs))
    assert np.abs((ours - theirs) / np.outer(size, size)).max() < 1e-3
    assert np.allclose(ours, ours.T, rtol=1e-9) and np.linalg.eigvalsh(ours).min() > 0.0


def test_a_carrier_in_the_last_hinge_moves_as_the_tip_does():
    """With an even number of links a force goes through the hinge itself."""
    params = DESIGNS[1]
    assert np.allclose(carrier_compliance(params, 0.9)[:3, :3], tip_compliance(params, 0.9),
                       rtol=1e-9)
