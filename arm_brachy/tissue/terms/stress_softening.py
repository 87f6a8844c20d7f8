"""Stress softening: tissue strained once is softer below the strain that it has seen."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.kernels import deformation_gradient
from arm_brachy.tissue.material import inverse_transpose


@dataclass(frozen=True)
class StressSoftening(BodyTerm):
    """Discontinuous damage: the isochoric stress times 1 - D, D set by the largest energy so far.

    D = damage (1 - exp(-W_max / energy)) with W the isochoric energy density (3.18) of the
    undamaged element, its mean over the volume. Below W_max the element is elastic with the
    modulus that is left, so loading and unloading part on the first cycle only; nothing heals,
    and time and rate do not matter. The volumetric part is spared; stiffening and fibres of the
    law count in W and soften too. Isochoric stress that terms acting before this one remember is
    softened alike.

    The damage of a step acts in the next one: on first loading the stress is late by one step,
    an error of first order in its length; unloading and reloading are exact.
    Test: tissue/terms/test_stress_softening.py (cycles, dissipation, relaxing element)
    """

    damage: float = quantity(
        0.0, '', 'largest share of the shear modulus that can be lost', low=0.0, high=0.95,
        prior=('uniform', 0.0, 0.6), typical=0.3,
        source='engineering judgement; breast skin depends on its largest past stretch '
               '(Kumaraswamy et al. 2017, J Mech Behav Biomed Mater 74:164)', neutral=0.0)
    energy: float = quantity(
        50.0, 'Pa', 'energy density [J/m^3] at which 63 % of it is lost', low=0.1, high=1e6,
        prior=('lognormal', 50.0, 3.0),
        source='3/2 mu e^2 of the scenes (mu = 2 kPa) at a strain of e = 13 %, as near a pad')

    spec: ClassVar[TermSpec] = TermSpec(
        name='stress_softening', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='softer after the first loading (Mullins, preconditioning)',
        equation='S_iso -> (1 - D) S_iso;  D = damage (1 - exp(-W_max / energy)), '
                 'W_max(t) = max over s <= t of W(s)',
        source='Simo 1987, CMAME 60:153; Miehe 1995, Eur J Mech A/Solids 14:697 (this D); '
               'Holzapfel 2000, Nonlinear Solid Mechanics, ch. 6',
        invisible_when='the tissue has been strained further before the recording, or is loaded '
                       'only once and monotonously (then a softer law); hardly in positions where '
                       'it softens uniformly',
        leaves_open='the course of the damage with energy, and a threshold; recovery at rest; a '
                    'set that stays')

    def prepare(self, body):
        """Return `body` as it is: its moduli are those of tissue never strained."""
        return body

    def memory(self, body):
        """Return the largest energy density so far (m,) [J/m^3] of each element: none."""
        return np.zeros(len(body.mu))

    def before_step(self, body, memory, t, dt, fields):
        """Soften modulus and added stress in `fields` by the damage done until t - dt."""
        left = 1.0 + self.damage * np.expm1(-memory / self.energy)
        fields.scale_all_but_bulk(left)
        fields.stress *= left[:, None, None, None]

    def after_step(self, body, memory, x, t, dt):
        """Return the largest energy density so far (m,) [J/m^3], that at x (n, 3) [m] included."""
        return np.maximum(memory, isochoric_energy(body, x))


def isochoric_energy(body, x):
    """Return the energy density (m,) [J/m^3] but for the bulk modulus's, mean over each element.

    body : SoftBody, its own moduli;  x : (n, 3) [m], no element inverted
    """
    g, out = body.geometry, np.empty(len(body.mu))
    _mean_energy(np.ascontiguousarray(x, dtype=float), g.connectivity, g.gradients, g.weights,
                 body.mu, body.beyond, out)
    return out


@njit(cache=True, error_model='numpy')
def _mean_energy(x, conn, G, weights, mu, beyond, out):
    """Element loop of `isochoric_energy`: `material.energy` without kappa, arrays as `kernels`."""
    F, inv_T = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(mu)):
        total, volume = 0.0, 0.0
        for q in range(G.shape[1]):
            if weights[e, q] == 0.0:
                continue
            I1 = deformation_gradient(x, conn[e], G[e, q], F)
            excess = inverse_transpose(F, inv_T) ** (-2.0 / 3.0) * I1 - 3.0
            along = 0.0
            for i in range(3):
                along += (F[i, 0] * beyond[e, 2] + F[i, 1] * beyond[e, 3]
                          + F[i, 2] * beyond[e, 4]) ** 2
            total += weights[e, q] * (0.5 * mu[e] * excess + beyond[e, 0] * excess**2
                                      + 0.5 * beyond[e, 1] * (along - 1.0) ** 2)
            volume += weights[e, q]
        out[e] = total / volume
