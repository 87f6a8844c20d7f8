"""What a procedure with needle and probe left behind, ready to be evaluated."""

from dataclasses import dataclass, field

import numpy as np

from arm_brachy.evaluation.timeseries import Series


@dataclass(frozen=True)
class Frame:
    """One picture of the imager: (h, w, 3) uint8 with the template's holes and the tip marked."""

    t: float
    picture: np.ndarray


@dataclass(frozen=True)
class ArmPicture:
    """The cell at one instant: joints of the arm as a line (k, 3) [m], the probe's face.

    R, p : pose of the probe, (3, 3) and (3,) [m];  holes : (m, 3) [m] of the template
    shaft : (k, 3) [m] of the needle, template to tip
    """

    t: float
    line: np.ndarray
    R: np.ndarray
    p: np.ndarray
    holes: np.ndarray
    shaft: np.ndarray


@dataclass(frozen=True)
class ProcedureData:
    """A run of a procedure. World frame, SI; a part that was not recorded is None or empty.

    steps : (t [s], mapping) each time a step began: phase, outcome, why it is not OK, plan
    needle : Series of depth, speed, force as measured (n, 3)
    roll : Series (n,) [rad] of the needle's base
    tip, axis : Series (n, 3) of the true tip, and of the true direction there
    tip_told, tip_image : Series (n, 3) of it by depth and template, and found in the image
    target_image : Series (n, 3) of the target, located in the images
    probe, probe_told : Series (n, 12), rotation row by row and position, true and by encoders
    state : Series (n, 4) of phase, contact, force goal, distance of the tip from the image plane
    force : Series (n,) contact force of every period of the controller, by its own sensor
    contact : Series (n, 3) of the true force of the tissue on the probe, every tick
    joints, torque : Series (n, k) of the joints, of an evaluation those that turn
    frames : Frame, a few;  picture : ArmPicture or None
    shafts : t [s] -> (k, 3) [m] of the true needle, template to tip
    target : its name;  strategy, control, overlay : what ran
    """

    steps: tuple = ()
    needle: Series | None = None
    roll: Series | None = None
    tip: Series | None = None
    axis: Series | None = None
    tip_told: Series | None = None
    tip_image: Series | None = None
    target_image: Series | None = None
    probe: Series | None = None
    probe_told: Series | None = None
    state: Series | None = None
    force: Series | None = None
    contact: Series | None = None
    joints: Series | None = None
    torque: Series | None = None
    frames: tuple = ()
    picture: ArmPicture | None = None
    target: str = ''
    strategy: str = ''
    control: str = ''
    overlay: bool = False
    shafts: dict = field(default_factory=dict)

    def when(self, phase):
        """(start, end) [s] of a step, by the name of procedure_steps.Phase; None if none."""
        for i, (t, said) in enumerate(self.steps):
            if said.get('phase') == phase:
                later = [s for s, other in self.steps[i + 1:] if other.get('phase') != phase]
                return t, (later[0] if later else np.inf)
        return None

    @property
    def plan(self):
        """The mapping of the last step that has a plan, which may be made anew before the needle.

        Empty if none has.
        """
        return next((said for _, said in reversed(self.steps) if 'hole_m' in said), {})

    @property
    def message(self):
        """Why the outcome is not OK, '' if it is."""
        return self.steps[-1][1].get('message', '') if self.steps else ''

    @property
    def outcome(self):
        """Name of the outcome at the end."""
        return self.steps[-1][1].get('outcome', '') if self.steps else ''


def vector(text):
    """(k,) numbers of a text 'x y z ...'."""
    return np.array([float(word) for word in text.split()])


def sampled(series, t):
    """Values (n, ...) of the last sample at or before each time."""
    index = np.clip(np.searchsorted(series.t, t + 1e-9, side='right') - 1, 0, len(series.t) - 1)
    return series.values[index]
