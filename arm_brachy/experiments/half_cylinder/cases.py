"""What was planted in each of the laboratory's recordings, and what of it an answer should say."""

from arm_brachy.experiments import laboratory
from arm_brachy.experiments.half_cylinder.bodies import ASIDE, RATIO, REMEMBERING
from arm_brachy.experiments.half_cylinder.layout import MM, E
from arm_brachy.experiments.half_cylinder.memory import SHARE, TAU
from arm_brachy.experiments.half_cylinder.mesh import LUMP
from arm_brachy.experiments.half_cylinder.recorder import Setup
from arm_brachy.experiments.told import ONSET, OUTSIDE


class Case(laboratory.Case):
    """One recording of the laboratory."""

    @property
    def modulus_kPa(self):
        """Young's modulus of the gel once what relaxes has relaxed."""
        relaxing = SHARE if self.body == REMEMBERING else 0.0
        return 1e-3 * E * self.setup.modulus * (1.0 - relaxing)


SLIP, SLIPS_AT = (0.42, 0.429, -0.36), 47.6                     # mm, s
JUMP, JUMPS_AT, FADES = (0.03, -0.04, 0.14), 44.3, 14.0         # N, s, s
YIELDING = 0.36
# True of every recording, by more than a careful laboratory leaves: no answer is wrong to say so.
BESIDE = ('clock_offset', 'em_offset')

CASES = (
    Case('null', Setup()),
    Case('null_stiffer', Setup(1.08)),
    Case('lump', Setup(0.97), 'lump', 'inclusion',
         truth={'ratio': RATIO, 'radius_mm': LUMP[1] / MM, 'centre_mm': tuple(LUMP[0] / MM)}),
    # a strip: the term's sector is round, so no size of it is right
    Case('loose_base', Setup(1.03), 'loose', 'base_debond'),
    Case('visco', Setup(1.05), REMEMBERING, 'viscoelasticity', truth={'g1': SHARE, 'tau1_s': TAU}),
    Case('slip_m4', Setup(0.96, slip=('m4', SLIPS_AT, tuple(MM * v for v in SLIP))),
         term='marker_slip', truth={'offset_mm': SLIP, 'onset_s': SLIPS_AT},
         place={'marker': 'm4'}),
    # across the push and the vertical, `side` of this pad is x
    Case('pad_aside', Setup(1.02, aside=ASIDE), 'aside', 'pad_misplacement',
         truth={'side_mm': ASIDE[1] / MM}, place={'pads': [ASIDE[0]]}),
    Case('force_jump', Setup(jump=('top', JUMPS_AT, JUMP, FADES)), term=OUTSIDE,
         truth={ONSET: JUMPS_AT}, place={'stream': 'force', 'channel': 'top'}),
    Case('hysteresis', Setup(1.04, hysteresis=YIELDING), term=OUTSIDE),
)
