"""The face of an ultrasound probe, as the tissue feels it."""

from dataclasses import dataclass

from arm_brachy.core.quantity import quantity
from arm_brachy.tissue.contact_shapes import RoundedBox


@dataclass(frozen=True)
class ProbeFace:
    """Rigid face of a linear transducer: rectangle with rounded edges, z out of it, x along it.

    Across the elements it is rounded over most of its width, as housings are; what lies between
    the roundings is flat.
    """

    width: float = quantity(38.0, 'mm', 'along the elements', low=1.0, high=200.0,
                            source='38 mm footprint of linear transducers for breast and small '
                                   'parts, such as L14-5/38')
    thickness: float = quantity(10.0, 'mm', 'across the elements', low=1.0, high=100.0,
                                source='housing of the same')
    edge_radius: float = quantity(4.5, 'mm', 'of the rounded edges', low=0.1, high=50.0,
                                  source='housing of the same (own estimate)')
    friction: float = quantity(0.1, '', 'Coulomb coefficient on the skin', low=0.0, high=2.0,
                               source='skin under ultrasound gel is all but lubricated; 0.1 is '
                                      'our own choice')
    strips: int = 12    # equal parts along the elements for which the pressure is reported

    def __post_init__(self):
        RoundedBox(self.width, self.thickness, self.edge_radius)  # refuses what has no flat left

    @property
    def shape(self):
        """The contact_shapes.RoundedBox."""
        return RoundedBox(self.width, self.thickness, self.edge_radius)
