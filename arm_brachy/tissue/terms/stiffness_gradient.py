"""A modulus that changes steadily across the body."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.mesh import volumes


@dataclass(frozen=True)
class StiffnessGradient(BodyTerm):
    """Moduli times exp(g . (X - X0)), X0 the volume's centroid; Poisson's ratio stays.

    The logarithm is linear in position, so that moduli stay positive and two opposite gradients
    are mirror images. Each element takes the value at its centroid: second order in its size.
    Test: tissue/terms/test_stiffness_gradient.py (series bar, parallel bar)
    """

    gradient: tuple = quantity(
        [0.0, 0.0, 0.0], 'per_m', 'gradient of the logarithm of the modulus', shape=(3,),
        low=-200.0, high=200.0, prior=('normal', 0.0, 3.0), typical=5.6,
        source='40 % within half a breast phantom, ln 1.4 / 60 mm (engineering judgement: '
               'uneven curing or gland); limits wider', neutral=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='stiffness_gradient', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='modulus rises steadily across the body',
        equation='mu_e -> mu_e exp(g . (X_e - X_0)), kappa_e, c_e, k_e likewise;  X_e, X_0 '
                 'centroids of element and body',
        source='first order of any smooth logarithm of the modulus',
        invisible_when='only positions are recorded and the strain is uniform along the gradient '
                       '(parallel bar); with one pad it looks like a gain of its force sensor',
        leaves_open='the profile: two layers with an edge between them, or a modulus instead of '
                    'a logarithm that is linear')

    def prepare(self, body):
        """Return `body` with graded moduli."""
        centroids, volume = body.mesh.nodes[body.mesh.tets].mean(axis=1), volumes(body.mesh)
        centre = volume @ centroids / volume.sum()
        scale = np.exp((centroids - centre) @ np.array(self.gradient))
        return body.with_stiffness(scale)
