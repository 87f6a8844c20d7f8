"""How ADMM goes from one iterate to the next: as published, or accelerated and safe.

The accelerated scheme changes three things and cannot cycle.
1. The weights follow the energy's curvature (`admm_weights.curvature_weights`; in the spirit of
   Brown & Narain, WRAPD, ACM Trans. Graph. 40(4), 2021): a scalar weight stiff enough for
   changes of volume slows all others by kappa / mu.
2. Anderson extrapolation of s = z + u (Ouyang et al., Comput. Graph. Forum 39(5), 2020).
3. A merit function that must fall: the augmented Lagrangian at (x, z, u), which for z and u from
   a local step is the Douglas-Rachford envelope of s (Themelis & Patrinos, SIAM J. Optim. 30(1),
   2020). A step is accepted if it lowers the merit by DECREASE |D x - z|_W^2; an extrapolation
   that does not is replaced by the plain step, and if that does not either, the weights are taken
   anew at z, multiplied by GROWTH, with W u, the multiplier, kept.
Accepted steps between two changes of weights have strictly falling merit, so no iterate comes
back: there is no cycle of any period. Weights change at iterations 3, 9, 27, ... and at failures,
and failures are finitely many: where the energy's second derivative lies within +- L W between the
old z and the new, the plain step lowers the merit by at least ((1 - L) / 2 - L^2) |dz|_W^2 (as
in Hong, Luo & Razaviyayn, SIAM J. Optim. 26(1), 2016, sec. 2, for curvature of that sign), and
|D x - z|_W <= (1 + L) |dz|_W; for L <= 0.42 that is the decrease asked for. A body whose elements
keep det z away from zero has such an L for weights large enough; `largest_weight` ends the search
for it with NOT_CONVERGED where it has not. The claim is up to rounding of the merit.
"""

import numpy as np

from arm_brachy.tissue.admm_weights import curvature_weights, published_weights

GROWTH = 1.5         # of c at a failure
DECREASE = 0.05      # of the merit, in units of |D x - z|_W^2
MERIT_ROUNDING = 1e-13  # of the merit, relative: sums over some thousand elements
FIRST_REWEIGHING = 3  # iterations; then at REWEIGHING_RATIO times as many each time
REWEIGHING_RATIO = 3
# Curvature assumed across n before the first reweighing, in mu: the pressures (up to a tenth of
# kappa) that a push of 10 mm is about to cause. 5 to 50 serve.
FIRST_CURVATURE = 20.0
# Newton's method squares its error: a local step that ends with a step of sqrt(1e-2 |r|) is off by
# about a hundredth of the distance r = D x - z still to go.
INEXACT = 1e-2
LAST_STEP = 1e-7     # of the published scheme's local steps: rounding after squaring


class Published:
    """(3.11)-(3.13) with the scalar weight of the thesis, which stays what it is."""

    def __init__(self, iteration, solver):
        self._it, self._volume, self.c = iteration, solver.volume, solver.options.first_weight
        self.count = self.reweighings = self.rejected = 0
        self.exhausted = False

    def begin(self):
        """The first global step, from z and multipliers of the start."""
        self._it.reweigh(published_weights(self._volume, self._it.problem.fields.kappa, self.c))
        self.step_global()

    def step(self):
        """One iteration."""
        self._it.local_step(self._it.u + self._it.F, LAST_STEP)
        self.step_global()

    def step_global(self):
        """The global step ends an iteration."""
        self._it.global_step()
        self.count += 1


class Accelerated:
    """Weights by curvature, Anderson extrapolation, and a merit that must fall."""

    def __init__(self, iteration, solver, anderson):
        self._it, self._volume, self._anderson = iteration, solver.volume, anderson
        self.c, self._largest = solver.options.first_weight, solver.options.largest_weight
        self.count = self.reweighings = self.rejected = 0
        self.exhausted = False
        self._due = FIRST_REWEIGHING
        self._Y, self._image, self._residual, self._z, self._u = (
            np.empty_like(iteration.z) for _ in range(5))

    def begin(self):
        """The first global step, from z and multipliers of the start."""
        self._reweigh(FIRST_CURVATURE)
        self.reweighings = 0

    def step(self):
        """One iteration, or two or three where a step is not accepted."""
        it = self._it
        if self.count >= self._due:
            self._due *= REWEIGHING_RATIO
            self._reweigh()
            return
        before = it.merit, it.square
        self._z[:], self._u[:] = it.z, it.u
        np.add(it.u, it.F, out=self._image)
        np.subtract(it.F, it.z, out=self._residual)
        tolerance = max(np.sqrt(INEXACT * it.largest), LAST_STEP)
        extrapolated = self._anderson.propose(self._image, self._residual, self._Y)
        if self._move(self._Y, tolerance, before):
            return
        if extrapolated:
            self.rejected += 1
            self._anderson.restart()
            if self._move(self._image, tolerance, before):
                return
        it.z[:], it.u[:] = self._z, self._u
        self.c *= GROWTH
        self.exhausted = self.c > self._largest
        self._reweigh()

    def _move(self, Y, tolerance, before):
        """Local and global step to Y; True if the merit has fallen enough."""
        self._it.local_step(Y, tolerance)
        self._it.global_step()
        self.count += 1
        merit, square = before
        limit = merit - DECREASE * square + MERIT_ROUNDING * abs(merit)
        return self._it.merit <= limit

    def _reweigh(self, least=0.0):
        it, fields = self._it, self._it.problem.fields
        it.reweigh(curvature_weights(it.z, self._volume, fields.mu, fields.kappa, self.c, least))
        it.global_step()
        self._anderson.restart(it.weights.alpha + it.weights.beta / 9.0)
        self.count += 1
        self.reweighings += 1
