"""Parameters of `pod`, apart from what computes with them: every process reads them.

Test: estimation/test_pod.py
"""

from dataclasses import dataclass, field
from typing import Literal

from arm_brachy.core.quantity import quantity, whole, word
from arm_brachy.estimation.unknowns import PriorParams


@dataclass(frozen=True)
class PodParams:
    """How the modes are made and what the measurement is believed to be."""

    # as many modes as the network of chapter 5 has latents
    modes: int = whole(26, 'of the displacement', low=1, high=1000)
    pushes: int = whole(16, "at which the unknowns' effects are computed", low=1, high=1000)
    reach: float = quantity(15.0, 'mm', 'deepest of these pushes', low=0.1, high=200.0,
                            source='effects are taken per metre of push: half a stroke')
    noise: float = quantity(0.09, 'mm', 'sd of a marker coordinate', low=1e-4, high=50.0,
                            source='optical tracker: 0.15 mm rms length over three axes')
    local: float = quantity(0.01, 'mm_per_mm', 'sd of what the modes leave of a point, per push',
                            low=0.0, high=1.0, source='fitted to plants outside the tables')
    floor: float = quantity(0.03, 'mm', 'the same without push', low=1e-4, high=10.0,
                            source='optical tracker: 0.025 mm rms of the random error')
    update: Literal['closed_form', 'es_mda'] = word('of the coordinates', default='closed_form')
    members: int = whole(100, 'of the ensemble; es_mda only', low=2)
    assimilations: int = whole(5, 'of one measurement; es_mda only', low=1)
    seed: int = 0                       # of the sampled pushes and the members
    # one prior for all kinds at once: narrower where map's holds for the one that is suspected
    prior: PriorParams = field(default_factory=lambda: PriorParams(
        fibres=0.05, base=0.25e-6, faces=0.0, load_places=0))
