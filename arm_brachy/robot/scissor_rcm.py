"""The spherical scissor linkage: two branches of curved links that hold a tip on a sphere.

All hinge axes meet in the remote centre O. A branch is a chain of N arcs of angle beta at radius
R; left and right branch are mirror images and cross in every second hinge. theta_0 turns the whole
about the axis through the first hinge, theta_1 opens the scissors. With rigid links
    polar angle of the tip from that axis = N atan(tan beta cos theta_1),  azimuth = theta_0.
N counts the arcs of a branch, as (A.22) does: theta_max = N beta. With an odd number the branches
end apart and a carrier between them holds the tip midway, on the plane of symmetry.

Frame B: origin in the first hinge, z away from O, x where the scissors open to at theta_0 = 0.
Source: thesis, appendix A, Tables A.1 and A.2 read as modified (Craig) Denavit-Hartenberg
parameters, the only ones with which their offsets put every hinge at the distance R from O.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantity

RIGHT_ANGLE = np.pi / 2
_NARROWEST, _WIDEST = 1e-3, 1.2   # rad around the rigid passive angle where closure is sought


@dataclass(frozen=True)
class ScissorParams:
    """The linkage; defaults are the prototype's.

    links : arcs of each branch
    """

    links: int = 5
    beta: float = quantity(18.0, 'deg', 'arc of a link', low=1.0, high=60.0,
                           source='prototype, thesis sec. A.7')
    radius: float = quantity(240.0, 'mm', 'of the sphere', low=10.0, high=2000.0,
                             source='prototype, thesis sec. A.7')
    width: float = quantity(30.0, 'mm', "of a link along the sphere's radius", low=1.0,
                            high=200.0, source='1 x 3 cm, thesis sec. A.6')
    thickness: float = quantity(10.0, 'mm', 'of a link along the sphere', low=1.0, high=200.0,
                                source='1 x 3 cm, thesis sec. A.6')
    E: float = quantity(200e6, 'kPa', "Young's modulus", low=1e3, high=1e9,
                        source='200 GPa, thesis sec. A.6, said to be aluminium; it is that of '
                               'steel, aluminium has 70 GPa')
    nu: float = quantity(0.3, '', "Poisson's ratio", low=0.0, high=0.49, source='steel')


def branch(params, theta_0, theta_1, psi, gamma, side=1):
    """Return the frames (n, 4, 4) of a branch, Tables A.1 and A.2, in frame B.

    theta_0, theta_1 : [rad];  psi : (stages,) [rad] passive angles, one for every second arc
    gamma : (links,) [rad] bending of each arc about its first hinge;  side : 1 left, -1 right
    The last frame is that of the branch's end.
    """
    R, beta = params.radius, params.beta
    a, d = R * np.sin(beta), R - R * np.cos(beta)
    T, frames = np.eye(4), []

    def add(theta, alpha, a, d):
        nonlocal T
        T = T @ _modified_dh(theta, alpha, a, d)
        frames.append(T)

    add(theta_0, 0.0, 0.0, 0.0)
    add(-side * theta_1, 0.0, 0.0, 0.0)
    for arc in range(params.links):
        add(beta + gamma[arc], -RIGHT_ANGLE, 0.0, 0.0)
        turn = psi[arc // 2] if arc % 2 == 0 else -2.0 * theta_1
        add(side * turn, RIGHT_ANGLE, a, d)
    return np.array(frames)


def _modified_dh(theta, alpha, a, d):
    """Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d), Craig."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[ct, -st, 0.0, a],
                     [st * ca, ct * ca, -sa, -sa * d],
                     [st * sa, ct * sa, ca, ca * d],
                     [0.0, 0.0, 0.0, 1.0]])


def rigid_passive_angle(params, theta_1):
    """Return psi [rad] of every stage with rigid links: 2 atan(cos beta tan theta_1), (A.4)."""
    return 2.0 * np.arctan2(np.cos(params.beta) * np.sin(theta_1), np.cos(theta_1))


