"""How well pads that can only push move a target: positive bases, inverse kinematics, index.

Throughout, J (m, p) maps pad travel q (p,) [m], counted along each pad's push direction, to
target displacement (m,) [m]: (3.23) contracted with the directions d_i. Its rows are the
controlled axes only.
"""

import numpy as np
from scipy.optimize import linprog, nnls

# Residual, relative to the vector sought, below which a vector counts as reached: far above the
# rounding of nnls (1e-12) and far below what a Jacobian from finite elements is good for (1e-2).
CONE_TOLERANCE = 1e-6


def in_cone(J, v, tolerance=CONE_TOLERANCE):
    """Tell whether v is a positive combination of the columns of J (Definitions 1 and 2).

    J : (m, p);  v : (m,);  tolerance : residual allowed, relative to the length of v
    """
    v = np.asarray(v, dtype=float)
    return nnls(J, v)[1] <= tolerance * np.linalg.norm(v)


def positively_independent(J):
    """Tell whether no column is a positive combination of the others (Definition 3).

    J : (m, p)
    """
    columns = range(J.shape[1])
    return not any(in_cone(J[:, [j for j in columns if j != i]], J[:, i]) for i in columns)


def positive_span(J, tolerance=CONE_TOLERANCE):
    """Tell whether pushing alone moves the target in every direction of R^m.

    J : (m, p). True if J has rank m and some strictly positive combination of its columns
    vanishes, which is equivalent (Davis 1954, theorem 3.3): writing that combination as 1 + mu
    with mu >= 0 leaves one non-negative least-squares problem.
    tolerance : relative to the sum of the columns' lengths
    """
    if np.linalg.matrix_rank(J) < J.shape[0]:
        return False
    scale = np.linalg.norm(J, axis=0).sum()
    return nnls(J, -J.sum(axis=1))[1] <= tolerance * scale


def is_positive_basis(J):
    """Tell whether the columns of J (m, p) span R^m positively and none can be spared.

    Such a set has between m + 1 and 2 m members (Theory 1).
    """
    return positive_span(J) and positively_independent(J)


def inverse_kinematics(J, p):
    """Least pad travel that brings the target as near to displacement p as pushing allows (3.26).

    J : (m, p) rows of the controlled axes only, so that a relaxed axis costs nothing
    p : (m,) wanted displacement [m]
    Returns q (p,) >= 0 [m]. The nearest point J q of the cone is unique; the pads that reach it
    are not (four pads, two axes), and among equals the total travel sum q_i is least, since that
    is the denominator of (3.25). Printed as a strict inequality, (3.26) has no minimiser whenever
    a pad should rest; >= 0 is meant.
    Valid for displacements over which J is constant (5 mm changes it by some 10 % in soft tissue).
    """
    p = np.asarray(p, dtype=float)
    q_any, _ = nnls(J, p)
    scale = np.abs(q_any).sum()
    if scale == 0.0:
        return q_any
    reached = J @ q_any / scale
    least = linprog(np.ones(J.shape[1]), A_eq=J, b_eq=reached, bounds=(0, None), method='highs')
    # Fails only where rounding makes `reached` unreachable; q_any reaches it by construction.
    return scale * least.x if least.status == 0 else q_any


def index(J, p):
    """Manipulability index (3.25) of one task: target travel over summed pad travel.

    J : (m, p) rows of the controlled axes;  p : (m,) wanted displacement [m]
    Returns the index [m/m]. The numerator is the travel that pushing attains on the controlled
    axes, so an unreachable task scores by what it reaches and 0 where no pad helps.
    """
    q = inverse_kinematics(J, p)
    travel = q.sum()
    return float(np.linalg.norm(J @ q) / travel) if travel > 0.0 else 0.0


def index_map(J, p, axes):
    """Index (3.25) and attained share of one task at many points.

    J : (k, 3, p) Jacobian at k points;  p : (3,) wanted displacement [m];  axes : (3,) bool
    Returns (index (k,) [m/m], share (k,) of |p| attained on the controlled axes, 1 = all).
    """
    axes = np.asarray(axes, dtype=bool)
    goal = np.asarray(p, dtype=float)[axes]
    qq = np.array([inverse_kinematics(Jk[axes], goal) for Jk in J])
    moved = np.linalg.norm(np.einsum('kmp,kp->km', J[:, axes], qq), axis=1)
    travel = qq.sum(axis=1)
    values = np.divide(moved, travel, out=np.zeros(len(J)), where=travel > 0.0)
    return values, moved / np.linalg.norm(goal)
