"""Stiffness of the scissor linkage under a force on its tip: links that bend, shear and twist.

Virtual joint method: an arc is rigid, with a spring of six degrees of freedom at its far end whose
compliance is that of the curved beam,
    C = int W(s)^T D W(s) ds,   W(s) the internal forces at s of unit loads at the end,
    D = diag(1/GA', 1/GA', 1/EA; 1/EI_n, 1/EI_r, 1/GJ)   (shear, shear, normal; bending, bending,
    torsion; axes radial, normal to the arc's plane, along the arc)
(Castigliano). Arcs are joined as they are in the linkage: a link goes through a crossing, hinges
turn freely about their axis through O, the first hinge is held by locked actuators. Linear, at an
unloaded pose.
`thesis_stiffness` is the reduced form of appendix A: bending in the arc's plane only, one
torsional spring a link, two independent chains.
Source: Pashkevich, Klimchik, Chablat 2011, Mech Mach Theory 46:662 (virtual joints of six degrees
of freedom); Timoshenko, Strength of Materials I, ch. 12 (curved bars; thin: R over height is 8).
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.robot.scissor_rcm import branch, rigid_passive_angle, tip

_QUADRATURE = 12     # Gauss points along an arc: exact to rounding for products of sines
_SHEAR = 5.0 / 6.0   # of a rectangle, Timoshenko
BASE = 'C0'
CARRIER = 7           # motions of the carrier: three moves, three turns, one free within it


@dataclass(frozen=True)
class Arc:
    """One arc between two hinges; `body` names the link it is part of.

    start, end : names of hinges;  R : (3, 3) columns radial, normal, tangent at its start
    """

    start: str
    end: str
    body: str
    R: np.ndarray


def layout(params, theta_1):
    """Return (hinges: name -> (3,) [m] from O, arcs) of the open linkage at theta_0 = 0.

    C0, C1, ... lie in the plane of symmetry, L1, R1, ... on either side.
    """
    hinges, arcs = {}, []
    psi = np.full((params.links + 1) // 2, rigid_passive_angle(params, theta_1))
    centre = np.array([0.0, 0.0, params.radius])
    for name, side in (('L', 1), ('R', -1)):
        frames = branch(params, 0.0, theta_1, psi, np.zeros(params.links), side)
        points = [centre] + [frames[2 * k + 3][:3, 3] + centre for k in range(params.links)]
        labels = [_hinge(name, k) for k in range(params.links + 1)]
        hinges.update(zip(labels, points, strict=True))
        for k in range(params.links):
            arcs.append(Arc(labels[k], labels[k + 1], _body(name, k),
                            _triad(points[k], points[k + 1])))
    return hinges, arcs


def _hinge(side, k):
    return f'C{k // 2}' if k % 2 == 0 else f'{side}{k // 2 + 1}'


def _body(side, k):
    """Arc k and the next one of the other branch are one link, for k odd: it crosses."""
    other = {'L': 'R', 'R': 'L'}[side]
    return f'{side}{k}' if k % 2 or k == 0 else f'{other}{k - 1}'


def _triad(a, b):
    """Right-handed, so that turns keep their sign."""
    radial = a / np.linalg.norm(a)
    normal = np.cross(b, a)
    normal /= np.linalg.norm(normal)
    return np.column_stack([radial, normal, np.cross(radial, normal)])


@dataclass(frozen=True)
class Section:
    """Rectangular section of a link: A [m2], I_n (bending in the arc's plane), I_r, J [m4]."""

    area: float
    in_plane: float
    across: float
    torsion: float

    @classmethod
    def of(cls, params):
        """The section of ScissorParams; torsion constant by Roark, Table 10.1, 4 %."""
        h, b = params.width, params.thickness
        long, short = max(h, b), min(h, b)
        J = long * short**3 * (1.0 / 3.0 - 0.21 * short / long
                               * (1.0 - short**4 / (12.0 * long**4)))
        return cls(h * b, b * h**3 / 12.0, h * b**3 / 12.0, J)


def arc_compliance(params, angle):
    """Return C (6, 6): end displacement and rotation of a clamped arc per end force and moment.

    Axes radial, normal, tangent at the START of the arc; angle : [rad] of the arc
    """
    section, G = Section.of(params), params.E / (2.0 * (1.0 + params.nu))
    D = np.diag([1.0 / (G * _SHEAR * section.area)] * 2 + [1.0 / (params.E * section.area)]
                + [1.0 / (params.E * section.across), 1.0 / (params.E * section.in_plane),
                   1.0 / (G * section.torsion)])
    end = params.radius * np.array([np.cos(angle), 0.0, np.sin(angle)])
    x, w = np.polynomial.legendre.leggauss(_QUADRATURE)
    C = np.zeros((6, 6))
    for phi, weight in zip(0.5 * angle * (x + 1.0), 0.5 * angle * w, strict=True):
        turn = np.array([[np.cos(phi), 0.0, -np.sin(phi)], [0.0, 1.0, 0.0],
                         [np.sin(phi), 0.0, np.cos(phi)]])      # columns: local axes at phi
        W = np.zeros((6, 6))
        W[:3, :3] = W[3:, 3:] = turn.T
        W[3:, :3] = turn.T @ _cross(end - params.radius * turn[:, 0])
        C += weight * params.radius * W.T @ D @ W
    return C


def tip_compliance(params, theta_1):
    """Return (3, 3) [m/N] of the tip at theta_0 = 0, axes of frame B, actuators locked.

    With an odd number of links the carrier shares the force between both ends and stands midway.
    """
    hinges, arcs = layout(params, theta_1)
    K, index = _assembled(params, hinges, arcs)
    ends = _ends(arcs)
    load = np.zeros((len(K), 3))
    for end in ends:
        load[index[end]:index[end] + 3] = np.eye(3) / len(ends)
    return load.T @ np.linalg.solve(K, load)


def carrier_compliance(params, theta_1):
    """Return C (6, 6): move [m] and turn [rad] of a carrier at the tip per force and moment on it.

    Axes of frame B at theta_0 = 0, about the tip; actuators locked. The carrier's two hinges stand
    square on it. With an odd number of links they slide on it, by equal ways to either side of
    the plane of symmetry (a rack and pinion); with an even number both are one, and the carrier
    halves the angle between the two links there (a pair of gears). Both are assumed: the thesis
    does not say what holds its end effector in its orientation.
    """
    hinges, arcs = layout(params, theta_1)
    K, index = _assembled(params, hinges, arcs)
    followers = _carried(hinges, arcs, index, tip(params, 0.0, theta_1))
    own = [i for i in range(len(K)) if i not in followers]
    T = np.zeros((len(K), len(own) + CARRIER))
    T[own, np.arange(len(own))] = 1.0
    for i, row in followers.items():
        T[i, -CARRIER:] = row
    load = np.zeros((T.shape[1], 6))
    load[len(own):len(own) + 6] = np.eye(6)
    return load.T @ np.linalg.solve(T.T @ K @ T, load)


def _carried(hinges, arcs, index, at):
    """Which degrees of freedom follow the carrier, and how: number -> row (7,).

    at : (3,) the carrier's origin. Columns: its move, its turn, and what is free in it.
    """
    rows = {}
    for end in _ends(arcs):
        point, first = hinges[end], index[end]
        axis = point / np.linalg.norm(point)
        move, tilt = np.zeros((3, CARRIER)), np.zeros((2, CARRIER))
        move[:, :3], move[:, 3:6] = np.eye(3), -_cross(point - at)
        side = {'L': 1.0, 'R': -1.0, 'C': 0.0}[end[0]]
        move[1, 6] = side          # y of B stands on the plane of symmetry
        tilt[:, 3:6] = np.linalg.svd(axis[None])[2][1:]
        rows |= dict(zip(range(first, first + 5), np.vstack([move, tilt]), strict=True))
        bodies = sorted({a.body for a in arcs if a.end == end})
        for body, way in zip(bodies, (1.0, -1.0), strict=False) if not side else ():
            rows[index[end, body]] = np.array([*np.zeros(3), *axis, way])
    return rows


def _ends(arcs):
    return sorted({a.end for a in arcs} - {a.start for a in arcs})


def _assembled(params, hinges, arcs):
    """(K (n, n), index) of the linkage; index as in `_numbering`."""
    index, size = _numbering(arcs)
    K = np.zeros((size, size))
    local = np.linalg.inv(arc_compliance(params, params.beta))
    for arc in arcs:
        lever = arc.R.T @ (hinges[arc.end] - hinges[arc.start])
        k = _to_axes(_element(local, lever), arc.R)
        map_ = np.zeros((12, size))
        for half, hinge in ((0, arc.start), (6, arc.end)):
            _place(map_[half:half + 6], hinges[hinge], index, hinge, arc.body)
        K += map_.T @ k @ map_
    return K, index


def _numbering(arcs):
    """First degree of freedom of each hinge and of each (hinge, body): 3 moves, 2 tilts, turns."""
    index, size = {}, 0
    for arc in arcs:
        for hinge in (arc.start, arc.end):
            if hinge == BASE:
                continue
            if hinge not in index:
                index[hinge] = size
                size += 5
            if (hinge, arc.body) not in index:
                index[hinge, arc.body] = size
                size += 1
    return index, size


def _place(rows, point, index, hinge, body):
    """Write how the six motions of a link's end follow from the degrees of freedom."""
    if hinge == BASE:
        return
    axis = point / np.linalg.norm(point)
    across = np.linalg.svd(axis[None])[2][1:]
    first = index[hinge]
    rows[:3, first:first + 3] = np.eye(3)
    rows[3:, first + 3:first + 5] = across.T
    rows[3:, index[hinge, body]] = axis


def _element(stiffness, lever):
    """(12, 12) of an arc from its end's stiffness (6, 6); lever : (3,) from start to end."""
    T = np.eye(6)
    T[:3, 3:] = -_cross(lever)
    return np.block([[T.T @ stiffness @ T, -T.T @ stiffness], [-stiffness @ T, stiffness]])


def _to_axes(K, R):
    """Turn a (12, 12) of an arc's axes into those of frame B."""
    Q = np.kron(np.eye(4), R)
    return Q @ K @ Q.T


def _cross(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def radial_stiffness(params, theta_1):
    """Return the stiffness [N/m] along the radius at the tip: one over its radial compliance."""
    u = tip(params, 0.0, theta_1) / params.radius
    return float(1.0 / (u @ tip_compliance(params, theta_1) @ u))


def torsional_spring(params):
    """Return K_gamma [N m/rad] of a link, (A.17) corrected.

    (A.14) gives the deflection of an arc's end, (A.15) needs 1/2 F Delta, and then
    K = 2 E I sin^2 phi / (R cos^2(phi/2) (phi - sin phi cos phi)); as printed it is 8.3 times as
    stiff at 18 deg.
    """
    phi, EI = params.beta, params.E * Section.of(params).in_plane
    return (2.0 * EI * np.sin(phi)**2
            / (params.radius * np.cos(phi / 2)**2 * (phi - np.sin(phi) * np.cos(phi))))


def thesis_stiffness(params, theta_1):
    """Return the radial stiffness [N/m] of appendix A: 2 / sum_i (lever_i^2 / K_gamma).

    (A.13) corrected: K_c = (J K_gamma^-1 J^T)^-1 of one chain, two chains in parallel. Passive
    hinges turn about axes through O and move the tip along the radius to second order only.
    """
    hinges, arcs = layout(params, theta_1)
    end = tip(params, 0.0, theta_1)
    u = end / params.radius
    compliance = 0.0
    for arc in (a for a in arcs[:params.links]):
        lever = u @ np.cross(arc.R[:, 1], end - hinges[arc.start])
        compliance += lever**2 / torsional_spring(params)
    return float(2.0 / compliance)


def mass_of_arc(params, density):
    """Mass [kg] of one arc; density : [kg/m3]"""
    return params.beta * params.radius * Section.of(params).area * density
