"""The topic map of `import bag`: which topic of a laboratory's own bag is what, in YAML.

Test: recording/test_import_bag.py
"""

from dataclasses import dataclass
from typing import Literal

from arm_brachy.core.quantity import quantity, word
from arm_brachy.recording.csv_map import ZEROS, Way

TOPIC = 'name of the topic'
ONE_EACH = ('name in the scene -> topic of its own: PoseStamped, PointStamped, TransformStamped')
FRAME = 'frame_id that is written'


@dataclass(frozen=True)
class BagEncoders:
    """sensor_msgs/JointState -> actuators/state."""

    topic: str = word(TOPIC)
    names: dict[str, str] = word('pad of the scene -> joint of the topic; left out, the joints '
                                 'are called as the pads', default_factory=dict)
    unit: Literal['m', 'cm', 'mm'] = word('of the positions; ROS has metres', default='m')
    reversed: tuple[str, ...] = word('pads whose joint falls as they are pushed in', default=())
    frame: str = word(FRAME, default='world')


@dataclass(frozen=True)
class BagForces:
    """geometry_msgs/WrenchStamped, one topic for each pad -> force/<pad>/wrench."""

    topics: dict[str, str] = word('pad of the scene -> topic')
    sign: Literal['on_tool', 'on_tissue'] = word('on what the force acts')
    unit: Literal['N', 'mN', 'kN', 'lbf', 'kgf'] = word('of the forces; ROS has newtons',
                                                        default='N')
    mounted: dict[str, tuple[Way, Way]] = word(
        'pad -> where x and z of the cell point, in the axes of the scene; cells left out have '
        'these axes', default_factory=dict)
    frame: str = word(FRAME, default='world')


@dataclass(frozen=True)
class BagPoints:
    """Markers -> optical/markers, or tools -> em/<tool>/pose and status."""

    topic: str = word('of all points: PoseArray or PointCloud2, with `order`; TFMessage, with '
                      '`names`; arm_brachy_msgs/OpticalFrame', default='')
    order: tuple[str, ...] = word('names in the scene of the points of a PoseArray or cloud, '
                                  'in their order; "" = a point that is left out', default=())
    names: dict[str, str] = word('name in the scene -> child_frame_id of a transform, or id of a '
                                 'marker', default_factory=dict)
    topics: dict[str, str] = word(ONE_EACH, default_factory=dict)
    unit: Literal['m', 'cm', 'mm'] = word('of the positions; ROS has metres', default='m')
    zeros: Literal['gap', 'place'] = word(ZEROS, default='gap')
    codes: tuple[float, ...] = word('numbers that mean "not measured", besides those that `keys '
                                    'columns` names', default=())
    frame: str = word(FRAME, default='world')


@dataclass(frozen=True)
class TopicMap:
    """One recording. Topics that are not named are not read."""

    name: str = word('of the recording, unless one is given at the import')
    clock: Literal['stamp', 'log'] = word(
        'stamp: times are those of the headers, at which things were measured; log: at which they '
        'were received, where headers have none', default='stamp')
    encoders: tuple[BagEncoders, ...] = ()
    forces: tuple[BagForces, ...] = ()
    optical: tuple[BagPoints, ...] = ()
    em: tuple[BagPoints, ...] = ()
    start: float = quantity(0.0, 's', 'added to every time of the recording')
    source: str = word('where it comes from, kept in the bag', default='')
