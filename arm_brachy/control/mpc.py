"""Model predictive control of a target by pads, (3.27)-(3.29), as one small quadratic programme.

Prediction (3.27) is an integrator with gain J, so e_h = e_0 - J sum_{i<h} u_i and the programme
condenses to the pushes alone: with L the lower triangle of ones,
    H = (L' W L) (x) (J' Q J) + I (x) R,   f = -(L' W 1) (x) (J' Q e_0).
Lengths are in millimetres inside the programme: its tolerances are absolute, and 1e-6 of a
millimetre means something where 1e-6 of a metre is what an encoder resolves.
"""

from dataclasses import dataclass

import numpy as np
import osqp
import scipy.sparse as sp

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity

_MM = 1e-3
_NOTHING = 1e-6  # mm; ten times OSQP's tolerance below, a thousandth of an encoder step


@dataclass(frozen=True)
class MpcParams:
    """Weights and limits of (3.29). The thesis prints neither; each default says its reason.

    horizon : N_p, number of control periods looked ahead
    retraction : pads may go back as well as push; False as published
    """

    horizon: int = 10
    error_weight: float = quantity(
        1.0, 'per_mm2', 'weight Q on the squared error of each controlled axis', low=1e-6,
        source='sets the scale of the cost; only R / Q matters')
    push_weight: float = quantity(
        2.0, 'per_mm2', 'weight R on the squared push of each pad and period', low=1e-6,
        source='with J = 0.4 the error shrinks by a quarter per period: no overshoot, which '
               'push-only pads could not undo, even if the tissue moves twice as far as the model')
    terminal_weight: float = quantity(
        1.0, '', 'factor on Q at the end of the horizon', low=1.0,
        source='1 as published')
    period: float = quantity(
        0.1, 's', 'control period', low=0.01, high=10.0,
        source='4 samples of a 40 Hz tracker; the thesis needed 1-2 s')
    retraction: bool = False

    def __post_init__(self):
        """Refuse a horizon that looks nowhere."""
        if self.horizon < 1:
            raise ConfigError(f'mpc: horizon = {self.horizon}; must be >= 1 control period')


@dataclass(frozen=True)
class MpcStep:
    """What the programme answers.

    push : (p,) [m] change of each pad's travel now, 0 unless `outcome` is OK
    plan : (horizon, p) [m] pushes over the horizon;  path : (horizon, 3) [m] predicted error
    """

    push: np.ndarray
    plan: np.ndarray
    path: np.ndarray
    outcome: Outcome