def passive_angles(params, theta_1, gamma):
    """Return psi (stages,) [rad] that close every stage: both branches meet in its end.

    gamma : (links,) [rad], the same in both branches, so that each stage's end has to lie in the
        plane of symmetry. (A.3) holds for gamma = 0 only; here closure is solved for.
    Raises InputError if a stage cannot be closed: bending beyond what links of metal bear.
    """
    psi = np.full((params.links + 1) // 2, rigid_passive_angle(params, theta_1))
    for stage in range(params.links // 2):

        def aside(angle, stage=stage):
            psi[stage] = angle
            return branch(params, 0.0, theta_1, psi, gamma)[2 * (2 * stage + 2) + 1, 1, 3]

        middle, reach = psi[stage], _NARROWEST
        while aside(middle - reach) * aside(middle + reach) > 0.0:
            reach *= 2.0
            if reach > _WIDEST:
                raise InputError(f'scissor linkage: stage {stage + 1} does not close with bending '
                                 f'of {np.degrees(np.abs(gamma).max()):.3g} deg; must be a few '
                                 'degrees at most')
        psi[stage] = brentq(aside, middle - reach, middle + reach, xtol=1e-15, rtol=8.9e-16)
    return psi


def tip(params, theta_0, theta_1):
    """Return the tip (3,) [m] relative to the remote centre O, axes of B; rigid links."""
    polar = polar_angle(params, theta_1)
    return params.radius * np.array([np.sin(polar) * np.cos(theta_0),
                                     np.sin(polar) * np.sin(theta_0), np.cos(polar)])


def polar_angle(params, theta_1):
    """Return the angle [rad] of the tip from the axis of the first hinge."""
    return params.links * np.arctan(np.tan(params.beta) * np.cos(theta_1))


def joint_angles(params, direction):
    """Return (theta_0, theta_1) [rad] that point the tip along a direction (3,) from O.

    Raises InputError for a direction beyond N beta from the first hinge's axis. On that axis
    theta_0 is open; 0 is returned.
    """
    u = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    polar, most = np.arctan2(np.hypot(u[0], u[1]), u[2]), params.links * params.beta
    if polar > most * (1.0 + 1e-12):
        raise InputError(f'scissor linkage: direction {np.degrees(polar):.2f} deg from its axis; '
                         f'must be at most {np.degrees(most):.2f} deg, {params.links} links of '
                         f'{np.degrees(params.beta):.2f} deg')
    cosine = np.tan(min(polar, most) / params.links) / np.tan(params.beta)
    return float(np.arctan2(u[1], u[0])), float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def jacobian(params, theta_0, theta_1):
    """Return d tip / d (theta_0, theta_1), (3, 2) [m/rad], rigid links."""
    polar, t = polar_angle(params, theta_1), np.tan(params.beta)
    slope = -params.links * t * np.sin(theta_1) / (1.0 + (t * np.cos(theta_1))**2)
    s, c = np.sin(polar), np.cos(polar)
    around = np.array([-np.sin(theta_0), np.cos(theta_0), 0.0])
    down = np.array([c * np.cos(theta_0), c * np.sin(theta_0), -s])
    return params.radius * np.column_stack([s * around, slope * down])


def isotropy(params, theta_1):
    """Return least over largest singular value of the Jacobian, 0 to 1; the same for any theta_0.

    It is 0 at both ends of the stroke: closed, the tip lies on the axis of theta_0; stretched,
    theta_1 does not move it. So the linkage is not free of singularities in its workspace.
    """
    values = np.linalg.svd(jacobian(params, 0.0, theta_1), compute_uv=False)
    return values[1] / values[0]


MEASURES = ('joint', 'polar', 'area')


def global_conditioning(params, measure, samples=4000):
    """Return the global conditioning index (A.21): the mean isotropy over the workspace.

    measure : what is uniform: theta_1 ('joint'), the polar angle ('polar') or the area of the
        hemisphere ('area'); theta_0 does not matter. (A.21) leaves it open.
    """
    if measure not in MEASURES:
        raise InputError(f'measure {measure!r}; must be one of {", ".join(MEASURES)}')
    theta_1 = (np.arange(samples) + 0.5) * RIGHT_ANGLE / samples
    values = np.array([isotropy(params, t) for t in theta_1])
    polar = polar_angle(params, theta_1)
    rate = np.abs(np.gradient(polar, theta_1))
    weight = {'joint': np.ones(samples), 'polar': rate, 'area': rate * np.sin(polar)}[measure]
    return float(values @ weight / weight.sum())


def clear_range(params):
    """Return (low, high) of theta_1 [rad] between which no link touches another.

    Closed, successive hinges of one side come as near as links are thick; open, the two sides do.
    Crossing links pass each other in layers, as the prototype's do. Raises InputError if no
    opening is clear.
    """
    R, beta, gap = params.radius, params.beta, params.thickness
    # Side hinge: at half a stage along the plane of symmetry, and this far off it.
    off = np.arcsin(min(1.0, gap / (2.0 * R)))
    low = np.arcsin(min(1.0, np.sin(off) / np.sin(beta)))

    def spacing(theta_1):
        """Distance [m] between neighbouring side hinges, less a thickness."""
        step = 2.0 * np.arctan(np.tan(beta) * np.cos(theta_1))
        aside = np.arcsin(np.sin(beta) * np.sin(theta_1))
        return 2.0 * R * np.cos(aside) * np.sin(0.5 * step) - gap

    if spacing(low) <= 0.0:
        raise InputError(f'scissor linkage: links of {1e3 * gap:g} mm touch at any opening; must '
                         f'be thinner than {2e3 * R * np.tan(beta):.3g} mm')
    return float(low), float(brentq(spacing, low, RIGHT_ANGLE))
