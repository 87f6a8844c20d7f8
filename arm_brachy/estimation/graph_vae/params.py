"""Parameters of the GNN-VAE estimator, without torch: every scenario reads them."""

from dataclasses import dataclass
from typing import Literal

from arm_brachy.core.quantity import quantity, whole, word
from arm_brachy.estimation.es_mda import EsMdaOptions


@dataclass(frozen=True)
class GraphVaeParams:
    """What the estimator believes of its measurement, and how it samples."""

    weights: str = word('file that `arm-brachy train` wrote; empty = the one shipped for the '
                        'scene', default='')
    prior: Literal['model', 'travel'] = word('whose state the members are drawn around',
                                             default='model')
    members: int = whole(EsMdaOptions.members, 'of the ensemble', low=2)
    assimilations: int = whole(EsMdaOptions.assimilations, 'of one measurement', low=1)
    inflation: float = EsMdaOptions.inflation
    localised: bool = EsMdaOptions.localised
    seed: int = 0
    noise: float = quantity(0.09, 'mm', 'sd of a marker coordinate', low=1e-4, high=50.0,
                            source='optical tracker: 0.15 mm rms length over three axes')
    local: float = quantity(0.02, 'mm_per_mm', 'sd of what the network leaves of a point, per '
                            'push', low=0.0, high=1.0,
                            source='reconstruction of test states over their push')
    floor: float = quantity(0.03, 'mm', 'the same without push', low=1e-4, high=10.0,
                            source='optical tracker: 0.025 mm rms of the random error')
    # sd of the prior over that of the training states about what travel says of them: a plant
    # differs from the model in one way, the states in up to six. Like `local` the value of least
    # negative log predictive density on fresh plants (README, "Sizes of the estimator").
    spread: float = 0.4
