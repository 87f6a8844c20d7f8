"""An independent model of the scissor linkage: straight Timoshenko beams, hinges as constraints.

It shares with `robot.scissor_stiffness` where hinges are and which arcs make one link, and
nothing else: elements are textbook ones of straight beams along chords of the arc (Przemieniecki
1968, Theory of Matrix Structural Analysis, sec. 5.6, with shear), hinges are Lagrange multipliers.
"""

import numpy as np
from scipy.sparse import block_diag, bmat, coo_matrix, csc_matrix, hstack, vstack
from scipy.sparse.linalg import spsolve

from arm_brachy.robot.scissor_rcm import tip
from arm_brachy.robot.scissor_stiffness import BASE, Section, layout

_SHEAR = 5.0 / 6.0


def radial_stiffness(params, theta_1, elements=24):
    """Return the stiffness [N/m] of the tip along the radius; `elements` straight beams an arc."""
    hinges, arcs = layout(params, theta_1)
    nodes, beams, at = _mesh(hinges, arcs, params.radius, elements)
    K = _stiffness(params, np.array(nodes), beams)
    B = _constraints(hinges, at, 6 * len(nodes))
    u = tip(params, 0.0, theta_1) / params.radius
    ends = sorted({a.end for a in arcs} - {a.start for a in arcs})
    load = np.zeros(6 * len(nodes))
    for end in ends:
        node = next(n for (hinge, _), n in at.items() if hinge == end)
        load[6 * node:6 * node + 3] = u / len(ends)
    system = bmat([[K, B.T], [B, None]], format='csc')
    x = spsolve(system, np.concatenate([load, np.zeros(B.shape[0])]))
    return 1.0 / float(load @ x[:len(load)])


def carrier_compliance(params, theta_1, elements=24):
    """Return C (6, 6) as `scissor_stiffness.carrier_compliance`, from straight beams."""
    hinges, arcs = layout(params, theta_1)
    nodes, beams, at = _mesh(hinges, arcs, params.radius, elements)
    n, where = 6 * len(nodes), tip(params, 0.0, theta_1)
    K = block_diag([_stiffness(params, np.array(nodes), beams), csc_matrix((7, 7))])
    own = _constraints(hinges, at, n)
    rows = [hstack([own, csc_matrix((own.shape[0], 7))])]
    for end in sorted({a.end for a in arcs} - {a.start for a in arcs}):
        axis = hinges[end] / np.linalg.norm(hinges[end])
        members = sorted((body, node) for (hinge, body), node in at.items() if hinge == end)
        rows.append(_on_carrier(n, members[0][1], hinges[end] - where, axis,
                                {'L': 1.0, 'R': -1.0, 'C': 0.0}[end[0]]))
        if end[0] == 'C':
            rows += [csc_matrix(_row(n + 7, {
                **{6 * node + 3 + d: axis[d] for d in range(3)},
                **{n + 3 + d: -axis[d] for d in range(3)}, n + 6: -sign})[None])
                for (_, node), sign in zip(members, (1.0, -1.0), strict=True)]
    B = vstack(rows)
    system = bmat([[K, B.T], [B, None]], format='csc')
    load = np.zeros((system.shape[0], 6))
    load[n:n + 6] = np.eye(6)
    return load.T @ spsolve(system, csc_matrix(load)).toarray()


def _on_carrier(n, node, lever, axis, side):
    """Rows that hold a hinge's node to the carrier: three moves, free along y by `side`; tilts."""
    rows = np.zeros((5, n + 7))
    rows[:3, 6 * node:6 * node + 3], rows[:3, n:n + 3] = np.eye(3), -np.eye(3)
    rows[:3, n + 3:n + 6] = np.cross(lever, np.eye(3)).T   # d + phi x lever
    rows[1, n + 6] = -side
    across = np.linalg.svd(axis[None])[2][1:]
    rows[3:, 6 * node + 3:6 * node + 6], rows[3:, n + 3:n + 6] = across, -across
    return csc_matrix(rows)


