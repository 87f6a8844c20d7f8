"""Parameters of the arm that holds the probe."""

import math
from dataclasses import dataclass, field
from typing import Literal

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.robot.force_torque import ForceTorqueParams
from arm_brachy.robot.impedance import ImpedanceParams
from arm_brachy.robot.reference import ReferenceParams
from arm_brachy.robot.scissor_parameters import ScissorHolderParams
from arm_brachy.robot.surface_scan import ScanParams
from arm_brachy.robot.switched import SwitchedParams

PERIOD = 1e-3        # s of the arm's own loop, of either holder: Franka Control Interface


@dataclass(frozen=True)
class ProbeArmParams:
    """Where the arm stands, how it holds the probe, and what it may do.

    probe_holder : the Panda, or the spherical scissor linkage of appendix A, which turns the probe
        about the centre of the body; `base`, `friction_known`, `switched` and all of `impedance`
        but the stiffness of the tissue are the Panda's, `scissor_rcm` is the linkage's
    strategy : move the probe over the skin, or turn it about its contact point
    control : impedance with force along the axis, or position and force in turns
    surface : from the scanner's cloud, or from the estimator's mesh
    """

    probe_holder: Literal['panda', 'scissor_rcm'] = 'panda'
    strategy: Literal['translational', 'orientation'] = 'translational'
    control: Literal['impedance', 'switched'] = 'impedance'
    surface: Literal['scan', 'model'] = 'scan'
    base: tuple = quantity((350.0, -350.0, -100.0), 'mm', "of the arm's base in W", shape=(3,),
                           source='own choice: beside the bed, across the needle, between pads')
    base_turn: float = quantity(135.0, 'deg', "from x of W to x of the arm's base, about z",
                                low=-180.0, high=180.0, source='own choice: faces the body')
    home: tuple = quantity((0.0, 0.0, 110.0), 'mm', "of the probe's face in W, at rest",
                           shape=(3,), source='own choice: two of its clearances off the skin')
    home_turn: float = quantity(45.0, 'deg', 'from x of W to y of the probe, about z', low=-180.0,
                                high=180.0, source='along the needle of the standard set-up')
    tool_mass: float = quantity(0.45, 'kg', 'of probe and holder', low=0.05, high=3.0,
                                source='4DL14-5/38 with a printed holder (own estimate)')
    tool_centre: tuple = quantity((0.0, 10.0, 60.0), 'mm', 'of that mass from the flange',
                                  shape=(3,), source='as above')
    tool_radius: float = quantity(30.0, 'mm', 'of the cylinder whose inertia it has', low=1.0,
                                  high=200.0, source='as above')
    tool_length: float = quantity(180.0, 'mm', 'from the flange to the face', low=20.0,
                                  high=400.0, source='as above')
    friction_known: float = quantity(0.8, '', "share of the joints' friction that the controller "
                                     'makes up for', low=0.0, high=1.0,
                                     source='own choice: friction changes with temperature')
    force: float = quantity(3.0, 'N', 'goal of the contact force along the axis', low=0.5,
                            high=15.0, source='breast ultrasound by robots: 2 to 5 N')
    rise: float = quantity(0.4, 's', 'from touch to 95 % of that goal', low=0.01, high=5.0,
                           source='own choice: recontact within half a second')
    approach_speed: float = quantity(20.0, 'mm_s', 'along the axis until the skin is touched',
                                     low=1.0, high=100.0,
                                     source='own choice: 0.3 N in a tick on 300 N/m')
    clearance: float = quantity(30.0, 'mm', 'off the skin, before contact and after', low=5.0,
                                high=200.0, source='own choice: above breathing and its error')
    zeroing: float = quantity(0.3, 's', 'over the skin before contact, in which the zero of the '
                              'sensor is taken once more', low=0.0, high=10.0,
                              source='own choice: 0.1 s to come to rest, and four times the 50 '
                                     'ms in which a drift of 0.1 N a minute outgrows noise of '
                                     '0.02 N at 1 kHz')
    search: float = quantity(15.0, 'mm', 'below the expected skin until contact is given up',
                             low=1.0, high=100.0, source='own choice: what pads move the skin')
    touch: float = quantity(0.3, 'N', 'that is contact', low=0.05, high=5.0,
                            source='15 standard deviations of the sensor')
    release: float = quantity(0.1, 'N', 'below which contact ends', low=0.01, high=5.0,
                              source='five of them')
    release_time: float = quantity(30.0, 'ms', 'for so long', low=1.0, high=1000.0,
                                   source='own choice')
    force_most: float = quantity(8.0, 'N', 'on the probe: it retracts', low=1.0, high=50.0,
                                 source='own choice: well above the goal, below what hurts')
    speed_most: float = quantity(250.0, 'mm_s', "of the probe's face", low=10.0, high=1700.0,
                                 source='ISO 10218-1, reduced speed beside people')
    reach: float = quantity(250.0, 'mm', 'radius about the origin of W that the face keeps to',
                            low=50.0, high=1000.0, source='own choice: body and room above it')
    floor: float = quantity(5.0, 'mm', 'lowest height of the face in W', low=-200.0, high=200.0,
                            source='own choice: chest wall')
    joint_margin: float = quantity(2.0, 'deg', 'from a joint limit', low=0.1, high=20.0,
                                   source='own choice: the limit of the interface stops the arm')
    joint_share: float = quantity(0.9, '', "of a joint's speed limit", low=0.1, high=1.0,
                                  source='own choice')
    side_rate: float = quantity(20.0, 'per_s', 'with which measured force across the axis is '
                                'carried', low=0.0, high=200.0,
                                source='own choice: below the bandwidth of the impedance')
    tip_memory: float = quantity(0.5, '', 'of the filter of the tip: 0 = the last sample alone',
                                 low=0.0, high=0.99, source='own choice: 50 ms samples')
    tip_patience: float = quantity(1.0, 's', 'without news of the tip until it retracts',
                                   low=0.05, high=60.0, source='own choice: 20 samples')
    hold_patience: float = quantity(5.0, 's', 'of a hold by the supervisor until it retracts',
                                    low=0.1, high=600.0, source='own choice')
    lost_patience: float = quantity(2.0, 's', 'without contact until it retracts', low=0.1,
                                    high=60.0, source='own choice: four times a recontact')
    brake_time: float = quantity(0.2, 's', 'between a stop and the retraction', low=0.0,
                                 high=5.0, source='from the largest speed at 2 m/s2, and as much')
    deepest: float = quantity(25.0, 'mm', 'into the skin as planned: it retracts', low=1.0,
                              high=100.0, source='own choice: twice that of 3 N on 300 N/m')
    steepest: float = quantity(30.0, 'deg', "between the skin's normal and the probe's axis",
                               low=5.0, high=80.0, source='own choice: beyond, a probe that '
                               'presses slides off')
    tilt: float = quantity(40.0, 'deg', 'largest turn of the orientation strategy', low=5.0,
                           high=80.0, source='own choice: half of the face still touches')
    tilting: float = quantity(20.0, 'deg_s', 'with which it turns to the tip after touch',
                              low=1.0, high=90.0, source='own choice: 0.1 N of force error')
    hole: float = quantity(10.0, 'mm', 'to the nearest known skin, from which on there is a hole',
                           low=1.0, high=100.0, source='two spacings of the scanned patches')
    impedance: ImpedanceParams = field(default_factory=ImpedanceParams)
    switched: SwitchedParams = field(default_factory=SwitchedParams)
    reference: ReferenceParams = field(default_factory=ReferenceParams)
    sensor: ForceTorqueParams = field(default_factory=ForceTorqueParams)
    scan: ScanParams = field(default_factory=ScanParams)
    scissor_rcm: ScissorHolderParams = field(default_factory=ScissorHolderParams)

    def __post_init__(self):
        """Refuse forces in the wrong order, and what the linkage cannot do. Raises ConfigError."""
        order = [(key, getattr(self, key)) for key in ('release', 'touch', 'force', 'force_most')]
        for (less, low), (more, high) in zip(order, order[1:], strict=False):
            if not low < high:
                raise ConfigError(f'probe: {less}_N = {low:g} with {more}_N = {high:g}; must be '
                                  'less: release_N < touch_N < force_N < force_most_N')
        far = math.hypot(*self.home)
        if far > self.reach or self.home[2] < self.floor:
            place = ', '.join(f'{1e3 * c:g}' for c in self.home)
            raise ConfigError(f'probe: home_mm = ({place}), {1e3 * far:.0f} mm from the origin; '
                              f'must be within reach_mm = {1e3 * self.reach:g} and not below '
                              f'floor_mm = {1e3 * self.floor:g}: the arm keeps to them')
        if self.probe_holder != 'scissor_rcm':
            return
        for key, only, why in (
                ('strategy', 'orientation', 'the linkage turns the probe about a centre and does '
                 'not carry it over the skin'),
                ('control', 'impedance', 'the scheme in turns needs an arm that moves freely')):
            given = getattr(self, key)
            if given != only:
                raise ConfigError(f'probe: {key} = {given!r} with probe_holder = '
                                  f"'scissor_rcm'; must be {only}: {why}")
