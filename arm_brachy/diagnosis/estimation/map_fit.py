"""All numbers of the causes that were chosen, fitted in full and together.

With d(z) measured minus predicted over the noise, of all recordings, z the free numbers on the
scale of their priors (`parameters`) and U the nuisances, each column at one prior standard
deviation, what belongs to the set-up the same in all, the cost is

    F(z) = d' C^-1 d / 2 + z' z / 2,    C = I + U U',

minus the log of the posterior density but for a constant. Gauss-Newton
steps minimise its quadratic model in a box, that of the limits cut by a trust region which grows
and shrinks by what F really loses (Nocedal & Wright 2006, Numerical Optimization, ch. 4, 10). Only
steps that lower F by a tenth of what was promised are made. The end is where the model promises,
over the whole box of limits, less than `Options.tolerance`, or `ROUGH` if no step helps.

Derivatives come from the tangent answers of `sensitivities` at the present model, a term's changed
value being to its present one what a term is to a model without it; where no tangent leads there
(pads that touch), from differences of full runs.
Terms that act on sensors alone ask for no tissue solve after the first.

Memories are followed along the motion of the model without the causes, and what they do to the
body is taken from its adjoints there; so is everything that answers nearly in proportion to its
size. Where the fit has settled, one full run says what that leaves out; it is added as an offset,
and the fit goes on from there, until what the offset may still be off by is less than the
tolerance, or an effect turns out to bend too much.
Test: diagnosis/forward/test_refit.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from arm_brachy.control.reach import bounded_least_squares
from arm_brachy.core.errors import ConfigError, InputError, MeshError, NotConverged
from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.estimation.fit_model import RecordingFit
from arm_brachy.diagnosis.estimation.parameters import Space, free_space
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, stacked
from arm_brachy.tissue.assembly import InvertedElement

SUFFICIENT = 0.1    # of the promised descent, for a step to be made
GOOD = 0.5          # of it, for a larger one to be tried next
# Derivatives are kept after a step of less than one standard deviation of the posterior, and after
# any step that lowered the cost as they said it would.
NEAR, TRUE = 0.5, 0.02
# A lump that moves through points of quadrature, or a support through nodes, ripples the cost:
# where no step of a quarter of the tolerance helps, or all runs are made, the end may promise a
# standard deviation, and the interval has it; or a share of what the effect is worth, which is a
# sixtieth of it in every channel; or more, where the whole step helps as little as short ones.
TINY, ROUGH, RIPPLE = 0.25, 0.5, 2.5e-4


class Unsettled(NotConverged):
    """Too many runs, or no step that helps.

    z : (k,) where the fit was: no result, but a start for the same causes in other noise
    """

    def __init__(self, message, z):
        super().__init__(message)
        self.z = z


@dataclass(frozen=True)
class Options:
    """When to stop."""

    tolerance: float = quantity(0.02, '', 'descent of the cost not worth a step', low=1e-8,
                                high=1.0, source='own choice: a fifth of the standard deviation '
                                                 'of the posterior')
    runs: int = 60      # forward runs of each recording, differences included


@dataclass(frozen=True)
class Refit:
    """The most probable values of all free numbers.

    terms : one per hypothesis;  estimates : hypothesis -> {field: Estimate, 90 %, SI}
    predicted : per recording kind -> (n, c, 3), with the terms;  residual : per recording (N,)
        over the noise, nuisances not removed
    before, after : cost F at the start and in the end;  runs : forward runs, all recordings
    space : parameters.Space;  z : (k,) its coordinates;  covariance : (k, k) of these,
        without limits
    mean : (k,) of the normal that limits cut off: z, but beyond a limit that stops it
    columns : per recording (N, k) change of the prediction over the noise per coordinate
    """

    terms: tuple
    estimates: dict
    predicted: tuple
    residual: tuple
    before: float
    after: float
    runs: int
    space: Space
    z: np.ndarray
    covariance: np.ndarray
    mean: np.ndarray
    columns: tuple


def refit(data, hypotheses, amplitudes, *, held=(), start=None, options=None):
    """Return the Refit of hypothesis.Hypotheses to recordings that they have in common.

    data : Data of each recording;  amplitudes : per hypothesis (k,) where its strengths start, in
        typical sizes (`Strength.spread` times the means of `Response.per_prior`)
    held : names of fields that stay at their place or default (`parameters.free_space`)
    start : `Refit.z` of the same hypotheses and held, on a cheaper specimen or in other noise,
        where it begins; None = at the amplitudes
    Finds the minimum next to the start: a place from a grid as fine as an effect is wide.
    A lump held much smaller than it is has no minimum within reach; one of free size and strong
    effect has a narrow bent valley (T7), where it may need more runs. Both are refused.
    Intervals are those of the quadratic model, cut off by limits: what the data leave open has
    the interval of its prior. Raises InputError if nothing is free, NotConverged where the start
    has no prediction, Unsettled, which is one, where the cost does not settle.
    """
    space = free_space(hypotheses, amplitudes, data[0].specimen, held)
    if not space.charts:
        raise InputError(f'{", ".join(one.name for one in hypotheses)}: no field is free; must '
                         'be one at least; hold fewer')
    options = options or Options()
    start = space.joined('start') if start is None else start
    fit = _Fit(data, space, start, options)
    now, slope, covariance = fit.settled(start)
    low, high = space.joined('low'), space.joined('high')
    stuck = (now.z <= low) & (slope < 0.0) | (now.z >= high) & (slope > 0.0)
    mean = now.z + np.where(stuck, np.diag(covariance) * slope, 0.0)
    return Refit(now.terms, space.estimates(now.z, mean, covariance), now.predicted, now.residual,
                 fit.before, now.cost, sum(one.runs for one in fit.recordings), space, now.z,
                 covariance, mean, fit.columns)


@dataclass(frozen=True)
class _Point:
    """Everything at one z; cost infinite where there is no prediction."""

    z: np.ndarray
    cost: float
    terms: tuple = ()
    models: tuple = ()
    predicted: tuple = ()
    residual: tuple = ()


class _Fit:
    """The cost, its quadratic model and the way down."""

    def __init__(self, data, space, start, options):
        self.space, self.options, self.columns = space, options, ()
        terms = space.terms(start)
        self.recordings = [RecordingFit(one, terms) for one in data]
        self.beside = Beside(stacked(data))

    def settled(self, start):
        """Return `minimum`, its predictions those of full runs.

        What full runs have added goes with the square of an effect: it is twice as wrong as that
        has moved since, relative to it.
        """
        z, found = start, self.minimum(start)
        before = self.before
        while any(one.beside is not None for one in self.recordings):
            moved = self.beside.square(np.concatenate(self.columns) @ (found[0].z - z))
            added, effect = np.sum([one.open for one in self.recordings], axis=0)
            left = 2.0 * moved * added / effect if np.isfinite(added) else np.inf
            if left < self.options.tolerance:
                break
            self.refuse_endless(left, False, found[0].z)
            self.correct(found[0])
            z, found = found[0].z, self.minimum(found[0].z)
        self.before = before
        return found

    def correct(self, now):
        """Run all recordings in full at a _Point; where that ends tangents' lead, forget them."""
        led = [one.beside for one in self.recordings]
        for one, shown in zip(self.recordings, now.predicted, strict=True):
            one.correct(now.terms, shown)
        if led != [one.beside for one in self.recordings]:
            self.columns = ()

    def minimum(self, start):
        """Return (_Point, slope (k,) of -F, covariance (k, k) of z) where F is least.

        Derivatives from before serve until they mislead.
        The step that is left counts as one standard deviation more. Raises NotConverged.
        """
        now, region, fresh = self.at(start), 1.0, not self.columns
        self.before = now.cost
        if not np.isfinite(now.cost):
            raise NotConverged('the refit has no prediction at its start; must be a model that '
                               'has all its states; start from fainter effects')
        if fresh:
            self.linearise(now)
        while True:
            slope, curvature = self.model(now)
            rest, left = self.promise(now, slope, curvature, np.inf)
            step, promised = self.promise(now, slope, curvature, region)
            tiny = fresh and promised < TINY * self.options.tolerance
            spent = max(one.runs for one in self.recordings) >= self.options.runs
            over = left < self.options.tolerance or tiny or spent
            if over and (left < self.options.tolerance or self.rippled(now, rest, left, tiny)):
                return now, slope, np.linalg.inv(curvature) + np.outer(rest, rest)
            self.refuse_endless(left, tiny, now.z)
            ahead = self.at(now.z + step)
            gain = (now.cost - ahead.cost) / promised
            if gain < SUFFICIENT:
                region, kept = 0.25 * self.length(step), fresh
            else:
                now, fresh, off = ahead, False, abs(gain - 1.0)
                region *= 2.0 if gain > GOOD else 0.5
                kept = off < TRUE or promised < NEAR and off < GOOD
            if not kept:
                self.linearise(now)
                fresh = True

    def rippled(self, now, rest, left, tiny):
        """True if a descent that is still promised, by a step `rest` (k,), is the cost's ripple.

        tiny : no short step helps
        """
        effect = sum(np.sum(np.square(one.data.residual(one.data.baseline.shown) - r))
                     for one, r in zip(self.recordings, now.residual, strict=True)
                     if one.data.baseline is not None)
        rough = max(ROUGH, 0.5 * RIPPLE * effect)
        return left < rough or tiny and self.at(now.z + rest).cost > now.cost - rough

    def linearise(self, now):
        """Take the derivatives at a point."""
        self.columns = tuple(one.columns(self.space, now, model)
                             for one, model in zip(self.recordings, now.models, strict=True))

    def length(self, step):
        """Length of a step (k,), 1 = as far as one of its coordinates should go at once."""
        return float(np.abs(step / self.space.joined('reach')).max())

    def refuse_endless(self, left, tiny, z):
        """Raise Unsettled at z (k,) where no step helps or too many were made."""
        runs = max(one.runs for one in self.recordings)
        if tiny or runs >= self.options.runs:
            raise Unsettled(
                f'the refit still promises a descent of {left:.3g} after {runs} runs, of at most '
                f'{self.options.runs}; must be below {self.options.tolerance:g}; start nearer, or '
                'hold what the data do not tell', z)

    def at(self, z):
        """The _Point at z."""
        lost = _Point(z, np.inf)
        try:
            terms = self.space.terms(z)
            models, predicted = zip(*(one.predicted(terms) for one in self.recordings),
                                    strict=True)
        except (ConfigError, InvertedElement, MeshError, NotConverged):  # of this z alone
            return lost
        if any(one is None for one in predicted):
            return lost
        residual = tuple(one.data.residual(p)
                         for one, p in zip(self.recordings, predicted, strict=True))
        cost = 0.5 * z @ z + 0.5 * self.beside.square(np.concatenate(residual))
        return _Point(z, float(cost), terms, models, predicted, residual)

    def model(self, now):
        """(slope of -F (k,), curvature (k, k)) of the quadratic model at a point."""
        columns = np.concatenate(self.columns)
        carried = self.beside.weighted(columns)
        curvature = np.eye(len(now.z)) + carried.T @ columns
        return carried.T @ np.concatenate(now.residual) - now.z, 0.5 * (curvature + curvature.T)

    def promise(self, now, slope, curvature, region):
        """(step (k,), descent that the quadratic model promises) within limits and region."""
        reach = region * self.space.joined('reach')
        factor = cholesky(curvature, lower=True)
        step = bounded_least_squares(
            factor.T, solve_triangular(factor, slope, lower=True),
            np.maximum(self.space.joined('low') - now.z, -reach),
            np.minimum(self.space.joined('high') - now.z, reach))
        return step, float(slope @ step - 0.5 * step @ curvature @ step)
