"""The explicit list of physics terms: what the plant can switch on and what can be diagnosed.

A new effect is one file, its test and one line in TERMS. Nothing is discovered, nothing registers
itself.
"""

import copy
import dataclasses
import difflib

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.core.term import Kind, Stage
from arm_brachy.devices.terms.actuator_compliance import ActuatorCompliance
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.actuator_lag import ActuatorLag
from arm_brachy.devices.terms.axis_crosstalk import AxisCrosstalk
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.devices.terms.clock_offset import ClockOffset
from arm_brachy.devices.terms.em_distortion import EmDistortion
from arm_brachy.devices.terms.em_offset import EmOffset
from arm_brachy.devices.terms.force_drift import ForceDrift
from arm_brachy.devices.terms.force_gain import ForceGain
from arm_brachy.devices.terms.lost_steps import LostSteps
from arm_brachy.devices.terms.marker_slip import MarkerSlip
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.tissue.terms.anisotropy import Anisotropy
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.base_debond import BaseDebond
from arm_brachy.tissue.terms.breathing import Breathing
from arm_brachy.tissue.terms.compressibility import Compressibility
from arm_brachy.tissue.terms.damping import Damping
from arm_brachy.tissue.terms.external_force import ExternalForce
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.obstacle import Obstacle
from arm_brachy.tissue.terms.pad_misplacement import PadMisplacement
from arm_brachy.tissue.terms.pad_slip import PadSlip
from arm_brachy.tissue.terms.point_mass import PointMass
from arm_brachy.tissue.terms.reference_shape import ReferenceShape
from arm_brachy.tissue.terms.skin_layer import SkinLayer
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.stiffness_gradient import StiffnessGradient
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale
from arm_brachy.tissue.terms.strain_stiffening import StrainStiffening
from arm_brachy.tissue.terms.stress_softening import StressSoftening
from arm_brachy.tissue.terms.swelling_drift import SwellingDrift
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

# Order is the order of application.
TERMS = (
    # The mesh slides under a pad before its shape changes; what is placed in the body or on it
    # is placed in its true shape.
    PadMisplacement, ReferenceShape,
    StiffnessScale, Compressibility, StiffnessGradient, SkinLayer, Inclusion,
    StrainStiffening, Anisotropy,
    Gravity, PointMass, Damping,
    # Memory: what softens or drifts, does so together with what is remembered.
    Viscoelasticity, StressSoftening, StiffnessDrift, SwellingDrift,
    # A skin ends at the fixed base, so supports give way after it; glue that is left then yields.
    Obstacle, BaseDebond, BaseCompliance, PadSlip, ExternalForce, Breathing,
    # From the motor to the pad: the force on the pad acts last.
    ActuatorLag, ActuatorGain, Backlash, LostSteps, ActuatorCompliance,
    # From the thing seen to what is read of it: place, scale, zero, stamp.
    MarkerSlip, OpticalScale, EmDistortion, EmOffset, AxisCrosstalk, ForceGain, ForceDrift,
    ClockOffset,
)


def by_name(name):
    """Return the term class called `name`. Raises ConfigError with the nearest known name."""
    known = {term.spec.name: term for term in TERMS}
    if name in known:
        return known[name]
    near = difflib.get_close_matches(str(name), known, n=1)
    hint = f'did you mean {near[0]!r}?' if near else 'known: ' + ', '.join(known)
    raise ConfigError(f'unknown term {name!r}; {hint}')


def parse_terms(entries, where):
    """Build the terms a scenario lists.

    entries : sequence of mappings {name: ..., <parameter>_<unit>: value}, values in edge units;
        a mapping read from YAML keeps its line numbers for messages
    where : file name and key for messages
    Returns a tuple of term instances in the order of TERMS (the order of application), equal
    names in the order given. Raises ConfigError naming the entry, key, value and what is allowed.
    """
    terms = [_parse(entry, f'{where}[{i}]') for i, entry in enumerate(entries)]
    return tuple(sorted(terms, key=lambda term: TERMS.index(type(term))))


def _parse(entry, where):
    if not isinstance(entry, dict) or 'name' not in entry:
        raise ConfigError(f'{where}: got {entry!r}; must be a mapping with a name and the '
                          'parameters of a term')
    try:
        term = by_name(entry['name'])
    except ConfigError as error:
        raise ConfigError(f'{where}: {error}') from None
    parameters = copy.copy(entry)
    del parameters['name']
    place = f'{where} {term.spec.name}'
    try:
        return config.from_mapping(term, parameters, place)
    except ConfigError as error:  # a term that checks its parameters together knows no place
        text = str(error)
        raise ConfigError(text if text.startswith(place) else f'{place}: {text}') from None


def to_entries(terms):
    """Return the plain mappings that `parse_terms` turns back into `terms`."""
    return [{'name': term.spec.name, **config.to_mapping(term)} for term in terms]


def split(terms):
    """Sort terms by who applies them.

    Returns a dict Stage -> tuple of terms, with every Stage present: Stage.BODY for the tissue
    simulator, SETPOINT, TRANSMISSION and ENCODER for the actuators, EM, OPTICAL and FORCE for the
    sensors. Order within a stage is kept.
    """
    return {stage: tuple(t for t in terms if t.stage is stage) for stage in Stage}


def documentation_table():
    """Return the table of terms as Markdown, generated from the declarations alone."""
    heads = ('term', 'what', 'kind', 'equation', 'parameters', 'source', 'invisible when',
             'left open')
    lines = [f'| {" | ".join(heads)} |', '|---' * len(heads) + '|']
    for kind in Kind:
        lines += [_row(term) for term in TERMS if term.spec.kind is kind]
    return '\n'.join(lines) + '\n'


def _row(term):
    spec = term.spec
    infos = quantities(term)
    parameters = '<br>'.join(_parameter(f.name, infos[f.name]) if f.name in infos else
                             f'`{f.name}` (default {f.default!r})'
                             for f in dataclasses.fields(term))
    cells = (f'`{spec.name}`', spec.summary, spec.kind.value, f'`{spec.equation}`', parameters,
             spec.source, spec.invisible_when or 'none known', spec.leaves_open)
    return '| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |'


def _parameter(name, info):
    unit = UNITS[info.unit][1]
    bounds = f'{_number(info.low)} to {_number(info.high)}'
    prior = '' if info.prior is None else f'; prior {info.prior[0]}{info.prior[1:]}'
    return f'`{info.key(name)}` [{unit}] {info.text}; {bounds}{prior}; {info.source}'


def _number(bound):
    return 'unbounded' if bound is None else f'{bound:g}'