def _mesh(hinges, arcs, radius, elements):
    """Nodes along every link, beams (i, j, radial direction), node of each (hinge, body)."""
    nodes, beams, at = [], [], {}
    for arc in arcs:
        a, b = hinges[arc.start], hinges[arc.end]
        angle = np.arccos(a @ b / radius**2)
        line = [(np.sin((1 - s) * angle) * a + np.sin(s * angle) * b) / np.sin(angle)
                for s in np.linspace(0.0, 1.0, elements + 1)]
        ids = []
        for k, point in enumerate(line):
            key = {0: (arc.start, arc.body), elements: (arc.end, arc.body)}.get(k)
            if key in at:
                ids.append(at[key])
                continue
            nodes.append(point)
            ids.append(len(nodes) - 1)
            if key is not None:
                at[key] = ids[-1]
        beams += list(zip(ids[:-1], ids[1:], strict=True))
    return nodes, beams, at


def _stiffness(params, nodes, beams):
    section, E = Section.of(params), params.E
    G = E / (2.0 * (1.0 + params.nu))
    rows, columns, values = [], [], []
    for i, j in beams:
        k = _beam(nodes[i], nodes[j], section, E, G)
        dofs = np.concatenate([6 * i + np.arange(6), 6 * j + np.arange(6)])
        rows.append(np.repeat(dofs, 12))
        columns.append(np.tile(dofs, 12))
        values.append(k.ravel())
    n = 6 * len(nodes)
    return coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                      shape=(n, n)).tocsc()


def _beam(a, b, section, E, G):
    """(12, 12) of one straight beam from a to b; y of its axes lies along the radius."""
    L = np.linalg.norm(b - a)
    x = (b - a) / L
    y = 0.5 * (a + b)
    y = y - x * (x @ y)
    y /= np.linalg.norm(y)
    Q = np.kron(np.eye(4), np.vstack([x, y, np.cross(x, y)]))
    k = np.zeros((12, 12))
    for d, stiffness in ((0, E * section.area / L), (3, G * section.torsion / L)):
        k[np.ix_([d, d + 6], [d, d + 6])] = stiffness * np.array([[1, -1], [-1, 1]])
    # Bending that moves the beam along y turns it about z, and along z about -y.
    for EI, move, turn, sign in ((E * section.in_plane, 1, 5, 1), (E * section.across, 2, 4, -1)):
        shear = 12.0 * EI / (_SHEAR * section.area * G * L**2)
        c = EI / (L**3 * (1.0 + shear))
        block = c * np.array([
            [12, 6 * L, -12, 6 * L],
            [6 * L, (4 + shear) * L**2, -6 * L, (2 - shear) * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, (2 - shear) * L**2, -6 * L, (4 + shear) * L**2]])
        flip = np.diag([1, sign, 1, sign])
        k[np.ix_([move, turn, move + 6, turn + 6],
                 [move, turn, move + 6, turn + 6])] += flip @ block @ flip
    return Q.T @ k @ Q


def _constraints(hinges, at, size):
    """Rows that hold the first hinge and tie links in the others, free about the hinge's axis."""
    rows = []
    for hinge, point in hinges.items():
        members = [node for (name, _), node in at.items() if name == hinge]
        if hinge == BASE:
            for node in members:
                rows += [_row(size, {6 * node + d: 1.0}) for d in range(6)]
            continue
        across = np.linalg.svd((point / np.linalg.norm(point))[None])[2][1:]
        for node in members[1:]:
            rows += [_row(size, {6 * members[0] + d: 1.0, 6 * node + d: -1.0}) for d in range(3)]
            for direction in across:
                rows.append(_row(size, {6 * n + 3 + d: s * direction[d] for n, s in (
                    (members[0], 1.0), (node, -1.0)) for d in range(3)}))
    return csc_matrix(np.array(rows))


def _row(size, entries):
    row = np.zeros(size)
    for k, value in entries.items():
        row[k] = value
    return row
