"""Swelling or drying: the stress-free shape grows or shrinks during the run."""

from dataclasses import dataclass
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.terms.stiffness_drift import drift


@dataclass(frozen=True)
class SwellingDrift(BodyTerm):
    """Every line of the stress-free body times a stretch that grows or falls from `onset` on.

    The same everywhere and in all directions, as where uptake or loss is slow against diffusion.
    What is free to swell does so without stress; what is held back pushes. Moduli per current
    stress-free volume and weight stay: the water that comes or goes is not weighed, nor does it
    soften (`stiffness_drift` does).
    Test: tissue/terms/test_swelling_drift.py (free block, clamped bar, enclosed block, markers)
    """

    rate: float = quantity(
        0.0, 'per_min', 'relative change of length per time', low=-0.5, high=0.5,
        prior=('normal', 0.0, 0.01), typical=0.015,
        source='engineering judgement: 1 mm of 60 mm in a minute, a gel phantom in air, water or '
               'warmth; limits wider', neutral=0.0)
    onset: float = quantity(
        0.0, 's', 'when the drift begins', low=0.0, high=1e5, prior=('uniform', 0.0, 60.0),
        source='the start of the run, or any time in its first minute')

    spec: ClassVar[TermSpec] = TermSpec(
        name='swelling_drift', kind=Kind.TISSUE, stage=Stage.BODY, timed=True,
        summary='tissue swells or dries during the run',
        equation='Psi(F) -> s^3 Psi(F / s);  s = 1 + r, or 1 / (1 - r) where r < 0, '
                 'r = rate max(t - onset, 0)',
        source='multiplicative growth F = F_e s I: Rodriguez, Hoger & McCulloch 1994, J Biomech '
               '27:455',
        invisible_when='the run is short against 0.1 mm / (rate x height); a scale of the '
                       'optical tracker that drifts moves markers alike',
        leaves_open='the course over time; a shell that dries before the inside does')

    def prepare(self, body):
        """Return `body` as it is: the scene's shape is that before the onset."""
        return body

    def memory(self, body):
        """Return the stretch reached, 1. Not None, so that it grows from substep to substep."""
        return 1.0

    def before_step(self, body, memory, t, dt, fields):
        """Swell the stress-free shape in `fields` to that at t."""
        fields.swelling *= drift(self.rate, self.onset, t)

    def after_step(self, body, memory, x, t, dt):
        """Return the stretch at t."""
        return drift(self.rate, self.onset, t)
