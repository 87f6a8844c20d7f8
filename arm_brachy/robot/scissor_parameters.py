"""Parameters of the scissor linkage as holder of the probe.

The thesis has two actuated joints, theta_0 and theta_1, and a fixed end effector; its prototype
was measured without a body. What presses a probe on skin needs two more, on the carrier at the
linkage's end: a spin about the radius, which puts the image plane across the needle, and a stage
along the radius, which makes contact, force and retreat.
"""

from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.robot.scissor_rcm import ScissorParams

MOST_LINKS = 20      # of a branch; a carrier of more is softer than it is worth


@dataclass(frozen=True)
class ScissorHolderParams:
    """Where the linkage stands, and what its four joints may do; the linkage itself: `linkage`."""

    linkage: ScissorParams = field(default_factory=ScissorParams)
    centre: tuple = quantity((0.0, 0.0, -10.0), 'mm', 'of the sphere, in W: the probe turns about '
                             'it', shape=(3,), source='sphere fitted to the skin of breast.yaml, '
                                                      '1 mm rms')
    axis: tuple = quantity((1.0, -1.0, 0.8), '', 'from the centre to the first hinge, in W; any '
                           'length', shape=(3,), source='own choice: beside the bed, across the '
                           'needle, the skin halfway through the stroke of theta_1')
    density: float = quantity(7850.0, 'kg_m3', 'of the links', low=100.0, high=25000.0,
                              source='steel')
    swing: float = quantity(100.0, 'deg', 'largest theta_0 to either side of upright', low=1.0,
                            high=175.0, source='own choice: the hemisphere')
    spin: float = quantity(170.0, 'deg', 'largest spin to either side', low=1.0, high=179.0,
                           source='own choice: a cable goes along')
    farthest: float = quantity(160.0, 'mm', "of the probe's face from the centre", low=1.0,
                               high=2000.0, source='own choice: 30 mm beyond home')
    nearest: float = quantity(35.0, 'mm', "of the probe's face from the centre", low=1.0,
                              high=2000.0, source='own choice: 30 mm into the skin at most')
    turning_speed: float = quantity(60.0, 'deg_s', 'of theta_0, theta_1 and spin', low=0.1,
                                    high=720.0, source="own choice: as the arm's reference")
    turning_acceleration: float = quantity(600.0, 'deg_s2', 'of these', low=1.0, high=1e5,
                                           source='own choice: geared servo motors')
    stage_speed: float = quantity(100.0, 'mm_s', 'of the stage', low=0.1, high=1000.0,
                                  source='own choice: ball screw of 5 mm pitch, 1200 per minute')
    stage_acceleration: float = quantity(3.0, 'm_s2', 'of the stage', low=0.01, high=50.0,
                                         source='as above')
    bandwidth: float = quantity(30.0, 'Hz', 'of the position loop of every joint, critically '
                                'damped', low=1.0, high=150.0,
                                source='own choice: usual for a stiff geared servo')
    force_gain: float = quantity(50.0, 'mm_Ns', 'velocity of the stage for an error of force',
                                 low=0.1, high=1000.0, source='own choice: 15 per second on '
                                 '300 N/m; stable up to 1900 N/m with the bandwidth above')
    force_rate: float = quantity(3.0, 'per_s', 'of the integral, as a share of that gain',
                                 low=0.0, high=50.0, source='own choice: a fifth of the loop on '
                                 '300 N/m')

    def __post_init__(self):
        """Refuse what no linkage can be. Raises ConfigError."""
        link = self.linkage
        if not 2 <= link.links <= MOST_LINKS or link.links * link.beta > np.pi:  # noqa: PLR2004
            raise ConfigError(
                f'scissor_rcm: linkage: links = {link.links}, beta_deg = '
                f'{np.degrees(link.beta):g}; must be 2 to {MOST_LINKS} links that reach 180 deg '
                'at most together')
        if not self.nearest < self.farthest < link.radius:
            raise ConfigError(
                f'scissor_rcm: nearest_mm = {1e3 * self.nearest:g}, farthest_mm = '
                f'{1e3 * self.farthest:g}, linkage radius_mm = {1e3 * link.radius:g}; must '
                'increase: the probe stands between the centre and the linkage')
        if not np.any(self.axis):
            raise ConfigError(f'scissor_rcm: axis = {list(self.axis)}; must not be zero: it '
                              'points from the centre to the first hinge')
