"""What may be missing from the model of a body that is let go: terms, places, times, and how far.

Test: diagnosis/test_free_body.py
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantities
from arm_brachy.core.scene import Material
from arm_brachy.diagnosis.free_vibration.scenes import InScene, at_loads
from arm_brachy.diagnosis.model.hypothesis import Hypothesis, hypothesis
from arm_brachy.diagnosis.results.channels import whereabouts
from arm_brachy.diagnosis.selection.candidates import (
    BASE_PLACES,
    FIBRES,
    SOFTENING_ENERGIES,
    interior_places,
    surface_places,
)
from arm_brachy.tissue.mesh import volumes
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.base_compliance import BaseCompliance, base_areas
from arm_brachy.tissue.terms.base_debond import BaseDebond
from arm_brachy.tissue.terms.compressibility import Compressibility
from arm_brachy.tissue.terms.damping import Damping
from arm_brachy.tissue.terms.external_force import ExternalForce
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.point_mass import PointMass
from arm_brachy.tissue.terms.reference_shape import ReferenceShape
from arm_brachy.tissue.terms.skin_layer import SkinLayer
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient
from arm_brachy.tissue.terms.strain_stiffening import StrainStiffening
from arm_brachy.tissue.terms.stress_softening import StressSoftening
from arm_brachy.tissue.terms.swelling_drift import SwellingDrift
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

INSIDE, OUTSIDE = 20, 8     # places of an inclusion, of a force or a weight
# s: from what only damps to what only creeps, so near that a branch between two is either
TIMES = (0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.1, 2.0, 4.0, 8.0)
STEP = 0.1          # of the typical size, over which differences are taken
EARTH = (9.76, 9.85)    # m/s^2 on its ground (WGS 84: 9.780 to 9.832): then its size is known
YIELD = 0.1         # of what the body gives: prior of a base that gives, for any stiffness
LOOSE = 0.35        # of the side of a square base: radius where the glue may be gone
LONG = 1e5          # s, longer than any recording


@dataclass(frozen=True)
class Free:
    """One way in which a term may act on a released body.

    hypothesis : Hypothesis;  step : amplitude over which differences are taken
    prior : (k,) standard deviations of its amplitudes;  scene : name of the only one, '' = all
    """

    hypothesis: Hypothesis
    step: float
    prior: np.ndarray
    scene: str = ''

    @property
    def key(self):
        """(term, variant): the same for the same place in every specimen of one body."""
        where = whereabouts(self.hypothesis.cls, self.hypothesis.place, ())
        scene = f'scene {self.scene}' if self.scene else ''
        return self.hypothesis.name, ', '.join(filter(None, (where, scene)))

    def term(self, amplitudes):
        """The term with amplitudes (k,); a scenes.InScene where it acts in one alone."""
        term = self.hypothesis.term(amplitudes)
        return InScene(term, self.scene) if self.scene else term

    def alone(self, k, amplitude):
        """As `term`, strength k at `amplitude` and the others off."""
        return self.term(amplitude * (np.arange(len(self.prior)) == k))

    def allows(self, amplitudes):
        """True if every parameter (SI) lies within the bounds of its declaration."""
        infos = quantities(self.hypothesis.cls)
        return all(_bounded(strength, infos[strength.name], a) for strength, a in zip(
            self.hypothesis.strengths, amplitudes, strict=True))


def _bounded(strength, info, amplitude):
    if not np.isfinite(strength.neutral):
        return amplitude >= 0.0
    value = strength.value(amplitude) / info.scale
    low, high = (np.inf if edge is None else edge for edge in (info.low, info.high))
    return (info.low is None or value >= low) and value <= high


def free_hypotheses(specimen, scenes=()):
    """Return a tuple of Free on a specimen.Specimen without pads.

    scenes : core.scene.Scene in which it was let go, whose loads may be others than they say
    The modulus is a nuisance and no cause. Of gravity only the direction is in question where the
    scene has that of the Earth, whose size is known to 0.3 %. Of another size it may be what is
    wrong: how far a body sags goes with it, how fast it rings does not. Terms of pads and
    of rhythms have nothing to act on.
    """
    places = [('centre', tuple(c)) for c in interior_places(specimen.mesh, INSIDE)]
    outside = [('centre', tuple(c)) for c in surface_places(specimen, OUTSIDE, base=False)]
    under = [('centre', tuple(c)) for c in _under(specimen)]
    out = [_free(hypothesis(cls)) for cls in (
        Compressibility, StiffnessGradient, SkinLayer, StrainStiffening, Damping, StiffnessDrift,
        SwellingDrift)]
    out += [_free(hypothesis(ReferenceShape, ('height', 'width'))), _gravity(specimen)]
    out += [_free(hypothesis(Anisotropy, azimuth=np.radians(a), elevation=np.radians(e)))
            for a, e in FIBRES]
    out += [_free(hypothesis(StressSoftening, energy=e * _stiffness(specimen)))
            for e in SOFTENING_ENERGIES]
    out += [_free(hypothesis(Inclusion, **dict([place]))) for place in places]
    out += [_free(hypothesis(ExternalForce, duration=LONG, **dict([place]))) for place in outside]
    out += _hanging(scenes, outside)
    out += [_loose(specimen, place) for place in under]
    if under:
        out.append(_yielding(specimen))
    return (*out, *relaxations(TIMES))


def relaxations(times):
    """One relaxing branch at each of `times` [s], and every pair of two that lie well apart."""
    one = [_free(hypothesis(Viscoelasticity, ('g1',), tau1=tau)) for tau in times]
    two = [_free(hypothesis(Viscoelasticity, ('g1', 'g2'), tau1=a, tau2=b))
           for a, b in combinations(times, 2) if b > 5.0 * a]
    return (*one, *two)


def _free(hypothesis, step=STEP):
    return Free(hypothesis, step, np.array([s.spread for s in hypothesis.strengths]))


def _stiffness(specimen):
    """Modulus over that of the tissue for which typical sizes are declared."""
    return specimen.scene.material.E / Material().E


def _under(specimen):
    try:
        return surface_places(specimen, BASE_PLACES, base=True)
    except (ConfigError, ValueError, IndexError):
        return np.zeros((0, 3))


def _gravity(specimen):
    g = np.asarray(specimen.scene.gravity, dtype=float)
    full = hypothesis(Gravity)
    size = float(np.linalg.norm(g))
    if not EARTH[0] <= size <= EARTH[1]:
        return _free(full)
    across = tuple(s for s in full.strengths if abs(g[s.component]) < 0.5 * size)
    return _free(Hypothesis(Gravity, {}, across))


def _hanging(scenes, outside):
    """Another weight where scenes have one, in all of them or in one; else one somewhere outside.
    """
    one = [_free(hypothesis(PointMass, **dict([place])))
           for place in [('centre', where) for where in at_loads(scenes)] or outside]
    return [*one, *(replace(free, scene=name) for free in one if len(named := at_loads(
        scenes).get(free.hypothesis.place['centre'], ())) > 1 for name in named)]


def _loose(specimen, place):
    """Glue that is gone over a share of the base; a smaller patch may hold no node at all."""
    free = hypothesis(BaseDebond, **dict([place]))
    size = LOOSE * float(np.sqrt(np.linalg.norm(
        base_areas(specimen.mesh, specimen.body.fixed).vectors, axis=1).sum()))
    step = min(1.0, size / free.strengths[0].typical)
    return Free(free, step, np.array([step]))


def _yielding(specimen):
    """A base that gives by some share of what the body over it does."""
    free = hypothesis(BaseCompliance)
    length = float(volumes(specimen.mesh).sum()) ** (1.0 / 3.0)
    share = YIELD * length / specimen.scene.material.E
    prior = np.array([share * s.typical for s in free.strengths])
    return Free(free, float(prior[0]), prior)
