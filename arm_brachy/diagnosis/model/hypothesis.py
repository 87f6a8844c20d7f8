"""A hypothesis: one term of the registry somewhere, with the strengths that scale its effect.

Test: diagnosis/forward/test_candidates.py
"""

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.quantity import quantities

LOOSENING = ('pad_slip',)   # condensed; beside terms with memory minutes of runs with contact

FAINT = 1e6     # times the typical value: as good as infinite where a parameter has no bound
# Strength -> field of the place that it alone depends on, in terms that have that field: it is
# free only where that is given.
TIED = {'bump_height': 'bump_centre', 'g1': 'tau1', 'g2': 'tau2', 'pull': 'metal',
        'gradient': 'pad', 'rotation': 'pad', 'pad_coupling': 'pad'}


@dataclass(frozen=True)
class Strength:
    """One number that scales an effect, in units of the typical size: 0 = off, 1 = typical.

    name : field of the term;  component : of a vector, or None;  neutral, typical : SI
    high : SI, what stands for an infinite `neutral`
    spread : standard deviation of the prior, in typical sizes; 1 where it is lognormal
    one_sided : True if limits leave no negative amplitude: nothing relaxes or sticks less than
        nothing does
    """

    name: str
    component: int | None
    neutral: float
    typical: float
    high: float
    spread: float = 1.0
    one_sided: bool = False

    def value(self, amplitude):
        """The parameter (SI) at an amplitude: linear, or inversely where off means infinite."""
        if np.isfinite(self.neutral):
            return self.neutral + amplitude * (self.typical - self.neutral)
        least = self.typical / self.high
        return self.typical / max(amplitude, least)

    @property
    def label(self):
        """Name, with the axis of a vector."""
        return self.name if self.component is None else f'{self.name}_{"xyz"[self.component]}'


def strengths(cls):
    """Return the Strengths of a term class, vectors component by component."""
    out = []
    defaults = {f.name: f.default for f in dataclasses.fields(cls)}
    for name, info in quantities(cls).items():
        if info.neutral is None:
            continue
        neutral, typical = info.scale * info.neutral, info.scale * _typical(info)
        default = np.linalg.norm(np.atleast_1d(defaults[name]))
        if info.typical is None and np.isfinite(neutral) and not info.shape and (
                abs(default - neutral) > 1e-12):
            typical = float(defaults[name])
        high = FAINT * typical if info.high is None else info.scale * info.high
        spread = info.scale * _sd(info) / abs(typical - neutral) if _sd(info) else 1.0
        out += [Strength(name, i, neutral, typical, high, spread, _one_sided(info))
                for i in (range(3) if info.shape else (None,))]
    return tuple(out)


def _one_sided(info):
    """True if a quantity is off at its limit, or where it is infinite."""
    return not np.isfinite(info.neutral) or info.neutral in (info.low, info.high)


def _sd(info):
    """Standard deviation of a prior that is not lognormal, edge unit; None for those."""
    if info.prior is None or info.prior[0] == 'lognormal':
        return None
    kind, a, b = info.prior
    return b if kind == 'normal' else (b - a) / np.sqrt(12.0)


def _typical(info):
    """Typical size in the edge unit: declared, or the width of the prior."""
    if info.typical is not None:
        return info.typical
    kind, a, b = info.prior
    return {'uniform': 0.5 * (a + b) if a >= 0.0 else 0.5 * b, 'normal': b, 'lognormal': a}[kind]


@dataclass(frozen=True)
class Hypothesis:
    """A term class with its place fixed.

    cls : from registry.TERMS;  place : field -> SI value for what says where, when or how
    strengths : those that are free; all others of the class are neutral
    only : number of the recording in which it happened, None = in any
    size : amplitude at which its response is taken, where no tangent leads there
    """

    cls: type
    place: dict = field(default_factory=dict)
    strengths: tuple = ()
    only: int | None = None
    size: float = 1.0

    @property
    def name(self):
        """Name of the term."""
        return self.cls.spec.name

    def term(self, amplitudes):
        """Return the term with amplitudes (k,), one per strength.

        Raises ConfigError where the term refuses such values.
        """
        values = {}
        given = {(s.name, s.component): a
                 for s, a in zip(self.strengths, amplitudes, strict=True)}
        for strength in strengths(self.cls):
            value = strength.value(given.get((strength.name, strength.component), 0.0))
            if strength.component is None:
                values[strength.name] = value
            else:
                values[strength.name] = (*values.get(strength.name, ()), value)
        return self.cls(**{**values, **self.place})

    def acts_in(self, number):
        """True if it acts in the recording of a number, None = one that was not fitted."""
        return self.only is None or self.only == number

    def alone(self, k, amplitude):
        """Return the term with strength k at `amplitude` and the others off."""
        return self.term(amplitude * (np.arange(len(self.strengths)) == k))

    def same_alone(self, k):
        """What `alone` of strength k depends on but its amplitude, hashable; None = all there is.

        A bump has a place, the height of the body beside it is the same at each.
        """
        one = self.strengths[k]
        others = {tie_of(self.cls, s.name) for s in strengths(self.cls)} - {
            None, tie_of(self.cls, one.name)}
        if not others:
            return None
        return (self.cls, one.name, one.component,
                tuple(sorted((f, v) for f, v in self.place.items() if f not in others)))


def tie_of(cls, strength):
    """The field of a term class that a strength of this name is `TIED` to; None = to none."""
    field = TIED.get(strength)
    return field if field in cls.__dataclass_fields__ else None


def hypothesis(cls, names=None, **place):
    """Return the Hypothesis of a term class with the strengths called `names`, None = all."""
    chosen = tuple(s for s in strengths(cls) if names is None or s.name in names)
    return Hypothesis(cls, place, chosen)
