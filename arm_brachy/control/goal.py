"""What an operator asks of the manipulator: a target, where it should go, which axes matter."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from arm_brachy.core.errors import CommandRefused


class GoalKind(Enum):
    """How `Goal.value` is meant."""

    DISPLACEMENT = 'displacement from where the model has the target at rest'
    POSITION = 'position in the world frame'


@dataclass(frozen=True)
class Goal:
    """Where one target should go.

    target : name of a target of the scene
    value : (3,) [m], world frame; entries on free axes are ignored
    kind : displacement from where the model has the target at rest, or absolute position
    axes : which world axes are controlled; False = relaxed, as y is in task 1 of sec. 3.4.2
    Raises CommandRefused where a controlled entry is not finite or no axis is controlled.
    """

    target: str
    value: tuple
    kind: GoalKind = GoalKind.DISPLACEMENT
    axes: tuple = (True, True, False)

    def __post_init__(self):
        """Refuse at once what no controller could act on."""
        if len(self.value) != 3 or len(self.axes) != 3:
            raise CommandRefused(f'goal for {self.target}: got value {self.value} and axes '
                                 f'{self.axes}; each must have 3 entries (x, y, z)')
        if not any(self.axes):
            raise CommandRefused(f'goal for {self.target}: no axis is controlled; name at least '
                                 'one of x, y, z')
        wrong = [a for a, v, on in zip('xyz', self.value, self.axes, strict=True)
                 if on and not np.isfinite(v)]
        if wrong:
            raise CommandRefused(f'goal for {self.target}: {wrong[0]} = '
                                 f'{self.value["xyz".index(wrong[0])]}; must be a finite number')

    @property
    def mask(self):
        """(3,) bool, True on controlled axes."""
        return np.array(self.axes, dtype=bool)

    def position(self, rest):
        """Goal position (3,) [m], world frame, equal to `rest` on free axes.

        rest : (3,) [m] where the model has the target with no pad pushing
        """
        rest, value = np.asarray(rest, dtype=float), np.array(self.value, dtype=float)
        if self.kind is GoalKind.DISPLACEMENT:
            value = rest + value
        return np.where(self.mask, value, rest)


def task(number, target, distance=5e-3):
    """Return one of the three tasks of sec. 3.4.2 as a Goal.

    number : 1 (along -x, y free), 2 (along -y, x free) or 3 (along +x and +y)
    target : name;  distance : [m] along each controlled axis, 5 mm as published
    z is free in all three: pads of one plane have no authority over it.
    """
    direction, axes = _TASKS[number]
    return Goal(target, tuple(distance * d for d in direction), axes=axes)


_TASKS = {
    1: ((-1.0, 0.0, 0.0), (True, False, False)),
    2: ((0.0, -1.0, 0.0), (False, True, False)),
    3: ((1.0, 1.0, 0.0), (True, True, False)),
}
