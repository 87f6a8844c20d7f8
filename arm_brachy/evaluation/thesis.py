"""Published numbers that ours are set beside, copied as printed."""

import math
from dataclasses import dataclass

CITATION = ('M. Afshar, The Development of an Autonomous Robotic Surgical Framework for Breast '
            'Brachytherapy, PhD thesis, University of Alberta, Table 3.1')


@dataclass(frozen=True)
class Manipulation:
    """One row of Table 3.1, theirs or ours.

    target : 1-5;  task : 1-3 (5 mm along -x, along -y, along +x and +y; thesis sec. 3.4.2)
    open_loop_itae_mm_s2, closed_loop_itae_mm_s2 : (3.30). The thesis prints no unit; mm s^2 is
        the one that fits: a steady error e held for T leaves e T^2 / 2, and with the printed
        errors in mm that gives T between 30 and 60 s in every row.
    open_loop_steady_state_error_mm, closed_loop_steady_state_error_mm : distance of the final
        position from the desired one. The thesis prints none for closed loop (NaN), only that it
        is minimal.
    """

    target: int
    task: int
    open_loop_itae_mm_s2: float
    closed_loop_itae_mm_s2: float
    open_loop_steady_state_error_mm: float
    closed_loop_steady_state_error_mm: float = math.nan


TABLE_3_1 = (
    Manipulation(1, 1, 403.40, 193.23, 0.66),
    Manipulation(1, 2, 342.52, 117.22, 0.36),
    Manipulation(1, 3, 910.17, 231.02, 0.92),
    Manipulation(2, 1, 1172.6, 155.61, 1.64),
    Manipulation(2, 2, 1046.8, 144.67, 1.47),
    Manipulation(2, 3, 931.33, 260.22, 1.35),
    Manipulation(3, 1, 1201.12, 604.45, 2.42),
    Manipulation(3, 2, 752.62, 171.21, 0.46),
    Manipulation(3, 3, 1319.85, 297.01, 1.88),
    Manipulation(4, 1, 1112.89, 285.3, 1.37),
    Manipulation(4, 2, 986.23, 195.67, 1.12),
    Manipulation(4, 3, 1360.5, 521.61, 1.93),
    Manipulation(5, 1, 1036.10, 350.21, 2.1),
    Manipulation(5, 2, 1205.37, 270.9, 1.4),
    Manipulation(5, 3, 1112.34, 130.71, 1.61),
)


def published_task(target, task):
    """The row of Table 3.1 for target 1-5 and task 1-3; KeyError if there is none."""
    return {(row.target, row.task): row for row in TABLE_3_1}[target, task]