class Mpc:
    """The programme with its structure fixed once; every step changes numbers only.

    Same inputs in the same order give the same bits: iterations are counted, never timed.
    """

    def __init__(self, params, strokes, max_speed):
        """Set up for p pads.

        params : MpcParams;  strokes : (p,) [m] largest travel;  max_speed : (p,) or scalar [m/s]
        """
        self.params = params
        self._strokes = np.asarray(strokes, dtype=float) / _MM
        self._step = np.broadcast_to(np.asarray(max_speed, dtype=float) * params.period / _MM,
                                     self._strokes.shape)
        self._L = np.tril(np.ones((params.horizon, params.horizon)))
        self._weights = np.ones(params.horizon)
        self._weights[-1] = params.terminal_weight
        self._LWL = self._L.T @ (self._weights[:, None] * self._L)
        self._qp = None

    @property
    def n_pads(self):
        """Number of pads p."""
        return len(self._strokes)

    def reset(self):
        """Forget the last solution, so that a new goal starts as a fresh controller would."""
        self._qp = None

    def step(self, error, J, q, axes=(True, True, True)):
        """Solve (3.29) once.

        error : (3,) [m] goal minus predicted position, world frame
        J : (3, p) Jacobian along the push directions;  q : (p,) [m] travel commanded so far
        axes : (3,) bool, controlled axes; the others weigh nothing
        Returns MpcStep. Outcome INFEASIBLE if q leaves no room (beyond the stroke), NOT_CONVERGED
        if OSQP stopped short; the push is then zero.
        """
        error = np.where(axes, error, 0.0) / _MM
        H, f = self._cost(error, J, np.asarray(axes, dtype=float))
        lower, upper = self._limits(np.asarray(q, dtype=float) / _MM)
        if np.any(lower > upper):
            return self._refused(error, Outcome.INFEASIBLE)
        answer = self._solve(H, f, lower, upper)
        outcome = _OUTCOMES.get(answer.info.status_val, Outcome.NOT_CONVERGED)
        if not outcome.ok:
            self._qp = None  # a failed iterate is no warm start
            return self._refused(error, outcome)
        plan = answer.x.reshape(self.params.horizon, self.n_pads)
        path = error - (self._L @ plan) @ J.T
        return MpcStep(self._admissible(plan[0], lower, upper) * _MM, plan * _MM, path * _MM,
                       outcome)

    def _cost(self, error, J, on):
        """Return (H, f) of the condensed programme, in mm."""
        # per_mm2 is stored in 1/m^2; the programme counts in mm
        Q = self.params.error_weight * _MM**2 * on
        R = self.params.push_weight * _MM**2
        n = self.params.horizon * self.n_pads
        H = np.kron(self._LWL, J.T @ (Q[:, None] * J)) + R * np.eye(n)
        f = -np.kron(self._L.T @ self._weights, J.T @ (Q * error))
        return H, f

    def _limits(self, q):
        """Bounds on each push and on each pad's travel, in mm: (2 horizon p,) twice."""
        N = self.params.horizon
        back = -self._step if self.params.retraction else np.zeros(self.n_pads)
        lower = np.concatenate([np.tile(back, N), np.tile(-q, N)])
        upper = np.concatenate([np.tile(self._step, N), np.tile(self._strokes - q, N)])
        return lower, upper

    def _solve(self, H, f, lower, upper):
        values = H[self._upper_triangle(len(f))]
        if self._qp is None:
            self._qp = osqp.OSQP()
            self._qp.setup(_upper(H), f, self._constraints(), lower, upper, **_SETTINGS)
        else:
            self._qp.update(Px=values, q=f, l=lower, u=upper)
        return self._qp.solve(raise_error=False)

    def _constraints(self):
        """Pushes one by one, then travel after each of them: [I; L (x) I]."""
        p = self.n_pads
        return sp.csc_matrix(np.vstack([np.eye(self.params.horizon * p),
                                        np.kron(self._L, np.eye(p))]))

    @staticmethod
    def _upper_triangle(n):
        """Index of the upper triangle in the order of `_upper`'s data (column by column)."""
        cols, rows = np.tril_indices(n)
        return rows, cols

    def _admissible(self, push, lower, upper):
        """Trim the programme's tolerance, so that limits are kept exactly and rest is rest."""
        push = np.where(np.abs(push) < _NOTHING, 0.0, push)
        p, n = self.n_pads, self.params.horizon * self.n_pads
        return np.clip(push, np.maximum(lower[:p], lower[n:n + p]),
                       np.minimum(upper[:p], upper[n:n + p]))

    def _refused(self, error, outcome):
        N = self.params.horizon
        return MpcStep(np.zeros(self.n_pads), np.zeros((N, self.n_pads)),
                       np.tile(error * _MM, (N, 1)), outcome)


# Tolerances are in mm: what a push is off by is nanometres. Not polished: OSQP would print a line
# whenever no limit is active. rho adapts by iteration count; by time, runs would differ.
_SETTINGS = {
    'verbose': False, 'eps_abs': 1e-7, 'eps_rel': 1e-7, 'max_iter': 20000, 'polishing': False,
    'adaptive_rho': 1, 'adaptive_rho_interval': 50, 'check_termination': 25,
    'warm_starting': True,
}

_OUTCOMES = {
    int(osqp.SolverStatus.OSQP_SOLVED): Outcome.OK,
    int(osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE): Outcome.INFEASIBLE,
    int(osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE_INACCURATE): Outcome.INFEASIBLE,
}


def _upper(H):
    """Upper triangle as CSC that stores every entry, also those that happen to be zero now."""
    n = len(H)
    rows, cols = Mpc._upper_triangle(n)
    indptr = np.concatenate([[0], np.cumsum(np.arange(1, n + 1))])
    return sp.csc_matrix((H[rows, cols], rows, indptr), shape=(n, n))
