"""What may act on the plant besides its pads: an ultrasound probe and a needle.

They are instruments with poses of their own, given tick by tick, not properties of the tissue:
therefore no terms of the registry, which the diagnosis tries one by one on recordings of bodies
that no needle ever entered.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.tissue.contact import ContactLaw
from arm_brachy.tissue.needle_beam import NeedleBeam
from arm_brachy.tissue.needle_load import NeedleLaw
from arm_brachy.tissue.needle_path import NeedleInTissue
from arm_brachy.tissue.probe_contact import GEL
from arm_brachy.tissue.probe_face import ProbeFace
from arm_brachy.tissue.probe_reading import ProbeReading


@dataclass(frozen=True)
class Instruments:
    """What a plant has.

    probe : probe_face.ProbeFace;  needle : NeedleLaw of a needle outside the tissue; None = none
    beam : NeedleBeam of that needle; None = it neither bends nor feels the tissue sideways
    layer : contact.ContactLaw between probe and skin
    """

    probe: ProbeFace | None = None
    needle: NeedleLaw | None = None
    beam: NeedleBeam | None = None
    layer: ContactLaw = GEL


@dataclass(frozen=True)
class Tools:
    """Where they are at the end of a step, world frame.

    probe : (R (3, 3), p (3,) [m]) of the middle of its face, None = away from the body
    needle : NeedleInTissue, None = outside
    """

    probe: tuple[np.ndarray, np.ndarray] | None = None
    needle: NeedleInTissue | None = None


IDLE = Tools()


@dataclass(frozen=True)
class Felt:
    """What they feel.

    probe : ProbeReading or None;  needle_force : [N] of the tissue along the needle
    shaft : (k, 3) [m] of the needle as it is bent, template to tip, None = outside
    """

    probe: ProbeReading | None = None
    needle_force: float = 0.0
    shaft: np.ndarray | None = None
