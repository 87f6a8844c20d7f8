"""A pad whose glue has gone: it pushes, does not pull, and slides against friction."""

from dataclasses import dataclass, replace
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.body import PadFootprint
from arm_brachy.tissue.terms.selection import chosen_pads, with_pad


@dataclass(frozen=True)
class PadSlip(BodyTerm):
    """Coulomb friction between pad and tissue in place of a bond (`contact`, `contact_pads`).

    Symbols: p pressure, t shear traction, v sliding velocity of the tissue on the pad, mu
    `friction`. The face of a bonded pad has the shape of the patch that it was bonded to, and
    touches all of it at rest; p acts along the pad's direction, t across it, which holds while
    the patch slides by less than it takes for its slope to change. A pad that touches already
    keeps its face and gets this coefficient.

    Large mu is not a bond: a pad that touches can never pull, so a pad that is retracted, or
    tissue that shrinks from it, shows the difference at any mu. Models of the controller bond
    every pad (`Pad.face`), so the term acts in the plant alone, in quasi-static motion.
    Test: tissue/terms/test_pad_slip.py (cone at every point, sliding force, stick as bonded)
    """

    friction: float = quantity(
        0.3, '', 'Coulomb coefficient between pad and tissue', low=0.0, high=5.0,
        prior=('lognormal', 0.3, 2.0), typical=0.3,
        source='0.2 to 0.5 of dry skin on smooth polymers, Derler & Gerhardt 2012, Tribol Lett '
               '45:1; a pad that never slips in the limit of large values', neutral=float('inf'))
    pads: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='pad_slip', kind=Kind.BOUNDARY, stage=Stage.BODY,
        summary='pads touch with friction instead of being bonded',
        equation='p >= 0, |t| <= mu p; |t| < mu p: v = 0; |t| = mu p: v = -s t, s >= 0',
        source='Coulomb friction: Alart & Curnier 1991, Comput Methods Appl Mech Eng 92:353; '
               'Wriggers 2006, Computational Contact Mechanics, sec. 5.2',
        invisible_when='mu itself while nothing slips: the recordings then only say that mu is '
                       'above the largest |t| / p; that a pad is not bonded shows as soon as it '
                       'leaves the tissue',
        leaves_open='friction that differs at rest and in motion, or wears off; adhesion')

    def prepare(self, body):
        """Return `body` with pads that touch.

        Raises ConfigError for a pad that the body does not have.
        """
        for i in chosen_pads(body, self.pads, self.spec.name):
            body = replace(body, pads=with_pad(body, i, self._loose(body.pads[i])))
        return body

    def _loose(self, pad):
        face = PadFootprint(self.friction) if pad.face is None else replace(
            pad.face, friction=self.friction)
        return replace(pad, face=face)
