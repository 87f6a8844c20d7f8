"""A named cause: a term of the registry with its parameters and how sure they are."""

import dataclasses
import re
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from arm_brachy import registry
from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import UNITS, quantities, quantity
from arm_brachy.core.term import Kind, Stage, TermSpec


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its 90 % interval, SI; all three floats, or all three (3,).

    An end that is not known is infinite.
    """

    value: float | tuple
    low: float | tuple
    high: float | tuple

    def __post_init__(self):
        value, low, high = (np.asarray(v, dtype=float) for v in (self.value, self.low, self.high))
        if not value.shape == low.shape == high.shape:
            raise InputError(f'estimate of shapes {value.shape}, {low.shape}, {high.shape}; value '
                             'and ends of the interval must have one shape')
        if not (np.all(low <= value) and np.all(value <= high)):
            raise InputError(f'estimate {self.value} outside its interval {self.low} to '
                             f'{self.high}; must lie in it')

    @classmethod
    def unsure(cls, value):
        """The Estimate of a value (float or (3,)) that was given and not fitted: no ends known."""
        value = np.asarray(value, dtype=float)
        return cls(*(tuple(map(float, part)) if value.ndim else float(part)
                     for part in (value, value - np.inf, value + np.inf)))


@dataclass(frozen=True)
class Discretisation:
    """The mesh, not the tissue, is at fault; no term that a scenario could switch on."""

    error: float = quantity(0.0, 'mm', 'displacement that a finer mesh changes', low=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='discretisation', kind=Kind.NUMERICS, stage=Stage.BODY,
        summary='the mesh is too coarse for these data',
        equation='u_h -> u as h -> 0;  the error is what other meshes of the body give otherwise',
        source='spread of the solution over an ensemble of meshes and elements')


@dataclass(frozen=True)
class Cause:
    """One thing that the model lacks.

    term : name in the registry, or 'discretisation'
    parameters : field of the term -> Estimate;  fields left out keep the term's default
    applies_to : field -> value of those that only select ('pads', 'actuators', 'marker', ...)
    probability : after the data, 0 to 1;  option : 0 = it holds; causes of one other number hold
        together, and of the numbers one
    scenes : names of the scenes in which alone it acts, of recordings of several; () = in all
    Raises InputError for a term or parameter that does not exist, and for a probability outside
    its range.
    """

    term: str
    parameters: dict = field(default_factory=dict)
    applies_to: dict = field(default_factory=dict)
    probability: float = 1.0
    option: int = 0
    scenes: tuple = ()

    def __post_init__(self):
        fields = {f.name for f in dataclasses.fields(self.declared)}
        scaled = set(quantities(self.declared))
        if odd := set(self.parameters) - scaled:
            raise InputError(f'{self.term}: parameter {", ".join(sorted(odd))}; must be of '
                             f'{", ".join(sorted(scaled))}')
        if odd := set(self.applies_to) - (fields - scaled):
            raise InputError(f'{self.term}: applies to {", ".join(sorted(odd))}; must be of '
                             f'{", ".join(sorted(fields - scaled)) or "nothing"}')
        if not 0.0 <= self.probability <= 1.0:
            raise InputError(f'{self.term}: probability {self.probability:g}; must be 0 to 1')

    @property
    def declared(self):
        """The dataclass that declares the parameters."""
        return Discretisation if self.term == 'discretisation' else registry.by_name(self.term)

    @property
    def spec(self):
        """TermSpec: what it is, its equation, its source."""
        return self.declared.spec

    @property
    def symbols(self):
        """What the symbols of the equation mean, as the term documents it; '' if it does not."""
        found = re.search(r'Symbols: (.+?)\.\s', self.declared.__doc__ or '', re.DOTALL)
        return '' if found is None else ' '.join(found[1].replace('`', '').split())

    @property
    def physical(self):
        """False if the mesh is at fault and not the physics."""
        return self.spec.kind is not Kind.NUMERICS

    def build(self):
        """The term with these values, as a scenario would switch it on."""
        return self.declared(**{name: _value(one.value) for name, one in self.parameters.items()},
                             **self.applies_to)

    def shown(self):
        """Rows (name, meaning, unit as printed, value, low, high), values in edge units."""
        infos = quantities(self.declared)
        return tuple((name, infos[name].text, UNITS[infos[name].unit][1],
                      *(infos[name].to_edge(v) for v in (one.value, one.low, one.high)))
                     for name, one in self.parameters.items())


def _value(value):
    return tuple(float(v) for v in value) if np.ndim(value) else float(value)
