"""What differs from the label in every case, a null one too, and is nobody's fault."""
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Nuisances:
    """modulus: true over labelled; touch (p,) travel at which pads meet the tissue [m];
    turn (3,) rotation vector [rad] and slide (3,) [m] of the optical frame; em_zero (3,) [m];
    force_zero (p, 3) [N].
    """

    modulus: float
    touch: np.ndarray
    turn: np.ndarray
    slide: np.ndarray
    em_zero: np.ndarray
    force_zero: np.ndarray

    def travel(self, u):
        """Travel (t, p) [m] of pads whose motors stand at u: less where they meet it later."""
        return u - self.touch

    def optical(self, points):
        """Positions (..., 3) in the optical frame of positions in the world frame."""
        turned = Rotation.from_rotvec(self.turn).apply(points.reshape(-1, 3))
        return turned.reshape(points.shape) + self.slide


def draw_nuisances(rng, pads):
    """Random `Nuisances` of a set-up with so many pads."""
    return Nuisances(
        modulus=float(rng.uniform(0.85, 1.15)),
        touch=rng.normal(0, 2e-4, pads),
        turn=rng.normal(0, np.deg2rad(0.3) / np.sqrt(3), 3),
        slide=rng.normal(0, 3e-4 / np.sqrt(3), 3),
        em_zero=rng.normal(0, 2e-4 / np.sqrt(3), 3),
        force_zero=rng.normal(0, 0.03, (pads, 3)))
