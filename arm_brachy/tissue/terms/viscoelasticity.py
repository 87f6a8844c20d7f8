"""Isochoric viscoelasticity: force depends on rate, holds relax, release recovers slowly."""

import math
from dataclasses import dataclass
from hashlib import blake2b
from typing import ClassVar

import numpy as np
from numba import njit

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.kernels import deformation_gradient
from arm_brachy.tissue.material import inverse_transpose

TOGETHER = 32   # positions whose stresses are held at once: a MB each for 2300 quadratic elements
_SOURCE = ('creep of glandular tissue in vivo: retardation times 3.2 +- 0.8 s and 42 +- 28 s, '
           'viscous about equal to elastic strain (Sridhar & Insana 2007, Med Phys 34:4757); '
           'relaxation is faster by the ratio of long-term to sudden modulus, within the prior')


@dataclass(frozen=True)
class ViscoMemory:
    """Internal variables, per element.

    elastic : (m, q, 3, 3) [Pa] equilibrium stress S_iso at the last step, `relaxing_stress`
    over : (2, m, q, 3, 3) [Pa] overstress Q_i of each branch, second Piola-Kirchhoff
    """

    elastic: np.ndarray
    over: np.ndarray


@dataclass(frozen=True)
class Viscoelasticity(BodyTerm):
    """Quasi-linear finite viscoelasticity with a Prony series of one or two branches.

    Convention: the modulus of the scene is the LONG-TERM one (it comes from a slow test, and a
    hold ends where the elastic body would be). A sudden load meets mu / (1 - g1 - g2). The volume
    response does not relax; stiffening and fibres do, by the same share. The convolution is
    integrated with an exponential recursion that is exact for a stress history linear within a
    step (Kaliske & Rothert 1997), hence stable for any step: dt = inf means that the body has
    rested for ever.

    Holds for overstress of the order of the elastic stress at strains below about 50 %: the
    kernel does not depend on strain, and dissipation is guaranteed near equilibrium only.
    Test: tissue/terms/test_viscoelasticity.py (relaxation, ramp, marker invariance)
    """

    g1: float = quantity(0.3, '', 'share of the instantaneous modulus that relaxes with tau1',
                         low=0.0, high=0.9, prior=('uniform', 0.0, 0.6), source=_SOURCE,
                         neutral=0.0)
    tau1: float = quantity(3.0, 's', 'relaxation time of the first branch', low=1e-3, high=1e4,
                           prior=('lognormal', 3.0, 3.0), source=_SOURCE)
    g2: float = quantity(0.0, '', 'share that relaxes with tau2 (0 = one branch)', low=0.0,
                         high=0.9, prior=('uniform', 0.0, 0.4), source=_SOURCE, neutral=0.0)
    tau2: float = quantity(40.0, 's', 'relaxation time of the second branch', low=1e-3, high=1e4,
                           prior=('lognormal', 40.0, 3.0), source=_SOURCE)

    spec: ClassVar[TermSpec] = TermSpec(
        name='viscoelasticity', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='rate-dependent force, relaxation in a hold, slow recovery',
        equation='S = S_vol + S_iso + Q_1 + Q_2;  dQ_i/dt + Q_i / tau_i = '
                 'g_i / (1 - g_1 - g_2) dS_iso/dt',
        source='Simo 1987, CMAME 60:153; Holzapfel 2000, Nonlinear Solid Mechanics, ch. 6; '
               'Kaliske & Rothert 1997, Comput Mech 19:228 (recursion); Holzapfel & Gasser 2001, '
               'CMAME 190:4379 (fibres)',
        invisible_when='only positions are recorded, the tissue is homogeneous and nearly '
                       'incompressible and only moved by bonded pads, never released',
        leaves_open='the number of relaxation times and their spread; a relaxation that depends '
                    'on strain')

    def __post_init__(self):
        if self.g1 + self.g2 >= 1.0:
            raise ConfigError(f'g1 + g2 = {self.g1 + self.g2:.4g}; must be < 1, or '
                              'nothing elastic is left; lower one of them')

    def prepare(self, body):
        """Return `body` as it is: its moduli are the long-term ones."""
        return body

    def memory(self, body):
        """Return the ViscoMemory of a body that has never been strained."""
        shape = (*body.geometry.weights.shape, 3, 3)
        return ViscoMemory(np.zeros(shape), np.zeros((2, *shape)))

    def before_step(self, body, memory, t, dt, fields):
        """Stiffen the moduli and add the remembered stress for the step (t - dt, t]."""
        decay, gain = self._recursion(dt)
        fields.scale_all_but_bulk(1.0 + gain.sum())
        remembered = np.tensordot(decay, memory.over, axes=1)
        fields.stress += remembered - gain.sum() * memory.elastic

    def after_step(self, body, memory, x, t, dt):
        """Return the ViscoMemory at t, given the positions x (n, 3) [m] reached."""
        decay, gain = self._recursion(dt)
        elastic = relaxing_stress(body.geometry, body, x)
        rise = elastic - memory.elastic
        over = np.stack([d * q + g * rise
                         for d, q, g in zip(decay, memory.over, gain, strict=True)])
        return ViscoMemory(elastic, over)

    def carried(self, body, steps, fields):
        """As BodyTerm.carried; the recursion is linear in the stresses at the positions.

        Each is weighed by numbers alone, and found but once of positions that return.
        """
        which, first = _distinct(steps)
        now = dict(zip(steps.at.tolist(), fields, strict=True))
        over, weights = np.zeros((2, len(first))), []
        for k in range(steps.at[-1] + 1):
            if k in now:
                decay, gain = self._recursion(steps.acting[k])
                now[k].scale_all_but_bulk(1.0 + gain.sum())
                weights.append(decay @ over)
                weights[-1][which[k - 1:k]] -= gain.sum()
            decay, gain = self._recursion(steps.dt[k])
            over *= decay[:, None]
            over[:, which[k]] += gain
            over[:, which[k - 1:k]] -= gain[:, None]
        for some in np.array_split(np.arange(len(first)), np.ceil(len(first) / TOGETHER)):
            stress = np.stack([self._elastic(body, steps, k) for k in first[some]])
            added = np.tensordot(np.array(weights)[:, some], stress, axes=1)
            for one, more in zip(fields, added, strict=True):
                one.stress += more

    @staticmethod
    def _elastic(body, steps, k):
        swollen = body.swollen(steps.swelling[k])
        return relaxing_stress(swollen.geometry, swollen, steps.x[k])

    def _recursion(self, dt):
        """Return per branch (decay, gain): Q <- decay Q + gain (S_iso,new - S_iso,old)."""
        long_term = 1.0 - self.g1 - self.g2
        steps = [dt / tau for tau in (self.tau1, self.tau2)]
        mean = [-math.expm1(-r) / r if r > 0.0 else 1.0 for r in steps]
        gain = [g / long_term * f for g, f in zip((self.g1, self.g2), mean, strict=True)]
        return np.array([math.exp(-r) for r in steps]), np.array(gain)


def _distinct(steps):
    """(which (m,), first (u,)): steps with one shape and its positions, of Steps up to the last
    that is asked for, and the first of each.
    """
    known, which, first = {}, [], []
    for k in range(steps.at[-1] + 1):
        key = float(steps.swelling[k]), blake2b(np.ascontiguousarray(steps.x[k])).digest()
        if key not in known:
            known[key] = len(first)
            first.append(k)
        which.append(known[key])
    return np.array(which), np.array(first)


def relaxing_stress(geometry, law, x):
    """Second Piola-Kirchhoff stress in each element but for what the bulk modulus adds.

    geometry : ElementGeometry;  law : SoftBody or StepFields, for mu and beyond
    x : (n, 3) positions [m]
    Returns (m, q, 3, 3) [Pa] at the quadrature points, with the symbols of `material`:
    (mu + 4 c (Ib - 3)) J^(-2/3) (I - tr(C) / 3 C^-1) + 2 k (I4 - 1) a0 a0', zero at points that
    carry volume change only.
    """
    out = np.empty((*geometry.weights.shape, 3, 3))
    _relaxing(np.ascontiguousarray(x, dtype=float), geometry.connectivity, geometry.gradients,
              geometry.shear, law.mu, law.beyond, out)
    return out


@njit(cache=True, error_model='numpy')
def _relaxing(x, conn, G, shear, mu, beyond, out):
    """Element loop of `relaxing_stress`; arrays as in `kernels`."""
    F, inv_T = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(mu)):
        a0 = beyond[e, 2:]
        for q in range(G.shape[1]):
            I1 = deformation_gradient(x, conn[e], G[e, q], F)
            root = inverse_transpose(F, inv_T) ** (-2.0 / 3.0)
            scale = shear[q] * (mu[e] + 4.0 * beyond[e, 0] * (root * I1 - 3.0)) * root
            I4 = 0.0
            for i in range(3):
                I4 += (F[i, 0] * a0[0] + F[i, 1] * a0[1] + F[i, 2] * a0[2]) ** 2
            pull = shear[q] * 2.0 * beyond[e, 1] * (I4 - 1.0)
            for i in range(3):
                for k in range(3):
                    C_inv = (inv_T[0, i] * inv_T[0, k] + inv_T[1, i] * inv_T[1, k]
                             + inv_T[2, i] * inv_T[2, k])
                    out[e, q, i, k] = (scale * ((1.0 if i == k else 0.0) - I1 / 3.0 * C_inv)
                                       + pull * a0[i] * a0[k])
